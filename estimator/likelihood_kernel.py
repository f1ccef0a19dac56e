"""The compiled steps of `estimator.likelihood`: Kalman filters with their likelihoods.

With ``x, P`` the state predicted for a sample and its covariance, a step is

    e = z - H x,  S = H P H' + R = L L',  w = L^-1 e,  K = P H' S^-1,
    log p = -(w'w + log det S + m log 2 pi)/2,  x <- F (x + K e),
    P <- F [(I - K H) P (I - K H)' + K R K'] F' + Q        (Joseph's form).

The last line is the costly one. It is left out for a filter whose P has reached its steady value, and taken
up again where a sample is missing. A sample that is not usable enters nothing, each measurement for itself.
Filters with fewer states are padded with zeros, which stay zero.

Array shapes: c speed cells, n filters, s states, m measurements, T samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.residuals import window_step

__all__ = ["Design", "Memory", "Work", "likelihood_run", "likelihood_step"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Design(NamedTuple):
    """What `likelihood_step` reads.

    `F` (c, n, s, s), `H` (c, n, m, s), `Q` (c, n, s, s), `R` (m, m), `start` and `limit` (c, n, s) variances;
    where `steady` (c, n) also the steady `P` (c, n, s, s), `PH` P H' and `K` (c, n, s, m), `whitener` L^-1
    (c, n, m, m) and `log_det` S (c, n). A filter is taken for steady when log det S is within `tolerance` of
    that, and each entry of P H' within `tolerance` times its `scale` (c, n, s, m), the standard deviations.
    """

    F: Array
    H: Array
    Q: Array
    R: Array
    start: Array
    limit: Array
    steady: Mask
    P: Array
    PH: Array
    scale: Array
    K: Array
    whitener: Array
    log_det: Array
    tolerance: float


class Memory(NamedTuple):
    """What `likelihood_step` keeps from sample to sample.

    `x` (n, s) and `P` (n, s, s) are predictions for the coming sample. Where `moving` (n,) is false, P is the
    steady one, whatever stands here. `cell` (1,) is the speed cell of the last sample.
    """

    x: Array
    P: Array
    K: Array
    whitener: Array
    log_det: Array
    moving: Mask
    cell: Indices


class Work(NamedTuple):
    """Room that `likelihood_step` needs: e (m,), x (s,), PH (s, m), S (m, m), A, B and C (s, s)."""

    e: Array
    x: Array
    PH: Array
    S: Array
    A: Array
    B: Array
    C: Array


@njit(cache=True, error_model="numpy")
def _factor(S: Array, whitener: Array) -> float:  # pragma: no cover - compiled
    """Write the inverse of the Cholesky factor of S into `whitener`; return log det S. S is lost.

    The factor is a small triangle, and each sample is multiplied by its inverse.
    """
    m = S.shape[0]
    log_det = 0.0
    for j in range(m):
        for k in range(j):
            S[j, j] -= S[j, k] * S[j, k]
        S[j, j] = math.sqrt(S[j, j])
        log_det += 2.0 * math.log(S[j, j])
        for i in range(j + 1, m):
            for k in range(j):
                S[i, j] -= S[i, k] * S[j, k]
            S[i, j] /= S[j, j]
    for j in range(m):
        for i in range(m):
            total = 1.0 if i == j else 0.0
            for k in range(j, i):
                total -= S[i, k] * whitener[k, j]
            whitener[i, j] = total / S[i, i] if i >= j else 0.0
    return log_det


@njit(cache=True, error_model="numpy")
def _gain(  # pragma: no cover - compiled
    P: Array, H: Array, R: Array, usable: Mask, PH: Array, S: Array, K: Array, whitener: Array
) -> float:
    """Write gain and whitener of the usable measurements for the predicted covariance; return log det S."""
    s, m = K.shape
    for j in range(s):
        for a in range(m):
            total = 0.0
            for k in range(s):
                total += P[j, k] * H[a, k]
            PH[j, a] = total if usable[a] else 0.0
    for a in range(m):
        for b in range(m):
            total = R[a, b]
            for k in range(s):
                total += H[a, k] * PH[k, b]
            # What is not usable is a measurement of unit variance that has nothing to do with the others.
            S[a, b] = total if usable[a] and usable[b] else (1.0 if a == b else 0.0)
    log_det = _factor(S, whitener)
    for j in range(s):
        for a in range(m):
            K[j, a] = 0.0
        for b in range(m):
            total = 0.0
            for a in range(b + 1):
                total += whitener[b, a] * PH[j, a]
            for a in range(b + 1):
                K[j, a] += total * whitener[b, a]
    return log_det


@njit(cache=True, error_model="numpy")
def _congruence(A: Array, P: Array, out: Array, room: Array) -> None:  # pragma: no cover - compiled
    """Write A P A' into `out`, symmetric to the last bit, for a symmetric P."""
    s = A.shape[0]
    for i in range(s):
        for j in range(s):
            total = 0.0
            for k in range(s):
                total += A[i, k] * P[k, j]
            room[i, j] = total
    for i in range(s):
        for j in range(i + 1):
            total = 0.0
            for k in range(s):
                total += room[i, k] * A[j, k]
            out[i, j] = total
            out[j, i] = total


@njit(cache=True, error_model="numpy")
def _move_covariance(  # pragma: no cover - compiled
    P: Array, K: Array, F: Array, H: Array, Q: Array, R: Array, work: Work
) -> None:
    """Take the predicted covariance over a sample with gain K to the next prediction, by Joseph's form."""
    s, m = K.shape
    A, B = work.A, work.B
    for i in range(s):
        for j in range(s):
            total = 1.0 if i == j else 0.0
            for a in range(m):
                total -= K[i, a] * H[a, j]
            A[i, j] = total
    _congruence(A, P, B, work.C)
    for i in range(s):
        for j in range(i + 1):
            total = B[i, j]
            for a in range(m):
                for b in range(m):
                    total += K[i, a] * R[a, b] * K[j, b]
            B[i, j] = total
            B[j, i] = total
    _congruence(F, B, P, work.C)
    for i in range(s):
        for j in range(s):
            P[i, j] += Q[i, j]


@njit(cache=True, error_model="numpy")
def _reached(
    design: Design, c: int, i: int, PH: Array, log_det: float
) -> bool:  # pragma: no cover - compiled
    """Return whether filter `i` weighs its measurements as it will in steady state.

    States that the sensors see through others only may still be on their way.
    """
    if not abs(log_det - design.log_det[c, i]) <= design.tolerance:
        return False
    PH_steady, scale = design.PH[c, i], design.scale[c, i]
    for j in range(PH.shape[0]):
        for a in range(PH.shape[1]):
            if not abs(PH[j, a] - PH_steady[j, a]) <= design.tolerance * scale[j, a]:
                return False
    return True


@njit(cache=True, error_model="numpy")
def _enter_steady(design: Design, memory: Memory, c: int, i: int) -> None:  # pragma: no cover - compiled
    memory.moving[i] = False
    memory.K[i] = design.K[c, i]
    memory.whitener[i] = design.whitener[c, i]
    memory.log_det[i] = design.log_det[c, i]


@njit(cache=True, error_model="numpy")
def _enter_cell(design: Design, memory: Memory, c: int) -> None:  # pragma: no cover - compiled
    """Take the steady gains of another speed cell; a covariance that moves goes on from where it is."""
    before = memory.cell[0]
    memory.cell[0] = c
    for i in range(memory.x.shape[0]):
        if memory.moving[i]:
            continue
        if design.steady[c, i]:
            _enter_steady(design, memory, c, i)
        else:
            memory.P[i] = design.P[before, i]
            memory.moving[i] = True


@njit(cache=True, error_model="numpy")
def _lost(P: Array, limit: Array) -> bool:  # pragma: no cover - compiled
    """Return whether a variance is beyond its limit, or not a number."""
    for j in range(P.shape[0]):  # noqa: SIM110 - numba has no generators
        if not P[j, j] <= limit[j]:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _restart(design: Design, memory: Memory, c: int, i: int) -> None:  # pragma: no cover - compiled
    """Let filter `i` know nothing."""
    memory.x[i] = 0.0
    memory.P[i] = 0.0
    for j in range(memory.x.shape[1]):
        memory.P[i, j, j] = design.start[c, i, j]
    memory.moving[i] = True


@njit(cache=True, error_model="numpy")
def _move(  # pragma: no cover - compiled
    design: Design, memory: Memory, work: Work, c: int, i: int, usable: Mask, complete: bool
) -> None:
    """Find the gain of filter `i` for this sample, and its covariance for the next one."""
    if not memory.moving[i]:
        memory.P[i] = design.P[c, i]
        memory.moving[i] = True
    P, K = memory.P[i], memory.K[i]
    H = design.H[c, i]
    if _lost(P, design.limit[c, i]):
        _restart(design, memory, c, i)
    memory.log_det[i] = _gain(P, H, design.R, usable, work.PH, work.S, K, memory.whitener[i])
    if complete and design.steady[c, i] and _reached(design, c, i, work.PH, memory.log_det[i]):
        _enter_steady(design, memory, c, i)
    else:
        _move_covariance(P, K, design.F[c, i], H, design.Q[c, i], design.R, work)


@njit(cache=True, error_model="numpy")
def _advance(  # pragma: no cover - compiled
    F: Array,
    H: Array,
    K: Array,
    whitener: Array,
    log_det: Array,
    z: Array,
    usable: Mask,
    first: int,
    end: int,
    x: Array,
    e: Array,
    updated: Array,
    nis: Array,
    loss: Array,
) -> None:
    """Take the predictions x (n, s) over samples with the gains as they are, and count the likelihood."""
    n, s = x.shape
    m = z.shape[1]
    for t in range(first, end):
        for i in range(n):
            for a in range(m):
                total = z[t, a]
                for k in range(s):
                    total -= H[i, a, k] * x[i, k]
                e[a] = total if usable[t, a] else 0.0
            squares = 0.0
            for a in range(m):
                white = 0.0
                for b in range(a + 1):
                    white += whitener[i, a, b] * e[b]
                squares += white * white
            nis[i] += squares
            loss[i] += squares + log_det[i]
            for j in range(s):
                total = x[i, j]
                for a in range(m):
                    total += K[i, j, a] * e[a]
                updated[j] = total
            for j in range(s):
                total = 0.0
                for k in range(s):
                    total += F[i, j, k] * updated[k]
                x[i, j] = total


@njit(cache=True, error_model="numpy")
def _complete(usable: Mask, t: int) -> bool:  # pragma: no cover - compiled
    for a in range(usable.shape[1]):  # noqa: SIM110 - numba has no generators
        if not usable[t, a]:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _stretch(  # pragma: no cover - compiled
    usable: Mask, cells: Indices, first: int, end: int, moving: Mask
) -> int:
    """Return up to where, from `first` on, all gains stay as they are; at least one sample."""
    for i in range(moving.shape[0]):
        if moving[i]:
            return first + 1
    t = first
    while t < end and cells[t] == cells[first] and _complete(usable, t):
        t += 1
    return max(t, first + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def likelihood_step(  # pragma: no cover - compiled
    design: Design,
    memory: Memory,
    work: Work,
    z: Array,
    usable: Mask,
    cells: Indices,
    first: int,
    end: int,
    nis: Array,
    loss: Array,
) -> int:
    """Advance all filters by one or more of the samples z (T, m) from `first` to `end`; return how far.

    Adds ``w'w`` to `nis` (n,) and ``w'w + log det S`` to `loss` (n,). Where `usable` (T, m) is false, z
    counts for nothing. `cells` (T,) are the speed cells.
    """
    c = cells[first]
    if c != memory.cell[0]:
        _enter_cell(design, memory, c)
    end = _stretch(usable, cells, first, end, memory.moving)
    complete = _complete(usable, first)
    for i in range(memory.x.shape[0]):
        if memory.moving[i] or not complete:
            _move(design, memory, work, c, i, usable[first], complete)
    _advance(
        design.F[c],
        design.H[c],
        memory.K,
        memory.whitener,
        memory.log_det,
        z,
        usable,
        first,
        end,
        memory.x,
        work.e,
        work.x,
        nis,
        loss,
    )
    return end


@njit(cache=True, nogil=True, error_model="numpy")
def likelihood_run(  # pragma: no cover - compiled
    design: Design,
    memory: Memory,
    work: Work,
    z: Array,
    usable: Mask,
    cells: Indices,
    every: int,
    history: Array,
    sums: Array,
) -> None:
    """Write the moving means of nis, loss and number of measurements after each `every` samples.

    `history` (window, 2 n + 1) is the room of `window_step` in rows of `sums` (T // every, 2 n + 1), whose
    columns are those three.
    """
    n = memory.x.shape[0]
    nis, loss = np.zeros(n), np.zeros(n)
    front, block = np.zeros(2 * n + 1), np.zeros(2 * n + 1)
    for row in range(sums.shape[0]):
        nis[:] = 0.0
        loss[:] = 0.0
        t, end = row * every, (row + 1) * every
        while t < end:
            t = likelihood_step(design, memory, work, z, usable, cells, t, end, nis, loss)
        block[:n] = nis
        block[n : 2 * n] = loss
        block[2 * n] = np.sum(usable[row * every : end])
        window_step(block, row, history, front, sums[row])
