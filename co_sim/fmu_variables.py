"""What an FMU's description says about its variables as ports."""

from __future__ import annotations

import copy
from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING, cast

from co_sim import fmi_table as at
from co_sim.component import Port
from co_sim.errors import Fault, suggestion
from co_sim.units import Unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from fmpy.model_description import ModelDescription, ModelVariable

    from co_sim.component import Kind

    Variables = Mapping[str, ModelVariable]
    #: Values of structural parameters by name, where they differ from those of the description.
    Sizes = Mapping[str, int]
    #: Meaning of units by name, where it is declared.
    Units = Mapping[str, Unit]

__all__ = [
    "attribute",
    "describe",
    "feedthrough",
    "is_signal",
    "kind_of",
    "port_faults",
    "port_of",
    "select",
    "shape_of",
    "units_of",
    "variables_of",
]

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_KINDS: dict[str, Kind] = {
    "Real": "float64",
    "Integer": "int32",
    "Float64": "float64",
    "Float32": "float32",
    "Int8": "int8",
    "UInt8": "uint8",
    "Int16": "int16",
    "UInt16": "uint16",
    "Int32": "int32",
    "UInt32": "uint32",
    "Int64": "int64",
    "UInt64": "uint64",
    "Boolean": "boolean",
    "Enumeration": "enumeration",
    "String": "string",
}


def variables_of(description: ModelDescription) -> dict[str, ModelVariable]:
    """Return all variables by name; those of FMI 3 also by their aliases, as variables of that name."""
    variables = {variable.name: variable for variable in description.modelVariables}
    for variable in description.modelVariables:
        for alias in variable.aliases:
            same = copy.copy(variable)
            same.name, same.description, same.alias = alias.name, alias.description, variable
            variables[alias.name] = same
    return variables


def kind_of(variable: ModelVariable) -> Kind | None:
    """Return the kind of a port for a variable; ``None`` for binaries and clocks."""
    return _KINDS.get(variable.type)


def shape_of(variable: ModelVariable, sizes: Sizes) -> tuple[int, ...]:
    """Return the shape of a variable; that of a scalar is empty."""
    return tuple(
        int(d.start) if d.variable is None else sizes.get(d.variable.name, int(d.variable.start))
        for d in variable.dimensions
    )


def select(variables: Variables, names: Sequence[str] | None, causality: str) -> list[ModelVariable]:
    """Return the named variables, or without names all that can be ports of this causality, not by alias."""
    if names is not None:
        return [variables[name] for name in names]
    own = (v for v in variables.values() if v.alias is None)
    return [v for v in own if v.causality == causality and is_signal(v)]


def port_of(variable: ModelVariable, sizes: Sizes, units: Units) -> Port:
    """Return the port of a variable; its unit may be that of its declared type."""
    shape = shape_of(variable, sizes)
    unit = attribute(variable, "unit") or "1"
    return Port(
        variable.name,
        unit,
        _start(variable, shape),
        variable.description or "",
        cast("Kind", kind_of(variable)),
        shape,
        variable.variability == "continuous",
        units.get(unit),
    )


def units_of(description: ModelDescription) -> dict[str, Unit]:
    """Return the units that an FMU defines by their base units, by name."""
    bases = {unit.name: unit.baseUnit for unit in description.unitDefinitions if unit.baseUnit is not None}
    return {
        name: replace(
            Unit(**{exponent: int(getattr(base, exponent) or 0) for exponent in _BASES}),
            factor=float(base.factor),
            offset=float(base.offset or 0.0),
        )
        for name, base in bases.items()
        if float(base.factor or 0.0)
    }


def port_faults(fmu: str, variables: Variables, names: Sequence[str], causality: str) -> Iterator[Fault]:
    """Find names that cannot be ports: an input must be one, an output may be any variable with a value."""
    for name in names:
        what = f'{causality} "{name}" of {fmu}'
        variable = variables.get(name)
        fitting = [v.name for v in select(variables, None, causality)]
        if variable is None:
            yield Fault(what, "an unknown name", "a name from its description", suggestion(name, fitting))
        elif not is_signal(variable):
            yield Fault(what, describe(variable), "a number, a boolean or a text", "choose another variable")
        elif causality == "input" and variable.causality != "input":
            yield Fault(
                what, f"a variable with causality {variable.causality}", "an input", "see its description"
            )


def feedthrough(
    description: ModelDescription, inputs: Iterable[ModelVariable], outputs: Iterable[ModelVariable]
) -> dict[str, list[str]] | None:
    """Return for each output the inputs on which it depends at once; ``None`` if the FMU does not tell.

    What an output depends on during initialisation counts as well. Continuous states follow nothing at
    once.
    """
    declared: dict[object, set[object]] = {}
    for unknown in (*description.outputs, *description.initialUnknowns):
        if unknown.dependencies is not None:
            known = declared.setdefault(_identity(unknown.variable), set())
            known.update(map(_identity, unknown.dependencies))
    told = {_identity(y.variable) for y in description.outputs if y.dependencies is not None}
    if not told:
        return None
    inputs = list(inputs)
    told |= {_identity(unknown.variable.derivative) for unknown in description.derivatives}
    return {
        output.name: [
            u.name
            for u in inputs
            if _identity(u) in declared.get(_identity(output), ())
            or (_identity(output) not in told and not _is_held(output))
        ]
        for output in outputs
    }


def attribute(variable: ModelVariable, name: str) -> str | None:
    """Return an attribute of the variable or, where it has none, of its declared type."""
    return getattr(variable, name) or getattr(variable.declaredType, name, None)


def describe(variable: ModelVariable) -> str:
    """Return in words what a variable is."""
    if variable.clocks:
        return f"a clocked variable of type {variable.type}"
    return f"{'an array' if variable.dimensions else 'a scalar'} of type {variable.type}"


def is_signal(variable: ModelVariable) -> bool:
    """Tell whether a variable can be a port."""
    return kind_of(variable) is not None and not variable.clocks


def _is_held(variable: ModelVariable) -> bool:
    """Tell whether a variable does not follow inputs."""
    held = {"parameter", "calculatedParameter", "structuralParameter", "independent"}
    return variable.causality in held or variable.variability == "constant"


def _identity(variable: ModelVariable) -> tuple[str, int]:
    """Return what variables with the same value have in common."""
    return variable.type, variable.valueReference


def _start(variable: ModelVariable, shape: tuple[int, ...]) -> float | str | tuple[float | str, ...] | None:
    """Return the start value of a port: none where there is none, or none that fits or can travel."""
    kind, start = kind_of(variable), variable.start
    if start is None:
        return None
    values: list[float | str]
    if kind == "string":
        # An array of texts has a list of them.
        values = [start] if isinstance(start, str) else list(start)
    else:
        numbers = [_number(kind, text) for text in start.split()]
        if kind in {"int64", "uint64"} and any(abs(number) > at.EXACT for number in numbers):
            return None
        values = list(map(float, numbers))
    if len(values) == 1:
        return values[0]
    return tuple(values) if len(values) == prod(shape) else None


def _number(kind: Kind | None, text: str) -> float | int:
    if kind == "boolean":
        return float(text in {"true", "1"})
    # Whole numbers beyond 2**53 must not be rounded before they are compared.
    return float(text) if kind in {"float64", "float32"} else int(text)
