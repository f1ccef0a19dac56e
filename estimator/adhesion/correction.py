"""One measured number taken into state and covariance, compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.motion import N_X
from estimator.adhesion.rows import put, row, total

__all__ = ["correct"]

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _joseph(R_e: float, gain: float, C: Array, work: Array) -> None:  # pragma: no cover - compiled
    """Replace C by (1 - K H) C (1 - K H)' + K R_e K', by two products of vectors of equal triangles.

    `work` has H in its first row, C H' in its second; K = gain C H'.
    """
    root, K, c = math.sqrt(gain), gain * row(work, 1), row(work, 1)
    w = root * c
    put(work, 2, w)
    left = 0.0 * w
    for i in range(N_X):
        less = row(C, i) - work[2, i] * w
        left = left + work[0, i] * less
        put(C, i, less)
    u = 0.5 * (R_e * K - left)
    put(work, 1, u)
    put(work, 2, K)
    for i in range(N_X):
        put(C, i, row(C, i) + (work[1, i] * K + work[2, i] * u))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def correct(  # pragma: no cover - compiled
    e: float, R_e: float, x: Array, C: Array, work: Array
) -> float:
    """Take an innovation e with the row H into x and C, Joseph's form; return its variance.

    `work` (4, 12) has H in its first row.
    """
    even, odd = work[0, 0] * row(C, 0), work[0, 1] * row(C, 1)
    for k in range(2, N_X, 2):
        even, odd = even + work[0, k] * row(C, k), odd + work[0, k + 1] * row(C, k + 1)
    c = even + odd
    S_e = R_e + total(row(work, 0) * c)
    gain = 1.0 / S_e
    put(x, 0, row(x, 0) + (gain * e) * c)
    put(work, 1, c)
    _joseph(R_e, gain, C, work)
    return S_e
