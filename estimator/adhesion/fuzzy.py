"""The paper's fuzzy identifier on the adhesion bank: from the residuals of N filters to condition and region.

Of each filter the rules see three things over a moving window: how much larger its residual is than the
smallest one, whether that is what the filter itself expects, and where on the creep curve it believes itself.
The rules are made from the hypotheses, so that they fit any bank.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import CREEP, FRICTION, LOOKED, NOBODY
from estimator.adhesion.curves import PAST_PEAK, landmarks
from estimator.adhesion.ekf import COUNT, LOG_L, SQUARE
from estimator.adhesion.fuzzy_rules import fuzzy_system
from estimator.adhesion.hypotheses import kinds
from estimator.advice import Advice, Advisers, advice_score, new_advisers
from estimator.fuzzy import Tables, infer
from estimator.residuals import window_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.adhesion.bank import AdhesionBank
    from estimator.adhesion.curves import Curves
    from estimator.adhesion.hypotheses import Hypothesis
    from estimator.adhesion.judgement import Judgement

__all__ = ["SURE", "SURELY_NOT", "FuzzyIdentifier", "Verdict", "fuzzy_block"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

#: Length of the moving window of residuals, s: the paper's.
WINDOW = 1.0
#: Degrees of a class that is certainly the one, and certainly not: centroids of the terms "yes" and "no".
SURE, SURELY_NOT = 0.9, 0.1
#: Lead of one degree over the next that counts as an answer: a rival is then 6 nats behind.
_LEAD = 0.2
#: Normalised square that counts at most, on average over a block: no blow on a sensor decides for a second.
_CAP = 4.0
#: Below this a sum of squares is none.
_TINY = 1e-12


class Verdict(NamedTuple):
    """What the fuzzy identifier says of blocks, one row each.

    Parameters
    ----------
    region, condition : (rows, 3) and (rows, c) degrees from 0.1, certainly not, over 0.5, undecided, to 0.9,
        certainly; they need not sum to one.
    known : (rows,) the same for the question whether any filter is as good as it expects to be.
    clear : (rows,) whether one condition leads, linear and unstable region are not alike, and `known` is at
        least 0.5.
    score : (rows,) advice, as in `estimator.advice.Advice`; NaN: no statement.
    """

    region: Array
    condition: Array
    known: Array
    clear: Flags
    score: Array

    def at(self, rows: slice) -> Verdict:
        """Return some of the rows."""
        return Verdict(
            self.region[rows], self.condition[rows], self.known[rows], self.clear[rows], self.score[rows]
        )

    def only(self, where: Flags) -> Verdict:
        """Return the same with a statement only where (rows,) is true."""
        return self._replace(clear=self.clear & where, score=np.where(where, self.score, np.nan))

    @property
    def advice(self) -> Advice:
        """What a driver or a traction controller should do."""
        return Advice.of(self.score)


class Design(NamedTuple):
    """What `fuzzy_block` reads.

    Curves of the conditions, their places by filter (n, 2), mean of the friction's logarithm and one over its
    variance (n, 2), which of m kinds each filter is of (n,), and the fuzzy system. Filters are of one
    kind if they differ in patch and friction alone; the best of them speaks for it.
    """

    curves: Curves
    curve: Indices
    friction: Array
    kind: Indices
    fuzzy: Tables


class Memory(NamedTuple):
    """What is kept from block to block, as in `window_step`: (window, 3 n), (3 n,), (3 n,)."""

    history: Array
    front: Array
    mean: Array


class Work(NamedTuple):
    """Room for a block: (3 n,), (3 m,), (rules,), (outputs, grid), (outputs,) and that of the advisers."""

    values: Array
    x: Array
    strength: Array
    area: Array
    y: Array
    advisers: Advisers


@njit(cache=True, nogil=True, error_model="numpy")
def _sums(told: Array, values: Array) -> None:  # pragma: no cover - compiled
    """Write number, normalised squares and logarithms of the variances of a block's innovations, (n, 3) flat.

    A filter that says no number, or has not looked, counts as the worst that there is.
    """
    n = told.shape[0]
    widest = -math.inf
    for i in range(n):
        spread = -(2.0 * told[i, LOG_L] + told[i, SQUARE])
        if math.isfinite(spread):
            widest = max(widest, spread)
    for i in range(n):
        count, square = told[i, COUNT], told[i, SQUARE]
        spread = -(2.0 * told[i, LOG_L] + square)
        sound = math.isfinite(spread) and told[i, LOOKED] != NOBODY
        values[3 * i] = count
        values[3 * i + 1] = min(square, _CAP * count) if sound else _CAP * count
        values[3 * i + 2] = spread if sound else max(widest, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _place(design: Design, i: int, told: Array, v: float) -> float:  # pragma: no cover - compiled
    """Return where filter i believes its creep to be: 1 at the knee, 2 where the peak ends."""
    peak, knee = math.inf, math.inf
    for side in range(2):
        _, at_peak, at_knee = landmarks(design.curves, design.curve[i, side], v, told[i, FRICTION])
        peak, knee = min(peak, at_peak), min(knee, at_knee)
    creep, knee, past = told[i, CREEP], math.exp(knee), PAST_PEAK * math.exp(peak)
    if not math.isfinite(creep):
        return 3.0
    if creep <= knee:
        return float(creep / knee)
    return float(1.0 + (creep - knee) / (past - knee) if creep <= past else creep / past + 1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _see(  # pragma: no cover - compiled
    design: Design, mean: Array, blocks: int, told: Array, v: float, x: Array
) -> None:
    """Write misfit, rms of the residual and place on the creep curve of each kind's best filter, (m, 3) flat.

    With the residual g^2 = exp(mean ln S) mean(e^2/S), the rms of the innovations in units that all filters
    share, the misfit is N ln(g/g_best): minus the logarithm of the likelihood ratio of N innovations if
    their scale is not known. What the prior of the friction holds against the filter is added: one whose
    friction has gone to that of another condition explains the data as well as that one.
    """
    best = math.inf
    x[:] = math.inf
    for i in range(told.shape[0]):
        count, square, spread = mean[3 * i], mean[3 * i + 1], mean[3 * i + 2]
        ratio = max(square / count, _TINY) if count > 0.0 else 1.0
        s = told[i, FRICTION] - design.friction[i, 0] if math.isfinite(told[i, FRICTION]) else 0.0
        misfit = 0.5 * (blocks * (count * math.log(ratio) + spread) + s * s * design.friction[i, 1])
        j = 3 * design.kind[i]
        if misfit < x[j]:
            x[j], x[j + 1], x[j + 2] = misfit, math.sqrt(ratio), _place(design, i, told, v)
        best = min(best, misfit)
    for j in range(0, x.shape[0], 3):
        x[j] -= best


@njit(cache=True, nogil=True, error_model="numpy")
def _leads(degrees: Array) -> bool:  # pragma: no cover - compiled
    """Return whether the greatest of the degrees is well above the next."""
    first, second = 0.0, 0.0
    for degree in degrees:
        if degree > first:
            first, second = degree, first
        elif degree > second:
            second = degree
    return bool(first - second >= _LEAD)


@njit(cache=True, nogil=True, error_model="numpy")
def _torn(region: Array) -> bool:  # pragma: no cover - compiled
    """Return whether linear and unstable region are alike, with nothing likelier in between."""
    linear, peak, unstable = region
    return bool(abs(linear - unstable) < _LEAD and max(linear, unstable) >= peak)


@njit(cache=True, nogil=True, error_model="numpy")
def fuzzy_block(  # pragma: no cover - compiled
    design: Design, memory: Memory, work: Work, k: int, told: Array, v: float,
    identifiable: bool, mu_used: float, mu_max_low: float, said: Verdict, row: int,
) -> None:  # fmt: skip
    """Take block k = 0, 1, ..., told (n, 14) at the speed v; write a row of what is said.

    `identifiable`, `mu_used` and `mu_max_low` are what the bank says of the block.
    """
    _sums(told, work.values)
    window_step(work.values, k, memory.history, memory.front, memory.mean)
    _see(design, memory.mean, min(k + 1, memory.history.shape[0]), told, v, work.x)
    infer(design.fuzzy, work.x, work.strength, work.area, work.y)
    region, condition = said.region[row], said.condition[row]
    region[:] = work.y[:3]
    condition[:] = work.y[3:-1]
    known = work.y[-1]
    clear = _leads(condition) and not _torn(region) and known >= 0.5
    said.known[row], said.clear[row] = known, clear
    # With certainty 0 and 1; what is neither is reckoned with on the side of caution.
    past = min(max((region[2] - SURELY_NOT) / (SURE - SURELY_NOT), 0.0), 1.0)
    linear = min(max((region[0] - SURELY_NOT) / (SURE - SURELY_NOT), 0.0), 1.0)
    score = advice_score(work.advisers, past, max(past, 1.0 - linear), mu_used, mu_max_low)
    said.score[row] = score if clear and identifiable else math.nan


class FuzzyIdentifier:
    """Turns what the filters of a bank tell of each block into condition, region and advice.

    Parameters
    ----------
    bank : whose filters they are. hypotheses : of the filters, in their order.
    window : length of the moving window of residuals, s.
    """

    def __init__(
        self, bank: AdhesionBank, hypotheses: Sequence[Hypothesis], *, window: float = WINDOW
    ) -> None:
        block = bank.block * bank.h
        if not (math.isfinite(window) and window >= block):
            raise ValueError(
                f"fuzzy identifier: got a window of {window!r} s, expected at least a block of {block:g} s; "
                f"choose a longer window"
            )
        self._blocks = round(window / block)
        self._n, self._conditions = len(hypotheses), len(bank.conditions)
        rules = bank.rules(hypotheses)
        chosen, kind = np.unique(kinds(hypotheses), return_inverse=True)
        names = bank.conditions
        rails = [names[rules.condition[i]] for i in chosen]
        fuzzy = fuzzy_system([hypotheses[i].name for i in chosen], rails, names).compile().tables
        friction = bank.assumed.frictions(hypotheses)
        weight = np.divide(1.0, friction[:, 1] ** 2, out=np.zeros(self._n), where=friction[:, 1] > 0.0)
        self._design = Design(
            rules.curves,
            rules.curve,
            np.column_stack((friction[:, 0], weight)),
            kind,
            fuzzy,
        )
        self._kinds = len(chosen)
        self.reset()

    @property
    def state(self) -> Memory:
        """What `step` keeps: arrays to be copied or written into."""
        return self._memory

    def reset(self) -> None:
        """Forget all blocks."""
        n, fuzzy = 3 * self._n, self._design.fuzzy
        self._memory = Memory(np.zeros((self._blocks, n)), np.zeros(n), np.zeros(n))
        self._work = Work(
            np.empty(n), np.empty(3 * self._kinds), np.empty(len(fuzzy.conclusions)),
            np.empty_like(fuzzy.grid), np.empty(len(fuzzy.grid)), new_advisers(),
        )  # fmt: skip

    def new_verdict(self, rows: int) -> Verdict:
        """Return room for that many rows: nothing is known."""
        return Verdict(
            np.full((rows, 3), 0.5),
            np.full((rows, self._conditions), 0.5),
            np.full(rows, 0.5),
            np.zeros(rows, dtype=np.bool_),
            np.full(rows, np.nan),
        )

    def step(self, k: int, told: Array, speed: float, said: Judgement, verdict: Verdict) -> None:
        """Take block `k` = 0, 1, ...: told (n, 14), and row 0 of what the bank says; write row 0."""
        self._check(told)
        v = np.array([abs(speed)])
        _rows(self._design, self._memory, self._work, k, 0, told[None], v, said, verdict)

    def take(self, k: int, told: Array, speed: Array, said: Judgement, verdict: Verdict) -> None:
        """Take blocks from `k` on: told (blocks, n, 14) at the speeds (blocks,); write their rows."""
        self._check(told)
        _rows(self._design, self._memory, self._work, k, k, told, np.abs(speed), said, verdict)

    def _check(self, told: Array) -> None:
        if told.shape[-2] != self._n:
            raise ValueError(
                f"fuzzy identifier: got {told.shape[-2]} filters, expected {self._n}; make the identifier "
                f"for the hypotheses of these filters"
            )

    def run(self, told: Array, speed: Array, said: Judgement) -> Verdict:
        """Reset, then judge all blocks, told (rows, n, 14), at the speeds (rows,)."""
        self.reset()
        verdict = self.new_verdict(len(told))
        self.take(0, told, speed, said, verdict)
        return verdict


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(  # pragma: no cover - compiled
    design: Design, memory: Memory, work: Work, k: int, row: int, told: Array, v: Array,
    said: Judgement, verdict: Verdict,
) -> None:  # fmt: skip
    for j in range(told.shape[0]):
        fuzzy_block(
            design, memory, work, k + j, told[j], v[j], said.identifiable[row + j], said.mu[row + j, 0],
            said.mu[row + j, 2], verdict, row + j,
        )  # fmt: skip
