"""How often the adhesion bank is right, on recordings of the plant FMU, and what a step of it costs.

    python benchmarks/adhesion_bank.py [--seeds 2] [--friction 0.05]

Torque driven with axle torsion, ERRI low, gyro 1 mrad/s and accelerometer 0.05 m/s2 rms at 1 kHz, 12 s each,
utilisation 40, 60, 80 and 95 % of the peak adhesion. `--friction` scales mu_0 of each recording by exp of a
normal deviate with this standard deviation, the one that the bank expects.
"""

from __future__ import annotations

import argparse
import itertools
import time
from dataclasses import dataclass, fields, replace

import numpy as np

from co_sim.master import Master
from co_sim.observers import Recorder
from co_sim.wheelset.assembly import Case, assemble
from co_sim.wheelset.scenario import Rail, Scenario
from co_sim.wheelset.track import synthesise
from estimator import ERRI_B176, CreepCurve
from estimator.adhesion import AdhesionBank, Unknowns
from estimator.adhesion.block import ITSELF, LOOKED
from estimator.log import Log
from fmu_wheelset.parameters import CONDITIONS

SPEEDS = (20.0, 40.0, 60.0)
UTILISATIONS = (0.4, 0.6, 0.8, 0.95)
DURATION = 12.0


@dataclass(frozen=True)
class Trial:
    """A recording and the truth about it."""

    condition: str
    speed: float
    utilisation: float
    peak: float
    log: Log


def record(condition: str, speed: float, utilisation: float, seed: int, friction: float) -> Trial:
    """Drive the FMU over a rail whose friction is scaled at random."""
    rng = np.random.default_rng((seed, list(CONDITIONS).index(condition), int(speed), int(100 * utilisation)))
    rail = CONDITIONS[condition]
    rail = replace(rail, mu_0=rail.mu_0 * float(np.exp(friction * rng.standard_normal())))
    curve = CreepCurve(rail, speed)
    torque = 2.0 * 0.5 * curve.N * utilisation * curve.peak_adhesion
    scenario = Scenario(
        simulation={"duration": DURATION},
        drive={"mode": "torque_driven", "speed": speed, "torque": (torque,)},
        conditions={"trial": {f.name: getattr(rail, f.name) for f in fields(rail)}},
        rail=(Rail(condition="trial"),),
    )
    track = synthesise(ERRI_B176["erri_low"], speed * DURATION, rng)
    creep = curve.creep_at(utilisation * curve.peak_adhesion)
    case = Case("trial", "torque_driven", creep, scenario.rail, track, DURATION, int(rng.integers(2**32)))
    recorder = Recorder()
    with Master(assemble(scenario, case, None), h=1e-3, observers=(recorder,)) as master:
        master.run(DURATION)
    T = recorder.time.size
    log = Log(
        time=recorder.time,
        yaw_rate=recorder["sensors.yaw_rate"],
        lateral_acceleration=recorder["sensors.lateral_acceleration"],
        speed=np.full(T, speed),
        traction_torque=np.full(T, torque),
    )
    return Trial(condition, speed, utilisation, curve.peak_adhesion, log)


def judge(trial: Trial, banks: dict[float, AdhesionBank]) -> list[tuple[float, ...]]:
    """Return share right, median error of the peak, coverage, share more than 10 % too high; by window."""
    results = []
    for window, bank in banks.items():
        said = bank.look_at(trial.log, bank.hypotheses())[1]
        since = int(max(window, 1.0) * 100)
        right = np.argmax(said.p_condition[since:], axis=1) == list(CONDITIONS).index(trial.condition)
        _, peak, lower, upper = said.mu[since:].T / trial.peak
        inside = (lower <= 1.0) & (upper >= 1.0)
        results.append(
            (right.mean(), float(np.median(np.abs(peak - 1.0))), inside.mean(), (peak > 1.1).mean())
        )
    return results


def main() -> None:
    """Print one line for each condition and speed, and the cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--friction", type=float, default=0.05)
    parser.add_argument("--known", action="store_true", help="offsets of the sensors and patch are known")
    options = parser.parse_args()
    unknown = Unknowns.none(friction=Unknowns.friction) if options.known else Unknowns()
    windows, peaks = (1.0, 5.0), []
    banks = {window: AdhesionBank(window=window, unknown=unknown) for window in windows}
    print("condition  m/s   window s   right   worst utilisation")
    for condition, speed in itertools.product(CONDITIONS, SPEEDS):
        trials = [
            record(condition, speed, utilisation, seed, options.friction)
            for utilisation in UTILISATIONS
            for seed in range(options.seeds)
        ]
        found = np.array([judge(trial, banks) for trial in trials])
        loaded = [trial.utilisation >= 0.6 for trial in trials]
        peaks.append(found[loaded])
        for i, window in enumerate(windows):
            by_load = found[:, i, 0].reshape(len(UTILISATIONS), -1).mean(axis=1)
            print(f"{condition:9s} {speed:4.0f} {window:8.0f} {by_load.mean():11.3f} {by_load.min():10.3f}")
    for i, window in enumerate(windows):
        error, inside, high = np.concatenate(peaks)[:, i, 1:].mean(axis=0)
        print(
            f"peak from 60 % utilisation on, {window:g} s: median error {error:.1%}, "
            f"inside the 90 % interval {inside:.1%}, more than 10 % too high {high:.1%}"
        )
    bank = AdhesionBank(unknown=unknown)
    start = time.process_time()
    told, _ = bank.look_at(trials[-1].log, bank.hypotheses(), workers=1)
    cost = 1e6 * (time.process_time() - start) / len(trials[-1].log)
    awake = (told[..., LOOKED] == ITSELF).sum(axis=1).mean()
    print(f"recursive evidence: {cost:.1f} us a sample, {awake:.1f} of {told.shape[1]} filters awake")


if __name__ == "__main__":
    main()
