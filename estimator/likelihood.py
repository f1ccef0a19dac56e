"""A bank of Kalman filters that says how likely the samples are under each of them.

The equations, and what is left out in steady state, are in `estimator.likelihood_kernel`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.likelihood_kernel import Design, Memory, Work, likelihood_run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.recursive import RecursiveFilter

__all__ = ["Evidence", "LikelihoodBank"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: A filter starts anew when a variance is this many times its start and its steady value: a long gap in the
#: samples lets the covariance of an unstable model grow without bound.
_LOST = 1e3


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the samples say about n filters, in rows of `every` samples, over a moving window each.

    Parameters
    ----------
    log_likelihood : (rows, n) of the innovations in the window, in the units of the measurements.
    nis : (rows, n) normalised innovations squared, summed over the window. Under the true model chi-square
        distributed with `measurements` degrees of freedom.
    measurements : (rows,) usable measurements in the window.
    """

    log_likelihood: Array
    nis: Array
    measurements: Array


class LikelihoodBank:
    """Filters over the same measurements, for one speed or scheduled over cells of speed.

    Parameters
    ----------
    cells : for each speed cell the filters, in the order in which all results list them.
    tolerance : within which a filter counts as steady, relative to the standard deviations of states and
        innovations; 0 moves all covariances for ever. The default changes the log-likelihood of a second's
        samples of the filter's own model by less than 0.1.

    Raises
    ------
    ValueError
        If there are no filters, or those of a cell differ from the others' in names, states or sensors.
    """

    def __init__(self, *cells: Sequence[RecursiveFilter], tolerance: float = 3e-3) -> None:
        _check_cells(cells)
        self.cells = tuple(tuple(filters) for filters in cells)
        self.design = _stack(self.cells, tolerance)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the filters."""
        return tuple(f.name for f in self.cells[0])

    def new_memory(self, cell: int = 0) -> Memory:
        """Return the memory of a bank that has seen no sample and begins in that speed cell."""
        _, n, s, m = self.design.K.shape
        start = self.design.start[cell]
        return Memory(
            x=np.zeros((n, s)),
            P=start[:, :, None] * np.eye(s),
            K=np.zeros((n, s, m)),
            whitener=np.zeros((n, m, m)),
            log_det=np.zeros(n),
            moving=np.ones(n, dtype=np.bool_),
            cell=np.array([cell], dtype=np.int64),
        )

    def new_work(self) -> Work:
        """Return room for a step."""
        _, _, s, m = self.design.K.shape
        square = (s, s)
        return Work(
            np.empty(m), np.empty(s), np.empty((s, m)), np.empty((m, m)),
            np.empty(square), np.empty(square), np.empty(square),
        )  # fmt: skip

    def run(
        self,
        z: Array,
        *,
        usable: Mask | None = None,
        cells: Indices | None = None,
        every: int = 1,
        window: int = 1,
    ) -> Evidence:
        """Return the evidence of the samples z (T, m), the filters knowing nothing at first.

        Parameters
        ----------
        z : samples. What is not finite must not be usable.
        usable : (T, m), all if left out. cells : (T,) speed cell of each sample, the first if left out.
        every : samples of a row of the result; what is left over at the end is in none.
        window : length of the moving window in rows. The first rows have what there is.

        Raises
        ------
        ValueError
            If shapes, cells or counts do not fit.
        """
        z, usable, cells = self._checked(z, usable, cells)
        if every < 1 or window < 1:
            raise ValueError(
                f"likelihood bank: got every = {every} and window = {window}, expected both >= 1"
            )
        n = len(self.names)
        sums = np.empty((len(z) // every, 2 * n + 1))
        memory = self.new_memory(int(cells[0]) if len(cells) else 0)
        history = np.zeros((window, 2 * n + 1))
        likelihood_run(self.design, memory, self.new_work(), z, usable, cells, every, history, sums)
        sums *= np.minimum(np.arange(1, len(sums) + 1), window)[:, None]
        nis, loss, measurements = sums[:, :n], sums[:, n : 2 * n], sums[:, 2 * n]
        return Evidence(-0.5 * (loss + measurements[:, None] * math.log(2.0 * math.pi)), nis, measurements)

    def _checked(self, z: Array, usable: Mask | None, cells: Indices | None) -> tuple[Array, Mask, Indices]:
        m, count = self.design.H.shape[2], len(self.cells)
        z = np.ascontiguousarray(z, dtype=np.float64)
        if z.ndim != 2 or z.shape[1] != m:
            raise ValueError(
                f"likelihood bank: got samples of shape {z.shape}, expected (T, {m}); check the sensors"
            )
        mask = np.ones(z.shape, np.bool_) if usable is None else np.ascontiguousarray(usable, dtype=np.bool_)
        which = np.zeros(len(z), np.int64) if cells is None else np.ascontiguousarray(cells, dtype=np.int64)
        if mask.shape != z.shape or which.shape != (len(z),):
            raise ValueError(
                f"likelihood bank: got usable of shape {mask.shape} and cells of shape {which.shape} for "
                f"samples of shape {z.shape}, expected a flag for each measurement and a cell for each sample"
            )
        if len(which) and not (which.min() >= 0 and which.max() < count):
            raise ValueError(
                f"likelihood bank: got speed cells {which.min()} to {which.max()}, expected 0 to "
                f"{count - 1}; design filters for every speed in the record"
            )
        if not np.isfinite(z[mask]).all():
            raise ValueError(
                "likelihood bank: got a usable sample that is not finite, expected finite ones; "
                "mark it unusable"
            )
        return z, mask, which


def _check_cells(cells: Sequence[Sequence[RecursiveFilter]]) -> None:
    if not cells or not cells[0]:
        raise ValueError("likelihood bank: got no filters, expected at least one; design one first")
    first = [(f.name, f.states, f.H.shape) for f in cells[0]]
    if len({f.H.shape[0] for f in cells[0]}) > 1 or any(
        not np.array_equal(f.R, cells[0][0].R) for filters in cells for f in filters
    ):
        raise ValueError(
            "likelihood bank: got filters of different sensors, expected one set; design all filters for it"
        )
    for c, filters in enumerate(cells):
        if [(f.name, f.states, f.H.shape) for f in filters] != first:
            raise ValueError(
                f"likelihood bank: got other names or states in speed cell {c} than in the first, expected "
                f"the same filters in the same order; design every cell from the same hypotheses"
            )


def _stack(cells: tuple[tuple[RecursiveFilter, ...], ...], tolerance: float) -> Design:
    """Return the filters as arrays, padded to the greatest number of states."""
    c, n, m = len(cells), len(cells[0]), cells[0][0].H.shape[0]
    s = max(len(f.F) for f in cells[0])
    F, Q, P = (np.zeros((c, n, s, s)) for _ in range(3))
    PH, scale, K = (np.zeros((c, n, s, m)) for _ in range(3))
    H, whitener = np.zeros((c, n, m, s)), np.zeros((c, n, m, m))
    log_det, steady = np.zeros((c, n)), np.zeros((c, n), dtype=np.bool_)
    start, limit = np.zeros((c, n, s)), np.zeros((c, n, s))
    for k, filters in enumerate(cells):
        for i, f in enumerate(filters):
            r = len(f.F)
            F[k, i, :r, :r], H[k, i, :, :r], Q[k, i, :r, :r] = f.F, f.H, f.Q
            start[k, i, :r], limit[k, i, :r] = f.start, _LOST * f.start
            if f.P is None:
                continue
            S = f.H @ f.P @ f.H.T + f.R
            L = np.linalg.cholesky(S)
            steady[k, i], P[k, i, :r, :r], PH[k, i, :r] = True, f.P, f.P @ f.H.T
            scale[k, i, :r] = np.sqrt(np.outer(np.diag(f.P), np.diag(S)))
            K[k, i, :r] = linalg.cho_solve((L, True), f.H @ f.P).T
            whitener[k, i] = linalg.solve_triangular(L, np.eye(m), lower=True)
            log_det[k, i] = 2.0 * np.sum(np.log(np.diag(L)))
            limit[k, i, :r] = np.maximum(limit[k, i, :r], _LOST * np.diag(f.P))
    R = cells[0][0].R
    return Design(F, H, Q, R, start, limit, steady, P, PH, scale, K, whitener, log_det, tolerance)
