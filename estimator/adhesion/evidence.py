"""From what the filters tell of a block to probabilities, peak adhesion and whether to trust them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import CREEP, FRICTION, ITSELF, LOOKED, STAND_IN, VAR_CREEP, VAR_FRICTION
from estimator.adhesion.curves import PAST_PEAK, landmarks
from estimator.adhesion.ekf import COUNT, E_ACC, E_YAW, LOG_L, ON_WHEELS, S_ACC, S_YAW, SQUARE

if TYPE_CHECKING:
    from estimator.adhesion.curves import Curves

__all__ = ["Belief", "Judgement", "Rules", "judge"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


#: Probability over the greatest below which a hypothesis says nothing of regions and peaks.
_FAINT = 1e-5
#: Of the interval in which a quantile is sought: to 1e-4 of the peak adhesion.
_HALVINGS = 14


class Rules(NamedTuple):
    """How evidence is weighed; n hypotheses, c conditions, "none of these" comes last.

    `prior` (n + 1,). `change` probability that a block begins with another hypothesis, `turn` (n + 1, n + 1)
    how likely each (column) is then after each (row). `clip` greatest log-likelihood ratio that one block
    may add. `none` variance of the innovations over what the filters expect, if none of them is right.
    `window` blocks of the moving window, 0 for recursive evidence. `condition` and `stand_in` (n,)
    condition of each hypothesis, and who stands in for it. `curve` (n, 2). `load` normal load times
    radius on both wheels, N m. `spread` standard deviation of the peak's logarithm that the model leaves.
    `doubt` greatest bound on the error of the condition, and greatest probability of the others, and
    `width` greatest logarithm of upper over lower bound of the peak adhesion for which the result is
    trusted. `memory` share of a block in the running sum of the information. `renewal` blocks from one
    renewal to the next, 0: none.
    """

    curves: Curves
    prior: Array
    change: float
    turn: Array
    clip: float
    none: float
    window: int
    condition: Indices
    stand_in: Indices
    curve: Indices
    load: float
    spread: float
    doubt: float
    width: float
    memory: float
    renewal: int


class Belief(NamedTuple):
    """What is kept from block to block.

    `p` (n + 1,) probabilities, `history` (window, n + 1) log-likelihoods with their sums (n + 1,),
    `information` (n, n) running divergences in nats, `gained` (n,) log-likelihoods since the last renewal.
    """

    p: Array
    history: Array
    total: Array
    information: Array
    gained: Array


class Judgement(NamedTuple):
    """What is said of blocks, (rows, ...); see `AdhesionIdentification`."""

    p_region: Array
    p_condition: Array
    p_hypothesis: Array
    p_none: Array
    mu: Array
    identifiable: NDArray[np.bool_]


@njit(cache=True, nogil=True, error_model="numpy")
def _normal(x: float) -> float:  # pragma: no cover - compiled
    """Return the probability that a standard normal deviate is less than x, to 1e-9."""
    if abs(x) > 6.0:
        return 1.0 if x > 0.0 else 0.0
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _likelihoods(rules: Rules, belief: Belief, told: Array, log_l: Array) -> None:  # pragma: no cover
    """Write the log-likelihoods of a block, less the greatest, (n + 1,)."""
    n = told.shape[0]
    best = -math.inf
    for i in range(n):
        best = max(best, told[i, LOG_L])
    # None of these: a mixture of the filters with wider innovations.
    known, mixed = 0.0, 0.0
    for i in range(n):
        known += belief.p[i]
    for i in range(n):
        wider = 0.5 * (told[i, SQUARE] * (1.0 - 1.0 / rules.none) - told[i, COUNT] * math.log(rules.none))
        share = belief.p[i] / known if known > 0.0 else 1.0 / n
        mixed += share * math.exp(min(max(told[i, LOG_L] - best + wider, -500.0), 500.0))
    for i in range(n):
        log_l[i] = max(told[i, LOG_L] - best, -rules.clip)
    other = math.log(mixed) if mixed > 0.0 else -rules.clip
    log_l[n] = min(max(other, -rules.clip), rules.clip)


@njit(cache=True, nogil=True, error_model="numpy")
def _slide(rules: Rules, belief: Belief, k: int, log_l: Array) -> None:  # pragma: no cover - compiled
    """Take the log-likelihoods of block k into the sums over the moving window."""
    row = belief.history[k % rules.window]
    for i in range(log_l.shape[0]):
        belief.total[i] += log_l[i] - row[i]
        row[i] = log_l[i]
        if k % rules.window == rules.window - 1:  # rounding does not pile up
            belief.total[i] = 0.0
            for j in range(rules.window):
                belief.total[i] += belief.history[j, i]


@njit(cache=True, nogil=True, error_model="numpy")
def _update(rules: Rules, belief: Belief, k: int, log_l: Array) -> None:  # pragma: no cover - compiled
    """Take the log-likelihoods of block k into the probabilities; log_l (n + 1,) is lost."""
    n = log_l.shape[0]
    if rules.window > 0:
        _slide(rules, belief, k, log_l)
    for i in range(n):
        if rules.window > 0:
            log_l[i] = math.log(rules.prior[i]) + belief.total[i]
        else:
            turned = 0.0
            for j in range(n):
                turned += belief.p[j] * rules.turn[j, i]
            log_l[i] += math.log((1.0 - rules.change) * belief.p[i] + rules.change * turned)
    highest, total = log_l.max(), 0.0
    for i in range(n):
        belief.p[i] = math.exp(log_l[i] - highest)
        total += belief.p[i]
    for i in range(n):
        belief.p[i] /= total


@njit(cache=True, nogil=True, error_model="numpy")
def _divergences(told: Array, i: int, j: int) -> tuple[float, float]:  # pragma: no cover - compiled
    """Return the divergences of the last sample's predictions by two filters, nats a sample.

    Of that by j from that by i, and of that by i from that by j.
    """
    one, other = 0.0, 0.0
    for e, s in ((E_YAW, S_YAW), (E_ACC, S_ACC)):
        S_i, S_j = told[i, s], told[j, s]
        if S_i > 0.0 and S_j > 0.0:
            apart = told[i, e] - told[j, e]
            square, log_ratio, scale = apart * apart, math.log(S_j / S_i), 1.0 / (S_i * S_j)
            one += 0.5 * ((S_i + square) * S_i * scale - 1.0 + log_ratio)
            other += 0.5 * ((S_j + square) * S_j * scale - 1.0 - log_ratio)
    return one, other


@njit(cache=True, nogil=True, error_model="numpy")
def _learn(rules: Rules, belief: Belief, told: Array) -> None:  # pragma: no cover - compiled
    """Take the divergences between filters of unlike conditions into their running sums.

    What another filter has looked at is known from that one.
    """
    n = told.shape[0]
    for i in range(n):
        for j in range(i):
            looked = told[i, LOOKED] == ITSELF and told[j, LOOKED] == ITSELF
            if looked and rules.condition[i] != rules.condition[j]:
                one, other = _divergences(told, i, j)
                gained = 0.5 * told[i, COUNT] * one, 0.5 * told[j, COUNT] * other
                for row, column, new in ((i, j, gained[0]), (j, i, gained[1])):
                    kept = belief.information[row, column]
                    belief.information[row, column] = kept + min(new, rules.clip) - rules.memory * kept


@njit(cache=True, nogil=True, error_model="numpy")
def _doubt(rules: Rules, belief: Belief, told: Array, best: int) -> float:  # pragma: no cover - compiled
    """Return the sum of the Chernoff bounds on taking another condition for that of the best filter.

    Between two equal spreads Chernoff's information is a quarter of the divergence. Before the data a
    hypothesis is less likely than the condition of the best filter, and counts by the root of that.
    """
    total, likely = 0.0, 0.0
    i = rules.stand_in[best] if told[best, LOOKED] == STAND_IN else best
    for k in range(rules.condition.shape[0]):
        if rules.condition[k] == rules.condition[best]:
            likely += rules.prior[k]
        else:
            j = rules.stand_in[k] if told[k, LOOKED] == STAND_IN else k
            information = min(belief.information[i, j], belief.information[j, i])
            total += 0.5 * math.sqrt(rules.prior[k]) * math.exp(-0.25 * information)
    return total / math.sqrt(likely)


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
def judge(  # pragma: no cover - compiled
    rules: Rules,
    belief: Belief,
    k: int,
    told: Array,
    v: float,
    log_l: Array,
    peaks: Array,
    said: Judgement,
    row: int,
) -> None:
    """Take block k, told (n, 14), into the belief; write row k of what is said.

    log_l (n + 1,) and peaks (n, 2) are work space.
    """
    n = told.shape[0]
    _likelihoods(rules, belief, told, log_l)
    for i in range(n):
        belief.gained[i] += log_l[i]
    _update(rules, belief, k, log_l)
    _learn(rules, belief, told)
    p = said.p_hypothesis[row]
    # Where "none of these" is all but certain, what is left still says which of them it would be.
    left, known = max(1.0 - belief.p[n], 1e-15), belief.p[:n].sum()
    for i in range(n):
        p[i] = left * (belief.p[i] / known if known > 0.0 else 1.0 / n)
    best, known, used = 0, 0.0, 0.0
    said.p_condition[row, :] = 0.0
    for i in range(n):
        if p[i] > p[best]:
            best = i
        known += p[i]
    known = max(known, 1e-300)
    for i in range(n):
        said.p_condition[row, rules.condition[i]] += p[i] / known
        used += p[i] * told[i, ON_WHEELS] / (known * rules.load)
    said.p_none[row] = belief.p[n]
    none = belief.p[n]
    _regions(rules, told, v, p, said.p_region[row])
    _peaks(rules, told, v, p, peaks)
    mu = said.mu[row]
    mu[0] = used
    for j, level in ((1, 0.5), (2, 0.05), (3, 0.95)):
        mu[j] = max(_quantile(p, peaks, level), abs(used))
    certain = _doubt(rules, belief, told, best) <= rules.doubt and math.log(mu[3] / mu[2]) <= rules.width
    sure = said.p_condition[row, rules.condition[best]] >= 1.0 - rules.doubt
    said.identifiable[row] = certain and sure and none < 0.5
