"""Sources: constants, and tables over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from co_sim.errors import Fault, InputError
from co_sim.native import TableComponent
from co_sim.texts import as_number

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike

    from co_sim.component import Kind, Port, Scalar, Vector
    from co_sim.native import NativeState

__all__ = ["Constant", "TimeTable"]

#: A breakpoint counts as reached this fraction of a step early: ``t0 + k*h`` is rounded.
EARLY = 1e-6

#: Whole numbers up to here are exact as float64.
EXACT = 2**53


class _Source(TableComponent):
    """A component without inputs and without memory."""

    def __init__(self, ports: Sequence[Port]) -> None:
        super().__init__((), ports, {})
        self._t0 = 0.0

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the values at the start time."""
        self.step(self._t0, 0.0, u, y)

    def save(self) -> object:
        """Return nothing: a source has no memory."""
        return None

    def restore(self, state: object) -> None:
        """Do nothing: a source has no memory."""

    def native_state(self) -> NativeState:
        """Return machine code that keeps nothing."""
        return self._array_state(np.empty(0))

    def serialize(self, state: object) -> bytes:
        """Return nothing: a source has no memory."""
        return b""

    def deserialize(self, data: bytes) -> object:
        """Return nothing: a source has no memory."""
        return None


class Constant(_Source):
    """Outputs that never change.

    Parameters
    ----------
    values : for each port a value of its kind: a finite number, a whole one, a bool or a text; for an array
        port a (nested) sequence of its shape.
    ports : the outputs.

    Raises
    ------
    InputError
        If values are missing, or are not of the kind or the shape of their ports.
    """

    def __init__(self, values: Sequence[Scalar | ArrayLike], ports: Sequence[Port]) -> None:
        super().__init__(ports)
        if len(values) != len(self.outputs):
            raise InputError(
                "values",
                got=f"{len(values)}",
                expected=f"one value for each of {len(self.outputs)} ports",
                remedy="give as many values as ports",
            )
        faults = [fault for port, value in zip(ports, values, strict=True) for fault in _faults(port, value)]
        if faults:
            raise InputError.from_faults(faults)
        self._constants: list[Scalar] = [
            element for value in values for element in np.array(value, dtype=object).ravel()
        ]
        self._values: Vector = np.empty(0)

    def start(self, t0: float, h: float) -> None:
        """Translate the values; the numbers of texts hold in one process only."""
        from co_sim.steps import constant_step

        numbers = [as_number(value) for value in self._constants]
        self._values = np.array(numbers)
        self._attach(constant_step, [len(numbers), self._values.ctypes.data])


class TimeTable(_Source):
    """Outputs given at breakpoints in time.

    Parameters
    ----------
    times : breakpoints, s, strictly increasing; shape ``(n,)``.
    values : shape ``(n, n_elements)`` of all ports, or ``(n,)`` for a single element.
    ports : the outputs, of any kind but texts.
    interpolation : ``"hold"`` keeps each value until the next breakpoint, ``"linear"`` joins them by
        straight lines. Before the first and after the last breakpoint the nearest value holds.

    Raises
    ------
    InputError
        If the times do not increase, the shapes do not fit, or the values are not of the ports' kinds.
    """

    def __init__(
        self,
        times: Sequence[float],
        values: ArrayLike,
        ports: Sequence[Port],
        interpolation: Literal["hold", "linear"] = "hold",
    ) -> None:
        super().__init__(ports)
        knots = _checked_times(times)
        table = _finite("values", values)
        self._values = table[:, np.newaxis] if table.ndim == 1 else table
        n_y = sum(port.size for port in self.outputs)
        if self._values.shape != (len(knots), n_y):
            raise InputError(
                "values",
                got=f"shape {table.shape}",
                expected=f"{len(knots)} times by {n_y} ports",
                remedy="give one row for each time and one column for each element of the ports",
            )
        faults = list(_column_faults(self.outputs, self._values, interpolation))
        if faults:
            raise InputError.from_faults(faults)
        self._times = knots
        self._slopes = _slopes(knots, self._values, interpolation)
        self._early: Vector = np.empty(0)

    def start(self, t0: float, h: float) -> None:
        """Remember the start time and the step."""
        from co_sim.steps import table_step

        self._t0 = t0
        self._early = np.array([EARLY * h])
        arrays = (self._values, self._times, self._slopes, self._early)
        values, knots, slopes, early = (int(array.ctypes.data) for array in arrays)
        n_times, n_y = self._values.shape
        self._attach(table_step, [n_y, values, n_times, knots, slopes, early])


def _faults(port: Port, value: Scalar | ArrayLike) -> Iterator[Fault]:
    """Find what is wrong with the value of a port: its shape, or its elements."""
    array = np.array(value, dtype=object)
    what = f'value of "{port.name}"'
    if array.shape != port.shape:
        remedy = "give one value for each element of the port"
        yield Fault(what, f"shape {array.shape}", f"shape {port.shape}", remedy)
        return
    for element in array.ravel():
        expected = _refusal(port.kind, element)
        if expected:
            yield Fault(what, repr(element), expected, "change the value, or the kind of the port")


def _refusal(kind: Kind, value: object) -> str:
    """Return what is expected instead of `value` for a port of a kind; nothing where it is right."""
    if kind == "string":
        return "" if isinstance(value, str) else "a text"
    if kind == "boolean":
        return "" if value in (False, True) else "True or False"
    if not isinstance(value, int | float | np.number):
        return "a number"
    if kind.startswith("float"):
        return "" if np.isfinite(value) else "a finite number"
    low, high = _bounds(kind)
    whole = np.isfinite(value) and value == int(value)
    return "" if whole and low <= value <= high else f"a whole number from {low} to {high}"


def _bounds(kind: Kind) -> tuple[int, int]:
    """Return the smallest and the largest whole number of a kind that float64 carries exactly."""
    limits = np.iinfo("int64" if kind == "enumeration" else kind)
    return max(int(limits.min), -EXACT), min(int(limits.max), EXACT)


def _column_faults(ports: Iterable[Port], values: Vector, interpolation: str) -> Iterator[Fault]:
    column = 0
    for port in ports:
        if interpolation == "linear" and not port.kind.startswith("float"):
            remedy = 'give interpolation="hold"'
            yield Fault(f'table of "{port.name}"', f"{port.kind}, linear", "a floating-point kind", remedy)
        for value in values[:, column : column + port.size].ravel():
            expected = _refusal(port.kind, float(value))
            if expected:
                yield Fault(f'table of "{port.name}"', f"{value:g}", expected, "change the value")
                break
        column += port.size


def _finite(what: str, values: ArrayLike) -> Vector:
    array = np.array(values, dtype=np.float64, order="C")
    if not np.isfinite(array).all():
        raise InputError(what, got="nan or inf", expected="finite numbers", remedy="remove those entries")
    return array


def _checked_times(times: Sequence[float]) -> Vector:
    knots = _finite("times", times)
    if knots.ndim != 1 or knots.size == 0:
        raise InputError(
            "times",
            got=f"shape {knots.shape}",
            expected="a list of times",
            remedy="give at least one breakpoint",
        )
    backwards = np.flatnonzero(np.diff(knots) <= 0.0)
    if backwards.size:
        i = int(backwards[0])
        raise InputError(
            "times",
            got=f"{knots[i]:g} s before {knots[i + 1]:g} s",
            expected="strictly increasing breakpoints",
            remedy="sort them, and keep one of equal times",
        )
    return knots


def _slopes(knots: Vector, values: Vector, interpolation: str) -> Vector:
    """Return the rate of change after each breakpoint; after the last one nothing changes."""
    slopes = np.zeros_like(values)
    if interpolation == "linear":
        slopes[:-1] = np.diff(values, axis=0) / np.diff(knots)[:, np.newaxis]
    elif interpolation != "hold":
        raise InputError(
            "interpolation",
            got=f'"{interpolation}"',
            expected='"hold" or "linear"',
            remedy="choose one of the two",
        )
    return slopes
