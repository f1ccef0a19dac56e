"""Iterated coupling: a step is repeated until the values at its end agree with what made them.

The unknowns are the outputs ``y`` at the end of the step that feed something; a repetition of the step gives
``F(y)``. The fixed point ``y = F(y)`` is sought by a quasi-Newton method (`co_sim.quasi_newton`).

Both loops make the same repetitions: that of the interpreter has its arithmetic from the compiled one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.iterated_kernel import NOT_CONVERGED, STATES, begin, iterate
from co_sim.loops import CompiledLoop, Failure, feed
from co_sim.native_state import CalledState, native_state_of
from co_sim.quasi_newton import agrees, new_iteration, next_guess
from co_sim.table import CALLS, PART, STEP

if TYPE_CHECKING:
    from co_sim.coupling import Coupling
    from co_sim.kernel import Integers, Matrix
    from co_sim.layout import Layout, Part
    from co_sim.quasi_newton import Iteration

__all__ = ["CompiledIteratedLoop", "IteratedLoop", "NotConvergedError"]


class NotConvergedError(ValueError):
    """The repetitions of a step did not come to agree."""


class IteratedLoop:
    """Repeats each step from saved states of all components, in Python."""

    def __init__(self, layout: Layout, t0: float, h: float, coupling: Coupling, progress: Integers) -> None:
        self._layout, self._t0, self._h, self._coupling = layout, t0, h, coupling
        self._progress = progress
        _, self._links = layout.tables()
        self._fed = np.unique(layout.links.source)
        self._iteration = new_iteration(len(self._fed), coupling.max_iterations)
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
        parts, fed, iteration, following = self._layout.parts, self._fed, self._iteration, rows[row + 1]
        states: dict[str, object] = {}
        for j, part in enumerate(parts):
            self._tell(k, j)
            try:
                states[part.name] = part.component.save()
            except BaseException as error:
                return Failure(part, error)
        begin(rows, row, k, fed, self.scale, iteration)
        self.repetitions = 0
        while True:
            following[fed] = iteration.guess
            failure = self._try(rows, row, k)
            if failure:
                return failure
            self.repetitions += 1
            newest = self.repetitions - 1
            if agrees(following, fed, newest, self.scale, self._coupling.tolerance, iteration):
                return None
            if self.repetitions == self._coupling.max_iterations:
                return not_converged(self._layout, fed, iteration)
            next_guess(newest, iteration)
            for j, part in enumerate(parts):
                self._tell(k, j)
                try:
                    part.component.restore(states[part.name])
                except BaseException as error:
                    return Failure(part, error)

    def _tell(self, k: int, j: int) -> None:
        self._progress[STEP], self._progress[PART] = k, j
        self._progress[CALLS] += 1

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


class CompiledIteratedLoop(CompiledLoop):
    """Repeats each step in machine code; components whose state needs the interpreter are called back."""

    def __init__(self, layout: Layout, t0: float, h: float, coupling: Coupling, progress: Integers) -> None:
        super().__init__(layout, t0, h, progress)
        self._coupling = coupling
        self._fed = np.unique(layout.links.source)
        self._iteration = new_iteration(len(self._fed), coupling.max_iterations)
        self.scale = np.zeros(len(self._fed))
        self.repetitions = 0
        self._states = np.zeros((len(layout.parts), len(STATES)), dtype=np.int64)
        self._called: dict[str, CalledState] = {}
        for row, part in zip(self._states, layout.parts, strict=True):
            native = native_state_of(part.component)
            if native is None:
                self._called[part.name] = CalledState(part.component)
                native = self._called[part.name].native
            row[:] = native

    def advance(self, rows: Matrix, row: int, k: int, n: int) -> tuple[int, Failure | None]:
        """Make `n` steps without the interpreter, except for the components that need it."""
        made, status, j, self.repetitions = iterate(
            rows,
            row,
            k,
            n,
            self._t0,
            self._h,
            self._parts,
            self._states,
            self._layout.u,
            self._fed,
            self.scale,
            self._coupling.tolerance,
            self._iteration,
            self._progress,
        )
        if status == NOT_CONVERGED:
            return made, not_converged(self._layout, self._fed, self._iteration)
        return made, self._failure(status, j)

    def _error(self, part: Part, status: int) -> BaseException:
        called = self._called.get(part.name)
        if called is not None and called.error is not None:
            return called.error
        return super()._error(part, status)


def not_converged(layout: Layout, fed: Integers, iteration: Iteration) -> Failure:
    """Return what names the signal that is farthest from agreement after the last repetition."""
    residual = iteration.residuals[-1]
    worst = int(np.argmax(np.abs(residual) / iteration.scale))
    column = int(fed[worst])
    part = next(part for part in layout.parts if part.y.start <= column < part.y.stop)
    names = [element for port in part.component.outputs for element in port.elements]
    return Failure(
        part,
        NotConvergedError(
            f"after {len(iteration.residuals)} repetitions of the step its output "
            f"{names[column - part.y.start]} still differs by {abs(residual[worst]):.3g} from what it "
            "was taken to be; use a smaller step, or raise max_iterations"
        ),
    )
