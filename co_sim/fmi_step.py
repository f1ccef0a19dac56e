"""Steps of FMUs whose ports are all float64 as machine code, see `co_sim.fmi_calls`."""

from __future__ import annotations

from numba import cfunc

from co_sim.fmi_calls import fmi2_step, fmi3_step
from co_sim.native import STEP

__all__ = ["step2", "step3"]


@cfunc(STEP, cache=True)
def step2(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an FMI 2 instance."""
    return fmi2_step(t, h, u, y, data)


@cfunc(STEP, cache=True)
def step3(t: float, h: float, u: int, y: int, data: int) -> int:
    """Do a step of an FMI 3 instance."""
    return fmi3_step(t, h, u, y, data)
