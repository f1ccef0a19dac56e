"""Hypotheses without a chance begin again where the wheelset is.

While the rail is dry, the filter for low rail bends its friction and its state until they explain dry rail
as well as they can. Were the rail low all of a sudden, that filter would have to unlearn it first. So each
second a hypothesis that has next to no probability, and has lost more of it, is put in the place that it
would have if its rail began here: the wheelset is where the most probable filter sees it, and the friction
is that of the condition. Until the next renewal it runs by itself and is judged by that: mixing states at
each step, as an IMM does, would correct a wrong filter before it has shown where it drifts to.

Most filters sleep from one renewal to the next. Another one stands in for each of them: what it tells is
taken as theirs.

- Of each rail one filter is always awake: enough to see the rail come. Those of its other patches and
  frictions wake when they have a chance, and it stands in for them while they have none.
- Unlike rails under left and right wheel have no such filter. The best one stands in for them: what nobody
  has looked at becomes neither likelier nor less likely.
- Some of those that sleep are tried in turn, for a second each, from where the best filter sees the
  wheelset: unlike rails, and other patches and frictions of the rail that it may be. One that has a
  chance by then, or that gains, stays awake.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import LOOKED, NOBODY, STAND_IN, awake, begin_filter, one
from estimator.adhesion.motion import L_L, L_R, N_X, S, linearise

if TYPE_CHECKING:
    from estimator.adhesion.block import Design, Memory
    from estimator.adhesion.evidence import Belief, Rules

__all__ = ["renew", "speak_for_the_sleeping"]

Array = NDArray[np.float64]

#: Probability over that of the most probable hypothesis from which on a hypothesis has a chance.
_CHANCE = 1e-3
#: Filters that are tried at a time.
_TRIALS = 3


@njit(cache=True, nogil=True, error_model="numpy")
def _take_over(  # pragma: no cover - compiled
    design: Design, memory: Memory, i: int, best: int, v: float, torque: float
) -> None:
    """Put filter `i` where filter `best` sees the wheelset, with the friction of its own condition.

    A held creep is its own as well: it starts where `begin_filter` puts it.
    """
    begin_filter(design, memory, i, v, torque)
    memory.settling[i] = 0
    kept, known = one(memory.filters, i), one(memory.filters, best)
    x, C = kept.x, kept.C
    held = design.held[i]
    for j in range(N_X):
        own_j = j == S or (held and j in (L_L, L_R))
        if not own_j:
            x[j] = known.x[j]
        for k in range(N_X):
            own_k = k == S or (held and k in (L_L, L_R))
            if not (own_j or own_k):
                C[j, k] = known.C[j, k]
            elif own_j != own_k:
                C[j, k] = 0.0
    C[S, S] = design.friction[i, 1] ** 2
    for j in range(N_X):
        kept.x0[j] = x[j]
    linearise(design.car, design.rails[i], held, v, 0.0, x, C, kept.f, kept.J)


@njit(cache=True, nogil=True, error_model="numpy")
def _best_awake(memory: Memory, belief: Belief, n: int) -> int:  # pragma: no cover - compiled
    """Return the most probable of the hypotheses whose filter is awake."""
    best = -1
    for i in range(n):
        if awake(memory, i) and (best < 0 or belief.p[i] > belief.p[best]):
            best = i
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _has_chance(belief: Belief, i: int, best: int) -> bool:  # pragma: no cover - compiled
    """Return whether hypothesis `i` may be the one."""
    return bool(belief.p[i] >= _CHANCE * belief.p[best])


@njit(cache=True, nogil=True, error_model="numpy")
def _is_hopeless(belief: Belief, i: int, best: int) -> bool:  # pragma: no cover - compiled
    """Return whether hypothesis `i` has no chance, and has lost more of it since the last renewal."""
    return bool(not _has_chance(belief, i, best) and belief.gained[i] < belief.gained[best])


@njit(cache=True, nogil=True, error_model="numpy")
def renew(  # pragma: no cover - compiled
    design: Design, rules: Rules, memory: Memory, belief: Belief, v: float, torque: float
) -> None:
    """Let all filters begin again whose hypotheses are hopeless, or send them to sleep if they may."""
    best = _best_awake(memory, belief, rules.stand_in.shape[0])
    for i in rules.always:
        if _is_hopeless(belief, i, best):
            _take_over(design, memory, i, best, v, torque)
    for i in rules.in_turn:
        _wake_or_sleep(design, rules, memory, belief, i, best, v, torque)
    _try_in_turn(design, rules, memory, belief, best, v, torque)
    belief.gained[:] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _wake_or_sleep(  # pragma: no cover - compiled
    design: Design, rules: Rules, memory: Memory, belief: Belief, i: int, best: int, v: float, torque: float
) -> None:
    """Choose whether filter `i` is awake until the next renewal, by its chance."""
    chosen = rules.stand_in[i]
    if awake(memory, i):
        if _is_hopeless(belief, i, best):
            memory.voice[i] = best if chosen == i else chosen
    elif chosen == i:
        memory.voice[i] = best
    elif _has_chance(belief, i, best):
        _take_over(design, memory, i, best if rules.stand_in[best] == chosen else chosen, v, torque)
        memory.voice[i] = i


@njit(cache=True, nogil=True, error_model="numpy")
def _try_in_turn(  # pragma: no cover - compiled
    design: Design, rules: Rules, memory: Memory, belief: Belief, best: int, v: float, torque: float
) -> None:
    """Wake the next of those that sleep, and that nobody has looked at or whose rail has a chance."""
    n, woken = rules.in_turn.shape[0], 0
    for _ in range(n):
        i = rules.in_turn[memory.turn[0] % n]
        memory.turn[0] += 1
        chosen = rules.stand_in[i]
        worth = chosen == i or _has_chance(belief, chosen, best) or chosen == rules.stand_in[best]
        if not awake(memory, i) and worth:
            _take_over(design, memory, i, best, v, torque)
            memory.voice[i] = i
            woken += 1
            if woken == _TRIALS:
                break


@njit(cache=True, nogil=True, error_model="numpy")
def speak_for_the_sleeping(  # pragma: no cover - compiled
    rules: Rules, memory: Memory, told: Array
) -> None:
    """Write what the sleeping filters tell of blocks, told (blocks, n, 14): what those do that stand in."""
    for i in range(rules.stand_in.shape[0]):
        if not awake(memory, i):
            told[:, i] = told[:, memory.voice[i]]
            told[:, i, LOOKED] = STAND_IN if memory.voice[i] == rules.stand_in[i] else NOBODY
