"""States of FMUs as machine code: `keep` gets the state of an instance, `go_back` sets it."""

from __future__ import annotations

from typing import Any

from numba import cfunc, njit, types

from co_sim import fmi_table as at
from co_sim.fmi_calls import failing
from co_sim.native import STATE, caller, integers_at

__all__ = ["go_back", "keep"]

_call = caller(types.int32(types.intp, types.intp))


@njit()
def _outcome(table: Any, action: int, status: int) -> int:
    if status < 0 or status > 1:
        return failing(table, action, status)
    return 0


@cfunc(STATE, cache=True)
def keep(data: int) -> int:
    """Get the state, after the one before has been freed: not all FMUs write into one that they are given."""
    table = integers_at(data)
    kept = data + 8 * at.KEPT
    if table[at.KEPT] != 0:
        outcome = _outcome(table, at.FREEING, _call(table[at.FREE_STATE], (table[at.INSTANCE], kept)))
        table[at.KEPT] = 0
        if outcome != 0:
            return outcome
    table[at.KEPT_ORDER] = table[at.LAST_ORDER]
    return _outcome(table, at.KEEPING, _call(table[at.GET_STATE], (table[at.INSTANCE], kept)))


@cfunc(STATE, cache=True)
def go_back(data: int) -> int:
    """Set the state that was kept."""
    table = integers_at(data)
    table[at.LAST_ORDER] = table[at.KEPT_ORDER]
    return _outcome(table, at.GOING_BACK, _call(table[at.SET_STATE], (table[at.INSTANCE], table[at.KEPT])))
