"""What is said of a block: conditions, regions, peak adhesion and its interval, and whether to trust it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import CREEP, FRICTION, VAR_CREEP, VAR_FRICTION
from estimator.adhesion.curves import PAST_PEAK, landmarks
from estimator.adhesion.ekf import ON_WHEELS

if TYPE_CHECKING:
    from estimator.adhesion.evidence import Rules

__all__ = ["Judgement", "describe", "new_judgement"]

Array = NDArray[np.float64]

#: Probability over the greatest below which a hypothesis says nothing of regions and peaks.
_FAINT = 1e-5
#: Least probability of the region for which the result is trusted where the torque is not known.
_PLACED = 0.9
#: Of the interval in which a quantile is sought: to 1e-4 of the peak adhesion.
_HALVINGS = 14


class Judgement(NamedTuple):
    """What is said of blocks, (rows, ...); see `AdhesionIdentification`."""

    p_region: Array
    p_condition: Array
    p_hypothesis: Array
    p_none: Array
    mu: Array
    identifiable: NDArray[np.bool_]


def new_judgement(rows: int, n: int, conditions: int) -> Judgement:
    """Return room for what is said in that many rows."""
    return Judgement(
        np.zeros((rows, 3)),
        np.zeros((rows, conditions)),
        np.zeros((rows, n)),
        np.zeros(rows),
        np.zeros((rows, 4)),
        np.zeros(rows, dtype=np.bool_),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _normal(x: float) -> float:  # pragma: no cover - compiled
    """Return the probability that a standard normal deviate is less than x, to 1e-9."""
    if abs(x) > 6.0:
        return 1.0 if x > 0.0 else 0.0
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _peaks(rules: Rules, told: Array, v: float, p: Array, peaks: Array) -> None:  # pragma: no cover
    """Write mean and deviation of the logarithm of each filter's peak adhesion, (n, 2).

    A hypothesis that is too faint to count gets the deviation 0.
    """
    faint = _FAINT * p.max()
    for i in range(told.shape[0]):
        peaks[i, 1] = 0.0
        if p[i] < faint:
            continue
        s, step = told[i, FRICTION], 0.1
        mean, slope = 0.0, 0.0
        for side in range(2):
            at = landmarks(rules.curves, rules.curve[i, side], v, s)[0]
            mean += 0.5 * math.exp(at)
            slope += 0.5 * (landmarks(rules.curves, rules.curve[i, side], v, s + step)[0] - at) / step
        peaks[i, 0] = math.log(mean)
        peaks[i, 1] = math.sqrt(slope * slope * max(told[i, VAR_FRICTION], 0.0) + rules.spread**2)


@njit(cache=True, nogil=True, error_model="numpy")
def _quantile(p: Array, peaks: Array, level: float) -> float:  # pragma: no cover - compiled
    """Return a quantile of the mixture of log-normal peaks with the weights p (n,), by bisection."""
    n = peaks.shape[0]
    lower, upper, known = math.inf, -math.inf, 0.0
    for i in range(n):
        if peaks[i, 1] > 0.0:
            lower = min(lower, peaks[i, 0] - 6.0 * peaks[i, 1])
            upper = max(upper, peaks[i, 0] + 6.0 * peaks[i, 1])
            known += p[i]
    for _ in range(_HALVINGS):
        middle, below = 0.5 * (lower + upper), 0.0
        for i in range(n):
            if peaks[i, 1] > 0.0:
                below += p[i] * _normal((middle - peaks[i, 0]) / peaks[i, 1])
        if below < level * known:
            lower = middle
        else:
            upper = middle
    return math.exp(0.5 * (lower + upper))


@njit(cache=True, nogil=True, error_model="numpy")
def _regions(rules: Rules, told: Array, v: float, p: Array, out: Array) -> None:  # pragma: no cover
    """Write the probabilities of the regions (3,), from the creep that each filter believes in."""
    out[:] = 0.0
    total, faint = 0.0, _FAINT * p.max()
    for i in range(told.shape[0]):
        if p[i] < faint:
            continue
        peak, knee = math.inf, math.inf
        for side in range(2):
            _, at_peak, at_knee = landmarks(rules.curves, rules.curve[i, side], v, told[i, FRICTION])
            peak, knee = min(peak, at_peak), min(knee, at_knee)
        sd = math.sqrt(max(told[i, VAR_CREEP], 1e-16))
        below_knee = _normal((math.exp(knee) - told[i, CREEP]) / sd)
        below_peak = _normal((PAST_PEAK * math.exp(peak) - told[i, CREEP]) / sd)
        out[0] += p[i] * below_knee
        out[1] += p[i] * max(below_peak - below_knee, 0.0)
        out[2] += p[i] * (1.0 - below_peak)
        total += p[i]
    for j in range(3):
        out[j] /= total


@njit(cache=True, nogil=True, error_model="numpy")
def describe(  # pragma: no cover - compiled
    rules: Rules, told: Array, v: float, peaks: Array, said: Judgement, row: int
) -> None:
    """Write the rest of row `row`, whose probabilities are there: told (n, 14) of a block at the speed v.

    Nothing that comes later depends on it. peaks (n, 2) is work space.
    """
    p, used = said.p_hypothesis[row], 0.0
    known = max(p.sum(), 1e-300)
    for i in range(told.shape[0]):
        used += p[i] * told[i, ON_WHEELS] / (known * rules.load)
    _regions(rules, told, v, p, said.p_region[row])
    _peaks(rules, told, v, p, peaks)
    mu, least = said.mu[row], abs(used) if rules.torque_known else 0.0
    mu[0] = used
    for j, level in ((1, 0.5), (2, 0.05), (3, 0.95)):
        mu[j] = max(_quantile(p, peaks, level), least)
    # A creep that does not follow from the torque is an estimate like any other.
    placed = rules.torque_known or said.p_region[row].max() >= _PLACED
    narrow = math.log(mu[3] / mu[2]) <= rules.width
    said.identifiable[row] = said.identifiable[row] and placed and narrow
