"""Hypotheses without a chance begin again where the wheelset is.

While the rail is dry, the filter for low rail bends its friction and its state until they explain dry rail
as well as they can. Were the rail low all of a sudden, that filter would have to unlearn it first. So each
second a hypothesis that has next to no probability, and has lost more of it, is put in the place that it
would have if its rail began here: the wheelset is where the most probable filter sees it, and the friction
is that of the condition. Until the next renewal it runs by itself and is judged by that: mixing states at
each step, as an IMM does, would correct a wrong filter before it has shown where it drifts to.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import begin_filter, one
from estimator.adhesion.motion import L_L, L_R, N_X, S, linearise

if TYPE_CHECKING:
    from estimator.adhesion.block import Design, Memory
    from estimator.adhesion.evidence import Belief

__all__ = ["renew"]

Array = NDArray[np.float64]

#: Probability over that of the most probable hypothesis from which on a hypothesis has a chance.
_CHANCE = 1e-3


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
    C[S, S] = design.prior.s**2
    for j in range(N_X):
        kept.x0[j] = x[j]
    linearise(design.car, design.rails[i], held, v, 0.0, x, C, kept.f, kept.J)


@njit(cache=True, nogil=True, error_model="numpy")
def renew(  # pragma: no cover - compiled
    design: Design, memory: Memory, belief: Belief, v: float, torque: float
) -> None:
    """Let all filters begin again whose hypotheses have no chance and have lost since the last renewal."""
    n = design.held.shape[0]
    best = int(belief.p[:n].argmax())
    for i in range(n):
        hopeless = belief.p[i] < _CHANCE * belief.p[best]
        if hopeless and belief.gained[i] < belief.gained[best]:
            _take_over(design, memory, i, best, v, torque)
    belief.gained[:] = 0.0
