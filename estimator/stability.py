"""At which speeds a wheelset is stable when its creep curve changes with the speed, as it does.

`estimator.linear_models.critical_speed` takes the slopes as fixed. Here they are those of the curve at each
speed: friction falls with the slip speed, so the curve is lower and peaks earlier the faster the train.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from estimator.contact import CreepCurve
from estimator.linear_models import point_at, state_matrix

if TYPE_CHECKING:
    from collections.abc import Callable

    from fmu_wheelset.parameters import RailCondition, WheelsetParameters

__all__ = ["StableSpeeds", "growth_rate", "stable_speeds"]

#: Growth within this part of the fastest mode's rate is rounding: such a wheelset neither gains nor loses.
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class StableSpeeds:
    """The ranges of speed in which small motions decay.

    Parameters
    ----------
    ranges : (from, to) in m/s, rising. searched : the whole range looked at, m/s.
    """

    ranges: tuple[tuple[float, float], ...]
    searched: tuple[float, float]

    @property
    def critical(self) -> float:
        """Speed (m/s) at which stability is first lost: 0 if unstable from the lowest speed, inf if never."""
        lowest, highest = self.searched
        if not self.ranges or self.ranges[0][0] > lowest:
            return 0.0
        return self.ranges[0][1] if self.ranges[0][1] < highest else math.inf


def stable_speeds(
    condition: RailCondition,
    creep: float | Callable[[CreepCurve], float],
    wheelset: WheelsetParameters,
    *,
    speeds: tuple[float, float] = (1.0, 120.0),
    resolution: float = 1.0,
) -> StableSpeeds:
    """Return where the greatest real part of the eigenvalues of (12) is below zero.

    Parameters
    ----------
    condition : of both rails.
    creep : longitudinal creepage, or what to take from the curve at each speed:
        ``lambda curve: 0.1 * curve.peak_creep`` follows P1.
    wheelset : parameters. speeds : range, m/s. resolution : step of the search for changes of sign, m/s;
        changes are then found to rounding, and two within one step are missed.

    Raises
    ------
    ValueError
        If the range or the resolution is not positive, or a curve has no maximum where it is asked for.
    """
    lowest, highest = speeds
    if not (0.0 < lowest < highest < math.inf and resolution > 0.0):
        raise ValueError(
            f"stable speeds: got {lowest:g} to {highest:g} m/s in steps of {resolution:g} m/s, expected "
            f"0 < from < to and a step > 0; give the range in m/s"
        )

    def growth(v: float) -> float:
        return growth_rate(condition, creep, wheelset, v)

    grid = np.linspace(lowest, highest, max(2, math.ceil((highest - lowest) / resolution) + 1))
    rates = [growth(float(v)) for v in grid]
    edges = [lowest]
    for (v0, r0), (v1, r1) in pairwise(zip(grid.tolist(), rates, strict=True)):
        if (r0 < 0.0) != (r1 < 0.0):
            edges.append(float(brentq(growth, v0, v1, xtol=1e-12, rtol=1e-12)) if r0 * r1 < 0.0 else v1)
    edges.append(highest)
    first = 0 if rates[0] < 0.0 else 1
    stable = list(pairwise(edges))[first::2]
    return StableSpeeds(tuple(stable), (lowest, highest))


def growth_rate(
    condition: RailCondition,
    creep: float | Callable[[CreepCurve], float],
    wheelset: WheelsetParameters,
    v: float,
) -> float:
    """Return the greatest real part (1/s) of the eigenvalues of (12) at the speed `v` (m/s).

    Zero where rounding alone decides its sign, as at the maximum of the curve.
    """
    curve = CreepCurve(condition, v, wheelset.N, wheelset.patch)
    point = point_at(curve, "", creep(curve) if callable(creep) else creep)
    poles = np.linalg.eigvals(state_matrix(point, wheelset))
    rate = float(np.max(poles.real))
    return 0.0 if abs(rate) <= _ROUNDING * float(np.max(np.abs(poles))) else rate
