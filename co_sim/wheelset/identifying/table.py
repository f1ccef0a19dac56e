"""Columns of a log file by name, whatever the format of the file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError, suggestion
from co_sim.units import UnknownUnitError, conversion

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["COLUMNS", "OPTIONAL", "Columns", "Found", "choose", "convert"]

#: The columns of a log with the unit and meaning of each.
COLUMNS = {
    "time": ("s", "time"),
    "yaw_rate": ("rad/s", "yaw rate of the wheelset"),
    "lateral_acceleration": ("m/s2", "lateral acceleration of the wheelset"),
    "speed": ("m/s", "forward speed"),
    "traction_torque": ("N.m", "total torque on the axle, negative when braking"),
}
#: What costs accuracy where it is missing, but not the run; `speed` only if it is given otherwise.
OPTIONAL = ("traction_torque",)

_HEADING = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))?$", re.S)


@dataclass(frozen=True, slots=True)
class Found:
    """Where a column is: its position in the file, its heading there, and its unit if one is told."""

    index: int
    heading: str
    unit: str | None = None


@dataclass(frozen=True)
class Columns:
    """What was read from a file.

    Parameters
    ----------
    values : (rows,) by name of `COLUMNS`, SI; NaN where the file has no number.
    ignored : headings of the columns that are not used.
    notes : what a reader of the results must know about the reading.
    """

    values: Mapping[str, Array]
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())


def choose(
    file: str,
    headings: Sequence[str],
    wanted: Iterable[str],
    renamed: Mapping[str, str],
    units: Sequence[str | None] | None = None,
) -> dict[str, Found]:
    """Find the columns of a log among the headings of a file.

    A heading is a name with or without its unit, ``speed [km/h]``. ``sensors.yaw_rate`` serves as
    ``yaw_rate`` if no other column does.

    Parameters
    ----------
    file : name for messages. headings : of the file, in order.
    wanted : names of `COLUMNS` to look for. renamed : heading to take for a name instead.
    units : of the columns where the file tells them apart from the headings.

    Raises
    ------
    InputError
        If a column is missing, not optional, or there are several of its name; all faults are told.
    """
    split = [_split(heading) for heading in headings]
    faults, found = [], {}
    for name in wanted:
        places = _places(renamed.get(name, name), split, exact=name in renamed)
        if len(places) == 1:
            i = places[0]
            told = units[i] if units and units[i] else split[i][1]
            found[name] = Found(i, headings[i], told)
        elif places:
            faults.append(_several(file, name, [headings[i] for i in places]))
        elif name not in OPTIONAL or name in renamed:
            faults.append(_missing(file, name, renamed.get(name, name), [s[0] for s in split]))
    if faults:
        raise InputError.from_faults(faults)
    return found


def convert(
    file: str, found: Mapping[str, Found], values: Mapping[str, Array]
) -> tuple[dict[str, Array], list[str]]:
    """Return the values in SI, where a heading tells another unit, and a sentence for each that changed.

    Raises
    ------
    InputError
        If a unit is unknown or of another quantity; all faults are told.
    """
    faults, converted, notes = [], {}, []
    for name, column in values.items():
        unit, (si, _) = found[name].unit, COLUMNS[name]
        try:
            scale = (1.0, 0.0) if unit is None else conversion(unit.replace("Nm", "N.m"), si)
        except UnknownUnitError:
            scale = None
        if scale is None:
            faults.append(
                Fault(
                    f"{file}: column {found[name].heading}",
                    f'the unit "{unit}"',
                    f"{si} or another unit of this quantity",
                    "correct the heading, or leave the unit out if the values are SI",
                )
            )
            continue
        converted[name] = column
        if scale != (1.0, 0.0):
            converted[name] = column * scale[0] + scale[1]
            notes.append(f"{found[name].heading} was converted to {si}.")
    if faults:
        raise InputError.from_faults(faults)
    return converted, notes


def _split(heading: str) -> tuple[str, str | None]:
    """Return the name and the unit of a heading."""
    match = _HEADING.match(heading.strip())
    if match is None:
        return heading, None
    unit = match["square"] if match["square"] is not None else match["round"]
    return match["name"], unit.strip() if unit and unit.strip() else None


def _places(name: str, split: Sequence[tuple[str, str | None]], *, exact: bool) -> list[int]:
    places = [i for i, (heading, _) in enumerate(split) if heading == name]
    if places or exact:
        return places
    return [i for i, (heading, _) in enumerate(split) if heading.endswith(f".{name}")]


def _several(file: str, name: str, headings: Sequence[str]) -> Fault:
    return Fault(
        f"{file}: column {name}",
        f"{len(headings)}: {', '.join(headings)}",
        "one",
        f"say which with --column {name}=HEADING, or rename the others",
    )


def _missing(file: str, name: str, sought: str, names: Sequence[str]) -> Fault:
    unit, meaning = COLUMNS[name]
    remedy = f"{suggestion(sought, names).rstrip('?')}? Say so with --column {name}=HEADING"
    if name == "speed":
        remedy = f"give a constant with --speed, or: {remedy}"
    return Fault(
        f"{file}: column {sought}", "none of this name", f"a column with the {meaning} in {unit}", remedy
    )
