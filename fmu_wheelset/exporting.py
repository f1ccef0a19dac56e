"""Copies of the packaged FMU, with other start values if asked.

The start values stand in ``modelDescription.xml``, and behind the instantiation token there: an importing
tool need not set what it takes over, but it must hand the token to the binary, which reads them from it
(``sources/token.c``). So one binary serves every set of start values and no compiler is needed.
"""

from __future__ import annotations

import difflib
import struct
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from xml.etree import ElementTree as ET

from fmu_wheelset.archive import write_archive
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode, Variable

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from os import PathLike

__all__ = ["export", "read_start_values"]

DESCRIPTION = "modelDescription.xml"
CHANGEABLE = {v.name: v for v in VARIABLES if v.start is not None}
LARGEST = sys.float_info.max
DRIVE_MODES = {mode.name.lower(): mode for mode in DriveMode}


def export(
    path: str | PathLike[str], fmi: Literal[2, 3] = 3, start_values: Mapping[str, object] | None = None
) -> Path:
    """Write the wheelset FMU, with other start values if asked.

    Parameters
    ----------
    path : file to write; an old one is replaced.
    fmi : major version of the FMI standard that the archive follows.
    start_values : new start values of parameters, inputs and states by name, such as ``{"m_w": 1300.0}``;
        ``drive_mode`` by name, such as ``"torque_driven"``. Names with a dot may be given as tables:
        ``{"patch": {"a": 7e-3}}``. What is not named keeps its start value.

    Returns
    -------
    the path of the file.

    Raises
    ------
    ValueError
        An unknown name or a value out of bounds; one line for each.
    FileNotFoundError
        There is no folder for the file, or no packaged archive.
    """
    from fmu_wheelset import path as packaged

    written = Path(path)
    if not written.parent.is_dir():
        raise FileNotFoundError(f"{path}: got no folder {written.parent}, expected one; make it first")
    changed = _checked(start_values or {})
    with zipfile.ZipFile(packaged(fmi)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    if changed:
        files[DESCRIPTION] = _described(files[DESCRIPTION], changed)
    write_archive(written, files)
    return written


def read_start_values(path: str | PathLike[str]) -> dict[str, Any]:
    """Read start values for `export` from a TOML file.

    Raises
    ------
    ValueError
        The file cannot be read or is not TOML.
    """
    name = Path(path).name
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise _fault(name, str(error.strerror), "a TOML file", "check the path") from None
    except UnicodeDecodeError:
        raise _fault(name, "text that is not UTF-8", "a TOML file", "mend it there") from None
    except tomllib.TOMLDecodeError as error:
        raise _fault(name, f"text that is not TOML ({error})", "TOML 1.0", "mend it there") from None


def _fault(what: str, got: str, expected: str, remedy: str) -> ValueError:
    return ValueError(f"{what}: got {got}, expected {expected}; {remedy}")


def _checked(values: Mapping[str, object]) -> dict[str, float]:
    """Return the start values that differ from the table, by name of the variable."""
    faults, checked = [], {}
    for name, value in _flat(values):
        try:
            checked[name] = _number(name, value)
        except ValueError as fault:
            faults.append(str(fault))
    if faults:
        raise ValueError("\n".join(faults))
    return {name: value for name, value in checked.items() if value != CHANGEABLE[name].start}


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _number(name: str, value: object) -> float:
    """Return a start value as the number that the binary stores."""
    variable = CHANGEABLE.get(name)
    if variable is None:
        closest = difflib.get_close_matches(name, CHANGEABLE, n=1, cutoff=0.0)[0]
        expected = "a variable of the FMU that has a start value"
        raise _fault(name, "an unknown name", expected, f"did you mean {closest}?")
    if variable.kind == "Enumeration":
        if not isinstance(value, str) or value not in DRIVE_MODES:
            raise _fault(name, repr(value), f"one of {', '.join(DRIVE_MODES)}", "choose one by name")
        return DRIVE_MODES[value]
    if variable.kind == "Boolean":
        if not isinstance(value, bool):
            raise _fault(name, repr(value), "true or false", "write it without quotes")
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _fault(name, repr(value), f"a number in {variable.unit}", "write it without quotes")
    if not max(variable.minimum, -LARGEST) <= value <= min(variable.maximum, LARGEST):
        expected = f"a finite value{_bounds(variable)} in {variable.unit}"
        raise _fault(name, f"{value}", expected, f"give the {variable.description} in SI units")
    return float(value)


def _bounds(variable: Variable) -> str:
    """Tell the bounds; the smallest number above zero stands for an excluded zero."""
    lower = "" if variable.minimum < -LARGEST else f" >= {variable.minimum:g}"
    if 0.0 < variable.minimum < sys.float_info.min:
        lower = " > 0"
    upper = "" if variable.maximum > LARGEST else f" <= {variable.maximum:g}"
    return " and".join(filter(None, (lower, upper)))


def _described(xml: bytes, start_values: Mapping[str, float]) -> bytes:
    """Return the model description with other start values and the token that carries them."""
    root = ET.fromstring(xml)
    for element in root.iterfind("ModelVariables/*"):
        name = element.attrib["name"]
        if name in start_values:
            # FMI 2 has an element for the type inside that of the variable.
            holder = element if "start" in element.attrib else element[0]
            holder.set("start", _text(CHANGEABLE[name], start_values[name]))
    attribute = "guid" if "guid" in root.attrib else "instantiationToken"
    root.set(attribute, root.attrib[attribute] + _token_part(start_values))
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"


def _text(variable: Variable, value: float) -> str:
    if variable.kind == "Boolean":
        return "true" if value else "false"
    return repr(float(value)) if variable.kind == "Float64" else str(int(value))


def _token_part(start_values: Mapping[str, float]) -> str:
    """Return the start values as value references and bits."""
    numbers = sorted((REFERENCES[name], struct.pack(">d", value)) for name, value in start_values.items())
    return f"[{','.join(f'{reference}={bits.hex()}' for reference, bits in numbers)}]"
