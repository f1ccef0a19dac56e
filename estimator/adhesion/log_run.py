"""The whole bank over a log: filters in threads, and beside them what is said of the blocks behind."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import N_TOLD, new_memory, run_filter
from estimator.adhesion.evidence import new_belief, weigh
from estimator.adhesion.judgement import describe
from estimator.adhesion.online import new_work, rate_of
from estimator.adhesion.renewal import renew, speak_for_the_sleeping

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future

    from estimator.adhesion.block import Design
    from estimator.adhesion.evidence import Belief, Rules
    from estimator.adhesion.judgement import Judgement
    from estimator.log import Log

__all__ = ["describe_blocks", "run_over", "weigh_blocks"]

Array = NDArray[np.float64]

#: Blocks that the filters pass at a time where no renewal sets another number.
_STRIDE = 100


@njit(cache=True, nogil=True, error_model="numpy")
def weigh_blocks(  # pragma: no cover - compiled
    rules: Rules, belief: Belief, told: Array, log_l: Array, said: Judgement, since: int
) -> None:
    """Take blocks from `since` on, told (blocks, n, 14), into the belief; write their rows."""
    for k in range(told.shape[0]):
        weigh(rules, belief, since + k, told[k], log_l, said, since + k)


@njit(cache=True, nogil=True, error_model="numpy")
def describe_blocks(  # pragma: no cover - compiled
    rules: Rules, told: Array, v: Array, said: Judgement, since: int
) -> None:
    """Complete the rows from `since` on: told (blocks, n, 14) at the speeds v (blocks,)."""
    peaks = np.empty((told.shape[1], 2))
    for k in range(told.shape[0]):
        describe(rules, told[k], v[k], peaks, said, since + k)


def run_over(
    log: Log,
    design: Design,
    rules: Rules,
    said: Judgement,
    take: Callable[[int, Array], None],
    workers: int | None = None,
) -> None:
    """Run a bank over a log.

    Parameters
    ----------
    said : rows for all blocks, which are written.
    take : gets the number of a block, and what the filters tell of that block and of some that follow,
        (blocks, n, 14), once their rows of `said` are complete; called in order, from another thread.
    workers : threads that share the filters; None: as many as there are processors.
    """
    n, rows = len(design.held), len(log) // design.block
    memory, belief, log_l = new_memory(n), new_belief(rules), np.zeros(n + 1)
    torque = np.full(len(log), np.nan) if log.traction_torque is None else log.traction_torque
    v_dot = rate_of(log.speed, design.h, memory.speed, True)
    speed, z, usable = np.abs(log.speed), log.measurements, np.asarray(log.usable)
    at_end = speed[design.block - 1 :: design.block]
    rooms = [new_work(n).filter for _ in range(n)]
    stride = rules.renewal or _STRIDE

    def run(i: int) -> None:
        run_filter(
            design, memory, i, speed, v_dot, torque, z, usable, rooms[i], told, since, until
        )  # fmt: skip

    def complete(since: int, told: Array) -> None:
        describe_blocks(rules, told, at_end[since : since + len(told)], said, since)
        take(since, told)

    with ThreadPoolExecutor(workers or os.cpu_count()) as pool, ThreadPoolExecutor(1) as beside:
        done: list[Future[None]] = []
        for since in range(0, rows, stride):
            until = min(since + stride, rows)
            told = np.empty((until - since, n, N_TOLD))
            list(pool.map(run, np.flatnonzero(memory.voice == np.arange(n))))
            speak_for_the_sleeping(rules, memory, told)
            weigh_blocks(rules, belief, told, log_l, said, since)
            if rules.renewal > 0 and until % rules.renewal == 0:
                last = until * design.block - 1
                renew(design, rules, memory, belief, speed[last], torque[last])
            done.append(beside.submit(complete, since, told))
        for job in done:
            job.result()
