"""What the sensors tell at best over creep and speed: bounds for creep and adhesion, windows between rails.

With slopes averaged over the motion that the track causes: on low rail it is as large as the working creep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from estimator import CreepCurve, OperatingPoint
from estimator.identifiability import (
    SENSORS,
    SLOPES,
    Process,
    Sensor,
    averaged_points,
    averaged_same_force,
    cramer_rao,
    creep_amplitude,
    creep_bound,
    divergence_rates,
    fisher_rate,
    peak_adhesion_bound,
    slope_family,
    stack,
    wheelset_process,
    window_needed,
)
from fmu_wheelset import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from co_sim.wheelset.reporting.setup import Setup

__all__ = [
    "ERROR",
    "NONE",
    "SHARES",
    "Limits",
    "NoiseLimits",
    "curve_of",
    "evenly",
    "limits",
    "noise_limits",
    "sensors_of",
]

Array = NDArray[np.float64]

#: Error probability at which two rails count as told apart.
ERROR = 0.05
#: Creeps that are looked at, over that of the peak; past it no steady state exists.
SHARES = (0.03, 0.06, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 0.97)
#: In place of a rival's name, where no other rail carries the force.
NONE = "none"
#: Speeds that are looked at, evenly chosen of the grid's.
_SPEEDS = 6


@dataclass(frozen=True, eq=False)
class Limits:
    """Arrays over rail condition, speed and creep; NaN where the motion has no steady state.

    Parameters
    ----------
    conditions : names. speeds : m/s. shares : mean creeps over that of the peak. T : window of the bounds, s.
    utilisation : mean force over that of the peak.
    amplitude : rms of the creepage that the track adds, over the creep of the peak.
    g11, g22 : least standard deviations of the averaged slopes, over the initial slope of the curve.
    creep : the same, over the creep. adhesion : of the peak adhesion, over itself.
    window : s after which the best decision against the nearest rival errs with `ERROR`; 0 without rival.
    rival : name of the rail that is hardest to tell from the true one, at the same mean force.
    """

    conditions: tuple[str, ...]
    speeds: tuple[float, ...]
    shares: tuple[float, ...]
    T: float
    utilisation: Array
    amplitude: Array
    g11: Array
    g22: Array
    creep: Array
    adhesion: Array
    window: Array
    rival: NDArray[np.str_]

    @property
    def small(self) -> NDArray[np.bool_]:
        """Where the track moves the creep by less than half the way to zero or to the peak."""
        share = np.array(self.shares)
        return np.asarray(self.amplitude < 0.5 * np.minimum(share, np.abs(1.0 - share)))


@dataclass(frozen=True, eq=False)
class NoiseLimits:
    """The windows of `Limits` at one speed, over rail condition, noise of all sensors and creep.

    `factors` are the noise over that of the setup. window : (condition, factor, share), s.
    """

    speed: float
    factors: tuple[float, ...]
    window: Array


def curve_of(condition: str, speed: float, setup: Setup) -> CreepCurve:
    """Return the creep curve of a rail for the wheelset of a setup."""
    return CreepCurve(CONDITIONS[condition], speed, setup.wheelset.N, setup.wheelset.patch)


def sensors_of(setup: Setup, names: Sequence[str], noise: float = 1.0) -> tuple[Sensor, ...]:
    """Return the sensors of a set with their noise in the setup, times a factor."""
    return tuple(
        Sensor(sensor.output, noise * setup.noise[name]) for name in names for sensor in SENSORS[name]
    )


def limits(
    setup: Setup, conditions: Sequence[str], speeds: Sequence[float], progress: Callable[[float], None]
) -> Limits:
    """Compute the limits of the main set of sensors; of many speeds some are chosen evenly."""
    chosen = evenly(speeds)
    names = ("utilisation", "amplitude", "g11", "g22", "creep", "adhesion", "window")
    shape = (len(conditions), len(chosen), len(SHARES))
    arrays = {name: np.full(shape, np.nan) for name in names}
    rival = np.full(shape, NONE, dtype=object)
    for j, speed in enumerate(chosen):
        field = _Field(setup, conditions, speed)
        for i, condition in enumerate(conditions):
            at = field.places[condition]
            if at:
                found, rival[i, j, at] = _at(setup, field, condition)
                for name, values in found.items():
                    arrays[name][i, j, at] = values
            progress((j * len(conditions) + i + 1) / (len(chosen) * len(conditions)))
    return Limits(tuple(conditions), chosen, SHARES, setup.window, **arrays, rival=rival.astype(str))


def evenly(speeds: Sequence[float]) -> tuple[float, ...]:
    """Return at most six of many speeds, the first and the last among them."""
    if len(speeds) <= _SPEEDS:
        return tuple(speeds)
    return tuple(speeds[round(k)] for k in np.linspace(0, len(speeds) - 1, _SPEEDS))


#: Place of a point among those of the true rail, name of another rail, its point with the same mean force.
Rivals: TypeAlias = "list[tuple[int, str, OperatingPoint]]"


class _Field:
    """Averaged points of some rails at one speed where the motion is steady, and rivals among all rails.

    `places` are those of the points in `SHARES`.
    """

    def __init__(self, setup: Setup, conditions: Sequence[str], speed: float) -> None:
        track, wheelset = setup.spectrum, setup.wheelset
        self.curves = {name: curve_of(name, speed, setup) for name in CONDITIONS}
        self.points: dict[str, list[OperatingPoint]] = {}
        self.places: dict[str, list[int]] = {}
        self._rivals: dict[str, dict[str, tuple[OperatingPoint | None, ...]]] = {}
        for name in conditions:
            curve = self.curves[name]
            every = averaged_points(curve, np.array(SHARES) * curve.peak_creep, track, wheelset)
            self.places[name] = [k for k, point in enumerate(every) if math.isfinite(point.force)]
            self.points[name] = [every[k] for k in self.places[name]]
        forces = [point.force for points in self.points.values() for point in points]
        ends = np.cumsum([0, *map(len, self.points.values())])
        for name, found in averaged_same_force(forces, self.curves, track, wheelset).items():
            spans = zip(self.points, ends, ends[1:], strict=False)
            self._rivals[name] = {true: found[start:end] for true, start, end in spans}

    def rivals(self, condition: str) -> Rivals:
        """Return the points of other rails that have the mean forces of a rail's points."""
        return [
            (k, name, point)
            for name, found in self._rivals.items()
            if name != condition
            for k, point in enumerate(found[condition])
            if point is not None
        ]


def _at(setup: Setup, field: _Field, condition: str) -> tuple[dict[str, Array], list[str]]:
    """Return the values (n,) at the points of one rail, and the names of the nearest rivals."""
    wheelset, track = setup.wheelset, setup.spectrum
    curve, points = field.curves[condition], field.points[condition]
    creeps = np.array([point.creep for point in points])

    def slopes(other: CreepCurve, creep: Array) -> Array:
        averaged = averaged_points(other, creep, track, wheelset)
        return np.array([(p.force, p.g11, p.g22) for p in averaged]).T

    family = slope_family(
        points,
        track,
        curve.initial_slope,
        wheelset=wheelset,
        sensors=sensors_of(setup, setup.main_sensors),
        h=1.0 / setup.sample_rate,
    )
    information = setup.window * fisher_rate(family)
    bound = cramer_rao(information, SLOPES, family.scale)
    window, rival = _nearest(setup, family.process, field.rivals(condition))
    amplitude = np.array([creep_amplitude(p, track, wheelset) for p in points])
    values = {
        "utilisation": np.array([point.force for point in points]) / float(curve.force(curve.peak_creep)),
        "amplitude": np.where(np.isfinite(amplitude), amplitude, np.nan) / curve.peak_creep,
        "g11": bound.std[:, 0] / curve.initial_slope,
        "g22": bound.std[:, 1] / curve.initial_slope,
        "creep": creep_bound(curve, creeps, information, slopes=slopes) / creeps,
        "adhesion": peak_adhesion_bound(curve, creeps, information, slopes=slopes) / curve.peak_adhesion,
        "window": window,
    }
    return values, rival


def _nearest(setup: Setup, truth: Process, rivals: Rivals, noise: float = 1.0) -> tuple[Array, list[str]]:
    """Return the windows (point,) against the hardest rivals, and their names; 0 without any.

    `truth` are the processes at the points, seen by the main set of sensors with its noise times `noise`.
    """
    window, names = np.zeros(truth.batch), [NONE] * truth.batch[0]
    if not rivals:
        return window, names
    others = _seen(setup, [q for _, _, q in rivals], noise)
    rates = divergence_rates(truth[np.array([k for k, _, _ in rivals])], others)
    for (k, name, _), needed in zip(rivals, window_needed(rates, ERROR), strict=True):
        if not (np.isnan(window[k]) or needed <= window[k]):
            window[k], names[k] = needed, name
    return window, names


def _seen(setup: Setup, points: Sequence[OperatingPoint], noise: float) -> Process:
    """Return what the main set of sensors samples at points, with its noise times `noise`."""
    sensors, h = sensors_of(setup, setup.main_sensors, noise), 1.0 / setup.sample_rate
    return stack(
        [wheelset_process(p, setup.spectrum, wheelset=setup.wheelset, sensors=sensors, h=h) for p in points]
    )


def noise_limits(
    setup: Setup, conditions: Sequence[str], speed: float, factors: Sequence[float]
) -> NoiseLimits:
    """Compute the windows over the noise of all sensors at one speed."""
    window = np.full((len(conditions), len(factors), len(SHARES)), np.nan)
    field = _Field(setup, conditions, speed)
    for i, condition in enumerate(conditions):
        points, rivals = field.points[condition], field.rivals(condition)
        for j, factor in enumerate(factors if points else ()):
            found, _ = _nearest(setup, _seen(setup, points, factor), rivals, factor)
            window[i, j, field.places[condition]] = found
    return NoiseLimits(speed, tuple(factors), window)
