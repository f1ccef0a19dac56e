"""Inputs and outputs of other types than float64, for the compiled step of a Model Exchange FMU.

Apart from that step, so that only FMUs with such ports wait for this to be compiled.
"""

from __future__ import annotations

from numba import cfunc

from co_sim.fmi_step_mixed import get_all, set_all
from co_sim.native import STEP

__all__ = ["get_ports", "set_ports"]


@cfunc(STEP, cache=True)
def set_ports(t: float, h: float, u: int, y: int, data: int) -> int:
    """Set all inputs."""
    return int(set_all(data, u))


@cfunc(STEP, cache=True)
def get_ports(t: float, h: float, u: int, y: int, data: int) -> int:
    """Get all outputs."""
    return int(get_all(data, y))
