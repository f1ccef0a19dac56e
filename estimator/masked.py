"""The paper's scheme over a log, in one compiled loop that passes over samples which are not usable.

A filter that lacks a measurement predicts and leaves it at that: its innovation counts as zero. The gains
stay those of the steady state, which is not optimal right after a gap and forgotten within the window (15).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.fuzzy import infer
from estimator.identifier import Design, Memory, Work
from estimator.residuals import duel, normalise, window_step

if TYPE_CHECKING:
    from estimator.identifier import Identifier
    from estimator.log import Log

__all__ = ["RowsIdentified", "identify_rows"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RowsIdentified:
    """What an identifier of n filters said at m rows of a log.

    Parameters
    ----------
    E : (m, n) normalised moving rms of the residuals (15). probabilities : (m, n) fuzzy probabilities.
    usable : (m,) share of the window's samples on which E rests; at the start the window is not full.
    """

    E: Array
    probabilities: Array
    usable: Array


class _Bank(NamedTuple):
    """Matrices of n filters with the filter as last index, so that one instruction serves several of them.

    F (s, s, n), H (m, s, n), K (s, m, n).
    """

    F: Array
    H: Array
    K: Array


@njit(cache=True, nogil=True, error_model="numpy")
def _add_products(M: Array, x: Array, sign: float, y: Array) -> None:  # pragma: no cover - compiled
    """Add `sign` times the product of M (rows, s, n) and x (s, n) to y (rows, n), filter by filter."""
    for j in range(y.shape[0]):
        for k in range(x.shape[0]):
            for i in range(y.shape[1]):
                y[j, i] += sign * M[j, k, i] * x[k, i]


@njit(cache=True, nogil=True, error_model="numpy")
def _masked_bank_step(  # pragma: no cover - compiled
    bank: _Bank, z: Array, usable: Mask, x: Array, prediction: Array, e: Array
) -> None:
    """Advance x (s, n) by one sample z (m,); writes the innovations e (m, n), zero where not usable."""
    prediction[:] = 0.0
    _add_products(bank.F, x, 1.0, prediction)
    for j in range(z.shape[0]):
        e[j] = z[j]
    _add_products(bank.H, prediction, -1.0, e)
    for j in range(z.shape[0]):
        if not usable[j]:
            e[j] = 0.0
    x[:] = prediction
    _add_products(bank.K, e, 1.0, x)


@njit(cache=True, nogil=True, error_model="numpy")
def _weighted_squares(  # pragma: no cover - compiled
    weights: Array, usable: Mask, e: Array, squares: Array
) -> None:
    """Write the weighted squares of e (m, n) and whether they count into `squares` (n + 1,)."""
    squares[:] = 0.0
    for j in range(e.shape[0]):
        if not usable[j] and weights[j] > 0.0:
            return
    squares[-1] = 1.0
    for j in range(e.shape[0]):
        for i in range(e.shape[1]):
            squares[i] += weights[j] * e[j, i] * e[j, i]


@njit(cache=True, nogil=True, error_model="numpy")
def _identify_rows(  # pragma: no cover - compiled
    bank: _Bank, design: Design, memory: Memory, work: Work, z: Array, usable: Mask, rows: Indices,
    E: Array, p: Array, share: Array,
) -> None:  # fmt: skip
    n, m = E.shape[1], z.shape[1]
    squares, e, prediction = np.empty(n + 1), np.empty((m, n)), np.empty_like(memory.x)
    row = 0
    for t in range(z.shape[0]):
        if row == rows.shape[0]:
            return
        _masked_bank_step(bank, z[t], usable[t], memory.x, prediction, e)
        _weighted_squares(design.weights, usable[t], e, squares)
        window_step(squares, t, memory.history, memory.front, memory.mean)
        if t != rows[row]:
            continue
        normalise(memory.mean[:n], E[row])
        duel(E[row], work.D)
        infer(design.fuzzy, work.D, work.strength, work.area, p[row])
        share[row] = memory.mean[n] * min(1.0, (t + 1) / memory.history.shape[0])
        row += 1


def identify_rows(identifier: Identifier, log: Log, rows: Indices) -> RowsIdentified:
    """Return what an identifier says at the samples `rows` (m,), rising, of a log from its start.

    A sample counts in (15) if every measurement that has a weight is usable.
    """
    n = len(identifier.bank.names)
    design, work = identifier.design, identifier.new_work()
    bank = _Bank(*(np.ascontiguousarray(np.moveaxis(M, 0, -1)) for M in (design.F, design.H, design.K)))
    # One more column than filters: whether the sample counted.
    memory = Memory(
        np.zeros((design.F.shape[1], n)),
        np.zeros((identifier.window, n + 1)),
        np.zeros(n + 1),
        np.zeros(n + 1),
    )
    E, p, share = np.empty((len(rows), n)), np.empty((len(rows), n)), np.empty(len(rows))
    usable = np.ascontiguousarray(log.usable)
    _identify_rows(bank, design, memory, work, log.measurements, usable, np.asarray(rows), E, p, share)
    return RowsIdentified(E, p, share)
