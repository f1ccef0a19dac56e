"""Watches a run for signals that grow without end, and tells what it saw.

The largest magnitude of each signal in windows of 64 steps, and of 512 and 4096 for slow oscillations, is
compared with that of the window before. A *streak* is a row of windows each larger than the last by more
than 5 %: exponential growth makes long ones, a straight line does not. The largest growth from one window to
the next is left out of a streak, so that a jump out of rounding errors counts for nothing.

In the first 256 steps windows of 8 steps count too, for a run that is short or is over soon. There a window
must be larger than the last by 40 %: so short a part of a parabola looks much like exponential growth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from co_sim.native import doubles_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.coupling import Coupling
    from co_sim.kernel import Integers, Matrix
    from co_sim.system import System

    Tensor = NDArray[np.float64]

__all__ = ["Growth", "Watch", "advice"]


class _Kind(NamedTuple):
    """How growth is looked at.

    Parameters
    ----------
    window : steps in the shortest window; windows of the next level have eight of the level below.
    growing : a streak goes on while each window is that many times larger than the last.
    long : windows in a streak, at each level, before it counts.
    """

    window: int
    growing: float
    long: tuple[int, ...]


_RATIO = 8
_KIND = _Kind(64, 1.05, (2, 3, 3))
_EARLY_KIND = _Kind(8, 1.4, (4,))
_EARLY = 256
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


#: What is known of each signal on each level: largest magnitude in the present window and in the
#: last; of its streak the value and the time where it began, its number of windows, and its largest growth
#: from one window to the next.
_PEAK, _LAST, _BASE, _BASE_TIME, _LENGTH, _JUMP = range(6)


@register_jitable
def _close_window(levels: Tensor, level: int, growing: float, time: float) -> None:
    """End the window of a level, at `time`."""
    for i in range(levels.shape[2]):
        peak, last = levels[level, _PEAK, i], levels[level, _LAST, i]
        if peak > growing * last and last > 0.0:
            levels[level, _LENGTH, i] += 1.0
            levels[level, _JUMP, i] = max(levels[level, _JUMP, i], peak / last)
        else:
            levels[level, _BASE, i], levels[level, _BASE_TIME, i] = peak, time
            levels[level, _LENGTH, i], levels[level, _JUMP, i] = 0.0, 1.0
        levels[level, _LAST, i], levels[level, _PEAK, i] = peak, 0.0
        if level + 1 < len(levels) and peak > levels[level + 1, _PEAK, i]:
            levels[level + 1, _PEAK, i] = peak


@register_jitable
def _raise_peaks(rows: Matrix, begin: int, end: int, first: int, peaks: Vector) -> None:
    """Raise the peaks of the columns from `first` to the magnitudes in the rows from `begin` to `end`."""
    # Pointers, and four rows at once, side by side in vector registers; the last stands in for missing ones.
    width, n = rows.shape[1], len(peaks)
    values, peak = doubles_at(rows.ctypes.data), doubles_at(peaks.ctypes.data)
    for r in range(begin, end, 4):
        a = r * width + first
        b = min(r + 1, end - 1) * width + first
        c = min(r + 2, end - 1) * width + first
        d = min(r + 3, end - 1) * width + first
        for i in range(n):
            x, y, z, w = abs(values[a + i]), abs(values[b + i]), abs(values[c + i]), abs(values[d + i])
            x, z = x if x > y else y, z if z > w else w
            x = x if x > z else z
            peak[i] = x if x > peak[i] else peak[i]


@register_jitable
def _fastest(levels: Tensor, level: int, long: Integers, columns: Integers, least: float) -> int:
    """Return the column that has grown most on a level, if by more than `least` without its jump, else -1."""
    found = -1
    for i in columns:
        if levels[level, _LENGTH, i] >= long[level] and levels[level, _BASE, i] > 0.0:
            factor = levels[level, _LAST, i] / levels[level, _BASE, i] / levels[level, _JUMP, i]
            if factor > least:
                found, least = i, factor
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _see(
    rows: Matrix,
    k: int,
    t0: float,
    h: float,
    divergence: float,
    window: int,
    growing: float,
    long: Integers,
    first: int,
    columns: Integers,
    levels: Tensor,
    filled: Integers,
    times: Vector,
) -> tuple[int, int, int]:
    """Take rows in; return the row at which a signal diverged, its level and column, or -1.

    Columns count from the `first` one. Windows of a level are made of those of the level below; `filled`
    tells of how many so far, `times` when the last one ended.
    """
    done = 0
    while done < len(rows):
        begin, done = done, min(done + window - filled[0], len(rows))
        filled[0] += done - begin
        _raise_peaks(rows, begin, done, first, levels[0, _PEAK])
        for level in range(len(levels)):
            if filled[level] < (_RATIO if level else window):
                break
            filled[level], times[level] = 0, t0 + (k + done - 1) * h
            if level + 1 < len(levels):
                filled[level + 1] += 1
            _close_window(levels, level, growing, times[level])
            worst = _fastest(levels, level, long, columns, divergence)
            if worst >= 0 and levels[level, _LAST, worst] > divergence:
                return done - 1, level, worst
    return -1, -1, -1


class _Series:
    """The windows of one kind, over `n` columns."""

    def __init__(self, kind: _Kind, n: int) -> None:
        self.window, self.growing = kind.window, kind.growing
        self.long = np.array(kind.long)
        self.levels = np.zeros((len(kind.long), 6, n))
        self.levels[:, _LAST], self.levels[:, _JUMP] = np.inf, 1.0
        self.filled = np.zeros(len(kind.long), dtype=np.int64)
        self.times = np.zeros(len(kind.long))


class Watch:
    """Sees all rows of a run.

    Parameters
    ----------
    system : of the run.
    looped : its components that act back on themselves. They are watched: where nothing comes back, no
        coupling can be unstable, and a part that grows on its own account is the user's affair.
    """

    def __init__(self, system: System, looped: set[str]) -> None:
        self._signals = system.signals
        columns = np.flatnonzero([signal.component in looped for signal in self._signals])
        self._first = int(columns[0]) if columns.size else 0
        #: Watched, from the first one on; what lies between them is looked at too, as that is faster.
        self._columns = columns - self._first
        self._divergence = float(system.coupling.divergence)
        n = self._columns[-1] + 1 if columns.size else 0
        self._series, self._early = _Series(_KIND, n), _Series(_EARLY_KIND, n)
        self._seen = 0
        self._idle = not (len(self._columns) and math.isfinite(self._divergence))

    def see(self, rows: Matrix, k: int, t0: float, h: float) -> tuple[int, Growth] | None:
        """Look at the rows of the steps from `k`; return the step up to which a signal diverged, and how."""
        if self._idle:
            return None
        early = rows[: max(_EARLY - self._seen, 0)]
        self._seen += len(rows)
        found = [self._see(self._early, early, k, t0, h), self._see(self._series, rows, k, t0, h)]
        # The first of the two, so that it does not matter how the run is cut into blocks.
        return min((each for each in found if each), key=lambda each: each[0], default=None)

    def _see(self, series: _Series, rows: Matrix, k: int, t0: float, h: float) -> tuple[int, Growth] | None:
        kind = series.window, series.growing, series.long
        arrays = series.levels, series.filled, series.times
        row, level, i = _see(rows, k, t0, h, self._divergence, *kind, self._first, self._columns, *arrays)
        return None if row < 0 else (k + row, self._growth(series, level, i))

    def unfinished(self) -> Growth | None:
        """Return what had been growing remarkably, and still was at the end of the run."""
        if self._idle:
            return None
        found = []
        for series in (self._series, self._early) if self._seen <= _EARLY else (self._series,):
            for level in range(len(series.levels)):
                i = _fastest(series.levels, level, series.long, self._columns, _REMARKABLE)
                if i >= 0:
                    found.append(self._growth(series, level, i))
        return max(found, key=lambda growth: growth.factor, default=None)

    def _growth(self, series: _Series, level: int, i: int) -> Growth:
        _, last, base, since, *_ = (float(value) for value in series.levels[level, :, i])
        column = self._first + i
        name = self._signals[column].name
        return Growth(column, name, since, float(series.times[level]), last / base, last)


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
