"""A step of an FMU whose ports are all float64, for compiled code: set inputs, doStep, get outputs.

The calls work on the memory of the master: nothing is copied. There is one row for each in the table
(`co_sim.fmi_table`); without inputs or outputs, theirs has no references.

The compiled loop has these lines within itself (`co_sim.kernel`), and so have the step functions of
`co_sim.fmi_step`. Machine code is cached by the date of the file that it was asked for in: a change here must
touch those too.
"""

from __future__ import annotations

from typing import Any

from numba import njit, types

from co_sim import fmi_table as at
from co_sim.native import caller, integers_at

__all__ = ["ENDING", "do_step2", "do_step3", "failing", "fmi2_step", "fmi3_step", "transfer2", "transfer3"]

#: Bytes of `FLAGS` that end a run: terminate and early return.
ENDING = 0xFFFF00

_pointer, _double, _int = types.intp, types.float64, types.int32
transfer2 = caller(_int(_pointer, _pointer, _pointer, _pointer))
transfer3 = caller(_int(_pointer, _pointer, _pointer, _pointer, _pointer))
# An int for a boolean of FMI 3: the callee looks at its lowest byte, or at all of it.
do_step2 = caller(_int(_pointer, _double, _double, _int))
do_step3 = caller(_int(_pointer, _double, _double, _int, _pointer, _pointer, _pointer, _pointer))

_SET, _GET = at.HEADER, at.HEADER + at.ROW


@njit()
def failing(table: Any, action: int, status: int) -> int:
    """Take note of the status of a call that ends the step by `action`."""
    table[at.STATUS] = status
    return action


@njit()
def fmi2_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an FMI 2 instance."""
    # A pointer, not an array: everything here is counted in ns.
    table = integers_at(data)
    instance = table[at.INSTANCE]
    n = table[_SET + at.N_REFERENCES]
    if n:
        status = transfer2(table[_SET + at.FUNCTION], (instance, table[_SET + at.REFERENCES], n, u))
        if status < 0 or status > 1:
            return failing(table, at.SETTING, status)
    status = do_step2(table[at.DO_STEP], (instance, t, h, table[at.NEVER_BACK]))
    if status < 0 or status > 1:
        return failing(table, at.STEPPING, status)
    n = table[_GET + at.N_REFERENCES]
    if n:
        status = transfer2(table[_GET + at.FUNCTION], (instance, table[_GET + at.REFERENCES], n, y))
        if status < 0 or status > 1:
            return failing(table, at.GETTING, status)
    return 0


@njit()
def fmi3_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an FMI 3 instance."""
    table = integers_at(data)
    instance = table[at.INSTANCE]
    n = table[_SET + at.N_REFERENCES]
    if n:
        values = (instance, table[_SET + at.REFERENCES], n, u, table[_SET + at.N_VALUES])
        status = transfer3(table[_SET + at.FUNCTION], values)
        if status < 0 or status > 1:
            return failing(table, at.SETTING, status)
    flags = data + 8 * at.FLAGS
    how = (instance, t, h, table[at.NEVER_BACK], flags, flags + 1, flags + 2, data + 8 * at.LAST)
    status = do_step3(table[at.DO_STEP], how)
    if status < 0 or status > 1:
        return failing(table, at.STEPPING, status)
    if table[at.FLAGS] & ENDING:
        return at.ENDED
    n = table[_GET + at.N_REFERENCES]
    if n:
        values = (instance, table[_GET + at.REFERENCES], n, y, table[_GET + at.N_VALUES])
        status = transfer3(table[_GET + at.FUNCTION], values)
        if status < 0 or status > 1:
            return failing(table, at.GETTING, status)
    return 0
