"""From what the filters tell of a block to the probabilities of the hypotheses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import ITSELF, LOOKED, STAND_IN
from estimator.adhesion.ekf import COUNT, E_ACC, E_YAW, LOG_L, S_ACC, S_YAW, SQUARE

if TYPE_CHECKING:
    from estimator.adhesion.curves import Curves
    from estimator.adhesion.judgement import Judgement

__all__ = ["Belief", "Rules", "new_belief", "weigh"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Rules(NamedTuple):
    """How evidence is weighed; n hypotheses, c conditions, "none of these" comes last.

    `prior` (n + 1,). `change` probability that a block begins with another hypothesis, `turn` (n + 1, n + 1)
    how likely each (column) is then after each (row). `clip` greatest log-likelihood ratio that one block
    may add. `none` variance of the innovations over what the filters expect, if none of them is right.
    `window` blocks of the moving window, 0 for recursive evidence. `condition` (n,) of each hypothesis.
    `curve` (n, 2) the places of its rails in `curves`. `load` normal load times radius on both wheels, N m.
    `spread` standard deviation of the peak's logarithm that the model leaves. `doubt` greatest bound on the
    error of the condition, and greatest probability of the others, and `width` greatest logarithm of upper
    over lower bound of the peak adhesion for which the result is trusted. `torque_known`, so that the peak
    is no less than what is used. `memory` share of a block in the running sum of the information. `renewal`
    blocks from one renewal to the next, 0: none. `stand_in` (n,) which filter stands in for each while it
    sleeps, `always` those that never sleep, and `in_turn` those that may, in the order in which they are
    tried.
    """

    curves: Curves
    prior: Array
    change: float
    turn: Array
    clip: float
    none: float
    window: int
    condition: Indices
    curve: Indices
    load: float
    spread: float
    doubt: float
    width: float
    torque_known: bool
    memory: float
    renewal: int
    stand_in: Indices
    always: Indices
    in_turn: Indices


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


def new_belief(rules: Rules) -> Belief:
    """Return what is believed before the first block."""
    n = len(rules.prior)
    return Belief(
        rules.prior.copy(),
        np.zeros((max(rules.window, 1), n)),
        np.zeros(n),
        np.zeros((n - 1, n - 1)),
        np.zeros(n - 1),
    )


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
def weigh(  # pragma: no cover - compiled
    rules: Rules, belief: Belief, k: int, told: Array, log_l: Array, said: Judgement, row: int
) -> None:
    """Take block k, told (n, 14), into the belief; write row `row` of the probabilities.

    And whether the condition is certain, as far as that shows here. log_l (n + 1,) is work space.
    """
    n = told.shape[0]
    _likelihoods(rules, belief, told, log_l)
    for i in range(n):
        belief.gained[i] += log_l[i]
    _update(rules, belief, k, log_l)
    _learn(rules, belief, told)
    p, p_condition, none = said.p_hypothesis[row], said.p_condition[row], belief.p[n]
    # Where "none of these" is all but certain, what is left still says which of them it would be.
    left, known = max(1.0 - none, 1e-15), belief.p[:n].sum()
    best = 0
    for i in range(n):
        p[i] = left * (belief.p[i] / known if known > 0.0 else 1.0 / n)
        if p[i] > p[best]:
            best = i
    known = max(p.sum(), 1e-300)
    p_condition[:] = 0.0
    for i in range(n):
        p_condition[rules.condition[i]] += p[i] / known
    said.p_none[row] = none
    sure = p_condition[rules.condition[best]] >= 1.0 - rules.doubt and none < 0.5
    said.identifiable[row] = sure and _doubt(rules, belief, told, best) <= rules.doubt
