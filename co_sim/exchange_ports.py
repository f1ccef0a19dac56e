"""Inputs and outputs of other types than float64, for the compiled step of a Model Exchange FMU.

Apart from that step, so that only FMUs with such ports wait for this to be compiled.
"""

from __future__ import annotations

from numba import cfunc

from co_sim import fmi_table as at
from co_sim.fmi_step_mixed import get_row, set_row
from co_sim.native import STEP, integers_at

__all__ = ["get_ports", "set_ports"]


@cfunc(STEP, cache=True)
def set_ports(t: float, h: float, u: int, y: int, data: int) -> int:
    """Set all inputs."""
    table = integers_at(data)
    row = data + 8 * at.HEADER
    for _ in range(table[at.N_SET]):
        action = set_row(table, integers_at(row), u)
        if action:
            return action
        row += 8 * at.ROW
    return 0


@cfunc(STEP, cache=True)
def get_ports(t: float, h: float, u: int, y: int, data: int) -> int:
    """Get all outputs."""
    table = integers_at(data)
    row = data + 8 * (at.HEADER + at.ROW * table[at.N_SET])
    for _ in range(table[at.N_GET]):
        action = get_row(table, integers_at(row), y)
        if action:
            return action
        row += 8 * at.ROW
    return 0
