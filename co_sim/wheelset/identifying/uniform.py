"""The uniform grid closest to time stamps, and what lies on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from co_sim.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["Grid", "fit_grid", "gaps", "near", "placed"]

#: Rates that a log may have, Hz.
_RATES = (90.0, 20e3)
#: Greatest share of the time without samples.
_EMPTY = 0.9
#: How fast the first grid follows the stamps: as slowly as an error of its step of 1 % allows.
_FOLLOWING = 0.1


@dataclass(frozen=True, eq=False)
class Grid:
    """A uniform grid and where the rows are on it.

    Parameters
    ----------
    h : step, s. times : (T,) of the grid, s.
    k : (rows,) place of each row. off : (rows,) distance from it, s.
    """

    h: float
    times: Array
    k: NDArray[np.int64]
    off: Array

    @property
    def first(self) -> NDArray[np.int64]:
        """The rows that are the first at their place."""
        return np.flatnonzero(np.diff(self.k, prepend=-1) > 0)


def fit_grid(file: str, time: Array) -> Grid:
    """Return the uniform grid closest to the times (least squares)."""
    steps = np.diff(time)
    h = float(np.median(steps))
    for _ in range(5):  # the median of a log with many holes is too long
        h = float(np.mean(steps[np.abs(steps - h) <= 0.5 * h]))
    if 1.0 / h < _RATES[0] or 1.0 / h > _RATES[1]:
        raise InputError(
            f"{file}: time",
            got=f"a rate of {1.0 / h:.4g} Hz",
            expected=f"{_RATES[0]:g} to {_RATES[1]:g} Hz",
            remedy="give the time in s" if 1.0 / h < _RATES[0] else "thin the log out",
        )
    k = _followed(time, h)
    for _ in range(5):
        centre = k.mean()
        spread = k - centre
        h = float(spread @ (time - time.mean()) / (spread @ spread))
        t0 = float(time.mean() - h * centre)
        again = np.rint((time - t0) / h)
        again -= again[0]
        if np.array_equal(again, k):
            break
        k = again
    h, t0 = _plain(time, h, t0, float(k[-1]))
    T = int(k[-1]) + 1
    if len(time) < (1.0 - _EMPTY) * T:
        raise InputError(
            file,
            got=f"{len(time)} rows in {T * h:g} s at {1.0 / h:.6g} Hz",
            expected=f"samples over at least {1.0 - _EMPTY:.0%} of the time",
            remedy="cut the log where it pauses",
        )
    return Grid(h, t0 + h * np.arange(T, dtype=np.float64), k.astype(np.int64), time - (t0 + h * k))


@njit(cache=True, error_model="numpy")
def _followed(time: Array, h: float) -> Array:  # pragma: no cover - compiled
    """Return the place of each time on a grid that follows the times slowly, as `h` is not yet exact."""
    k = np.zeros(time.shape[0])
    expected = time[0] + h
    for i in range(1, time.shape[0]):
        missed = max(np.rint((time[i] - expected) / h), -1.0)  # -1: the one before was late, not this early
        k[i] = k[i - 1] + 1.0 + missed
        on_grid = expected + missed * h
        expected = on_grid + h + _FOLLOWING * (time[i] - on_grid)
    return k


def _plain(time: Array, h: float, t0: float, last: float) -> tuple[float, float]:
    """Return the whole rate and the first time itself, where the stamps fit them as well."""
    tolerance = 0.01 * h
    plain = 1.0 / round(1.0 / h)
    if abs(plain - h) * last > tolerance:
        return h, t0
    t0 += 0.5 * (h - plain) * last
    return plain, float(time[0]) if abs(t0 - time[0]) < tolerance else t0


def placed(values: Array, grid: Grid) -> Array:
    """Return the values of the first rows at their places, and NaN at places without a row."""
    column = np.full(len(grid.times), np.nan)
    column[grid.k[grid.first]] = values
    return column


def near(time: Array, grid: Array, h: float) -> Mask:
    """Return where both neighbours of a place on the grid are close enough to interpolate between them."""
    right = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    return np.asarray(time[right] - time[right - 1] < 2.5 * h)


def gaps(gap: Mask, time: Array) -> tuple[tuple[float, float], ...]:
    """Return the first and the last time of each stretch of the grid without rows."""
    change = np.diff(gap.astype(np.int8), prepend=0, append=0)
    ends = zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1) - 1, strict=True)
    return tuple((float(time[a]), float(time[b])) for a, b in ends)
