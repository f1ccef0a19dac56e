"""The description of an FMU, read so that nothing in it does harm; fmpy makes the objects of it."""

from __future__ import annotations

import io
import zipfile
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import fmpy
from fmpy.model_description import read_model_description

from co_sim.archives import DEFAULT_LIMITS, read_entry
from co_sim.errors import Fault, InputError
from co_sim.fmu_elements import Declaration, reference_faults
from co_sim.safe_xml import parse, schema_faults

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fmpy.model_description import ModelDescription
    from lxml.etree import _Element

    from co_sim.archives import Limits

__all__ = ["DESCRIPTION", "description_schema", "read_description", "schema_folder"]

DESCRIPTION = "modelDescription.xml"
#: Faults that are told at once; `wheelset check` tells all.
_MOST_FAULTS = 10


def read_description(path: Path, limits: Limits = DEFAULT_LIMITS) -> ModelDescription:
    """Return the description of the FMU at `path`, without unpacking the archive.

    What departs from the XML schema, and references that lead nowhere, are refused. What only breaks a rule
    in the text of the standard, such as a unit that is not defined, is left to `co_sim.checking`.

    Raises
    ------
    InputError
        If the archive or the description is refused; with the line and the element.
    """
    what = f"{path}: {DESCRIPTION}"
    data = read_entry(path, DESCRIPTION, limits)
    root = parse(data, what)
    # Nobody needs it, and many get it wrong.
    root.attrib.pop("generationDateAndTime", None)
    _refuse(schema_faults(root, description_schema(root, what), what))
    if root.get("fmiVersion") != "1.0":
        _refuse(reference_faults(Declaration(root), what))
    try:
        description = read_model_description(_alone(data), validate=False)
    except Exception as error:
        raise InputError(
            what,
            got=" ".join(str(error).split()) or type(error).__name__,
            expected="a description by the rules of FMI",
            remedy="see all that is wrong with `wheelset check`",
        ) from error
    if description.fmiMajorVersion == 3:
        _complete(description, root)
    return description


def description_schema(root: _Element, what: str) -> Path:
    """Return the XML schema for a description.

    Raises
    ------
    InputError
        If its version of FMI is none that is known.
    """
    version = root.get("fmiVersion") or ""
    if version == "1.0":
        return schema_folder(1) / "fmiModelDescription.xsd"
    major = 2 if version == "2.0" else 3 if version.startswith("3.") else None
    if major is None:
        raise InputError(
            f"{what}, line {root.sourceline}",
            got=f'<{root.tag}> with fmiVersion="{version}"',
            expected="<fmiModelDescription> of FMI 2.0 or 3.0",
            remedy="export the model again",
        )
    return schema_folder(major) / f"fmi{major}ModelDescription.xsd"


def schema_folder(version: int) -> Path:
    """Return the folder with the XML schemas of a version of FMI."""
    return Path(fmpy.__file__).parent / "schema" / f"fmi{version}"


def _alone(data: bytes) -> io.BytesIO:
    """Return an archive with nothing but a description, so that fmpy reads what has been looked at."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(DESCRIPTION, data)
    file.seek(0)
    return file


def _refuse(faults: Iterable[Fault]) -> None:
    """Raise the first faults, if there are any."""
    found = list(islice(faults, _MOST_FAULTS))
    if found:
        raise InputError.from_faults(found)


def _complete(description: ModelDescription, root: _Element) -> None:
    """Add what fmpy leaves out: directional derivatives, bounds of unsigned integers, arrays of texts."""
    for kind, interface in (
        ("CoSimulation", description.coSimulation),
        ("ModelExchange", description.modelExchange),
    ):
        element = root.find(kind)
        if element is not None:
            provided = element.get("providesDirectionalDerivatives") in {"true", "1"}
            interface.providesDirectionalDerivative = provided
    elements = {element.get("name"): element for element in root.iterfind("ModelVariables/*")}
    for variable in description.modelVariables:
        element = elements.get(variable.name)
        if element is None:
            continue
        if variable.type.startswith("UInt"):
            variable.min, variable.max = element.get("min"), element.get("max")
        if variable.type == "String" and variable.dimensions:
            variable.start = [start.get("value", "") for start in element.iterfind("Start")] or None
