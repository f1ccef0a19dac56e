"""Steps as machine code: the contract, and components that keep it.

The master's compiled loop knows one kind of step, a C function ::

    int32_t step(double t, double h, const double *u, double *y, void *data);

that advances from `t` to ``t + h`` (s) with the inputs `u`, writes the outputs at ``t + h`` into `y` and
returns 0, or another number that the component's `failure` can explain. `data` is the component's own.
Whoever can give the address of such a function takes part without the interpreter: an FMU through the
functions of `co_sim.fmi`, a function compiled by numba through `co_sim.compiled_component`, a library of
the user's own through ctypes.

Iterated coupling repeats steps. Two more functions ::

    int32_t keep(void *data);
    int32_t go_back(void *data);

keep the present state, in place of the one kept before, and go back to it as often as wanted.
"""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from enum import IntEnum
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from co_sim.component import Component, StateError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.native_state import ArrayState

__all__ = [
    "STATE",
    "STEP",
    "Call",
    "NativeComponent",
    "NativeState",
    "NativeStep",
    "TableComponent",
    "caller",
    "doubles_at",
    "integers_at",
    "pointer_to",
]

#: The step as numba sees it; pointers are integers there.
STEP = types.int32(types.float64, types.float64, types.intp, types.intp, types.intp)
#: `keep` and `go_back` as numba sees them.
STATE = types.int32(types.intp)
_STEP_C = ctypes.CFUNCTYPE(
    ctypes.c_int32, ctypes.c_double, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p
)


@cache
def _c_function(address: int) -> Callable[..., int]:
    return _STEP_C(address)


class Call(IntEnum):
    """How the compiled loop makes a step: by its function, or by lines of its own that do the same."""

    FUNCTION = 0
    FMI2 = 2
    FMI3 = 3


class NativeStep(NamedTuple):
    """Addresses of a step function and of its `data`; both stay valid until the component is closed."""

    address: int
    data: int
    call: Call = Call.FUNCTION


class NativeState(NamedTuple):
    """Addresses of `keep`, `go_back` and their `data`; valid until the component is closed."""

    keep: int
    go_back: int
    data: int


class NativeComponent(Component):
    """A component whose step is machine code; the interpreter calls the same code.

    A subclass has its `NativeStep` ready when `start` returns. One whose step needs the interpreter in some
    configurations returns ``None`` then, and has a `step` of its own.
    """

    @abstractmethod
    def native(self) -> NativeStep | None:
        """Return the addresses of the step."""

    def failure(self, status: int) -> Exception:
        """Return the error that tells what the status of a step means, with the component's own words."""
        return RuntimeError(f"its step returned the status {status}")

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance by the machine code."""
        address, data, _ = cast("NativeStep", self.native())
        status = _c_function(address)(t, h, u.ctypes.data, y.ctypes.data, data)
        if status:
            raise self.failure(status)


class TableComponent(NativeComponent):
    """A component whose step reads a table of integers: sizes, and addresses of arrays that it keeps.

    `start` ends with `_attach`; `close` makes copies of the component independent again.
    """

    _table: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    _native: NativeStep | None = None
    _array: ArrayState | None = None

    def _attach(self, step: Any, table: Sequence[int]) -> None:
        """Give the next run the function `step`, compiled by `numba.cfunc`, and what it reads."""
        self._table = np.array(table, dtype=np.int64)
        self._native = NativeStep(step.address, self._table.ctypes.data)

    def native(self) -> NativeStep:
        """Return the addresses of the step."""
        if self._native is None:
            raise StateError("it is not started")
        return self._native

    def _array_state(self, x: Vector) -> NativeState:
        """Return machine code that keeps an array, which is all the state."""
        from co_sim.native_state import ArrayState

        self._array = ArrayState(x)
        return self._array.native

    def close(self) -> None:
        """Forget the run."""
        self._native = self._array = None


def caller(signature: Any) -> Any:
    """Return a function ``call(address, arguments)`` for compiled code that calls a C function.

    The address is an integer, so that code that uses it can be cached for other processes; the
    arguments are a tuple.

    Parameters
    ----------
    signature : of the C function, such as ``types.int32(types.intp, types.float64)``.
    """

    @intrinsic
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            c_type = ir.FunctionType(
                context.get_value_type(signature.return_type),
                [context.get_value_type(argument) for argument in signature.args],
            )
            function = builder.inttoptr(values[0], c_type.as_pointer())
            return builder.call(function, cgutils.unpack_tuple(builder, values[1], len(signature.args)))

        return signature.return_type(types.intp, types.Tuple(signature.args)), generate

    return call


def pointer_to(element: Any) -> Any:
    """Return a function ``at(address)`` for compiled code: a pointer to its values, for `numba.carray`."""
    pointer = types.CPointer(element)

    @intrinsic
    def at(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(pointer))

        return pointer(types.intp), generate

    return at


#: For compiled code, with `numba.carray`: the float64 or the int64 values at an address.
doubles_at = pointer_to(types.float64)
integers_at = pointer_to(types.int64)
