"""The paper's scheme over a log, in one compiled loop that passes over samples which are not usable.

A filter that lacks a measurement predicts and leaves it at that: its innovation counts as zero. The gains
stay those of the steady state, which is not optimal right after a gap and forgotten within the window (15).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

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


@njit(cache=True, nogil=True, error_model="numpy")
def _masked_bank_step(  # pragma: no cover - compiled
    F: Array, H: Array, K: Array, z: Array, usable: Mask, x: Array, prediction: Array, e: Array
) -> None:
    """Advance all filters as `estimator.bank.bank_step`, with innovations of zero where not usable."""
    n, s = x.shape
    m = z.shape[0]
    for i in range(n):
        for j in range(s):
            total = 0.0
            for k in range(s):
                total += F[i, j, k] * x[i, k]
            prediction[i, j] = total
        for j in range(m):
            total = 0.0
            if usable[j]:
                total = z[j]
                for k in range(s):
                    total -= H[i, j, k] * prediction[i, k]
            e[i, j] = total
        for j in range(s):
            total = prediction[i, j]
            for k in range(m):
                total += K[i, j, k] * e[i, k]
            x[i, j] = total


@njit(cache=True, nogil=True, error_model="numpy")
def _identify_rows(  # pragma: no cover - compiled
    design: Design,
    memory: Memory,
    work: Work,
    z: Array,
    usable: Mask,
    rows: Indices,
    E: Array,
    p: Array,
    share: Array,
) -> None:
    n, m = E.shape[1], z.shape[1]
    squares = np.empty(n + 1)
    e = np.empty((n, m))
    row = 0
    for t in range(z.shape[0]):
        if row == rows.shape[0]:
            return
        _masked_bank_step(design.F, design.H, design.K, z[t], usable[t], memory.x, work.prediction, e)
        counted = True
        for j in range(m):
            counted = counted and (usable[t, j] or design.weights[j] == 0.0)
        for i in range(n):
            squares[i] = 0.0
            for j in range(m):
                if counted:
                    squares[i] += design.weights[j] * e[i, j] * e[i, j]
        squares[n] = 1.0 if counted else 0.0
        window_step(squares, t, memory.history, memory.front, memory.mean)
        if t != rows[row]:
            continue
        normalise(memory.mean[:n], E[row])
        duel(E[row], work.D)
        infer(
            work.D,
            design.corners,
            design.bounds,
            design.clauses,
            design.conclusions,
            design.shapes,
            design.grid,
            work.strength,
            work.area,
            p[row],
        )
        share[row] = memory.mean[n] * min(1.0, (t + 1) / memory.history.shape[0])
        row += 1


def identify_rows(identifier: Identifier, log: Log, rows: Indices) -> RowsIdentified:
    """Return what an identifier says at the samples `rows` (m,), rising, of a log from its start.

    A sample counts in (15) if every measurement that has a weight is usable.
    """
    n = len(identifier.bank.names)
    design, work = identifier.design, identifier.new_work()
    x = identifier.new_memory().x
    # One more column than filters: whether the sample counted.
    memory = Memory(x, np.zeros((identifier.window, n + 1)), np.zeros(n + 1), np.zeros(n + 1))
    E, p, share = np.empty((len(rows), n)), np.empty((len(rows), n)), np.empty(len(rows))
    usable = np.ascontiguousarray(log.usable)
    _identify_rows(design, memory, work, log.measurements, usable, np.asarray(rows), E, p, share)
    return RowsIdentified(E, p, share)
