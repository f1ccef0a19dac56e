"""A component whose step is a Python function compiled by numba."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from co_sim.array_functions import (
    ARRAY_STEP,
    RAISED,
    address_of,
    as_compiled,
    compiled,
    exception_at,
)
from co_sim.component import StateError
from co_sim.errors import Fault, InputError, suggestion
from co_sim.native import TableComponent
from co_sim.texts import as_number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

    from co_sim.component import Port, Scalar, Vector
    from co_sim.native import NativeState

__all__ = ["CompiledComponent", "compiled"]


class CompiledComponent(TableComponent):
    """A component of the user's own, at the speed of C.

    The functions work on float64 arrays: inputs `u`, outputs `y`, state `x` (both changed in place) and
    parameters `p`, which they only read. They return 0, or another whole number for a failure; an exception
    that they raise is a failure too. Decorate them with `compiled` in a module file, so that their
    machine code is cached; plain functions are decorated here.

    Parameters
    ----------
    step : ``step(t, h, u, y, x, p)`` advances `x` from `t` to ``t + h`` (s) and writes `y` at ``t + h``.
        With `takes_derivatives`, `u` holds values, first and second derivatives at `t`.
    exchange : ``exchange(t, u, y, x, p)`` writes `y` at the start time, given `u` there. It is called
        several times and may set `x`. Without it every output needs a start value, which it has then.
    inputs, outputs : the ports; arrays take as many elements of `u` and `y` as they have.
    state : `x` at the start of a run.
    parameters : names and values, in the order they have in `p`; a system can set others.
    prepare : ``prepare(h, values)`` returns `p`, of any length, from the step size and the parameters by
        name, before each run; an ordinary Python function, for what is costly or depends on the step.
    feedthrough : as in `Component`.
    takes_derivatives : as in `Component`.

    Raises
    ------
    InputError
        If a function has other arguments or cannot be compiled, or a value is missing or not finite.
    """

    def __init__(
        self,
        step: Callable[..., int],
        *,
        exchange: Callable[..., int] | None = None,
        inputs: Sequence[Port] = (),
        outputs: Sequence[Port],
        state: ArrayLike = (),
        parameters: Mapping[str, float] = MappingProxyType({}),
        prepare: Callable[[float, Mapping[str, float]], ArrayLike] | None = None,
        feedthrough: Mapping[str, Iterable[str]] | None = None,
        takes_derivatives: bool = False,
    ) -> None:
        super().__init__(inputs, outputs, feedthrough)
        self.takes_derivatives = takes_derivatives
        faults = [*_start_faults(outputs if exchange is None else ()), *_value_faults(parameters)]
        if faults:
            raise InputError.from_faults(faults)
        self._step_function = as_compiled(step, 6)
        self._exchange_function = None if exchange is None else as_compiled(exchange, 5)
        self._start_state = _state(state)
        self._parameters = {name: float(value) for name, value in parameters.items()}
        self._prepare = prepare
        self._t0 = 0.0
        self._x: Vector = np.empty(0)
        self._p: Vector = np.empty(0)

    def parameter_faults(self, values: Mapping[str, Scalar]) -> Iterator[Fault]:
        """Find parameters that are unknown, and values that are not finite numbers."""
        for name in values:
            if name not in self._parameters:
                remedy = suggestion(name, self._parameters)
                yield Fault(f'parameter "{name}"', "an unknown name", "a parameter of the component", remedy)
        yield from _value_faults({name: values[name] for name in values if name in self._parameters})

    def set_parameters(self, values: Mapping[str, Scalar]) -> None:
        """Take parameters for the next `start`."""
        self._parameters |= {name: float(value) for name, value in values.items()}

    def start(self, t0: float, h: float) -> None:
        """Set the state and the parameters of this run."""
        from co_sim.steps import array_step

        self._t0 = t0
        self._x = self._start_state.copy()
        values = dict(self._parameters)
        p = list(values.values()) if self._prepare is None else self._prepare(h, values)
        # A copy, because the step keeps its address while the user may keep the array.
        self._p = np.array(p, dtype=np.float64).ravel()
        n_u, n_y = (sum(port.size for port in ports) for ports in (self.inputs, self.outputs))
        self._attach(
            array_step,
            [
                address_of(self._step_function, ARRAY_STEP),
                3 * n_u if self.takes_derivatives else n_u,
                n_y,
                self._x.ctypes.data,
                self._x.size,
                self._p.ctypes.data,
                self._p.size,
                0,  # the address of an exception, if one comes
            ],
        )

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the outputs at the start time: those of `exchange`, else the start values."""
        if self._exchange_function is None:
            starts = [value for port in self.outputs for value in port.starts or ()]
            y[:] = [as_number(value) for value in starts]
            return
        # Arrays of its own: numba tells read-only and strided arrays apart, and what is not written shows.
        outputs = np.full(y.size, np.nan)
        status = self._exchange_function(self._t0, np.array(u), outputs, self._x, self._p)
        if status:
            raise RuntimeError(f"its exchange returned the status {status}")
        y[:] = outputs

    def failure(self, status: int) -> Exception:
        """Return the exception that the step raised, or the status that it returned."""
        if status == RAISED:
            return exception_at(int(self._table[-1]))
        return super().failure(status)

    def save(self) -> object:
        """Return a copy of the state."""
        self.native()
        return self._x.copy()

    def restore(self, state: object) -> None:
        """Return to a state of `save`."""
        self.native()
        self._x[:] = cast("Vector", state)

    def native_state(self) -> NativeState:
        """Return machine code that keeps the state."""
        self.native()
        return self._array_state(self._x)

    def serialize(self, state: object) -> bytes:
        """Return the state as float64 in little-endian order."""
        return cast("Vector", state).astype("<f8").tobytes()

    def deserialize(self, data: bytes) -> object:
        """Return the state from the bytes of `serialize`."""
        size = self._start_state.size
        if len(data) != 8 * size:
            raise StateError(f"its state has {size} values of 8 bytes, and {len(data)} bytes were given")
        return np.frombuffer(data, dtype="<f8").astype(np.float64)


def _state(values: ArrayLike) -> Vector:
    state: Vector = np.array(values, dtype=np.float64)
    if state.ndim != 1 or not np.isfinite(state).all():
        raise InputError(
            "state",
            got=f"{np.array2string(state, threshold=8)}",
            expected="finite numbers in one row",
            remedy="flatten what has more dimensions, and give every state a start value",
        )
    return state


def _start_faults(outputs: Iterable[Port]) -> Iterator[Fault]:
    for port in outputs:
        if port.starts is None:
            yield Fault(
                f'output "{port.name}"',
                "no value at the start time",
                "an exchange function or a start value",
                "give exchange=, or Port(..., start=)",
            )


def _value_faults(parameters: Mapping[str, Any]) -> Iterator[Fault]:
    for name, value in parameters.items():
        if not isinstance(value, int | float | np.number | np.bool_) or not math.isfinite(value):
            yield Fault(f'parameter "{name}"', repr(value), "a finite number", "give a number")
