"""Steps of FMUs as machine code, for FMUs whose ports are all float64: set inputs, doStep, get outputs.

The calls work on the memory of the master: nothing is copied. There is one row for each in the table
(`co_sim.fmi_table`); without inputs or outputs, theirs has no references.
"""

from __future__ import annotations

from typing import Any

from numba import carray, cfunc, njit, types  # type: ignore[attr-defined]

from co_sim import fmi_table as at
from co_sim.native import STEP, caller, integers_at

__all__ = ["do_step2", "do_step3", "ending", "failing", "step2", "step3", "transfer2", "transfer3"]

#: Bytes of `FLAGS` that end a run: terminate and early return.
_ENDING = 0xFFFF00

_pointer, _double, _int = types.intp, types.float64, types.int32
transfer2 = caller(_int(_pointer, _pointer, _pointer, _pointer))
transfer3 = caller(_int(_pointer, _pointer, _pointer, _pointer, _pointer))
# An int for a boolean of FMI 3: the callee looks at its lowest byte, or at all of it.
do_step2 = caller(_int(_pointer, _double, _double, _int))
do_step3 = caller(_int(_pointer, _double, _double, _int, _pointer, _pointer, _pointer, _pointer))

_SET, _GET = at.HEADER, at.HEADER + at.ROW
_SIZE = at.HEADER + 2 * at.ROW


@njit(cache=True)
def failing(table: Any, action: int, status: int) -> int:
    """Return how a call that returned `status` ends the step: 0 after ok and warning."""
    if 0 <= status <= 1:
        return 0
    table[at.STATUS] = status
    return action


@njit(cache=True)
def ending(table: Any, status: int) -> int:
    """Return how a doStep of FMI 3 ends the step."""
    action = failing(table, at.STEPPING, status)
    if action == 0 and table[at.FLAGS] & _ENDING:
        return at.ENDED
    return action


@cfunc(STEP, cache=True)
def step2(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an FMI 2 instance."""
    table = carray(integers_at(data), _SIZE)
    instance = table[at.INSTANCE]
    n = table[_SET + at.N_REFERENCES]
    if n:
        status = transfer2(table[_SET + at.FUNCTION], (instance, table[_SET + at.REFERENCES], n, u))
        action = failing(table, at.SETTING, status)
        if action:
            return action
    status = do_step2(table[at.DO_STEP], (instance, t, h, table[at.NEVER_BACK]))
    action = failing(table, at.STEPPING, status)
    n = table[_GET + at.N_REFERENCES]
    if action or not n:
        return action
    status = transfer2(table[_GET + at.FUNCTION], (instance, table[_GET + at.REFERENCES], n, y))
    return failing(table, at.GETTING, status)


@cfunc(STEP, cache=True)
def step3(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an FMI 3 instance."""
    table = carray(integers_at(data), _SIZE)
    instance = table[at.INSTANCE]
    n = table[_SET + at.N_REFERENCES]
    if n:
        values = (instance, table[_SET + at.REFERENCES], n, u, table[_SET + at.N_VALUES])
        action = failing(table, at.SETTING, transfer3(table[_SET + at.FUNCTION], values))
        if action:
            return action
    flags = data + 8 * at.FLAGS
    how = (instance, t, h, table[at.NEVER_BACK], flags, flags + 1, flags + 2, data + 8 * at.LAST)
    action = ending(table, do_step3(table[at.DO_STEP], how))
    n = table[_GET + at.N_REFERENCES]
    if action or not n:
        return action
    values = (instance, table[_GET + at.REFERENCES], n, y, table[_GET + at.N_VALUES])
    return failing(table, at.GETTING, transfer3(table[_GET + at.FUNCTION], values))
