"""The machine code of `co_sim.native_state.ArrayState`."""

from __future__ import annotations

from numba import cfunc

from co_sim.native import STATE, doubles_at, integers_at

__all__ = ["go_back", "keep"]

#: Places in the table: addresses of the state and of its copy, and how many values they have.
_STATE, _KEPT, _SIZE = range(3)


@cfunc(STATE, cache=True)
def keep(data: int) -> int:
    """Copy the state."""
    table = integers_at(data)
    state, kept = doubles_at(table[_STATE]), doubles_at(table[_KEPT])
    for i in range(table[_SIZE]):
        kept[i] = state[i]
    return 0


@cfunc(STATE, cache=True)
def go_back(data: int) -> int:
    """Copy the copy back."""
    table = integers_at(data)
    state, kept = doubles_at(table[_STATE]), doubles_at(table[_KEPT])
    for i in range(table[_SIZE]):
        state[i] = kept[i]
    return 0
