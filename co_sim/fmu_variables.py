"""What an FMU's description says about its variables: ports, and the values a parameter may take."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import TYPE_CHECKING, cast

from co_sim.component import Port
from co_sim.errors import Fault, suggestion

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from fmpy.model_description import ModelVariable

    Scalar = float | int | bool | str
    Variables = Mapping[str, ModelVariable]

__all__ = ["parameter_faults", "plain_value", "port_faults", "port_of", "select"]

_FLOATS = frozenset({"Real", "Float32", "Float64"})
#: Integer types and their smallest and largest values; ctypes would cut off larger ones without a word.
_INTEGERS = {"Integer": (-(2**31), 2**31 - 1)} | {
    f"{prefix}{bits}": (low, high)
    for bits in (8, 16, 32, 64)
    for prefix, low, high in (("Int", -(2 ** (bits - 1)), 2 ** (bits - 1) - 1), ("UInt", 0, 2**bits - 1))
}


def select(variables: Variables, names: Sequence[str] | None, causality: str) -> list[ModelVariable]:
    """Return the named variables, or without names all that can be ports of this causality."""
    if names is not None:
        return [variables[name] for name in names]
    return [v for v in variables.values() if v.causality == causality and _is_signal(v)]


def port_of(variable: ModelVariable) -> Port:
    """Return the port of a float64 variable; its unit and bounds may be those of its declared type."""
    start = None if variable.start is None else float(variable.start)
    return Port(variable.name, _attribute(variable, "unit") or "1", start, variable.description or "")


def port_faults(fmu: str, variables: Variables, names: Sequence[str], causality: str) -> Iterator[Fault]:
    """Find names that cannot be ports: an input must be one, an output may be any float64 variable."""
    for name in names:
        what = f'{causality} "{name}" of {fmu}'
        variable = variables.get(name)
        fitting = [v.name for v in select(variables, None, causality)]
        if variable is None:
            yield Fault(what, "an unknown name", "a name from its description", suggestion(name, fitting))
        elif not _is_signal(variable):
            yield Fault(what, _kind(variable), "a scalar float64", "choose another variable")
        elif causality == "input" and variable.causality != "input":
            yield Fault(
                what, f"a variable with causality {variable.causality}", "an input", "see its description"
            )


def parameter_faults(fmu: str, variables: Variables, values: Mapping[str, Scalar]) -> Iterator[Fault]:
    """Find names that are unknown or cannot be set, and values of a wrong type or out of bounds."""
    for name, value in values.items():
        what = f'parameter "{name}" of {fmu}'
        variable = variables.get(name)
        if variable is None:
            settable = [v.name for v in variables.values() if _is_settable(v)]
            yield Fault(what, "an unknown name", "a name from its description", suggestion(name, settable))
        elif not _is_settable(variable):
            yield Fault(
                what,
                f"{_kind(variable)} with causality {variable.causality}",
                "a scalar parameter or start value",
                "connect it" if variable.causality == "input" else "leave it out",
            )
        elif not _accepts(variable, value):
            yield Fault(what, repr(value), _expected(variable), "correct the value")


def plain_value(variable: ModelVariable, value: Scalar) -> float | int | bool | bytes:
    """Return an accepted value as C takes it: a literal as its number, a text as UTF-8."""
    if not isinstance(value, str):
        return value
    return _literals(variable)[value] if variable.type == "Enumeration" else value.encode()


def _is_signal(variable: ModelVariable) -> bool:
    return variable.type in {"Real", "Float64"} and not variable.dimensions


def _is_settable(variable: ModelVariable) -> bool:
    if variable.dimensions or not _is_supported(variable.type):
        return False
    has_start = variable.causality in {"output", "local"} and variable.variability != "constant"
    return variable.causality == "parameter" or (has_start and variable.initial in {"exact", "approx"})


def _is_supported(kind: str) -> bool:
    return kind in _FLOATS or kind in _INTEGERS or kind in {"Boolean", "String", "Enumeration"}


def _accepts(variable: ModelVariable, value: object) -> bool:
    if variable.type in {"Boolean", "String"}:
        return isinstance(value, {"Boolean": bool, "String": str}[variable.type])
    if variable.type == "Enumeration":
        literals = _literals(variable)
        return not isinstance(value, bool) and (value in literals or value in literals.values())
    if isinstance(value, bool) or not isinstance(value, Integral if variable.type in _INTEGERS else Real):
        return False
    low, high = _bounds(variable)
    return math.isfinite(value) and low <= cast("float", value) <= high


def _expected(variable: ModelVariable) -> str:
    if variable.type == "Boolean":
        return "True or False"
    if variable.type == "String":
        return "a text"
    if variable.type == "Enumeration":
        return f"one of {', '.join(_literals(variable))}"
    low, high = _bounds(variable)
    kind = "a finite number" if variable.type in _FLOATS else "a whole number"
    unit = f" {_attribute(variable, 'unit')}" if _attribute(variable, "unit") else ""
    return f"{kind} from {low:g} to {high:g}{unit}"


def _bounds(variable: ModelVariable) -> tuple[float, float]:
    low, high = _INTEGERS.get(variable.type, (-math.inf, math.inf))
    declared_low, declared_high = _attribute(variable, "min"), _attribute(variable, "max")
    number = float if variable.type in _FLOATS else int
    return (
        max(low, number(declared_low)) if declared_low else low,
        min(high, number(declared_high)) if declared_high else high,
    )


def _literals(variable: ModelVariable) -> dict[str, int]:
    return {item.name: int(item.value) for item in variable.declaredType.items}


def _attribute(variable: ModelVariable, name: str) -> str | None:
    """Return an attribute of the variable or, where it has none, of its declared type."""
    return getattr(variable, name) or getattr(variable.declaredType, name, None)


def _kind(variable: ModelVariable) -> str:
    return f"{'an array' if variable.dimensions else 'a scalar'} of type {variable.type}"
