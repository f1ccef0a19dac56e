"""Runs a scenario: tunes the filter bank on the plant FMU, then watches the plant with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError, RunError
from co_sim.master import Master
from co_sim.observers import Recorder
from co_sim.supervisor import Supervised, start_server
from co_sim.wheelset.assembly import MEASURED, Case, assemble, sampling_period
from co_sim.wheelset.results import Experiment, FilterDesign, Run, assess
from co_sim.wheelset.scenario import PrescribedCreep, Rail
from co_sim.wheelset.track import read_track_csv, synthesise
from estimator import (
    ERRI_B176,
    CreepCurve,
    FilterBank,
    Identifier,
    NoiseModel,
    OperatingPoint,
    filter_model,
    identification_system,
    operating_points,
    tune,
)
from estimator.linear_models import point_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from co_sim.observers import Observer
    from co_sim.wheelset.scenario import Filter, Scenario
    from co_sim.wheelset.track import TrackProfile

__all__ = ["Laboratory"]

#: Start of a training record that does not count, s: the wheelset runs onto the irregular track.
_SETTLING = 0.2
#: Intensity of the unmodelled lateral acceleration where the tuning starts, m2/s3.
_UNMODELLED = 1e-4
# Purposes of random numbers: each has streams of its own, so that one more filter or run changes no other.
_TRACK, _NOISE, _TRAINING_TRACK, _TRAINING_NOISE = range(4)


class Laboratory:
    """A checked scenario, ready to run.

    Everything that can be wrong with a scenario is found here, before the first step.

    Parameters
    ----------
    scenario : what to simulate. name : for results. folder : where a measured track is looked for.
    in_process : run in this process, without protection, instead of supervised: for debugging. The results
        are the same to the bit.

    Raises
    ------
    InputError
        If the track cannot be read or is too short, the sensors do not fit each other or the step, or a
        filter's point is not on its curve.
    """

    def __init__(self, scenario: Scenario, name: str, folder: Path, *, in_process: bool = False) -> None:
        self.scenario = scenario
        self._master: type[Master | Supervised] = Master if in_process else Supervised
        if not in_process:
            # It gets ready while the scenario is checked.
            start_server(assemble.__module__)
        self.name = name
        self._wheelset = scenario.parameters
        self._period = sampling_period(scenario)
        names = [side for rail in scenario.rail for side in rail.sides]
        names += [f.condition for f in scenario.filters]
        self.curves = {
            name: CreepCurve(
                scenario.condition(name), scenario.drive.speed, self._wheelset.N, self._wheelset.patch
            )
            for name in dict.fromkeys(names)
        }
        self.points = tuple(self._point_of(f) for f in scenario.filters)
        self.cases = self._cases(self._track(folder))
        for case in self.cases:
            assemble(scenario, case, None).check()

    @property
    def steps(self) -> int:
        """Steps of all co-simulations, training included: the extent of a progress bar."""
        training = round(self.scenario.identifier.training / self.scenario.simulation.step)
        return len(self.points) * training + len(self.cases) * self.scenario.simulation.steps

    def run(self, observers: Iterable[Observer] = ()) -> Experiment:
        """Tune the bank, make all runs and sum them up.

        A run that stops early is part of the result, with its reason; the runs after it are made. So is one
        that is interrupted (Ctrl-C), which is then the last one.

        Raises
        ------
        RunError
            If a run cannot start, or one that tunes a filter stops early.
        KeyboardInterrupt
            If there is nothing yet to be kept.
        """
        observers = tuple(observers)
        filters = self.design(observers)
        identifier = self.identifier(filters)
        runs: tuple[Run, ...] = ()
        for case in self.cases:
            runs = (*runs, self._observe(case, identifier, observers))
            if runs[-1].interrupted:
                break
        stretches = tuple(s for run in runs for s in assess(run, self.scenario, filters))
        fuzzy = identifier.fuzzy.system
        return Experiment(self.name, self.scenario, filters, fuzzy, self.curves, runs, stretches)

    def design(self, observers: Iterable[Observer] = ()) -> tuple[FilterDesign, ...]:
        """Tune the filters of the bank, each on a run of the plant at its own operating point.

        Raises
        ------
        RunError
            If such a run cannot start or stops early.
        """
        observers = tuple(observers)
        return tuple(
            self._design(i, f, point, observers)
            for i, (f, point) in enumerate(zip(self.scenario.filters, self.points, strict=True))
        )

    def identifier(self, filters: Sequence[FilterDesign]) -> Identifier:
        """Return the identifier of the scenario with these filters."""
        return Identifier(
            FilterBank([f.tuning.filter for f in filters]),
            identification_system(len(filters)),
            window=self._window,
            weights=self._weights,
        )

    @property
    def _sample_time(self) -> float:
        return self._period * self.scenario.simulation.step

    @property
    def _window(self) -> int:
        """Samples in the moving window."""
        return max(round(self.scenario.identifier.window / self._sample_time), 1)

    @property
    def _noise_rms(self) -> tuple[float, ...]:
        return tuple(getattr(self.scenario.sensors, sensor).noise_rms for sensor in MEASURED)

    @property
    def _weights(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Weights of the measurements in the residual: one for the channel chosen, or over the noise."""
        residual = self.scenario.identifier.residual
        if residual == "both":
            return 1.0 / np.square(self._noise_rms)
        return np.array([float(name == residual) for name, _ in MEASURED.values()])

    def _random(self, purpose: int, index: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.scenario.seed, spawn_key=(purpose, index))

    def _noise_seed(self, purpose: int, index: int) -> int:
        return int(self._random(purpose, index).generate_state(1, np.uint64)[0])

    def _named_points(self, curve: CreepCurve) -> dict[str, OperatingPoint]:
        drive = self.scenario.drive
        if isinstance(drive, PrescribedCreep):
            points = operating_points(curve, linear=drive.linear, unstable=drive.unstable)
        else:
            points = operating_points(curve)
        return {point.name: point for point in points}

    def _point_of(self, wanted: Filter) -> OperatingPoint:
        curve = self.curves[wanted.condition]
        try:
            highest = curve.peak_adhesion
        except ValueError:
            raise InputError(
                f"filter {wanted.name}",
                got=f"a creep curve without a maximum at {curve.v:g} m/s",
                expected="one with a maximum",
                remedy="choose a higher speed or another condition",
            ) from None
        if wanted.point is not None:
            return self._named_points(curve)[wanted.point]
        adhesion = wanted.adhesion or 0.0
        if adhesion >= highest:
            raise InputError(
                f"filter {wanted.name}: adhesion",
                got=f"{adhesion:g}",
                expected=f"less than the maximum of {highest:.4g} at {curve.v:g} m/s",
                remedy='lower it, or use point = "P2" or "P3"',
            )
        return point_at(curve, wanted.name, curve.creep_at(adhesion))

    def _track(self, folder: Path) -> TrackProfile:
        """Return the track of the runs; all runs of a scenario pass over the same one."""
        scenario = self.scenario
        length = scenario.drive.speed * scenario.simulation.duration
        if scenario.track.file is None:
            rng = np.random.default_rng(self._random(_TRACK, 0))
            return synthesise(ERRI_B176[scenario.track.spectrum], length, rng)
        track = read_track_csv(folder / scenario.track.file)
        track.require(length)
        return track

    def _cases(self, track: TrackProfile) -> tuple[Case, ...]:
        drive, rail, duration = self.scenario.drive, self.scenario.rail, self.scenario.simulation.duration
        creeps: dict[str, float] = {drive.mode: 0.0}
        if isinstance(drive, PrescribedCreep):
            points = self._named_points(self.curves[rail[0].sides[0]])
            creeps = {name: points[name].creep for name in drive.points}
        return tuple(
            Case(name, drive.mode, creep, rail, track, duration, self._noise_seed(_NOISE, i))
            for i, (name, creep) in enumerate(creeps.items())
        )

    def _design(
        self, index: int, wanted: Filter, point: OperatingPoint, observers: tuple[Observer, ...]
    ) -> FilterDesign:
        """Tune a filter on a record of the plant at the filter's own operating point."""
        scenario = self.scenario
        spectrum = ERRI_B176[scenario.track.spectrum]
        h = scenario.simulation.step
        duration = round(scenario.identifier.training / h) * h
        rng = np.random.default_rng(self._random(_TRAINING_TRACK, index))
        case = Case(
            name=f"training {wanted.name}",
            mode="prescribed_creep",
            creep=point.creep,
            rail=(Rail(condition=wanted.condition),),
            track=synthesise(spectrum, scenario.drive.speed * duration, rng),
            duration=duration,
            seed=self._noise_seed(_TRAINING_NOISE, index),
        )
        recorder = Recorder()
        self._simulate(case, None, (recorder, *observers))
        usable = recorder.time <= self._valid_until(recorder)
        samples = np.column_stack([recorder[f"sensors.{name}"] for name, _ in MEASURED.values()])
        z = samples[usable][:: self._period]
        prior = NoiseModel(
            spectrum.rate_intensity(scenario.drive.speed), _UNMODELLED, self._wheelset.L_g, self._noise_rms
        )
        tuning = tune(
            filter_model(point, self._wheelset),
            prior,
            z,
            self._sample_time,
            name=wanted.name,
            skip=round(_SETTLING / self._sample_time),
        )
        return FilterDesign(wanted.name, wanted.condition, point, tuning, len(z) * self._sample_time)

    def _observe(self, case: Case, identifier: Identifier, observers: tuple[Observer, ...]) -> Run:
        recorder, stopped, interrupted = Recorder(), None, False
        try:
            self._simulate(case, identifier, (recorder, *observers))
        except RunError as error:
            if len(recorder.time) == 0:
                raise
            stopped = str(error)
        except KeyboardInterrupt:
            if len(recorder.time) == 0:
                raise
            stopped, interrupted = f"interrupted at t = {recorder.time[-1]:g} s", True
        names = identifier.bank.names
        drive = self.scenario.drive
        point = None
        if isinstance(drive, PrescribedCreep):
            point = self._named_points(self.curves[case.rail[0].sides[0]])[case.name]
        return Run(
            name=case.name,
            point=point,
            time=recorder.time,
            signals={name: recorder[name] for name in recorder.names},
            units=dict(zip(recorder.names, recorder.units, strict=True)),
            E=np.column_stack([recorder[f"identifier.E.{name}"] for name in names]),
            probabilities=np.column_stack([recorder[f"identifier.p.{name}"] for name in names]),
            valid_until=self._valid_until(recorder),
            stopped=stopped,
            interrupted=interrupted,
        )

    def _simulate(self, case: Case, identifier: Identifier | None, observers: Iterable[Observer]) -> None:
        """Co-simulate a case under the eyes of `observers`."""
        system = assemble(self.scenario, case, identifier)
        h, until = self.scenario.simulation.step, case.duration
        with self._master(system, h=h, observers=tuple(observers), stop_time=until) as master:
            master.run(case.duration)

    def _valid_until(self, recorder: Recorder) -> float:
        """Return the time at which the wheelset leaves the range of a model without flanges, s."""
        beyond = np.abs(recorder["plant.relative_displacement"]) > self.scenario.identifier.valid_offset
        return float(recorder.time[np.argmax(beyond)] if beyond.any() else recorder.time[-1])
