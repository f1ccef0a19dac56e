"""Types of values in documents of SSP 1.0 and 2.0."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.fmu_parameters import literals_of
from co_sim.fmu_variables import kind_of
from co_sim.ssp.document import NAMESPACES

if TYPE_CHECKING:
    from fmpy.model_description import ModelVariable

    from co_sim.component import Kind
    from co_sim.fmu_parameters import Value

__all__ = ["fits", "parameter_type", "port_type", "write_value"]

#: SSP 2.0 has a name for every type of FMI 3; those of SSP 1.0 are read by all.
_NAMES = {
    "float64": "Real",
    "float32": "Float32",
    "int8": "Int8",
    "uint8": "UInt8",
    "int16": "Int16",
    "uint16": "UInt16",
    "int32": "Integer",
    "uint32": "UInt32",
    "int64": "Int64",
    "uint64": "UInt64",
    "boolean": "Boolean",
    "string": "String",
}
_ALIASES = {"Real": ("Float64",), "Integer": ("Int32",)}
_OLD = frozenset({"Real", "Integer", "Boolean", "String"})
_INT32 = range(-(2**31), 2**31)


def port_type(kind: Kind, version: str) -> str | None:
    """Return the type element of a connector; ``None`` where the variable is left to tell its type."""
    name = _NAMES.get(kind)
    return name if version != "1.0" or name in _OLD else None


def fits(declared: str, kind: Kind) -> bool:
    """Tell whether a connector may have this type for a variable of a kind.

    The four types of SSP 1.0 stand for all types of FMI 3 of their sort.
    """
    sort = {"enumeration": "Enumeration"}.get(kind) or _NAMES[kind]
    if declared in {sort, *_ALIASES.get(sort, ())}:
        return True
    if declared == "Real":
        return kind in {"float64", "float32"}
    return declared == "Integer" and "int" in kind


def parameter_type(variable: ModelVariable, version: str) -> str:
    """Return the type element of a parameter."""
    kind = kind_of(variable)
    assert kind is not None
    if kind == "enumeration":
        return "Enumeration"
    if version == "1.0" and _NAMES[kind] not in _OLD:
        return "Real" if kind == "float32" else "Integer"
    return _NAMES[kind]


def write_value(typed: Any, parameter: Any, variable: ModelVariable, value: Value, version: str) -> None:
    """Write an accepted value of a variable into its type element.

    Raises
    ------
    ValueError
        If this version of SSP cannot hold it.
    """
    array = np.array(value, dtype=object)
    texts = [_text(variable, element, version) for element in array.ravel()]
    if not array.ndim:
        typed.set("value", texts[0])
        return
    if version == "1.0":
        raise ValueError("an array")
    if typed.tag.endswith(("}String", "}Enumeration")):
        for text in texts:
            child = typed.makeelement(f"{{{NAMESPACES['ssv']}}}Value", {"value": text})
            typed.append(child)
    else:
        typed.set("value", " ".join(texts))
    for size in array.shape:
        parameter.append(parameter.makeelement(f"{{{NAMESPACES['ssc']}}}Dimension", {"size": str(size)}))


def _text(variable: ModelVariable, value: Any, version: str) -> str:
    kind = kind_of(variable)
    if kind == "enumeration":
        return _literal(variable, value)
    if kind == "string":
        return str(value)
    if kind == "boolean":
        return "true" if value else "false"
    if kind in {"float64", "float32"}:
        return repr(float(value))
    if version == "1.0" and int(value) not in _INT32:
        raise ValueError(f"the whole number {value} beyond 32 bits")
    return str(int(value))


def _literal(variable: ModelVariable, value: str | int) -> str:
    """Return the name of a literal, which may be given by its number."""
    if isinstance(value, str):
        return value
    return next(name for name, number in literals_of(variable).items() if number == value)
