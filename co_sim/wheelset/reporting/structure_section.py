"""The sections on the structure of the linear models: motion, reach, sight, filters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from co_sim.wheelset.reporting.structure_access import access_sections
from co_sim.wheelset.reporting.structure_filters import filter_section
from co_sim.wheelset.reporting.structure_motion import motion_section

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.section import Section
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["structure_sections"]

#: Shares of the time that the parts take.
_MOTION, _ACCESS = 0.25, 0.65


def structure_sections(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> tuple[Section, ...]:
    """Ask how the wheelset moves, what is reached and seen of it, and where there is a steady filter."""
    motion = motion_section(setup, grid, lambda share: progress(_MOTION * share))
    access = access_sections(setup, grid, lambda share: progress(_MOTION + _ACCESS * share))
    rest = 1.0 - _MOTION - _ACCESS
    filters = filter_section(setup, grid, lambda share: progress(1.0 - rest + rest * share))
    return (motion, *access, filters)
