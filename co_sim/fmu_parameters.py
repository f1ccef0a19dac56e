"""The values that an FMU's description allows for its parameters and start values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from co_sim.errors import Fault, suggestion
from co_sim.fmu_variables import attribute, describe, kind_of, shape_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from fmpy.model_description import ModelVariable

    from co_sim.component import Scalar
    from co_sim.fmu_variables import Sizes, Variables

    #: A value, or the values of an array, row in row as it is declared.
    Value = Scalar | Sequence[Any]

__all__ = ["literals_of", "parameter_faults", "plain_values", "sizes_of", "start_of"]

_FLOATS = {"float64": math.inf, "float32": float(np.finfo(np.float32).max)}


def sizes_of(variables: Variables, values: Mapping[str, Value]) -> dict[str, int]:
    """Return those values that are structural parameters, as far as they are allowed."""
    return {
        name: int(cast("int", value))
        for name, value in values.items()
        if name in variables
        and variables[name].causality == "structuralParameter"
        and _accepts(variables[name], value)
    }


def parameter_faults(fmu: str, variables: Variables, values: Mapping[str, Value]) -> Iterator[Fault]:
    """Find names that are unknown or cannot be set, and values of a wrong type, shape or out of bounds."""
    sizes = sizes_of(variables, values)
    for name, value in values.items():
        what = f'parameter "{name}" of {fmu}'
        variable = variables.get(name)
        if variable is None:
            settable = [v.name for v in variables.values() if _is_settable(v)]
            yield Fault(what, "an unknown name", "a name from its description", suggestion(name, settable))
        elif not _is_settable(variable):
            yield Fault(
                what,
                f"{describe(variable)} with causality {variable.causality}",
                "a parameter or start value",
                "leave it out",
            )
        else:
            yield from _value_faults(what, variable, value, sizes)


def plain_values(variable: ModelVariable, value: Value) -> list[Any]:
    """Return the elements of an accepted value as C takes them: a literal as its number, a text as UTF-8."""
    return [_plain(variable, element) for element in _elements(value)]


def start_of(variable: ModelVariable, value: Value) -> float | str | tuple[float | str, ...]:
    """Return an accepted value as the start value of a port, where all but texts are numbers."""
    literals = literals_of(variable) if variable.type == "Enumeration" else {}
    starts = tuple(
        value if kind_of(variable) == "string" else float(literals.get(cast("str", value), value))
        for value in _elements(value)
    )
    return starts if variable.dimensions else starts[0]


def _value_faults(what: str, variable: ModelVariable, value: Value, sizes: Sizes) -> Iterator[Fault]:
    shape = shape_of(variable, sizes)
    if _shape(value) != shape:
        size = " by ".join(map(str, shape))
        expected = f"an array of {size}, {_expected(variable)} each" if shape else _expected(variable)
        yield Fault(what, repr(value), expected, "correct the value")
        return
    for element in _elements(value):
        if not _accepts(variable, element):
            yield Fault(what, repr(element), _expected(variable), "correct the value")


def _shape(value: object) -> tuple[int, ...] | None:
    """Return the shape of a value in rows of equal shape; ``None`` if they differ."""
    if not _is_array(value):
        return ()
    rows = {_shape(row) for row in cast("Sequence[Any]", value)}
    if len(rows) > 1 or None in rows:
        return None
    return (len(cast("Sequence[Any]", value)), *(rows.pop() or () if rows else ()))


def _elements(value: Value) -> Iterator[Scalar]:
    if _is_array(value):
        for row in cast("Sequence[Any]", value):
            yield from _elements(row)
    else:
        yield cast("Scalar", value)


def _is_array(value: object) -> bool:
    return (isinstance(value, Sequence) and not isinstance(value, str)) or (
        isinstance(value, np.ndarray) and value.ndim > 0
    )


def _plain(variable: ModelVariable, value: Scalar) -> float | int | bool | bytes:
    if not isinstance(value, str):
        return value
    return literals_of(variable)[value] if variable.type == "Enumeration" else value.encode()


def _is_settable(variable: ModelVariable) -> bool:
    if kind_of(variable) is None or variable.clocks:
        return False
    has_start = variable.causality in {"output", "local"} and variable.variability != "constant"
    return variable.causality in {"parameter", "structuralParameter", "input"} or (
        has_start and variable.initial in {"exact", "approx"}
    )


def _accepts(variable: ModelVariable, value: object) -> bool:
    kind = kind_of(variable)
    if kind == "boolean":
        return isinstance(value, bool | np.bool_)
    if kind == "string":
        return isinstance(value, str) and "\0" not in value
    if kind == "enumeration":
        literals = literals_of(variable)
        return not isinstance(value, bool) and (value in literals or value in literals.values())
    if isinstance(value, bool) or not isinstance(value, Real if kind in _FLOATS else Integral):
        return False
    low, high = _bounds(variable)
    return math.isfinite(value) and low <= cast("float", value) <= high


def _expected(variable: ModelVariable) -> str:
    kind = kind_of(variable)
    if kind == "boolean":
        return "True or False"
    if kind == "string":
        return "a text"
    if kind == "enumeration":
        return f"one of {', '.join(literals_of(variable))}"
    low, high = _bounds(variable)
    number = "a finite number" if kind in _FLOATS else "a whole number"
    unit = f" {attribute(variable, 'unit')}" if attribute(variable, "unit") else ""
    return f"{number} from {low:g} to {high:g}{unit}"


def _bounds(variable: ModelVariable) -> tuple[float, float]:
    kind = kind_of(variable)
    low: float
    high: float
    if kind in _FLOATS:
        # A float32 takes what does not overflow; without bounds, a float64 says so.
        low, high = -_FLOATS[kind], _FLOATS[kind]
    else:
        info = np.iinfo(cast("str", kind))
        low, high = int(info.min), int(info.max)
    declared_low, declared_high = attribute(variable, "min"), attribute(variable, "max")
    number = float if kind in _FLOATS else int
    return (
        max(low, number(declared_low)) if declared_low else low,
        min(high, number(declared_high)) if declared_high else high,
    )


def literals_of(variable: ModelVariable) -> dict[str, int]:
    """Return the literals of an enumeration with their numbers."""
    return {item.name: int(item.value) for item in variable.declaredType.items}
