"""``terminalsAndIcons.xml`` of FMI 3: the variables that belong together where another model is connected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["TERMINALS", "Terminal", "terminals_xml"]


@dataclass(frozen=True, slots=True)
class Terminal:
    """A physical connection.

    Parameters
    ----------
    name, description : as in the file.
    efforts : variables that act on the wheelset and sum to zero at a connection, by the name of the member.
    motions : variables that are equal on both sides, by the name of the member.
    """

    name: str
    description: str
    efforts: Mapping[str, str]
    motions: Mapping[str, str]


TERMINALS = (
    Terminal(
        name="suspension",
        description="where a vehicle's primary suspension holds the wheelset",
        efforts={"lateral_force": "suspension_lateral_force", "yaw_moment": "suspension_yaw_moment"},
        motions={
            "lateral_displacement": "lateral_displacement",
            "yaw_angle": "yaw_angle",
            "lateral_velocity": "lateral_velocity",
            "yaw_rate": "yaw_rate",
        },
    ),
    Terminal(
        name="drive",
        description="where a motor turns the right wheel, torque driven",
        efforts={"torque": "traction_torque"},
        motions={"speed": "right.wheel_speed"},
    ),
)


def terminals_xml() -> str:
    """Return ``terminalsAndIcons/terminalsAndIcons.xml``."""
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    picture = ET.SubElement(root, "GraphicalRepresentation")
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    ET.SubElement(picture, "CoordinateSystem", corners | {"suggestedScalingFactorTo_mm": "0.1"})
    ET.SubElement(picture, "Icon", corners)
    terminals = ET.SubElement(root, "Terminals")
    for terminal in TERMINALS:
        facts = {"name": terminal.name, "matchingRule": "plug", "description": terminal.description}
        element = ET.SubElement(terminals, "Terminal", facts)
        for kind, members in (("inflow", terminal.efforts), ("signal", terminal.motions)):
            for member, variable in members.items():
                described = {"variableName": variable, "memberName": member, "variableKind": kind}
                ET.SubElement(element, "TerminalMemberVariable", described)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
