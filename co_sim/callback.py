"""Python components in the compiled loop: machine code that calls back into the interpreter."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np
from numba import carray, cfunc, types  # type: ignore[attr-defined]

from co_sim.native import STEP, NativeStep, caller, doubles_at, integers_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.component import Component, Vector

__all__ = ["Callback"]

_CALLBACK = types.int32(types.float64, types.float64)
_CALLBACK_C = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_double, ctypes.c_double)
_call_back = caller(_CALLBACK)
_FAILED = 1


@cfunc(STEP, cache=True, error_model="numpy")
def _step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Call the interpreter, then copy what the component has written."""
    address, source, n_y = carray(integers_at(data), 3)
    status = _call_back(address, (t, h))
    results, outputs = carray(doubles_at(source), n_y), carray(doubles_at(y), n_y)
    for i in range(n_y):
        outputs[i] = results[i]
    return int(status)


class Callback:
    """The step of a Python component as machine code.

    The component sees the same two arrays at each step: making arrays from addresses would cost more than
    the call.

    Parameters
    ----------
    component : whose step is called.
    u : its inputs, at the address that the loop will pass. n_y : number of its outputs.
    """

    def __init__(self, component: Component, u: Vector, n_y: int) -> None:
        self.error: BaseException | None = None
        self._y = np.zeros(n_y)
        self._function = _CALLBACK_C(self._guarded(component, u, self._y))
        address = ctypes.cast(self._function, ctypes.c_void_p).value or 0
        self._data = np.array([address, self._y.ctypes.data, n_y], dtype=np.int64)
        self.native = NativeStep(int(_step.address or 0), self._data.ctypes.data)

    def _guarded(self, component: Component, u: Vector, y: Vector) -> Callable[[float, float], int]:
        step = component.step

        def call(t: float, h: float) -> int:
            try:
                step(t, h, u, y)
            except BaseException as error:
                self.error = error
                return _FAILED
            return 0

        return call
