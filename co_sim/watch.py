"""Watches a run for signals that grow without end, and tells what it saw.

The largest magnitude of each signal in windows of 64 steps, and of 512 and 4096 for slow oscillations, is
compared with that of the window before. A *streak* is a row of windows each larger than the last by more
than 5 %: exponential growth makes long ones, a straight line does not. The largest growth from one window to
the next is left out of a streak, so that a jump out of rounding errors counts for nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from co_sim.dependencies import looped_components

if TYPE_CHECKING:
    from co_sim.component import Vector
    from co_sim.coupling import Coupling
    from co_sim.kernel import Matrix
    from co_sim.system import System

__all__ = ["Growth", "Watch", "advice"]

_WINDOW, _RATIO = 64, 8
_GROWING = 1.05
#: Windows in a streak, at each level, before it counts. A short run can diverge in few of the shortest ones.
_LONG = (2, 3, 3)
#: Growth without pause that is worth a word even if the run ended before it was beyond all bounds.
_REMARKABLE = 1e3


@dataclass(frozen=True, slots=True)
class Growth:
    """A signal that has grown without pause.

    Parameters
    ----------
    column, signal : which one. since, until : s. factor : of growth between the two. value : magnitude
        reached.
    """

    column: int
    signal: str
    since: float
    until: float
    factor: float
    value: float

    def __str__(self) -> str:
        rate = math.log(self.factor) / (self.until - self.since)
        return (
            f"{self.signal} has grown {self.factor:.3g}-fold without pause since t = {self.since:g} s, "
            f"to {self.value:.3g} at t = {self.until:g} s (a growth rate of {rate:.3g} 1/s)"
        )


@dataclass
class _Level:
    """Windows of one length; `long` of them make a streak that counts."""

    n: int
    long: int
    filled: int = 0
    time: float = 0.0
    peak: Vector = field(init=False)
    last: Vector = field(init=False)
    base: Vector = field(init=False)
    base_time: Vector = field(init=False)
    length: Vector = field(init=False)
    jump: Vector = field(init=False)

    def __post_init__(self) -> None:
        self.peak, self.last, self.base = np.zeros(self.n), np.full(self.n, np.inf), np.zeros(self.n)
        self.base_time, self.length, self.jump = np.zeros(self.n), np.zeros(self.n), np.ones(self.n)

    def close(self, time: float) -> None:
        """End a window, at `time`."""
        growing = (self.peak > _GROWING * self.last) & (self.last > 0.0)
        self.base = np.where(growing, self.base, self.peak)
        self.base_time = np.where(growing, self.base_time, time)
        self.length = np.where(growing, self.length + 1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.jump = np.where(growing, np.maximum(self.jump, self.peak / self.last), 1.0)
        self.last, self.peak, self.filled, self.time = self.peak, np.zeros(self.n), 0, time


class Watch:
    """Sees all rows of a run.

    Parameters
    ----------
    system : whose components that act back on themselves are watched: where nothing comes back, no
        coupling can be unstable, and a part that grows on its own account is the user's affair.
    """

    def __init__(self, system: System) -> None:
        looped = looped_components(system)
        self._signals = system.signals
        self._columns = np.flatnonzero([signal.component in looped for signal in self._signals])
        self._divergence = system.coupling.divergence
        self._levels = [_Level(len(self._columns), long) for long in _LONG]
        self._idle = not (len(self._columns) and math.isfinite(self._divergence))

    def see(self, rows: Matrix, k: int, t0: float, h: float) -> tuple[int, Growth] | None:
        """Look at the rows of the steps from `k`; return the step up to which a signal diverged, and how."""
        if self._idle:
            return None
        done = 0
        while done < len(rows):
            lowest = self._levels[0]
            n = min(_WINDOW - lowest.filled, len(rows) - done)
            np.maximum(lowest.peak, np.abs(rows[done : done + n, self._columns]).max(axis=0), out=lowest.peak)
            lowest.filled += n
            done += n
            if lowest.filled == _WINDOW:
                step = k + done - 1
                growth = self._close(t0 + step * h)
                if growth:
                    return step, growth
        return None

    def _close(self, time: float) -> Growth | None:
        """End the window of each level that is full; a level's windows are made of those below."""
        for level, above in zip(self._levels, [*self._levels[1:], None], strict=True):
            peak = level.peak
            level.close(time)
            growth = self._worst(level, self._divergence)
            if growth and growth.value > self._divergence:
                return growth
            if above is None:
                return None
            np.maximum(above.peak, peak, out=above.peak)
            above.filled += 1
            if above.filled < _RATIO:
                return None
        return None

    def _worst(self, level: _Level, least: float) -> Growth | None:
        """Return the signal that has grown most, if by more than `least` without its largest jump."""
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = level.last / level.base
            steady = np.where((level.length >= level.long) & (level.base > 0.0), factor / level.jump, 0.0)
        i = int(np.argmax(steady))
        if steady[i] <= least:
            return None
        column = int(self._columns[i])
        name = self._signals[column].name
        return Growth(
            column, name, float(level.base_time[i]), level.time, float(factor[i]), float(level.last[i])
        )

    def unfinished(self) -> Growth | None:
        """Return what had been growing remarkably, and still was at the end of the run."""
        if self._idle:
            return None
        found = [self._worst(level, _REMARKABLE) for level in self._levels]
        return max((g for g in found if g), key=lambda g: g.factor, default=None)


def advice(coupling: Coupling, h: float) -> str:
    """Return what to try when a coupled run diverges."""
    others = {
        "jacobi": 'algorithm "gauss-seidel" or "iterated"',
        "gauss-seidel": 'algorithm "iterated"',
        "iterated": "order 1",
    }[coupling.algorithm]
    return (
        "if the parts are stable on their own, the coupling is not at this step: "
        f"try {h / 10:g} s, or {others}; check_coupling(system, duration) compares"
    )
