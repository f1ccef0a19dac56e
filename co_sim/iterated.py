"""Iterated coupling: a step is repeated until the values at its end agree with what made them.

The unknowns are the outputs ``y`` at the end of the step that feed something; a repetition of the step gives
``F(y)``. The fixed point ``y = F(y)`` is sought by the quasi-Newton method of least squares that
fluid-structure interaction uses (Degroote, Bathe, Vierendeels: Performance of a new partitioned procedure
versus a monolithic procedure, Computers & Structures 87, 2009): with the differences ``V`` of residuals
``r = F(y) - y`` and ``W`` of results ``F(y)`` so far ::

    y <- F(y) + W c,    c = arg min |V c + r|
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from co_sim.loops import Failure, feed
from co_sim.table import CALLS, PART, STEP

if TYPE_CHECKING:
    from co_sim.component import Vector
    from co_sim.coupling import Coupling
    from co_sim.kernel import Integers, Matrix
    from co_sim.layout import Layout

__all__ = ["IteratedLoop", "NotConvergedError"]


class NotConvergedError(ValueError):
    """The repetitions of a step did not come to agree."""


@dataclass
class _Iteration:
    """The results and residuals of one step's repetitions, newest last."""

    results: list[Vector] = field(default_factory=list)
    residuals: list[Vector] = field(default_factory=list)

    def next_guess(self, result: Vector, residual: Vector, scale: Vector) -> Vector:
        """Return what to try next."""
        self.results.append(result)
        self.residuals.append(residual)
        if len(self.results) == 1:
            return result
        V = np.diff(np.array(self.residuals), axis=0).T / scale[:, np.newaxis]
        W = np.diff(np.array(self.results), axis=0).T
        c, *_ = np.linalg.lstsq(V, -residual / scale, rcond=1e-12)
        guess: Vector = result + W @ c
        return guess


class IteratedLoop:
    """Repeats each step from saved states of all components."""

    def __init__(self, layout: Layout, t0: float, h: float, coupling: Coupling, progress: Integers) -> None:
        self._layout, self._t0, self._h, self._coupling = layout, t0, h, coupling
        self._progress = progress
        _, self._links = layout.tables()
        self._fed = np.unique(layout.links.source)
        #: Largest magnitude of each fed signal so far.
        self.scale = np.zeros(len(self._fed))
        #: Repetitions of the last step.
        self.repetitions = 0

    def advance(self, rows: Matrix, row: int, k: int, n: int) -> tuple[int, Failure | None]:
        """Make `n` steps, each as often as it takes."""
        for i in range(n):
            failure = self._step(rows, row + i, k + i)
            if failure:
                return i, failure
        return n, None

    def _step(self, rows: Matrix, row: int, k: int) -> Failure | None:
        parts, fed = self._layout.parts, self._fed
        states = []
        for j, part in enumerate(parts):
            self._tell(k, j)
            states.append(part.component.save())
        self.scale = np.maximum(self.scale, np.abs(rows[row, fed]))
        guess = self._first_guess(rows, row, k)
        iteration = _Iteration()
        for repetition in range(1, self._coupling.max_iterations + 1):
            rows[row + 1, fed] = guess
            failure = self._try(rows, row, k)
            if failure:
                return failure
            result = rows[row + 1, fed].copy()
            residual = result - guess
            scale = np.maximum(self.scale, np.abs(result))
            scale[scale == 0.0] = 1.0
            if (np.abs(residual) <= self._coupling.tolerance * scale).all():
                self.repetitions = repetition
                return None
            guess = iteration.next_guess(result, residual, scale)
            for j, (part, state) in enumerate(zip(parts, states, strict=True)):
                self._tell(k, j)
                part.component.restore(state)
        worst = int(np.argmax(np.abs(residual) / scale))
        column = int(fed[worst])
        part = next(part for part in parts if part.y.start <= column < part.y.stop)
        names = [element for port in part.component.outputs for element in port.elements]
        return Failure(
            part,
            NotConvergedError(
                f"after {self._coupling.max_iterations} repetitions of the step its output "
                f"{names[column - part.y.start]} still differs by {abs(residual[worst]):.3g} from what it "
                "was taken to be; use a smaller step, or raise max_iterations"
            ),
        )

    def _tell(self, k: int, j: int) -> None:
        self._progress[STEP], self._progress[PART] = k, j
        self._progress[CALLS] += 1

    def _first_guess(self, rows: Matrix, row: int, k: int) -> Vector:
        """Return the outputs at the end of the step as if they went on along a straight line."""
        now: Vector = rows[row, self._fed]
        return now.copy() if k == 0 else 2.0 * now - rows[row - 1, self._fed]

    def _try(self, rows: Matrix, row: int, k: int) -> Failure | None:
        # All parts read the guess, none a result of this repetition: their order changes nothing.
        for part in self._layout.parts:
            feed(part, self._links, self._layout.u, rows, row + 1, k + 1, k, self._h, part.ahead, part.end)
        for j, part in enumerate(self._layout.parts):
            y = rows[row + 1, part.y]
            self._tell(k, j)
            try:
                part.component.step(self._t0 + k * self._h, self._h, part.u, y)
            except BaseException as error:
                return Failure(part, error)
            if not np.isfinite(y).all():
                return Failure(part, None)
        return None
