"""Saved states of a Model Exchange FMU: that of the FMU and that of its integration."""

from __future__ import annotations

import weakref
from ctypes import byref, c_size_t, c_void_p
from typing import TYPE_CHECKING

import numpy as np

from co_sim.component import StateError

if TYPE_CHECKING:
    from co_sim.component import Vector
    from co_sim.exchange_model import ExchangeModel

__all__ = ["ExchangeState", "SavedStates"]

#: What the integration knows of the present point.
_SCALARS = ("time", "next_event", "running")
_ARRAYS = ("x", "z", "discrete_values")


class ExchangeState:
    """A saved state; the FMU keeps its part of it until nobody holds the object any more.

    Parameters
    ----------
    owner : the states of the instance that it was saved from.
    handle : the FMU's part.
    integration : the rest.
    """

    def __init__(self, owner: SavedStates, handle: int, integration: Vector) -> None:
        self.owner = owner
        self.handle = handle
        self.integration = integration
        weakref.finalize(self, owner.forget, handle).atexit = False


class SavedStates:
    """The saved states of one instance."""

    def __init__(self, model: ExchangeModel) -> None:
        self._model = model
        self._handles: set[int] = set()

    def save(self) -> ExchangeState:
        """Return the present state."""
        self._require("canGetAndSetFMUstate", "cannot save its state")
        handle = c_void_p()
        self._model.call("get_state", byref(handle))
        return self._keep(handle, self._integration())

    def restore(self, state: ExchangeState) -> None:
        """Return to a state of this instance."""
        if state.owner is not self:
            raise StateError("the state was saved from another instance of the FMU, or before a restart")
        self._model.call("set_state", c_void_p(state.handle))
        self._set_integration(state.integration)
        self._model.recover()

    def serialize(self, state: ExchangeState) -> bytes:
        """Return a saved state as bytes: the integration's part, then the FMU's."""
        self._require("canSerializeFMUstate", "cannot write its state as bytes")
        handle, size = c_void_p(state.handle), c_size_t()
        self._model.call("state_size", handle, byref(size))
        data = np.zeros(size.value, dtype=np.uint8)
        self._model.call("write_state", handle, c_void_p(data.ctypes.data), size)
        return state.integration.tobytes() + data.tobytes()

    def deserialize(self, data: bytes) -> ExchangeState:
        """Return the state that was written as bytes."""
        self._require("canSerializeFMUstate", "cannot read its state from bytes")
        n = self._integration().nbytes
        if len(data) < n:
            raise StateError(f"{len(data)} bytes are too few for a state of the FMU")
        integration = np.frombuffer(data[:n]).copy()
        own = np.frombuffer(data[n:], dtype=np.uint8).copy()
        handle = c_void_p()
        self._model.call("read_state", c_void_p(own.ctypes.data), c_size_t(own.size), byref(handle))
        return self._keep(handle, integration)

    def forget(self, handle: int) -> None:
        """Let the FMU free a state, unless it has."""
        if handle in self._handles:
            self._handles.remove(handle)
            self._model.call("free_state", byref(c_void_p(handle)))

    def close(self) -> None:
        """Let the FMU free all states, where it may still be called."""
        handles, self._handles = self._handles, set()
        if self._model.is_usable:
            for handle in handles:
                self._model.call("free_state", byref(c_void_p(handle)))

    def _keep(self, handle: c_void_p, integration: Vector) -> ExchangeState:
        value = handle.value or 0
        self._handles.add(value)
        return ExchangeState(self, value, integration)

    def _integration(self) -> Vector:
        scalars = [float(self._model.table[name]) for name in _SCALARS]
        return np.concatenate([scalars, *(self._model.arrays[name] for name in _ARRAYS)])

    def _set_integration(self, values: Vector) -> None:
        for name, value in zip(_SCALARS, values, strict=False):
            self._model.table[name] = value
        end = len(_SCALARS)
        for name in _ARRAYS:
            array = self._model.arrays[name]
            array[:] = values[end : end + array.size]
            end += array.size

    def _require(self, capability: str, lack: str) -> None:
        if not getattr(self._model.description.modelExchange, capability):
            raise StateError(f"the FMU {lack}: its description does not offer {capability}")
