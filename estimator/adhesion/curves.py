"""Peak and knee of the creep curve of a condition over speed and friction, as a table.

The linear region ends at the knee, where the tangent of the curve has fallen to 15 % of its initial value;
the unstable region begins past the peak.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.contact import KNEE_SLOPE, CreepCurve

if TYPE_CHECKING:
    from fmu_wheelset.parameters import RailCondition, WheelsetParameters

__all__ = ["REGIONS", "Curves", "curves_of", "landmarks"]

Array = NDArray[np.float64]

#: Regions of the creep curve in the order of all results.
REGIONS = ("linear", "peak", "unstable")
#: Creep from which on a rail counts as past its peak, over the creep of the peak.
PAST_PEAK = 1.05

_SPEEDS = np.geomspace(0.5, 130.0, 48)
_FRICTION = np.linspace(-1.2, 1.2, 9)
_CREEPS = np.geomspace(1e-6, 1.0, 1200)


class Curves(NamedTuple):
    """Logarithms of peak adhesion, creep of the peak and creep of the knee, (n, speeds, frictions, 3).

    `v` and `s` hold the first value and the step of ln(speed) and of the logarithm of the friction.
    """

    values: Array
    v: Array
    s: Array


def curves_of(conditions: list[RailCondition], wheelset: WheelsetParameters) -> Curves:
    """Return the table of these conditions."""
    values = np.array(
        [
            [[_landmarks_at(_scaled(c, s, v, wheelset)) for s in _FRICTION] for v in _SPEEDS]
            for c in conditions
        ]
    )
    log_v = np.log(_SPEEDS)
    return Curves(
        np.log(values),
        np.array([log_v[0], log_v[1] - log_v[0]]),
        np.array([_FRICTION[0], _FRICTION[1] - _FRICTION[0]]),
    )


def _scaled(condition: RailCondition, s: float, v: float, wheelset: WheelsetParameters) -> CreepCurve:
    scaled = replace(condition, mu_0=condition.mu_0 * math.exp(s))
    return CreepCurve(scaled, float(v), wheelset.N, wheelset.patch)


def _landmarks_at(curve: CreepCurve) -> tuple[float, float, float]:
    """Return peak adhesion, creep of the peak and creep of the knee; the peak by a parabola."""
    force = curve.force(_CREEPS)
    i = int(np.clip(np.argmax(force), 1, _CREEPS.size - 2))
    below, at, above = force[i - 1 : i + 2]
    bend = 2.0 * at - below - above
    shift = float(np.clip(0.5 * (above - below) / bend, -1.0, 1.0)) if bend > 0.0 else 0.0
    peak = at + 0.25 * (above - below) * shift
    creep = _CREEPS[i] * (_CREEPS[1] / _CREEPS[0]) ** shift
    steep = curve.tangent(_CREEPS) >= KNEE_SLOPE * curve.initial_slope
    knee = _CREEPS[min(int(np.argmin(steep)), i)]
    return peak / curve.N, float(creep), float(knee)


@njit(cache=True, nogil=True, error_model="numpy")
def landmarks(  # pragma: no cover - compiled
    curves: Curves, i: int, v: float, s: float
) -> tuple[float, float, float]:
    """Return the logarithms of peak adhesion and of the creeps of peak and knee of condition `i`."""
    n_v, n_s = curves.values.shape[1], curves.values.shape[2]
    at_v = (math.log(v) - curves.v[0]) / curves.v[1] if v > 0.0 else 0.0
    at_s = (s - curves.s[0]) / curves.s[1]
    at_v, at_s = min(max(at_v, 0.0), n_v - 1.0), min(max(at_s, 0.0), n_s - 1.0)
    j, k = min(int(at_v), n_v - 2), min(int(at_s), n_s - 2)
    a, b = at_v - j, at_s - k
    T = curves.values[i]
    w00, w01, w10, w11 = (1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b
    return (
        w00 * T[j, k, 0] + w01 * T[j, k + 1, 0] + w10 * T[j + 1, k, 0] + w11 * T[j + 1, k + 1, 0],
        w00 * T[j, k, 1] + w01 * T[j, k + 1, 1] + w10 * T[j + 1, k, 1] + w11 * T[j + 1, k + 1, 1],
        w00 * T[j, k, 2] + w01 * T[j, k + 1, 2] + w10 * T[j + 1, k, 2] + w11 * T[j + 1, k + 1, 2],
    )
