"""The step of a filter's slow states, and of its covariance, as products of rows.

A step is S M S: S moves the slow states in half the time with the fast ones held, M the fast states in all
of it with the slow ones going on as they did in the first half.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.motion import L_L, L_R, N_F, N_X, PSI, THETA, P, Q, R, U, Y
from estimator.adhesion.rows import put, row, transpose

if TYPE_CHECKING:
    from estimator.adhesion.motion import Vehicle

__all__ = ["Slow", "add_fast_noise", "drift", "move_slow", "slow_transition", "spread"]

Array = NDArray[np.float64]


class Slow(NamedTuple):
    """Half a step of the slow states: its length h, what a creep twists the axle by, the track's decays."""

    h: float
    w_L: float
    w_R: float
    e_p: float
    e_q: float
    c_pq: float


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def slow_transition(  # pragma: no cover - compiled
    car: Vehicle, held: bool, v: float, h: float, over_track: Array
) -> Slow:
    """Return what moves the slow states in h with the fast ones held."""
    turn = 0.0 if held else h * v
    return Slow(h, -turn / car.r_L, turn / car.r_R, over_track[1], over_track[2], over_track[3])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def move_slow(slow: Slow, x: Array) -> None:  # pragma: no cover - compiled
    """Advance the slow states in x (12,) with the fast ones held."""
    h, w_L, w_R, e_p, e_q, c_pq = slow
    x[PSI] += h * x[R]
    x[Y] += h * x[U] - (e_q - 1.0) * x[Q] - c_pq * x[P]
    x[THETA] += w_L * x[L_L] + w_R * x[L_R] + (w_L + w_R)
    x[Q] = e_q * x[Q] + c_pq * x[P]
    x[P] *= e_p


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _slow_rows(slow: Slow, A: Array, i: int) -> None:  # pragma: no cover - compiled
    """Replace the twelve rows of A from row i on, X, by S X with the transition S of the slow states."""
    h, w_L, w_R, e_p, e_q, c_pq = slow
    p, q = row(A, i + P), row(A, i + Q)
    put(A, i + PSI, row(A, i + PSI) + h * row(A, i + R))
    put(A, i + Y, row(A, i + Y) + (h * row(A, i + U) - (e_q - 1.0) * q - c_pq * p))
    put(A, i + THETA, row(A, i + THETA) + (w_L * row(A, i + L_L) + w_R * row(A, i + L_R)))
    put(A, i + Q, e_q * q + c_pq * p)
    put(A, i + P, e_p * p)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _fast_rows(M: Array, A: Array, i: int) -> None:  # pragma: no cover - compiled
    """Replace the first four of the twelve rows of A from row i on, X, by M X."""
    first = row(A, i)
    a, b, c, d = M[0, 0] * first, M[1, 0] * first, M[2, 0] * first, M[3, 0] * first
    for k in range(1, N_X):
        other = row(A, i + k)
        a, b, c, d = a + M[0, k] * other, b + M[1, k] * other, c + M[2, k] * other, d + M[3, k] * other
    put(A, i, a)
    put(A, i + 1, b)
    put(A, i + 2, c)
    put(A, i + 3, d)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def spread(slow: Slow, M: Array, C: Array, work: Array) -> None:  # pragma: no cover - compiled
    """Replace C by T C T' with T = S M S: S of the slow states, the first four rows of M of the fast ones.

    The products are of rows only, one before and one after transposing. What rounding leaves of a
    difference between the triangles is levelled out. `work` (5, 4, 12) begins with M; the rest is lost.
    """
    turned = N_F
    _slow_rows(slow, C, 0)
    _fast_rows(M, C, 0)
    _slow_rows(slow, C, 0)
    transpose(C, 0, work, turned)
    _slow_rows(slow, work, turned)
    _fast_rows(M, work, turned)
    _slow_rows(slow, work, turned)
    transpose(work, turned, C, 0)
    for i in range(N_X):
        put(C, i, 0.5 * (row(C, i) + row(work, turned + i)))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def drift(slow: Slow, J: Array, G: Array) -> None:  # pragma: no cover - compiled
    """Write by how much a slow step has changed the rates of the fast states, (4, 12).

    As a matrix over the states behind that step, J (1 - S^-1); J are the rates' partials.
    """
    h, w_L, w_R, e_p, e_q, c_pq = slow
    of_p, of_q = c_pq / (e_p * e_q), 1.0 - 1.0 / e_q
    for i in range(N_F):
        for j in range(N_X):
            G[i, j] = 0.0
        track = J[i, Q] - J[i, Y]
        G[i, U], G[i, R] = h * J[i, Y], h * J[i, PSI]
        G[i, L_L], G[i, L_R] = w_L * J[i, THETA], w_R * J[i, THETA]
        G[i, P], G[i, Q] = track * of_p, track * of_q


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add(variance: float, i: int, j: int, share: float, C: Array) -> None:  # pragma: no cover - compiled
    """Add a variance of state i, and of state j in which it stands with that share."""
    C[i, i] += variance
    C[i, j] += variance * share
    C[j, i] += variance * share
    C[j, j] += variance * share * share


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def add_fast_noise(  # pragma: no cover - compiled
    slow: Slow, u: float, r: float, both: float, right: float, C: Array
) -> None:
    """Add variances that come in before the fast step, to C before the slow one.

    Of the lateral velocity, the yaw rate, the common creep and that of the right wheel. The fast step damps
    them as it damps the states themselves; behind it they would stand undamped: at 2 m/s an acceleration of
    1e4 1/s times that of the velocity. What the slow step makes of them is taken off beforehand.
    """
    _add(u, U, Y, -slow.h, C)
    _add(r, R, PSI, -slow.h, C)
    _add(right, L_R, THETA, -slow.w_R, C)
    _add(both, L_R, THETA, -(slow.w_L + slow.w_R), C)
    C[L_L, L_L] += both
    C[L_L, L_R] += both
    C[L_R, L_L] += both
    twist = both * (slow.w_L + slow.w_R)
    C[L_L, THETA] -= twist
    C[THETA, L_L] -= twist
