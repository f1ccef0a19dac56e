"""The whole bank sample by sample, on memory that is there beforehand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import N_TOLD, awake, end_block, take_sample
from estimator.adhesion.evidence import weigh
from estimator.adhesion.judgement import describe
from estimator.adhesion.motion import N_X
from estimator.adhesion.renewal import renew, speak_for_the_sleeping

if TYPE_CHECKING:
    from estimator.adhesion.block import Design, Memory
    from estimator.adhesion.evidence import Belief, Rules
    from estimator.adhesion.judgement import Judgement

__all__ = ["Work", "bank_step", "new_work", "rate_of"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Time over which the speed's rate is found, s.
_RATE_TIME = 0.1


class Work(NamedTuple):
    """Room for a step: (1,), (5, 4, 12), (n, 14), (n + 1,), (n, 2)."""

    speed: Array
    filter: Array
    told: Array
    log_l: Array
    peaks: Array


@njit(cache=True, nogil=True, error_model="numpy")
def rate_of(speed: Array, h: float, smooth: Array, first: bool) -> Array:  # pragma: no cover - compiled
    """Return the rate (m/s2) of the speeds (T,), causal; `smooth` (1,) is what is kept between calls."""
    share = -math.expm1(-h / _RATE_TIME)
    rate = np.empty(speed.shape[0])
    for k in range(speed.shape[0]):
        if first and k == 0:
            smooth[0] = speed[0]
        smooth[0] += share * (speed[k] - smooth[0])
        rate[k] = (speed[k] - smooth[0]) / _RATE_TIME
    return rate


@njit(cache=True, nogil=True, error_model="numpy")
def bank_step(  # pragma: no cover - compiled
    design: Design, rules: Rules, memory: Memory, belief: Belief, work: Work, k: int,
    z: Array, usable: Flags, speed: float, torque: float, said: Judgement,
) -> bool:  # fmt: skip
    """Advance all filters by sample `k` = 0, 1, ...; at the end of a block write row 0 of what is said.

    Parameters
    ----------
    z : (2,) yaw rate (rad/s) and lateral acceleration (m/s2). usable : (2,) which of them may be used.
    speed : m/s. torque : on the axle, N m; NaN if it is not known.

    Returns
    -------
    Whether a block has ended.
    """
    work.speed[0] = speed
    v, v_dot = abs(speed), rate_of(work.speed, design.h, memory.speed, k == 0)[0]
    n = design.held.shape[0]
    for i in range(n):
        if awake(memory, i):
            take_sample(design, memory, i, k == 0, v, v_dot, torque, z, usable, work.filter)
    if (k + 1) % design.block != 0:
        return False
    for i in range(n):
        if awake(memory, i):
            end_block(design, memory, i, v, torque, work.told[i])
    speak_for_the_sleeping(rules, memory, work.told.reshape((1, n, N_TOLD)))
    block = (k + 1) // design.block - 1
    weigh(rules, belief, block, work.told, work.log_l, said, 0)
    describe(rules, work.told, v, work.peaks, said, 0)
    if rules.renewal > 0 and (block + 1) % rules.renewal == 0:
        renew(design, rules, memory, belief, v, torque)
    return True


def new_work(n: int) -> Work:
    """Return room for a step of n filters."""
    return Work(np.zeros(1), np.zeros((5, 4, N_X)), np.zeros((n, N_TOLD)), np.zeros(n + 1), np.zeros((n, 2)))
