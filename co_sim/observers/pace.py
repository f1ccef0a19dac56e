"""Runs at the pace of a clock."""

from __future__ import annotations

import math
import time as clocks
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.system import Signal

__all__ = ["Overruns", "Pace"]


@dataclass(frozen=True, slots=True)
class Overruns:
    """Steps that were complete only after their time on the clock.

    Parameters
    ----------
    steps : how many steps were watched.
    count : how many of them were late.
    worst, mean : lateness of the late ones, s of the clock; 0 if there are none.
    first : simulated time at the end of the first late one, s; ``None`` if there is none.
    """

    steps: int = 0
    count: int = 0
    worst: float = 0.0
    mean: float = 0.0
    first: float | None = None

    def __str__(self) -> str:
        if self.first is None:
            return f"all {self.steps} steps in time"
        return (
            f"{self.count} of {self.steps} steps late, first at t = {self.first:.12g} s, "
            f"by {1e3 * self.mean:.3g} ms in the mean and {1e3 * self.worst:.3g} ms at worst"
        )


class Pace:
    """Holds a run back so that simulated time passes at `factor` times the pace of the clock.

    The clock starts with the initial values, after the components have started. Each step has its own time
    on the clock, ``k h / factor`` from there, so that errors of single waits do not add up: a late step
    is followed by faster ones until the run has caught up. `overruns` tells how often and how much it was
    late. Observers behind this one see the values when they are due.

    Parameters
    ----------
    factor : simulated time per time of the clock; 1 for real time, 2 for twice as fast.
    clock : returns a time that never runs backwards, s.
    sleep : waits for so many seconds.

    Raises
    ------
    InputError
        If `factor` is not a finite number > 0.
    """

    max_block: int | None = 1

    def __init__(
        self,
        factor: float = 1.0,
        *,
        clock: Callable[[], float] = clocks.monotonic,
        sleep: Callable[[float], object] = clocks.sleep,
    ) -> None:
        if not (math.isfinite(factor) and factor > 0.0):
            raise InputError("factor", got=f"{factor}", expected="a finite number > 0", remedy="use 1")
        self.factor = factor
        self._clock = clock
        self._sleep = sleep
        self._step = 0.0
        self._origin = 0.0
        self._steps = self._late = 0
        self._worst = self._total = 0.0
        self._first: float | None = None

    @property
    def overruns(self) -> Overruns:
        """Late steps of this run so far, or of the last one."""
        mean = self._total / self._late if self._late else 0.0
        return Overruns(self._steps, self._late, self._worst, mean, self._first)

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Forget the last run."""
        self._step = h / self.factor
        self._steps = self._late = 0
        self._worst = self._total = 0.0
        self._first = None

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """Wait until the last row of the block is due."""
        now = self._clock()
        if k == 0:
            self._origin = now
        last = k + np.size(time) - 1
        if last == 0:
            return
        self._steps = last
        due = self._origin + last * self._step
        if now > due:
            self._note(now - due, float(np.ravel(time)[-1]))
        while (left := due - self._clock()) > 0.0:
            self._sleep(left)

    def end(self, error: BaseException | None) -> None:
        """Keep the numbers."""

    def _note(self, lateness: float, t: float) -> None:
        if self._first is None:
            self._first = t
        self._late += 1
        self._total += lateness
        self._worst = max(self._worst, lateness)
