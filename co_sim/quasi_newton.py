"""The quasi-Newton method of least squares for a fixed point ``y = F(y)``, without derivatives of F.

It is what fluid-structure interaction uses (Degroote, Bathe, Vierendeels: Performance of a new partitioned
procedure versus a monolithic procedure, Computers & Structures 87, 2009): with the differences ``V`` of
residuals ``r = F(y) - y`` and ``W`` of results ``F(y)`` so far, the newest first ::

    y <- F(y) + W c,    c = arg min |V c + r|

The least squares are solved by ``V = Q R``. A column that lies in the space of the newer ones, but for its
rounding errors, is left out (Haelterman and others: Improving the performance of the partitioned QN-ILS
procedure for fluid-structure interaction problems: filtering, Computers & Structures 171, 2016).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from co_sim.component import Vector
    from co_sim.kernel import Integers, Matrix

__all__ = ["Iteration", "agrees", "new_iteration", "next_guess"]

#: A column is left out if less than this part of it is new.
_NEW = 1e-8


class Iteration(NamedTuple):
    """The repetitions of one step, and room to work in; `n` signals, at most `m` repetitions.

    Parameters
    ----------
    guess : ``y``, to be tried next, shape ``(n,)``.
    results, residuals : ``F(y)`` and ``r`` of each repetition so far, shapes ``(m, n)``.
    scale : what residuals are measured by, shape ``(n,)``.
    Q, R : room for the columns of Q, one in each row, and for R, by columns too.
    c : room for the right-hand side and the solution. column : which difference a column of R belongs to.
    """

    guess: Vector
    results: Matrix
    residuals: Matrix
    scale: Vector
    Q: Matrix
    R: Matrix
    c: Vector
    column: Integers


def new_iteration(n: int, m: int) -> Iteration:
    """Return room for `m` repetitions with `n` signals."""
    rank = min(n, m)
    return Iteration(
        np.zeros(n),
        np.zeros((m, n)),
        np.zeros((m, n)),
        np.ones(n),
        np.zeros((rank, n)),
        np.zeros((rank, rank)),
        np.zeros(rank),
        np.zeros(rank, dtype=np.int64),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def agrees(
    row: Vector, fed: Integers, repetition: int, largest: Vector, tolerance: float, iteration: Iteration
) -> bool:
    """Take in the result of a repetition, found in a row at the columns `fed`; tell whether it is the guess.

    Residuals count by the largest magnitude that a signal has had, `largest`, or has now.
    """
    guess, results, residuals, scale = iteration[:4]
    agreed = True
    for j in range(len(fed)):
        result = row[fed[j]]
        residual = result - guess[j]
        scale[j] = max(largest[j], abs(result))
        if scale[j] == 0.0:
            scale[j] = 1.0
        results[repetition, j], residuals[repetition, j] = result, residual
        agreed &= abs(residual) <= tolerance * scale[j]
    return agreed


@njit(cache=True, nogil=True, error_model="numpy")
def next_guess(newest: int, iteration: Iteration) -> None:
    """Set the guess to be tried after the repetition `newest`, counted from 0."""
    guess, results, residuals, scale, Q, R, c, column = iteration
    n = guess.size
    rank = 0
    for j in range(newest, 0, -1):
        if rank == len(Q):
            break
        if _orthonormal(residuals[j], residuals[j - 1], scale, rank, Q, R):
            column[rank] = j
            rank += 1
    for i in range(rank):
        c[i] = 0.0
        for j in range(n):
            c[i] -= Q[i, j] * (residuals[newest, j] / scale[j])
    for i in range(rank - 1, -1, -1):
        for k in range(i + 1, rank):
            c[i] -= R[k, i] * c[k]
        c[i] /= R[i, i]
    for j in range(n):
        guess[j] = results[newest, j]
        for i in range(rank):
            guess[j] += c[i] * (results[column[i], j] - results[column[i] - 1, j])


@njit(error_model="numpy")
def _orthonormal(newer: Vector, older: Vector, scale: Vector, rank: int, Q: Matrix, R: Matrix) -> bool:
    """Make a difference of residuals the next column of Q, by Gram-Schmidt; tell whether it is a new one."""
    q = Q[rank]
    for j in range(q.size):
        q[j] = (newer[j] - older[j]) / scale[j]
    whole = _norm(q)
    R[rank, :rank] = 0.0
    for _ in range(2):  # twice is enough
        for i in range(rank):
            dot = 0.0
            for j in range(q.size):
                dot += Q[i, j] * q[j]
            for j in range(q.size):
                q[j] -= dot * Q[i, j]
            R[rank, i] += dot
    rest = _norm(q)
    if not rest > _NEW * whole:
        return False
    for j in range(q.size):
        q[j] /= rest
    R[rank, rank] = rest
    return True


@njit(error_model="numpy")
def _norm(q: Vector) -> float:
    total = 0.0
    for j in range(q.size):
        total += q[j] * q[j]
    norm: float = np.sqrt(total)
    return norm
