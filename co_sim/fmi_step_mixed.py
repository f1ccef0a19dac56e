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
from co_sim.fmi_calls import ENDING, do_step2, do_step3, failing, transfer2, transfer3
from co_sim.native import STEP, caller, doubles_at, integers_at, pointer_to

__all__ = ["get_all", "set_all", "step_mixed"]

_LARGEST = float(finfo(float32).max)

_pointer, _int = types.intp, types.int32
_set_derivatives = caller(_int(_pointer, _pointer, _pointer, _pointer, _pointer))
_float32 = pointer_to(types.float32)
_int8, _uint8 = pointer_to(types.int8), pointer_to(types.uint8)
_int16, _uint16 = pointer_to(types.int16), pointer_to(types.uint16)
_int32, _uint32 = pointer_to(types.int32), pointer_to(types.uint32)
_uint64 = pointer_to(types.uint64)


@njit()
def _outcome(table: Any, action: int, status: int) -> int:
    """Return how a call that returned `status` ends the step: 0 after ok and warning."""
    if 0 <= status <= 1:
        return 0
    return failing(table, action, status)


@njit()
def _fits(x: float, code: int, low: int, high: int) -> bool:
    """Tell whether a type can hold an input."""
    if code == at.FLOAT64:
        return True
    if code == at.FLOAT32:
        return not (_LARGEST < abs(x) < math.inf)
    return low <= x <= high and x == math.floor(x)


@njit()
def _store(address: int, i: int, code: int, x: float) -> None:
    """Write an input that fits into the buffer of its type."""
    if code == at.FLOAT64:
        doubles_at(address)[i] = x
    elif code == at.FLOAT32:
        _float32(address)[i] = x
    elif code == at.INT8:
        _int8(address)[i] = x
    elif code in (at.UINT8, at.BOOLEAN8):
        _uint8(address)[i] = x
    elif code == at.INT16:
        _int16(address)[i] = x
    elif code == at.UINT16:
        _uint16(address)[i] = x
    elif code in (at.INT32, at.BOOLEAN32):
        _int32(address)[i] = x
    elif code == at.UINT32:
        _uint32(address)[i] = x
    else:  # Up to 2**53, both 64-bit types look alike.
        integers_at(address)[i] = x


@njit()
def _is_exact(address: int, i: int, code: int) -> bool:
    """Tell whether a float64 can hold an output for certain."""
    if code == at.INT64:
        return bool(-at.EXACT <= integers_at(address)[i] <= at.EXACT)
    return code != at.UINT64 or bool(_uint64(address)[i] <= types.uint64(at.EXACT))


@njit()
def _load(address: int, i: int, code: int) -> float:
    """Return an output that is exact from the buffer of its type."""
    if code == at.FLOAT64:
        x = float(doubles_at(address)[i])
    elif code == at.FLOAT32:
        x = float(_float32(address)[i])
    elif code == at.INT8:
        x = float(_int8(address)[i])
    elif code == at.UINT8:
        x = float(_uint8(address)[i])
    elif code == at.INT16:
        x = float(_int16(address)[i])
    elif code == at.UINT16:
        x = float(_uint16(address)[i])
    elif code == at.INT32:
        x = float(_int32(address)[i])
    elif code == at.UINT32:
        x = float(_uint32(address)[i])
    elif code == at.BOOLEAN8:
        x = 1.0 if _uint8(address)[i] else 0.0
    elif code == at.BOOLEAN32:
        x = 1.0 if _int32(address)[i] else 0.0
    else:
        x = float(integers_at(address)[i])
    return x


@njit()
def _transfer(table: Any, row: Any, action: int) -> int:
    """Make the call of a row."""
    n, address = row[at.N_REFERENCES], row[at.VALUES]
    if table[at.VERSION] == 2:
        status = transfer2(row[at.FUNCTION], (table[at.INSTANCE], row[at.REFERENCES], n, address))
    else:
        values = (table[at.INSTANCE], row[at.REFERENCES], n, address, row[at.N_VALUES])
        status = transfer3(row[at.FUNCTION], values)
    return _outcome(table, action, status)


@njit()
def _set(table: Any, row: Any, u: int) -> int:
    """Make a call that sets inputs."""
    code, address, positions = row[at.CODE], row[at.VALUES], integers_at(row[at.POSITIONS])
    for i in range(row[at.N_VALUES]):
        k = positions[i]
        x = doubles_at(u)[k]
        if not _fits(x, code, row[at.LOW], row[at.HIGH]):
            table[at.ELEMENT], table[at.VALUE] = k, integers_at(u)[k]
            return at.UNFIT_INPUT
        _store(address, i, code, x)
    return _transfer(table, row, at.SETTING)


@njit()
def _get(table: Any, row: Any, y: int) -> int:
    """Make a call that gets outputs."""
    action = _transfer(table, row, at.GETTING)
    if action:
        return action
    code, address, positions = row[at.CODE], row[at.VALUES], integers_at(row[at.POSITIONS])
    for i in range(row[at.N_VALUES]):
        k = positions[i]
        if not _is_exact(address, i, code):
            table[at.ELEMENT], table[at.VALUE] = k, integers_at(address)[i]
            return at.UNFIT_OUTPUT
        doubles_at(y)[k] = _load(address, i, code)
    return 0


@njit()
def set_all(data: int, u: int) -> int:
    """Set all inputs."""
    table = integers_at(data)
    row = data + 8 * at.HEADER
    for _ in range(table[at.N_SET]):
        action = _set(table, integers_at(row), u)
        if action:
            return action
        row += 8 * at.ROW
    return 0


@njit()
def get_all(data: int, y: int) -> int:
    """Get all outputs."""
    table = integers_at(data)
    row = data + 8 * (at.HEADER + at.ROW * table[at.N_SET])
    for _ in range(table[at.N_GET]):
        action = _get(table, integers_at(row), y)
        if action:
            return action
        row += 8 * at.ROW
    return 0


@njit()
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


@njit()
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
    action = set_all(data, u)
    if action:
        return action
    if table[at.N_SLOPES]:
        action = _derive(table, u)
        if action:
            return action
    action = _advance(table, t, h, data)
    if action:
        return action
    return get_all(data, y)
