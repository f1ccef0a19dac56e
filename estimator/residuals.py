"""Residuals of a filter bank over a moving window, normalised as in (15).

The numerator of (15) lacks its root in print; read as ``E_i = rms_i / sqrt(sum_j rms_j^2)`` the squares
of all E sum to one, and n equal filters give ``1/sqrt(n)``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "duel",
    "duels",
    "equal_level",
    "moving_mean_square",
    "moving_normalised_rms",
    "normalise",
    "window_step",
]

Array = NDArray[np.float64]


def equal_level(n: int) -> float:
    """Return the normalised residual of each of `n` equally good filters."""
    return 1.0 / math.sqrt(n)


@njit(cache=True, error_model="numpy")
def window_step(  # pragma: no cover - compiled
    values: Array, k: int, history: Array, front: Array, mean: Array
) -> None:
    """Add sample `k` = 0, 1, ... of `values` (n,) to moving means over the last ``len(history)`` samples.

    No sum is ever reduced by subtraction, so a large sample leaves no rounding behind when it drops out
    of the window. `history` (window, n) holds, from the present slot on, suffix sums of the block of
    samples before this one; `front` (n,) is the sum of the present block. Both start as zeros. Until the
    window is full, `mean` (n,) is over the samples there are.
    """
    window, n = history.shape
    slot = k % window
    if slot == 0 and k > 0:
        for j in range(window - 2, -1, -1):
            for i in range(n):
                history[j, i] += history[j + 1, i]
        front[:] = 0.0
    count = min(k + 1, window)
    for i in range(n):
        front[i] += values[i]
        older = history[slot + 1, i] if k >= window and slot + 1 < window else 0.0
        mean[i] = (front[i] + older) / count
        history[slot, i] = values[i]


@njit(cache=True, error_model="numpy")
def normalise(mean_square: Array, E: Array) -> None:  # pragma: no cover - compiled
    """Write (15) for the moving mean squares (n,) into `E` (n,); equal levels where all are zero."""
    total = 0.0
    for i in range(mean_square.shape[0]):
        total += mean_square[i]
    for i in range(E.shape[0]):
        E[i] = math.sqrt(mean_square[i] / total) if total > 0.0 else 1.0 / math.sqrt(E.shape[0])


@njit(cache=True, error_model="numpy")
def duel(E: Array, D: Array) -> None:  # pragma: no cover - compiled
    """Write (15) of each residual E (n,) and its best rival alone into `D` (n,).

    ``D_i = E_i / sqrt(E_i^2 + E_r^2)`` with r the smallest of the others; ``1/sqrt(2)`` where they are equal.
    With all n in the denominator, one hopeless filter would make all others look equally small.
    """
    best, second = 0, 1
    if E[1] < E[0]:
        best, second = 1, 0
    for i in range(2, E.shape[0]):
        if E[i] < E[best]:
            best, second = i, best
        elif E[i] < E[second]:
            second = i
    for i in range(E.shape[0]):
        rival = E[second] if i == best else E[best]
        larger = max(E[i], rival)
        # Scaled by the larger one, since squares of tiny residuals would underflow.
        own, other = (E[i] / larger, rival / larger) if larger > 0.0 else (1.0, 1.0)
        D[i] = own / math.sqrt(own * own + other * other)


def duels(E: Array) -> Array:
    """Return `duel` of the residuals E (n,), n >= 2."""
    D = np.empty_like(E)
    duel(np.asarray(E, dtype=np.float64), D)
    return D


@njit(cache=True, error_model="numpy")
def _moving_mean_square(squares: Array, window: int) -> Array:  # pragma: no cover - compiled
    n = squares.shape[1]
    history, front, result = np.zeros((window, n)), np.zeros(n), np.empty_like(squares)
    for k in range(squares.shape[0]):
        window_step(squares[k], k, history, front, result[k])
    return result


def moving_mean_square(squares: Array, window: int) -> Array:
    """Return the mean of `squares` (T, n) over the last `window` samples, at every sample."""
    if window < 1:
        raise ValueError(f"window: got {window} samples, expected at least 1; choose a longer window")
    return np.asarray(_moving_mean_square(np.ascontiguousarray(squares, dtype=np.float64), window))


def moving_normalised_rms(residuals: Array, window: int) -> Array:
    """Return E (T, n) of (15) for scalar residuals (T, n) over a moving window of samples."""
    mean = moving_mean_square(np.square(residuals), window)
    E = np.empty_like(mean)
    for row, out in zip(mean, E, strict=True):
        normalise(row, out)
    return E
