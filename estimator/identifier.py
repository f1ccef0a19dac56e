"""From sensor samples to the probability of each operating point, one sample at a time.

bank -> innovations -> moving mean squares -> (15) -> each against its best rival -> fuzzy system,
all in one compiled step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.bank import bank_step
from estimator.fuzzy import infer
from estimator.residuals import duel, normalise, window_step

if TYPE_CHECKING:
    from estimator.bank import FilterBank
    from estimator.fuzzy import FuzzySystem

__all__ = ["Identification", "Identifier"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Identification:
    """What an identifier said over T samples with n filters and m measurements.

    Parameters
    ----------
    innovations : (T, n, m), in the units of the measurements.
    E : (T, n) normalised moving rms of the residuals (15).
    probabilities : (T, n) fuzzy probability of each filter's operating point.
    """

    innovations: Array
    E: Array
    probabilities: Array


@njit(cache=True, error_model="numpy")
def _identifier_step(  # pragma: no cover - compiled
    bank: tuple[Array, Array, Array],
    fuzzy: tuple[Array, Array, Indices, Indices, Array, Array],
    weights: Array,
    z: Array,
    k: int,
    memory: tuple[Array, Array, Array, Array],
    work: tuple[Array, Array, Array, Array],
    e: Array,
    E: Array,
    p: Array,
) -> None:
    """Advance everything by one sample z (m,); writes e (n, m), E (n,) and p (n,)."""
    F, H, K = bank
    x, history, front, mean = memory
    prediction, squares, D, area = work
    bank_step(F, H, K, z, x, prediction, e)
    for i in range(e.shape[0]):
        squares[i] = 0.0
        for j in range(e.shape[1]):
            squares[i] += weights[j] * e[i, j] * e[i, j]
    window_step(squares, k, history, front, mean)
    normalise(mean, E)
    corners, bounds, clauses, conclusions, shapes, grid = fuzzy
    duel(E, D)
    infer(D, corners, bounds, clauses, conclusions, shapes, grid, area, p)


class Identifier:
    """The paper's scheme (Fig. 4) for any number of filters.

    Parameters
    ----------
    bank : the filters.
    fuzzy : system with one input and one output for each filter, in the bank's order.
    window : samples in the moving window of (15).
    weights : (m,) weight of each measurement's squared innovation in the residual; the paper looks at
        the lateral acceleration alone.
    """

    def __init__(self, bank: FilterBank, fuzzy: FuzzySystem, *, window: int, weights: Array) -> None:
        n, m = bank.H.shape[:2]
        if n < 2:
            raise ValueError(
                f"identifier: got a bank of {n} filter, expected at least 2; a comparison needs two"
            )
        if (len(fuzzy.inputs), len(fuzzy.outputs)) != (n, n):
            raise ValueError(
                f"identifier: got a fuzzy system with {len(fuzzy.inputs)} inputs and "
                f"{len(fuzzy.outputs)} outputs, expected {n} of each for {n} filters; build it for this bank"
            )
        weights = np.asarray(weights, dtype=np.float64)
        if window < 1 or np.shape(weights) != (m,) or not (np.all(weights >= 0.0) and np.any(weights)):
            raise ValueError(
                f"identifier: got window {window} and weights {weights}, expected window >= 1 and {m} "
                f"weights >= 0, not all zero; one weight goes with each measurement"
            )
        self.bank = bank
        self.window = window
        self.weights = weights
        self.fuzzy = fuzzy.compile()
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        n, _, s = self.bank.H.shape
        self._k = 0
        self._memory = (np.zeros((n, s)), np.zeros((self.window, n)), np.zeros(n), np.zeros(n))
        self._work = (np.empty((n, s)), np.empty(n), np.empty(n), np.empty_like(self.fuzzy.grid))
        self._bank = (self.bank.F, self.bank.H, self.bank.K)
        self._fuzzy = self.fuzzy.arrays

    def step(self, z: Array, e: Array, E: Array, p: Array) -> None:
        """Take one sample z (m,); write the innovations e (n, m), E (n,) and the probabilities p (n,)."""
        _identifier_step(self._bank, self._fuzzy, self.weights, z, self._k, self._memory, self._work, e, E, p)
        self._k += 1

    def run(self, z: Array) -> Identification:
        """Reset, then identify over the samples z (T, m)."""
        self.reset()
        z = np.ascontiguousarray(z, dtype=np.float64)
        n, m = self.bank.H.shape[:2]
        if z.ndim != 2 or z.shape[1] != m:
            raise ValueError(
                f"identifier: got samples of shape {z.shape}, expected (T, {m}); check the sensors"
            )
        e, E, p = np.empty((len(z), n, m)), np.empty((len(z), n)), np.empty((len(z), n))
        for k in range(len(z)):
            self.step(z[k], e[k], E[k], p[k])
        return Identification(e, E, p)
