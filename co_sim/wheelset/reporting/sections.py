"""The sections of the report over a grid, in reading order."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from co_sim.wheelset.reporting.information_section import information_sections
from co_sim.wheelset.reporting.roads_section import roads_section
from co_sim.wheelset.reporting.structure_section import structure_sections

if TYPE_CHECKING:
    from collections.abc import Mapping

    from co_sim.wheelset.reporting.section import MakeSection

__all__ = ["SECTIONS"]

#: Functions that compute sections, by what the progress bar calls them.
SECTIONS: Mapping[str, MakeSection] = MappingProxyType(
    {
        "Structure": structure_sections,
        "Identifiability": information_sections,
        "Three roads": roads_section,
    }
)
