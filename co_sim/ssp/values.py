"""Units, transformations, parameter sets (SSV) and parameter mappings (SSM)."""

from __future__ import annotations

from dataclasses import fields, replace
from math import prod
from typing import TYPE_CHECKING

from co_sim.errors import InputError
from co_sim.ssp.elements import Linear, Mapped, Measure, Parameter
from co_sim.units import Unit

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from co_sim.ssp.document import Node
    from co_sim.ssp.elements import Transformation, Values

__all__ = ["measure_of", "parameters_of", "transformation_of", "units_of"]

_FLOATS = ("Real", "Float64", "Float32")
_INTEGERS = ("Integer", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
_TEXTS = ("String", "Enumeration")
_FLAGS = {"true": True, "1": True, "false": False, "0": False}
_TRANSFORMATIONS = (
    "LinearTransformation",
    "BooleanMappingTransformation",
    "IntegerMappingTransformation",
    "EnumerationMappingTransformation",
)


def _flag(text: str) -> bool:
    if text not in _FLAGS:
        raise ValueError(text)
    return _FLAGS[text]


#: How the text of a value of each type is read.
_READERS: dict[str, Callable[[str], float | int | bool | str]] = {
    **dict.fromkeys(_FLOATS, float),
    **dict.fromkeys(_INTEGERS, int),
    **dict.fromkeys(_TEXTS, str),
    "Boolean": _flag,
}


def units_of(root: Node) -> dict[str, Unit]:
    """Return the units that a document defines, by name."""
    units = {}
    for node in root.grandchildren("Units", "Unit"):
        base = node.child("BaseUnit")
        if base is None:
            continue
        exponents = {
            item.name: base.whole(item.name) for item in fields(Unit) if item.name not in {"factor", "offset"}
        }
        try:
            units[node.required("name")] = replace(
                Unit(**exponents), factor=base.number("factor", 1.0), offset=base.number("offset", 0.0)
            )
        except InputError as error:
            for fault in error.faults:
                node.fault(fault.got, fault.expected, fault.remedy)
    return units


def measure_of(node: Node | None, units: Mapping[str, Unit]) -> Measure | None:
    """Return the unit that a type element names; a document may leave out what everybody knows."""
    name = node.given("unit") if node else None
    return None if not name else Measure(name, units.get(name))


def transformation_of(node: Node) -> Transformation:
    """Return the transformation of a connection or a mapping entry; that which changes nothing if none."""
    found = next(node.children(*_TRANSFORMATIONS), None)
    if found is None:
        return Linear()
    if found.tag == "LinearTransformation":
        return Linear(found.number("factor", 1.0), found.number("offset", 0.0))
    kind = found.tag.removesuffix("MappingTransformation")
    reader = _READERS[kind]
    table: dict[object, float | int | bool | str] = {}
    for entry in found.children("MapEntry"):
        texts = entry.required("source"), entry.required("target")
        try:
            source, target = map(reader, texts)
        except ValueError:
            entry.fault(" and ".join(map(repr, texts)), f"values of type {kind}")
            continue
        if source in table:
            entry.fault("a second entry for this value", "one")
        table[source] = target
    return Mapped(kind, table)  # type: ignore[arg-type]


def parameters_of(root: Node, prefix: str, mapping: Node | None) -> tuple[Parameter, ...]:
    """Return the parameters of a parameter set, under the names that a prefix and a mapping give them."""
    units = units_of(root)
    found = {}
    for node in root.grandchildren("Parameters", "Parameter"):
        parameter = _parameter(node, prefix, units)
        if parameter is None:
            continue
        if parameter.name in found:
            node.fault("a second parameter of this name", "one")
        found[parameter.name] = parameter
    if mapping is None:
        return tuple(found.values())
    # Only what is mapped is applied, under the names that it is mapped to.
    mapped = {}
    for entry in mapping.children("MappingEntry"):
        source, target = entry.required("source"), entry.required("target")
        if target in mapped:
            entry.fault("a second parameter for this target", "one")
        if source in found:
            mapped[target] = replace(
                found[source],
                name=target,
                transformation=transformation_of(entry),
                suppress=entry.flag("suppressUnitConversion"),
                node=entry,
            )
    return tuple(mapped.values())


def _parameter(node: Node, prefix: str, units: Mapping[str, Unit]) -> Parameter | None:
    typed = next(node.children(*_READERS, "Binary"), None)
    if typed is None or typed.tag == "Binary":
        node.fault(f"{'no value' if typed is None else 'a binary'}", "a number, a boolean or a text")
        return None
    shape = tuple(dimension.whole("size") for dimension in node.children("Dimension"))
    texts = _texts(typed, is_array=bool(shape))
    try:
        values: Values = tuple(map(_READERS[typed.tag], texts))
    except ValueError:
        typed.fault(f'value="{typed.get("value")}"', f"a value of type {typed.tag}")
        return None
    if len(values) != prod(shape):
        typed.fault(f"{len(values)} values", f"{prod(shape)}")
        return None
    return Parameter(
        prefix + node.required("name"),
        values,
        shape,
        measure_of(typed, units),
        Linear(),
        suppress=False,
        node=node,
    )


def _texts(typed: Node, *, is_array: bool) -> list[str]:
    """Return the texts of a value, or of each element of an array."""
    listed = [value.required("value") for value in typed.children("Value")]
    if listed:
        return listed
    text = typed.required("value")
    if typed.tag in _TEXTS:
        return [text]
    return text.split() if is_array else [text.strip()]
