"""States that machine code keeps and goes back to, in place of `Component.save` and `restore`."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from co_sim.native import NativeState

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.component import Component, Vector

__all__ = ["ArrayState", "CalledState", "native_state_of"]

_STATE_C = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
_FAILED = 1


def native_state_of(component: Component) -> NativeState | None:
    """Return the machine code of a component for its state, unless a subclass has changed what that is."""
    classes = type(component).__mro__
    own, of_save = (
        next(i for i, each in enumerate(classes) if name in vars(each)) for name in ("native_state", "save")
    )
    return component.native_state() if own <= of_save else None


class ArrayState:
    """A state that is one array of float64, maybe empty."""

    def __init__(self, x: Vector) -> None:
        # numba takes a while to get ready, which who only imports the package need not wait for.
        from co_sim.array_state import go_back, keep

        self._x, self._kept = x, x.copy()
        self._table = np.array([x.ctypes.data, self._kept.ctypes.data, x.size], dtype=np.int64)
        kept: Any = keep
        back: Any = go_back
        self.native = NativeState(kept.address, back.address, self._table.ctypes.data)


class CalledState:
    """The state of a component whose `save` and `restore` need the interpreter: it is called back.

    Attributes
    ----------
    error : what was raised there.
    """

    def __init__(self, component: Component) -> None:
        self.error: BaseException | None = None
        self._component = component
        self._state: object = None
        self._functions = _STATE_C(self._guarded(self._keep)), _STATE_C(self._guarded(self._go_back))
        keep, go_back = (
            cast("int", ctypes.cast(function, ctypes.c_void_p).value) for function in self._functions
        )
        self.native = NativeState(keep, go_back, 0)

    def _keep(self) -> None:
        self._state = self._component.save()

    def _go_back(self) -> None:
        self._component.restore(self._state)

    def _guarded(self, function: Callable[[], None]) -> Callable[[object], int]:
        """Return a function for C: an exception must not pass through it."""

        def call(_: object) -> int:
            try:
                function()
            except BaseException as error:
                self.error = error
                return _FAILED
            return 0

        return call
