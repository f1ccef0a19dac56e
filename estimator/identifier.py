"""From sensor samples to the probability of each operating point, one sample at a time.

bank -> innovations -> moving mean squares -> (15) -> each against its best rival -> fuzzy system,
all in one compiled step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.bank import bank_step
from estimator.fuzzy import Tables, infer
from estimator.residuals import duel, normalise, window_step

if TYPE_CHECKING:
    from estimator.bank import FilterBank
    from estimator.fuzzy import FuzzySystem

__all__ = ["Design", "Identification", "Identifier", "Memory", "Work", "identifier_step"]

Array = NDArray[np.float64]


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


class Design(NamedTuple):
    """What `identifier_step` reads: filters of s states, weights (m,), and the fuzzy system."""

    F: Array
    H: Array
    K: Array
    weights: Array
    fuzzy: Tables


class Memory(NamedTuple):
    """What `identifier_step` keeps from sample to sample; zeros before the first one.

    `x` (n, s) are the states of the filters, the others those of `window_step`.
    """

    x: Array
    history: Array
    front: Array
    mean: Array


class Work(NamedTuple):
    """Room that `identifier_step` needs: (n, s), (n,), (n,), (rules,) and (n, grid)."""

    prediction: Array
    squares: Array
    D: Array
    strength: Array
    area: Array


@njit(cache=True, nogil=True, error_model="numpy")
def identifier_step(  # pragma: no cover - compiled
    design: Design, memory: Memory, work: Work, k: int, z: Array, e: Array, E: Array, p: Array
) -> None:
    """Advance everything by sample `k` = 0, 1, ..., z (m,); writes e (n, m), E (n,) and p (n,)."""
    bank_step(design.F, design.H, design.K, z, memory.x, work.prediction, e)
    squares = work.squares
    for i in range(e.shape[0]):
        squares[i] = 0.0
        for j in range(e.shape[1]):
            squares[i] += design.weights[j] * e[i, j] * e[i, j]
    window_step(squares, k, memory.history, memory.front, memory.mean)
    normalise(memory.mean, E)
    duel(E, work.D)
    infer(design.fuzzy, work.D, work.strength, work.area, p)


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
        self.weights = np.ascontiguousarray(weights)
        self.fuzzy = fuzzy.compile()
        self.reset()

    @property
    def design(self) -> Design:
        """The arrays that `identifier_step` reads."""
        return Design(self.bank.F, self.bank.H, self.bank.K, self.weights, self.fuzzy.tables)

    def new_memory(self) -> Memory:
        """Return the memory of an identifier that has seen no sample."""
        n, _, s = self.bank.H.shape
        return Memory(np.zeros((n, s)), np.zeros((self.window, n)), np.zeros(n), np.zeros(n))

    def new_work(self) -> Work:
        """Return room for a step."""
        n, _, s = self.bank.H.shape
        n_rules = len(self.fuzzy.tables.conclusions)
        return Work(
            np.empty((n, s)),
            np.empty(n),
            np.empty(n),
            np.empty(n_rules),
            np.empty_like(self.fuzzy.tables.grid),
        )

    def reset(self) -> None:
        """Forget all samples."""
        self._k = 0
        self._design, self._memory, self._work = self.design, self.new_memory(), self.new_work()

    def step(self, z: Array, e: Array, E: Array, p: Array) -> None:
        """Take one sample z (m,); write the innovations e (n, m), E (n,) and the probabilities p (n,)."""
        identifier_step(self._design, self._memory, self._work, self._k, z, e, E, p)
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
