"""The whole bank over a log: filters in threads, and beside them what is said of the blocks behind."""

from __future__ import annotations

import os
from collections import deque
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
    from concurrent.futures import Executor, Future

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


class _Filters:
    """The filters of a bank on their way through a log, shared by threads."""

    def __init__(self, log: Log, design: Design, threads: int) -> None:
        self.design, self.memory = design, new_memory(len(design.held))
        self.speed = np.abs(log.speed)
        self.torque = np.full(len(log), np.nan) if log.traction_torque is None else log.traction_torque
        self._v_dot = rate_of(log.speed, design.h, self.memory.speed, True)
        self._z, self._usable = log.measurements, np.asarray(log.usable)
        self._rooms = [new_work(len(design.held)).filter for _ in range(threads)]

    def advance(self, pool: Executor, since: int, until: int) -> Array:
        """Run all that are awake over blocks; return what they tell, (blocks, n, 14)."""
        n = len(self.design.held)
        told = np.empty((until - since, n, N_TOLD))
        waiting = deque(np.flatnonzero(self.memory.voice == np.arange(n)).tolist())

        def run(room: Array) -> None:
            while True:
                try:
                    i = waiting.pop()
                except IndexError:
                    return
                run_filter(
                    self.design, self.memory, i, self.speed, self._v_dot, self.torque, self._z,
                    self._usable, room, told, since, until,
                )  # fmt: skip

        list(pool.map(run, self._rooms))
        return told


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
    threads = workers or os.cpu_count() or 1
    filters, belief = _Filters(log, design, threads), new_belief(rules)
    rows, stride, log_l = len(log) // design.block, rules.renewal or _STRIDE, np.empty(len(rules.prior))

    def complete(since: int, told: Array) -> None:
        at = (np.arange(since, since + len(told)) + 1) * design.block - 1
        describe_blocks(rules, told, filters.speed[at], said, since)
        take(since, told)

    with ThreadPoolExecutor(threads) as pool, ThreadPoolExecutor(1) as other:
        # Who asks for one thread has other work for the other processors.
        beside = other if threads > 1 else pool
        completed: list[Future[None]] = []
        for since in range(0, rows, stride):
            until = min(since + stride, rows)
            told = filters.advance(pool, since, until)
            speak_for_the_sleeping(rules, filters.memory, told)
            weigh_blocks(rules, belief, told, log_l, said, since)
            if rules.renewal > 0 and until % rules.renewal == 0:
                last = until * design.block - 1
                renew(design, rules, filters.memory, belief, filters.speed[last], filters.torque[last])
            completed.append(beside.submit(complete, since, told))
        for job in completed:
            job.result()
