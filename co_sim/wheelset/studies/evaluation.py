"""What a worker does with a case: record the journey, let every bank look at it, score what they say."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.wheelset.identifying.adhesion import answer_of
from co_sim.wheelset.identifying.answer import Answer
from co_sim.wheelset.identifying.paper import PaperBank
from co_sim.wheelset.recordings import record
from co_sim.wheelset.studies.scoring import score
from co_sim.wheelset.studies.trial import NOISE, POINTS
from co_sim.wheelset.vehicle_file import Vehicle
from estimator import ERRI_B176
from estimator.log import Log

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.campaign import Case
    from co_sim.wheelset.recordings import Recording
    from co_sim.wheelset.results import FilterDesign
    from co_sim.wheelset.studies.study import Study
    from co_sim.wheelset.studies.trial import Trial
    from estimator import RegionBank, SensorNoise

__all__ = ["evaluate", "function_of"]

#: Seconds between two rows of an answer.
_EVERY = 0.01
#: Probability from which on a bank that does not say whether it can be trusted is trusted.
_SURE = 0.9
#: What a vehicle whose parameters are known to 10 % leaves open of the peak adhesion, see `Unknowns`.
_VEHICLE = 0.025
#: Normalised innovations squared of the best linear filter above which something happens that none of them
#: knows, such as an impact of a flange.
_FITS = 2.0


def function_of(study: Study) -> Callable[[Case], dict[str, Any]]:
    """Return the function that the workers call for each case of a study."""
    return partial(evaluate, banks=study.banks, window=study.window)


def evaluate(case: Case, banks: tuple[str, ...], window: float) -> dict[str, Any]:
    """Return the record of a case, see `score`; what it holds depends on the case alone."""
    from co_sim.wheelset.studies.trial import Trial

    trial = Trial.model_validate(case.values)
    recording = record(trial.journey(case.seed))
    if recording.stopped is not None:
        raise RuntimeError(f"the journey stopped early: {recording.stopped}")
    answers = {bank: _LOOK[bank](recording, trial, window) for bank in banks}
    return score(recording, trial, answers, window)


def _log(
    recording: Recording,
    speed_error: float = 1.0,
    torque_error: float = 1.0,
    biases: tuple[float, float] = (0.0, 0.0),
) -> Log:
    """Return what the filters are told."""
    return Log(
        time=recording.time,
        yaw_rate=recording.yaw_rate - biases[0],
        lateral_acceleration=recording.lateral_acceleration - biases[1],
        speed=recording.speed * speed_error,
        # With an imposed creep no torque is known.
        traction_torque=None
        if recording.journey.torque is None
        else recording.traction_torque * torque_error,
    )


def _noise(trial: Trial) -> tuple[float, float]:
    """Return what the filters assume of the sensors' noise."""
    factor = trial.noise if trial.assumed_noise is None else trial.assumed_noise
    return factor * NOISE[0], factor * NOISE[1]


def _track(trial: Trial) -> str:
    return trial.track if trial.assumed_track == "same" else trial.assumed_track


def _adhesion(recording: Recording, trial: Trial, window: float | None) -> Answer:
    from estimator import SensorNoise
    from estimator.adhesion import AdhesionBank, Unknowns

    log = _log(recording, trial.speed_error, trial.torque_error)
    unknown = {
        "usual": Unknowns(),
        "vehicle": Unknowns(vehicle=_VEHICLE),
        "nothing": Unknowns.none(friction=Unknowns.friction),
    }
    bank = AdhesionBank(
        noise=SensorNoise(*_noise(trial)),
        track=ERRI_B176[_track(trial)],
        h=log.h,
        window=window,
        unknown=unknown[trial.unknown],
    )
    return answer_of(bank.run(log, workers=1), log)


def _recursive(recording: Recording, trial: Trial, window: float) -> Answer:
    return _adhesion(recording, trial, None)


def _as_they_are(recording: Recording, trial: Trial) -> tuple[Log, SensorNoise]:
    """Return log and noise for one who knows the sensors: a bias that is known is subtracted."""
    from estimator import SensorNoise

    log = _log(recording, biases=(trial.gyro_bias, trial.accelerometer_bias))
    return log, SensorNoise(trial.noise * NOISE[0], trial.noise * NOISE[1])


def _matched(recording: Recording, trial: Trial, window: float) -> Answer:
    """Return what can be said by one who knows the plant as it is."""
    from estimator.adhesion import AdhesionBank, Unknowns

    log, noise = _as_they_are(recording, trial)
    bank = AdhesionBank(
        wheelset=trial.wheelset,
        noise=noise,
        track=ERRI_B176[trial.track],
        h=log.h,
        # After a drop a window would hold the old rail as well.
        window=None if trial.manoeuvre == "drop" else window,
        unknown=Unknowns.none(),
        conditions=trial.conditions,
    )
    return answer_of(bank.run(log, workers=1), log)


def _known(recording: Recording, trial: Trial, window: float) -> Answer:
    """Return the region on the curve of a rail that is known, by linear filters at creepages along it."""
    from estimator import CreepCurve, RegionBank, SensorNoise
    from fmu_wheelset import CONDITIONS, WheelsetParameters

    log = _log(recording, trial.speed_error)
    curve = CreepCurve(CONDITIONS[trial.condition], trial.speed)
    noise, track = SensorNoise(*_noise(trial)), ERRI_B176[_track(trial)]
    bank = RegionBank(curve, WheelsetParameters(), noise, track, log.h, window=window)
    return _of_regions("known", bank, log)


def _exact(recording: Recording, trial: Trial, window: float) -> Answer:
    """Return the region as one can tell it who knows the plant, and that the creep is one of four."""
    from estimator import RegionBank

    log, noise = _as_they_are(recording, trial)
    bank = RegionBank(
        trial.curve,
        trial.wheelset,
        noise,
        ERRI_B176[trial.track],
        log.h,
        window=window,
        hypotheses=[POINTS[name] for name in ("P1", "knee", "P2", "beyond")],
    )
    return _of_regions("exact", bank, log)


def _of_regions(name: str, bank: RegionBank, log: Log) -> Answer:
    """Return what a bank of linear filters says; trusted where it is sure and its model fits."""
    said = bank.run(log)
    return Answer(
        bank=name,
        time=said.time,
        samples=np.rint((said.time - log.time[0]) / log.h).astype(np.int64),
        p_region=said.p_region,
        identifiable=(said.p_region.max(axis=1) >= _SURE) & (said.nis < _FITS),
    )


def _paper(recording: Recording, trial: Trial, window: float) -> Answer:
    # Designed at the true speed of the case: tuning takes seconds, and is kept for all cases of a speed.
    log = _log(recording)
    bank = PaperBank(log, Vehicle(), _noise(trial), _track(trial))
    return bank.run(_paper_filters(bank.speed, _noise(trial), _track(trial), log.h), _EVERY)


@cache
def _paper_filters(
    speed: float, noise: tuple[float, float], track: str, h: float
) -> tuple[FilterDesign, ...]:
    still = np.zeros(3)
    log = Log(
        time=np.array([0.0, h, 2.0 * h]), yaw_rate=still, lateral_acceleration=still, speed=np.full(3, speed)
    )
    return PaperBank(log, Vehicle(), noise, track).design()


_LOOK: dict[str, Callable[[Recording, Trial, float], Answer]] = {
    "adhesion": _recursive,
    "window": _adhesion,
    "paper": _paper,
    "matched": _matched,
    "known": _known,
    "exact": _exact,
}
