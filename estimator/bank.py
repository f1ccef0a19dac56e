"""A bank of steady-state Kalman filters run side by side in compiled code.

The filters may have different numbers of states: shorter ones are padded with zeros, which stay zero.
Array shapes: n filters, s states (the greatest of the bank), m measurements, T samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.kalman import LinearFilter

__all__ = ["FilterBank", "bank_step"]

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def bank_step(  # pragma: no cover - compiled
    F: Array, H: Array, K: Array, z: Array, x: Array, prediction: Array, e: Array
) -> None:
    """Advance all filters by one sample `z` (m,): writes x (n, s) and the innovations e (n, m).

    `prediction` (n, s) is work space. Loops, because matrix calls cost more than 5-state products.
    """
    n, s = x.shape
    m = z.shape[0]
    for i in range(n):
        for j in range(s):
            total = 0.0
            for k in range(s):
                total += F[i, j, k] * x[i, k]
            prediction[i, j] = total
        for j in range(m):
            total = z[j]
            for k in range(s):
                total -= H[i, j, k] * prediction[i, k]
            e[i, j] = total
        for j in range(s):
            total = prediction[i, j]
            for k in range(m):
                total += K[i, j, k] * e[i, k]
            x[i, j] = total


@njit(cache=True, error_model="numpy")
def _bank_run(  # pragma: no cover - compiled
    F: Array, H: Array, K: Array, z: Array, x: Array, e: Array
) -> None:
    """Run `bank_step` over the samples z (T, m) into e (T, n, m)."""
    prediction = np.empty_like(x)
    for t in range(z.shape[0]):
        bank_step(F, H, K, z[t], x, prediction, e[t])


class FilterBank:
    """Any number of filters over the same measurements.

    Parameters
    ----------
    filters : the filters, in the order in which all results list them.
    """

    def __init__(self, filters: Sequence[LinearFilter]) -> None:
        if not filters:
            raise ValueError("filter bank: got no filters, expected at least one; design one first")
        widths = {f.H.shape[0] for f in filters}
        if len(widths) > 1:
            raise ValueError(
                f"filter bank: got filters with {sorted(widths)} measurements, expected one number; "
                f"design all filters for the same sensors"
            )
        self.filters = tuple(filters)
        n, m = len(filters), widths.pop()
        s = max(f.F.shape[0] for f in filters)
        self.F = np.zeros((n, s, s))
        self.H = np.zeros((n, m, s))
        self.K = np.zeros((n, s, m))
        for i, f in enumerate(filters):
            r = f.F.shape[0]
            self.F[i, :r, :r], self.H[i, :, :r], self.K[i, :r] = f.F, f.H, f.K

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the filters."""
        return tuple(f.name for f in self.filters)

    def innovations(self, z: Array) -> Array:
        """Return the innovations (T, n, m) of all filters, started at rest, over the samples z (T, m)."""
        n, m, s = self.H.shape
        z = np.ascontiguousarray(z, dtype=np.float64)
        if z.ndim != 2 or z.shape[1] != m:
            raise ValueError(
                f"filter bank: got samples of shape {z.shape}, expected (T, {m}); check the sensors"
            )
        e = np.empty((z.shape[0], n, m))
        _bank_run(self.F, self.H, self.K, z, np.zeros((n, s)), e)
        return e
