"""What is generated from the variable table: ``modelDescription.xml`` for FMI 2 and 3, and a C header.

All functions are pure: they take the table and return text.
"""

from __future__ import annotations

import hashlib
import math
import uuid
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from fmu_wheelset.variables import UNITS, VARIABLES, DriveMode, Variable

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

__all__ = ["MODEL", "build_description", "c_header", "fmi2_xml", "fmi3_xml", "instantiation_token"]

#: Name of the model and of its shared library.
MODEL = "wheelset"
TITLE = "Solid-axle wheelset with nonlinear creep forces"
ENUMERATIONS = {"drive_mode": DriveMode}
LOG_CATEGORIES = {
    "logStatusError": "messages of calls that return an error",
    "logStatusDiscard": "messages of calls at states that have no derivatives",
}
CAPABILITIES_2 = ("canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative")
CAPABILITIES_3 = (
    *("canGetAndSetFMUState", "canSerializeFMUState"),
    *("providesDirectionalDerivatives", "providesAdjointDerivatives"),
)
STEP_SIZE = 1e-3
STOP_TIME = 10.0


def instantiation_token(sources: Mapping[str, bytes], variables: Sequence[Variable] = VARIABLES) -> str:
    """Return a GUID-shaped hash of the C sources (by file name) and the variable table."""
    digest = hashlib.sha256()
    for name in sorted(sources):
        digest.update(f"{name}:{len(sources[name])}\n".encode())
        digest.update(sources[name])
    for variable in variables:
        digest.update(f"{variable!r}\n".encode())
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"


def _number(value: float) -> str:
    """Shortest decimal text that reads back as the same float."""
    return repr(float(value))


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _type_name(variable: Variable) -> str:
    return ENUMERATIONS[variable.name].__name__


def _start(variable: Variable) -> str | None:
    if variable.start is None:
        return None
    if variable.kind == "Float64":
        return _number(variable.start)
    if variable.kind == "Boolean":
        return "true" if variable.start else "false"
    return str(int(variable.start))


def _real_attributes(variable: Variable) -> dict[str, str]:
    """Attributes that FMI 2 and 3 share, without the reference to another variable."""
    facts = {
        "unit": variable.unit,
        "min": _number(variable.minimum) if math.isfinite(variable.minimum) else None,
        "max": _number(variable.maximum) if math.isfinite(variable.maximum) else None,
        "nominal": _number(variable.nominal) if variable.nominal else None,
        "start": _start(variable),
    }
    return {name: value for name, value in facts.items() if value is not None}


def _common_attributes(variable: Variable, reference: int) -> dict[str, str]:
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": variable.causality,
        "variability": variable.variability,
        "description": variable.description,
    }
    # An input has initial="exact" by definition and may not say so.
    if variable.initial:
        attributes["initial"] = variable.initial
    return attributes


def _unit_definitions(root: ET.Element) -> None:
    units = ET.SubElement(root, "UnitDefinitions")
    for name, exponents in UNITS.items():
        unit = ET.SubElement(units, "Unit", name=name)
        ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in exponents.items()})


def _log_categories(root: ET.Element) -> None:
    categories = ET.SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        ET.SubElement(categories, "Category", name=name, description=description)


def _default_experiment(root: ET.Element) -> None:
    experiment = {"startTime": _number(0.0), "stopTime": _number(STOP_TIME), "stepSize": _number(STEP_SIZE)}
    ET.SubElement(root, "DefaultExperiment", experiment)


def _outputs(variables: Sequence[Variable]) -> list[Variable]:
    return [v for v in variables if v.causality == "output"]


def _state_derivatives(variables: Sequence[Variable]) -> list[Variable]:
    """Return the derivatives in the order of their states."""
    by_state = {v.derivative_of: v for v in variables if v.derivative_of}
    return [by_state[v.name] for v in variables if v.is_state]


def _initial_unknowns(variables: Sequence[Variable]) -> list[Variable]:
    return [v for v in variables if v.initial == "calculated"]


def _root(version: str, token: tuple[str, str]) -> ET.Element:
    attributes = {
        "fmiVersion": version,
        "modelName": MODEL,
        token[0]: token[1],
        "description": TITLE,
        "license": "MIT",
        "generationTool": "wheelset-cosim",
        "variableNamingConvention": "structured",
    }
    return ET.Element("fmiModelDescription", attributes)


def _interfaces(root: ET.Element, capabilities: Sequence[str]) -> list[ET.Element]:
    """Add what the model can be used for, and return the elements."""
    flags = {"modelIdentifier": MODEL} | dict.fromkeys(capabilities, "true")
    # FMI 3 asks whether the call is needed, and takes no for granted.
    exchange = {"completedIntegratorStepNotNeeded": "true"} if root.get("fmiVersion") == "2.0" else {}
    steps = {"canHandleVariableCommunicationStepSize": "true"}
    return [
        ET.SubElement(root, "ModelExchange", flags | exchange),
        ET.SubElement(root, "CoSimulation", flags | steps),
    ]


def fmi2_xml(token: str, source_files: Sequence[str] = (), variables: Sequence[Variable] = VARIABLES) -> str:
    """Return ``modelDescription.xml`` for FMI 2.0.

    Parameters
    ----------
    token : the GUID, also compiled into the binary.
    source_files : C files below ``sources/`` that make up the model.
    variables : the table.
    """
    index = {v.name: str(i) for i, v in enumerate(variables, start=1)}
    root = _root("2.0", ("guid", token))
    for interface in _interfaces(root, CAPABILITIES_2):
        files = ET.SubElement(interface, "SourceFiles")
        for name in source_files:
            ET.SubElement(files, "File", name=name)
    _unit_definitions(root)
    types = ET.SubElement(root, "TypeDefinitions")
    for enumeration in ENUMERATIONS.values():
        simple = ET.SubElement(types, "SimpleType", name=enumeration.__name__)
        items = ET.SubElement(simple, "Enumeration")
        for item in enumeration:
            ET.SubElement(items, "Item", name=item.name.lower(), value=str(item.value))
    _log_categories(root)
    _default_experiment(root)

    table = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        scalar = ET.SubElement(table, "ScalarVariable", _common_attributes(variable, reference))
        if variable.kind == "Float64":
            real = ET.SubElement(scalar, "Real", _real_attributes(variable))
            if variable.derivative_of:
                real.set("derivative", index[variable.derivative_of])
        elif variable.kind == "Boolean":
            ET.SubElement(scalar, "Boolean", start=str(_start(variable)))
        else:
            attributes = {"declaredType": _type_name(variable), "start": str(_start(variable))}
            ET.SubElement(scalar, "Enumeration", attributes)

    structure = ET.SubElement(root, "ModelStructure")
    outputs = ET.SubElement(structure, "Outputs")
    derivatives = ET.SubElement(structure, "Derivatives")
    for parent, unknowns in ((outputs, _outputs(variables)), (derivatives, _state_derivatives(variables))):
        for v in unknowns:
            known = " ".join(sorted((index[name] for name in v.depends_on), key=int))
            ET.SubElement(parent, "Unknown", index=index[v.name], dependencies=known)
    initial = ET.SubElement(structure, "InitialUnknowns")
    for v in _initial_unknowns(variables):
        ET.SubElement(initial, "Unknown", index=index[v.name])
    return _text(root)


def fmi3_xml(token: str, variables: Sequence[Variable] = VARIABLES) -> str:
    """Return ``modelDescription.xml`` for FMI 3.0.

    Parameters
    ----------
    token : the instantiation token, also compiled into the binary.
    variables : the table.
    """
    reference = {v.name: str(i) for i, v in enumerate(variables)}
    root = _root("3.0", ("instantiationToken", token))
    _interfaces(root, CAPABILITIES_3)
    _unit_definitions(root)
    types = ET.SubElement(root, "TypeDefinitions")
    for enumeration in ENUMERATIONS.values():
        items = ET.SubElement(types, "EnumerationType", name=enumeration.__name__)
        for item in enumeration:
            ET.SubElement(items, "Item", name=item.name.lower(), value=str(item.value))
    _log_categories(root)
    _default_experiment(root)

    table = ET.SubElement(root, "ModelVariables")
    for i, variable in enumerate(variables):
        element = ET.SubElement(table, variable.kind, _common_attributes(variable, i))
        if variable.kind == "Float64":
            element.attrib.update(_real_attributes(variable))
            if variable.derivative_of:
                element.set("derivative", reference[variable.derivative_of])
        else:
            element.set("start", str(_start(variable)))
        if variable.kind == "Enumeration":
            element.set("declaredType", _type_name(variable))

    structure = ET.SubElement(root, "ModelStructure")
    for tag, unknowns in (
        ("Output", _outputs(variables)),
        ("ContinuousStateDerivative", _state_derivatives(variables)),
    ):
        for v in unknowns:
            known = " ".join(sorted((reference[name] for name in v.depends_on), key=int))
            ET.SubElement(structure, tag, valueReference=reference[v.name], dependencies=known)
    for v in _initial_unknowns(variables):
        ET.SubElement(structure, "InitialUnknown", valueReference=reference[v.name])
    return _text(root)


def build_description(source_files: Iterable[str]) -> str:
    """Return ``sources/buildDescription.xml`` of FMI 3.0 for the given C files."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=MODEL)
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    for name in source_files:
        ET.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _c_number(value: float) -> str:
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return _number(value)


def _settable(variable: Variable) -> str:
    if variable.causality == "input":
        return "ALWAYS"
    return "BEFORE_RUN" if variable.initial == "exact" else "READ_ONLY"


def _source(variable: Variable) -> str:
    if variable.field.startswith("peak["):
        return "PEAK_LEFT" if "[LEFT]" in variable.field else "PEAK_RIGHT"
    # States without start value are computed with the outputs until the run begins.
    computed = variable.field.startswith(("x_dot[", "outputs.")) or variable.initial == "calculated"
    return "EVALUATED" if computed else "STORED"


def c_header(token: str, variables: Sequence[Variable] = VARIABLES) -> str:
    """Return ``variables.h``: the token, the table by value reference and the nominals of the states."""
    rows = (
        f'    {{"{v.name}", {v.kind.upper()}, {_settable(v)}, {_source(v)}, offsetof(Component, {v.field}),\n'
        f"     {_c_number(v.start or 0.0)}, {_c_number(v.minimum)}, {_c_number(v.maximum)}}},\n"
        for v in variables
    )
    nominals = (
        f"    {v.field.removeprefix('wheelset.x')} = {_c_number(v.nominal or 1.0)},\n"
        for v in variables
        if v.is_state
    )
    return (
        "/* Generated from the variable table; included by component.c. */\n"
        f'#define TOKEN "{token}"\n'
        f"enum {{ N_VARIABLES = {len(variables)} }};\n\n"
        f"static const Variable VARIABLES[N_VARIABLES] = {{\n{''.join(rows)}}};\n\n"
        f"static const double STATE_NOMINALS[N_STATES] = {{\n{''.join(nominals)}}};\n"
    )
