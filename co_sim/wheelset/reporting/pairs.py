"""Pairs of rails: least errors over the window, what each set of sensors tells, what sensors must be like."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.reporting.information import curve_of, sensors_of
from estimator.identifiability import (
    ErrorProbability,
    Process,
    Rates,
    averaged_same_force,
    divergence_rates,
    error_probability,
    limit,
    wheelset_process,
)
from fmu_wheelset import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from co_sim.wheelset.reporting.setup import Setup
    from estimator import OperatingPoint
    from estimator.identifiability import Sensor

__all__ = [
    "PROPERTIES",
    "Design",
    "Pair",
    "chosen_pairs",
    "designs",
    "errors_over",
    "processes",
    "ranking_of",
]

Array = NDArray[np.float64]

#: Part of the peak adhesion that is used where pairs are looked at.
_UTILISATION = 0.5
_FACTORS = np.geomspace(0.1, 10.0, 9)
_BANDWIDTHS = np.geomspace(0.3, 300.0, 10)
_DIVISORS = (1, 2, 5, 10, 20, 50, 100)
#: What can be chosen of a sensor: name and unit of the axis.
PROPERTIES = {"noise": "times the noise assumed", "bandwidth": "Hz", "sample_rate": "Hz"}


@dataclass(frozen=True, slots=True)
class Pair:
    """Two rails that carry the same force at the same speed.

    Parameters
    ----------
    first, second : names of the conditions. p, q : their operating points. adhesion : used, the same on both.
    """

    first: str
    second: str
    p: OperatingPoint
    q: OperatingPoint
    adhesion: float

    @property
    def name(self) -> str:
        """Both rails and the speed."""
        return f"{self.first} or {self.second} at {self.p.v:g} m/s".replace("_", " ")


@dataclass(frozen=True, eq=False)
class Design:
    """Least error in the window of the setup over a property of all sensors, for each pair.

    Parameters
    ----------
    values : (n,) of the property. error : (pair, n). limit : (pair,) value at which the wanted error is met;
        NaN where none of the range will do.
    """

    values: Array
    error: Array
    limit: Array


def chosen_pairs(setup: Setup, conditions: Sequence[str], speeds: Sequence[float]) -> tuple[Pair, ...]:
    """Return each rail beside the one that is hardest to tell from it, where half its adhesion is used."""
    found: dict[tuple[float, frozenset[str]], Pair] = {}
    for speed in speeds:
        curves = {name: curve_of(name, speed, setup) for name in CONDITIONS}
        adhesions = [_UTILISATION * curves[name].peak_adhesion for name in conditions]
        forces = np.array(adhesions) * setup.wheelset.N
        points = averaged_same_force(forces, curves, setup.spectrum, setup.wheelset)
        for k, (condition, adhesion) in enumerate(zip(conditions, adhesions, strict=True)):
            own = points[condition][k]
            others = {name: ones[k] for name, ones in points.items() if name != condition}
            rivals = [
                Pair(condition, name, own, other, adhesion) for name, other in others.items() if own and other
            ]
            if rivals:
                hardest = min(rivals, key=lambda pair: float(_rates(pair, setup).chernoff))
                found.setdefault((speed, frozenset((hardest.first, hardest.second))), hardest)
    return tuple(found.values())


def processes(
    pair: Pair, setup: Setup, sensors: Sequence[Sensor], *, h: float | None = None, prescribed: bool = False
) -> tuple[Process, Process]:
    """Return what sensors sample on both rails."""
    h = h or 1.0 / setup.sample_rate
    p, q = (
        wheelset_process(
            point, setup.spectrum, wheelset=setup.wheelset, sensors=sensors, h=h, prescribed=prescribed
        )
        for point in (pair.p, pair.q)
    )
    return p, q


def _rates(
    pair: Pair, setup: Setup, sensors: Sequence[Sensor] | None = None, h: float | None = None
) -> Rates:
    seen = sensors_of(setup, setup.main_sensors) if sensors is None else sensors
    return divergence_rates(*processes(pair, setup, seen, h=h))


def errors_over(pairs: Sequence[Pair], setup: Setup, windows: Array) -> ErrorProbability:
    """Return the least errors (pair, window) of the main set of sensors."""
    found = [error_probability(_rates(pair, setup), windows) for pair in pairs]
    return ErrorProbability(
        *(np.array([getattr(one, name) for one in found]) for name in ("lower", "estimate", "upper"))
    )


def ranking_of(pairs: Sequence[Pair], setup: Setup) -> Array:
    """Return the Chernoff rates (set, pair), 1/s, of all sets of sensors."""
    return np.array(
        [
            [float(_rates(p, setup, sensors_of(setup, names)).chernoff) for p in pairs]
            for names in setup.sensors
        ]
    )


def designs(
    pairs: Sequence[Pair], setup: Setup, error: float, progress: Callable[[float], None]
) -> dict[str, Design]:
    """Compute, for each of `PROPERTIES` of the main set of sensors, errors and limits for a wanted error."""
    base, rate = sensors_of(setup, setup.main_sensors), setup.sample_rate

    def noise(pair: Pair, value: float) -> Rates:
        return _rates(pair, setup, [replace(s, noise=s.noise * value) for s in base])

    def bandwidth(pair: Pair, value: float) -> Rates:
        return _rates(pair, setup, [replace(s, bandwidth=value) for s in base])

    def sample_rate(pair: Pair, value: float) -> Rates:
        return _rates(pair, setup, base, 1.0 / value)

    kinds = (
        ("noise", noise, _FACTORS, "less"),
        ("bandwidth", bandwidth, _BANDWIDTHS, "more"),
        ("sample_rate", sample_rate, rate / np.array(_DIVISORS[::-1]), "more"),
    )
    found = {}
    for done, (name, rates, values, better) in enumerate(kinds):
        errors = [
            [float(error_probability(rates(p, x), setup.window).estimate) for x in values] for p in pairs
        ]
        limits = [
            limit(
                lambda x, p=p, rates=rates: rates(p, x),  # type: ignore[misc]
                error=error,
                window=setup.window,
                bounds=(float(values[0]), float(values[-1])),
                better="less" if better == "less" else "more",
            )
            for p in pairs
        ]
        found[name] = Design(values, np.array(errors), np.array(limits))
        progress((done + 1) / len(kinds))
    return found
