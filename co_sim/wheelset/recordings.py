"""Recordings of journeys: what the sensors of a wheelset write down, and what was true meanwhile.

The plant is the FMU. Nothing here knows filters: identification, studies and reports read the recordings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from co_sim.component import Port
from co_sim.errors import InputError, RunError
from co_sim.master import Master
from co_sim.observers import Recorder
from co_sim.signals import TimeTable
from co_sim.system import System
from co_sim.wheelset.assembly import MEASURED, plant_fmu, rail_table, wires_of_plant
from co_sim.wheelset.sensors import Channel, Sensors, SensorSpec
from co_sim.wheelset.track import TrackInput, TrackProfile, synthesise
from estimator import ERRI_B176, TrackSpectrum
from fmu_wheelset import CONDITIONS, RailCondition, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

__all__ = ["Journey", "Profile", "Recording", "Stretch", "record"]

_GYRO = SensorSpec(noise_rms=1e-3)
_ACCELEROMETER = SensorSpec(noise_rms=0.05)


@dataclass(frozen=True, slots=True)
class Profile:
    """A quantity over time, linear between corners and constant before and after them.

    Parameters
    ----------
    times : of the corners, s, rising. values : at the corners.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in zip(self.times, self.times[1:], strict=False))
        finite = all(map(math.isfinite, (*self.times, *self.values)))
        if not self.times or len(self.times) != len(self.values) or not (rising and finite):
            raise InputError(
                "profile over time",
                got=f"{len(self.times)} times and {len(self.values)} values",
                expected="one finite value for each time, and rising times",
                remedy="pair them up",
            )

    @classmethod
    def of(cls, value: float | Profile) -> Profile:
        """Return a profile as it is, and a number as one that never changes."""
        return value if isinstance(value, Profile) else cls((0.0,), (float(value),))

    def at(self, time: ArrayLike) -> Array:
        """Return the values at `time` (s, any shape)."""
        return np.interp(np.asarray(time, dtype=np.float64), self.times, self.values)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Rail from a time on.

    Parameters
    ----------
    since : time at which the wheelset reaches it, s.
    left : condition under the left wheel. right : under the right wheel; ``None``: the same.
    """

    since: float
    left: RailCondition
    right: RailCondition | None = None


@dataclass(frozen=True, kw_only=True)
class Journey:
    """What the wheelset does and what its sensors are like.

    Parameters
    ----------
    duration : s. step : communication step and sampling time, s.
    speed : forward speed, m/s.
    torque : total traction torque on the axle, N m, negative to brake: torque driven.
    creep : instead, a longitudinal creepage imposed on both wheels.
    initial_creep : longitudinal creepage at the start, torque driven.
    rails : stretches of rail, the first since 0 s.
    track : spectrum from which the lateral alignment is drawn, or the alignment itself.
    wheelset : parameters of the plant. gyro, accelerometer : faults of the sensors.
    seed : from which track and noise follow, each with a stream of its own.

    Raises
    ------
    InputError
        If not exactly one of `torque` and `creep` is given.
    """

    duration: float
    step: float = 1e-3
    speed: float | Profile = 20.0
    torque: float | Profile | None = None
    creep: float | None = None
    initial_creep: float = 0.0
    rails: tuple[Stretch, ...] = (Stretch(0.0, CONDITIONS["dry"]),)
    track: TrackSpectrum | TrackProfile = field(default_factory=lambda: ERRI_B176["erri_low"])
    wheelset: WheelsetParameters = field(default_factory=WheelsetParameters)
    gyro: SensorSpec = _GYRO
    accelerometer: SensorSpec = _ACCELEROMETER
    seed: int = 1

    def __post_init__(self) -> None:
        if (self.torque is None) == (self.creep is None):
            raise InputError(
                "drive of a journey",
                got="both or neither of torque and creep",
                expected="exactly one of them",
                remedy="keep the one you mean",
            )

    @property
    def length(self) -> float:
        """Greatest distance travelled, m: over a step the plant goes on at the speed of its start."""
        speed = Profile.of(self.speed)
        inside = [t for t in speed.times if 0.0 < t < self.duration]
        corners = np.array([0.0, *inside, self.duration])
        at_corners = speed.at(corners)
        lost = -np.minimum(np.diff(at_corners), 0.0).sum()
        return float(np.trapezoid(at_corners, corners) + self.step * lost)


@dataclass(frozen=True, eq=False)
class Recording:
    """What the sensors said over T samples, and what was true.

    Parameters
    ----------
    journey : what was recorded.
    time : (T,) s, uniform.
    yaw_rate, lateral_acceleration : (T,) measured, rad/s and m/s2.
    speed, traction_torque : (T,) m/s and N m (total, on the axle).
    truth : (T,) outputs of the plant by name, such as ``"relative_displacement"`` (m), ``"adhesion_used"``,
        ``"left.adhesion_peak"``, ``"left.creepage_x"``; see `docs/fmu.md`.
    stopped : why the journey ended early, or ``None``.
    """

    journey: Journey
    time: Array
    yaw_rate: Array
    lateral_acceleration: Array
    speed: Array
    traction_torque: Array
    truth: Mapping[str, Array]
    stopped: str | None = None

    @property
    def creep(self) -> Array:
        """Mean longitudinal creepage (T,) of both wheels."""
        return (self.truth["left.creepage_x"] + self.truth["right.creepage_x"]) / 2.0

    @property
    def peak_adhesion(self) -> Array:
        """Highest adhesion (T,) that both wheels together could use at this speed."""
        return (self.truth["left.adhesion_peak"] + self.truth["right.adhesion_peak"]) / 2.0

    def within(self, offset: float) -> NDArray[np.bool_]:
        """Return where (T,) the wheelset has never yet been further than `offset` (m) from the track."""
        beyond = np.abs(self.truth["relative_displacement"]) > offset
        return ~np.logical_or.accumulate(beyond)


def record(journey: Journey) -> Recording:
    """Run the wheelset FMU through a journey.

    A run that stops early is kept up to there, with the reason.

    Raises
    ------
    InputError
        If the step does not divide the duration, or the track is too short.
    RunError
        If the run cannot start.
    """
    recorder, stopped = Recorder(["plant.*", "sensors.*"]), None
    try:
        with Master(_system(journey), h=journey.step, observers=(recorder,)) as master:
            master.run(journey.duration)
    except RunError as error:
        if len(recorder.time) == 0:
            raise
        stopped = str(error)
    time = recorder.time
    truth = {
        name.removeprefix("plant."): recorder[name] for name in recorder.names if name.startswith("plant.")
    }
    return Recording(
        journey,
        time,
        yaw_rate=recorder["sensors.yaw_rate"],
        lateral_acceleration=recorder["sensors.lateral_acceleration"],
        speed=truth["forward_speed"],
        traction_torque=Profile.of(journey.torque or 0.0).at(time),
        truth=truth,
        stopped=stopped,
    )


def _system(journey: Journey) -> System:
    seeds = np.random.SeedSequence(journey.seed).spawn(2)
    track = journey.track
    if isinstance(track, TrackSpectrum):
        track = synthesise(track, journey.length, np.random.default_rng(seeds[0]))
    track.require(journey.length)
    mode = "prescribed_creep" if journey.torque is None else "torque_driven"
    rails = [(stretch.left, stretch.right or stretch.left) for stretch in journey.rails]
    components = {
        "drive": _drive(journey),
        "rail": rail_table([stretch.since for stretch in journey.rails], rails, journey.wheelset.N),
        "track": TrackInput(track),
        "plant": plant_fmu(journey.wheelset, mode, journey.initial_creep),
        "sensors": _sensors(journey, int(seeds[1].generate_state(1)[0])),
    }
    return System(components, list(wires_of_plant(components["rail"])))


def _drive(journey: Journey) -> TimeTable:
    speed, torque = Profile.of(journey.speed), Profile.of(journey.torque or 0.0)
    times = sorted({*speed.times, *torque.times})
    values = np.column_stack([speed.at(times), np.full(len(times), journey.creep or 0.0), torque.at(times)])
    ports = [Port("speed", "m/s"), Port("prescribed_creepage"), Port("traction_torque", "N.m")]
    return TimeTable(times, values, ports, interpolation="linear")


def _sensors(journey: Journey, seed: int) -> Sensors:
    channels = [Channel(name, unit, getattr(journey, sensor)) for sensor, (name, unit) in MEASURED.items()]
    return Sensors(channels, seed=seed)
