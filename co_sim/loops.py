"""The loops that advance a system: compiled, and step by step in the interpreter.

Both make the same steps from the same rows with the same arithmetic; they give the same bits. The
interpreted one is there to be read, to be debugged in, and to be compared with.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from co_sim.callback import Callback
from co_sim.kernel import NOT_FINITE, Feed, advance, gather
from co_sim.kernel import PART as COLUMNS
from co_sim.native import Call, NativeComponent
from co_sim.table import PART, STEP

if TYPE_CHECKING:
    from co_sim.component import Vector
    from co_sim.kernel import Integers, Matrix
    from co_sim.layout import Layout, Part

__all__ = ["CompiledLoop", "Failure", "InterpretedLoop", "Loop", "feed"]


class Failure(NamedTuple):
    """What ended a loop early: a part, and its error; ``None`` means an output that is not finite."""

    part: Part
    error: BaseException | None


class Loop(Protocol):
    """Something that advances a system; `scale` is what it remembers of the past beyond the rows."""

    scale: Vector

    def advance(self, rows: Matrix, row: int, k: int, n: int) -> tuple[int, Failure | None]:
        """Make `n` steps from step `k`, whose values are in `row`; return the steps made, and what failed."""


class CompiledLoop:
    """Makes steps in machine code, for components that are started."""

    def __init__(self, layout: Layout, t0: float, h: float, progress: Integers) -> None:
        self._layout, self._t0, self._h = layout, t0, h
        self._progress = progress
        self.scale = np.empty(0)
        self._parts, self._links = layout.tables()
        self._callbacks: dict[str, Callback] = {}
        for row, part in zip(self._parts, layout.parts, strict=True):
            native = part.component.native()
            if native is None:
                self._callbacks[part.name] = Callback(part.component, part.u, part.y.stop - part.y.start)
                native = self._callbacks[part.name].native
            self._set(row, call=native.call, address=native.address, data=native.data)
            stretch = layout.stretch(part)
            if native.call is not Call.FUNCTION and stretch is not None:
                # An FMU promises not to change its inputs, so that it may see the row itself.
                self._set(row, feed=Feed.ROW, u=8 * stretch)

    @staticmethod
    def _set(row: Integers, **values: int) -> None:
        for name, value in values.items():
            row[COLUMNS.index(name)] = value

    def advance(self, rows: Matrix, row: int, k: int, n: int) -> tuple[int, Failure | None]:
        """Make `n` steps without the interpreter, except for the components that need it."""
        made, status, j = advance(
            rows, row, k, n, self._t0, self._h, self._parts, self._layout.u, self._progress
        )
        return made, self._failure(status, j)

    def _failure(self, status: int, j: int) -> Failure | None:
        if status == 0:
            return None
        part = self._layout.parts[j]
        return Failure(part, None if status == NOT_FINITE else self._error(part, status))

    def _error(self, part: Part, status: int) -> BaseException:
        callback = self._callbacks.get(part.name)
        if callback is not None and callback.error is not None:
            return callback.error
        if isinstance(part.component, NativeComponent):
            return part.component.failure(status)
        return RuntimeError(f"its step returned the status {status}")


class InterpretedLoop:
    """Makes steps in Python."""

    def __init__(self, layout: Layout, t0: float, h: float, progress: Integers) -> None:
        self._layout, self._t0, self._h = layout, t0, h
        _, self._links = layout.tables()
        self._progress = progress
        self.scale = np.empty(0)

    def advance(self, rows: Matrix, row: int, k: int, n: int) -> tuple[int, Failure | None]:
        """Make `n` steps in Python."""
        for i in range(n):
            failure = self._step(rows, row + i, k + i)
            if failure:
                return i, failure
        return n, None

    def _step(self, rows: Matrix, row: int, k: int) -> Failure | None:
        layout, h = self._layout, self._h
        for j, part in enumerate(layout.parts):
            period = part.period
            if k % period == 0:
                feed(part, self._links, layout.u, rows, row, k, k, h, part.behind, part.ahead)
            y = rows[row + 1, part.y]
            if (k + 1) % period != 0:
                y[:] = rows[row, part.y]
                continue
            first = k + 1 - period
            if part.ahead < part.end:
                feed(part, self._links, layout.u, rows, row + 1, k + 1, first, h, part.ahead, part.end)
            self._progress[STEP], self._progress[PART] = k, j
            try:
                part.component.step(self._t0 + first * h, period * h, part.u, y)
            except BaseException as error:
                return Failure(part, error)
            if not np.isfinite(y).all():
                return Failure(part, None)
        return None


def feed(
    part: Part,
    links: Integers,
    u: Vector,
    rows: Matrix,
    row: int,
    k: int,
    begin: int,
    h: float,
    first: int,
    last: int,
) -> None:
    """Set the inputs of a part from row `row` at step `k`, for its step that begins at step `begin`."""
    gather(rows, row, k, begin, part.period, h, links, first, last, part.derived, u)
