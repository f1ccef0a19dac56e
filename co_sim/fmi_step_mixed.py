"""The step of an FMU with ports of any numeric type, and with derivatives of its inputs.

Values pass through a buffer for each call, of the type that the call takes. A number that its variable cannot
hold, or that a float64 cannot, ends the step; nothing is cut off. (A float32 is rounded to, but not beyond
its largest value.)
"""

from __future__ import annotations

import math
from typing import Any

from numba import cfunc, njit, types
from numpy import finfo, float32

from co_sim import fmi_table as at
from co_sim.fmi_step import ENDING, do_step2, do_step3, failing, transfer2, transfer3
from co_sim.native import STEP, caller, doubles_at, integers_at, pointer_to

__all__ = ["step_mixed"]

_LARGEST = float(finfo(float32).max)

_pointer, _int = types.intp, types.int32
_set_derivatives = caller(_int(_pointer, _pointer, _pointer, _pointer, _pointer))
_float32 = pointer_to(types.float32)
_int8, _uint8 = pointer_to(types.int8), pointer_to(types.uint8)
_int16, _uint16 = pointer_to(types.int16), pointer_to(types.uint16)
_int32, _uint32 = pointer_to(types.int32), pointer_to(types.uint32)
_uint64 = pointer_to(types.uint64)


@njit(cache=True)
def _outcome(table: Any, action: int, status: int) -> int:
    """Return how a call that returned `status` ends the step: 0 after ok and warning."""
    if 0 <= status <= 1:
        return 0
    return failing(table, action, status)


@njit(cache=True)
def _unfit_input(u: Any, positions: Any, n: int, code: int, low: int, high: int) -> int:
    """Return the index of the first value that does not fit its type, or -1."""
    for i in range(n):
        x = u[positions[i]]
        if code == at.FLOAT32:
            if abs(x) > _LARGEST and not math.isinf(x):
                return i
        elif not (low <= x <= high and x == math.floor(x)):
            return i
    return -1


@njit(cache=True)
def _gather(u: Any, positions: Any, n: int, values: Any) -> None:
    for i in range(n):
        values[i] = u[positions[i]]


@njit(cache=True)
def _fill(u: Any, positions: Any, n: int, code: int, address: int) -> None:
    """Write inputs into the buffer of their type."""
    if code == at.FLOAT64:
        _gather(u, positions, n, doubles_at(address))
    elif code == at.FLOAT32:
        _gather(u, positions, n, _float32(address))
    elif code == at.INT8:
        _gather(u, positions, n, _int8(address))
    elif code in (at.UINT8, at.BOOLEAN8):
        _gather(u, positions, n, _uint8(address))
    elif code == at.INT16:
        _gather(u, positions, n, _int16(address))
    elif code == at.UINT16:
        _gather(u, positions, n, _uint16(address))
    elif code in (at.INT32, at.BOOLEAN32):
        _gather(u, positions, n, _int32(address))
    elif code == at.UINT32:
        _gather(u, positions, n, _uint32(address))
    else:  # Up to 2**53, both 64-bit types look alike.
        _gather(u, positions, n, integers_at(address))


@njit(cache=True)
def _spread(values: Any, positions: Any, n: int, y: Any) -> None:
    for i in range(n):
        y[positions[i]] = values[i]


@njit(cache=True)
def _spread_booleans(values: Any, positions: Any, n: int, y: Any) -> None:
    for i in range(n):
        y[positions[i]] = 1.0 if values[i] else 0.0


@njit(cache=True)
def _unfit_output(address: int, code: int, n: int) -> int:
    """Return the index of the first whole number that a float64 might round, or -1."""
    signed, unsigned = integers_at(address), _uint64(address)
    for i in range(n):
        if code == at.UINT64:
            fits = unsigned[i] <= types.uint64(at.EXACT)
        else:
            fits = -at.EXACT <= signed[i] <= at.EXACT
        if not fits:
            return i
    return -1


@njit(cache=True)
def _empty(y: Any, positions: Any, n: int, code: int, address: int) -> None:
    """Write outputs from the buffer of their type."""
    if code == at.FLOAT64:
        _spread(doubles_at(address), positions, n, y)
    elif code == at.FLOAT32:
        _spread(_float32(address), positions, n, y)
    elif code == at.INT8:
        _spread(_int8(address), positions, n, y)
    elif code == at.UINT8:
        _spread(_uint8(address), positions, n, y)
    elif code == at.INT16:
        _spread(_int16(address), positions, n, y)
    elif code == at.UINT16:
        _spread(_uint16(address), positions, n, y)
    elif code == at.INT32:
        _spread(_int32(address), positions, n, y)
    elif code == at.UINT32:
        _spread(_uint32(address), positions, n, y)
    elif code == at.BOOLEAN8:
        _spread_booleans(_uint8(address), positions, n, y)
    elif code == at.BOOLEAN32:
        _spread_booleans(_int32(address), positions, n, y)
    else:
        _spread(integers_at(address), positions, n, y)


@njit(cache=True)
def _transfer(table: Any, row: Any, action: int) -> int:
    """Make the call of a row."""
    n, address = row[at.N_REFERENCES], row[at.VALUES]
    if table[at.VERSION] == 2:
        status = transfer2(row[at.FUNCTION], (table[at.INSTANCE], row[at.REFERENCES], n, address))
    else:
        values = (table[at.INSTANCE], row[at.REFERENCES], n, address, row[at.N_VALUES])
        status = transfer3(row[at.FUNCTION], values)
    return _outcome(table, action, status)


@njit(cache=True)
def _set(table: Any, row: Any, u: int) -> int:
    code = row[at.CODE]
    positions, n = integers_at(row[at.POSITIONS]), row[at.N_VALUES]
    inputs = doubles_at(u)
    if code != at.FLOAT64:
        i = _unfit_input(inputs, positions, n, code, row[at.LOW], row[at.HIGH])
        if i >= 0:
            table[at.ELEMENT] = positions[i]
            table[at.VALUE] = integers_at(u)[positions[i]]
            return at.UNFIT_INPUT
    _fill(inputs, positions, n, code, row[at.VALUES])
    return _transfer(table, row, at.SETTING)


@njit(cache=True)
def _get(table: Any, row: Any, y: Any) -> int:
    action = _transfer(table, row, at.GETTING)
    if action:
        return action
    code, n, address = row[at.CODE], row[at.N_VALUES], row[at.VALUES]
    positions = integers_at(row[at.POSITIONS])
    if code in (at.INT64, at.UINT64):
        i = _unfit_output(address, code, n)
        if i >= 0:
            table[at.ELEMENT] = positions[i]
            table[at.VALUE] = integers_at(address)[i]
            return at.UNFIT_OUTPUT
    _empty(y, positions, n, code, address)
    return 0


@njit(cache=True)
def _derive(table: Any, u: int) -> int:
    """Set the derivatives of the inputs up to the highest order that is, or last was, not zero."""
    n_inputs, n = table[at.N_INPUTS], table[at.N_SLOPES]
    inputs, values = doubles_at(u), doubles_at(table[at.SLOPE_VALUES])
    positions = integers_at(table[at.SLOPE_POSITIONS])
    highest = 0
    for order in (1, 2):
        for i in range(n):
            x = inputs[order * n_inputs + positions[i]]
            values[(order - 1) * n + i] = x
            if x != 0.0:
                highest = order
    order = max(highest, table[at.LAST_ORDER])
    table[at.LAST_ORDER] = highest
    if order == 0:
        return 0
    call = (
        table[at.INSTANCE],
        table[at.SLOPE_REFERENCES],
        order * n,
        table[at.SLOPE_ORDERS],
        table[at.SLOPE_VALUES],
    )
    return _outcome(table, at.DERIVING, _set_derivatives(table[at.SET_DERIVATIVES], call))


@njit(cache=True)
def _advance(table: Any, t: float, h: float, data: int) -> int:
    instance, never_back = table[at.INSTANCE], table[at.NEVER_BACK]
    if table[at.VERSION] == 2:
        return _outcome(table, at.STEPPING, do_step2(table[at.DO_STEP], (instance, t, h, never_back)))
    flags = data + 8 * at.FLAGS
    how = (instance, t, h, never_back, flags, flags + 1, flags + 2, data + 8 * at.LAST)
    action = _outcome(table, at.STEPPING, do_step3(table[at.DO_STEP], how))
    if action == 0 and table[at.FLAGS] & ENDING:
        return at.ENDED
    return action


@cfunc(STEP, cache=True)
def step_mixed(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an instance of either version."""
    table = integers_at(data)
    row = data + 8 * at.HEADER
    for _ in range(table[at.N_SET]):
        action = _set(table, integers_at(row), u)
        if action:
            return action
        row += 8 * at.ROW
    if table[at.N_SLOPES]:
        action = _derive(table, u)
        if action:
            return action
    action = _advance(table, t, h, data)
    if action:
        return action
    outputs = doubles_at(y)
    for _ in range(table[at.N_GET]):
        action = _get(table, integers_at(row), outputs)
        if action:
            return action
        row += 8 * at.ROW
    return 0
