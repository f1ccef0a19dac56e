"""Checks of the variables of a model description: what the text of the standard asks beyond the schema."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from typing import TYPE_CHECKING

from co_sim.checking.findings import Finding
from co_sim.fmu_elements import FLOATS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from co_sim.checking.findings import Severity
    from co_sim.fmu_elements import Declaration, Variable

__all__ = ["variable_findings"]

_WORD = r"[A-Za-z_][A-Za-z0-9_]*"
_QUOTED = r"'(?:[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
_PART = rf"(?:{_WORD}|{_QUOTED})(?:\[\d+(?:,\d+)*\])?"
_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"
#: The structured naming convention.
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,\d+)?\)")

_CALCULATED = {"calculated", "approx"}
_ANY = {"calculated", "approx", "exact"}
#: Values of `initial` that go with a causality and variability; other pairs are not allowed.
_INITIALS: dict[tuple[str, str], set[str]] = {
    **{(c, v): {"exact"} for c in ("parameter", "structuralParameter") for v in ("fixed", "tunable")},
    **{("calculatedParameter", v): _CALCULATED for v in ("fixed", "tunable")},
    **{("input", v): {"exact"} for v in ("discrete", "continuous")},
    **{(c, "constant"): {"exact"} for c in ("output", "local")},
    **{(c, v): _ANY for c in ("output", "local") for v in ("discrete", "continuous")},
    **{("local", v): _CALCULATED for v in ("fixed", "tunable")},
    ("independent", "continuous"): set(),
}
_RANGES = {
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "Integer": (-(2**31), 2**31 - 1),
    "Enumeration": (-(2**63), 2**63 - 1),
}
_SETTABLE = {"input", "parameter", "structuralParameter"}


def variable_findings(declaration: Declaration) -> Iterator[Finding]:
    """Find what is wrong with single variables and with variables that share something."""
    structured = declaration.root.get("variableNamingConvention") == "structured"
    for variable in declaration.variables:
        yield from _names(variable, structured=structured)
        yield from _combination(variable)
        yield from _start(declaration, variable)
        yield from _bounds(declaration, variable)
        yield from _type(declaration, variable)
        yield from _unit(declaration, variable)
        yield from _dimensions(declaration, variable)
    yield from _references(declaration)
    yield from _independent(declaration)


def _found(variable: Variable, topic: str, message: str, severity: Severity = "error") -> Finding:
    return Finding(severity, topic, f'line {variable.line}, "{variable.name}"', message)


def _names(variable: Variable, *, structured: bool) -> Iterator[Finding]:
    for name in (variable.name, *variable.aliases):
        if any(c in name for c in "\r\n\t"):
            yield _found(variable, "names", "a name with a line break or tab")
        elif structured and not _STRUCTURED.fullmatch(name):
            message = f"{name!r} does not follow the structured naming convention, which the FMU declares"
            yield _found(variable, "names", message)


def _combination(variable: Variable) -> Iterator[Finding]:
    if variable.type == "Clock":
        return
    if variable.variability == "continuous" and variable.type not in FLOATS:
        # FMI 2 makes it the default of types that cannot be continuous: many leave it out.
        implied = variable.element.get("variability") is None
        message = f"variability is continuous{' by default' if implied else ''}, for the type {variable.type}"
        yield _found(variable, "variability", message, "warning" if implied else "error")
        return
    allowed = _INITIALS.get((variable.causality, variable.variability))
    if allowed is None:
        message = f"causality {variable.causality} does not go with variability {variable.variability}"
        yield _found(variable, "variability", message)
    elif variable.initial is not None and variable.initial not in allowed:
        message = f"initial={variable.initial!r} does not go with {variable.variability} {variable.causality}"
        yield _found(variable, "variability", message)


def _start(declaration: Declaration, variable: Variable) -> Iterator[Finding]:
    starts = variable.starts
    if starts is None:
        if variable.type != "Clock" and variable.initial in {"exact", "approx"}:
            yield _found(variable, "start values", f"no start value, which {_reason(variable)} needs")
        return
    if variable.causality == "independent" or variable.initial == "calculated":
        yield _found(variable, "start values", f"a start value, which {_reason(variable)} must not have")
    shape = declaration.shape(variable)
    n = math.prod(shape) if shape is not None else len(starts)
    if len(starts) not in {1, n}:
        yield _found(variable, "start values", f"{len(starts)} start values for {n} elements")
    if variable.type == "Enumeration":
        yield from _literals(declaration, variable, starts)


def _reason(variable: Variable) -> str:
    if variable.causality in {"independent", "input"}:
        return f"an {variable.causality}"
    return f'initial="{variable.initial}"'


def _literals(declaration: Declaration, variable: Variable, starts: list[str]) -> Iterator[Finding]:
    definition = declaration.types.get(variable.get("declaredType") or "")
    for start in starts:
        number = _number(start)
        if definition is not None and number is not None and number not in definition.literals.values():
            yield _found(variable, "start values", f"start value {start} is no literal of {definition.name}")


def _bounds(declaration: Declaration, variable: Variable) -> Iterator[Finding]:
    if variable.type not in FLOATS and variable.type not in _RANGES:
        return
    low, high = (_number(declaration.attribute(variable, name)) for name in ("min", "max"))
    if low is not None and high is not None and low > high:
        yield _found(variable, "bounds", f"min {low:g} is greater than max {high:g}")
    type_low, type_high = _RANGES.get(variable.type, (-math.inf, math.inf))
    for start in variable.starts or ():
        number = _number(start)
        if number is None:
            continue  # the schema tells
        if not math.isfinite(number):
            yield _found(variable, "start values", f"start value {start}", "warning")
        elif (low is not None and number < low) or (high is not None and number > high):
            yield _found(variable, "start values", f"start value {start} is out of {_range(low, high)}")
        elif not type_low <= number <= type_high:
            yield _found(
                variable, "start values", f"start value {start} does not fit the type {variable.type}"
            )
    nominal = _number(declaration.attribute(variable, "nominal"))
    if nominal is not None and not nominal > 0.0:
        yield _found(variable, "bounds", f"nominal value {nominal:g}, which must be positive")


def _range(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return f"its bound of at least {low:g}" if low is not None else f"its bound of at most {high:g}"
    return f"its bounds {low:g} to {high:g}"


def _type(declaration: Declaration, variable: Variable) -> Iterator[Finding]:
    name = variable.get("declaredType")
    definition = declaration.types.get(name or "")
    if definition is not None and definition.type != variable.type:
        yield _found(
            variable, "types", f'is {variable.type}, its declared type "{name}" is {definition.type}'
        )
    if variable.type == "Enumeration" and definition is None:
        yield _found(variable, "types", "an enumeration without the declared type that names its literals")


def _unit(declaration: Declaration, variable: Variable) -> Iterator[Finding]:
    if variable.type not in FLOATS:
        return
    unit, display = (declaration.attribute(variable, name) for name in ("unit", "displayUnit"))
    if unit is not None and unit not in declaration.units:
        yield _found(variable, "units", f'unit "{unit}" is not among the unit definitions')
    elif display is not None and unit is None:
        yield _found(variable, "units", f'display unit "{display}" without a unit')
    elif display is not None and display != unit and display not in declaration.units[unit]:
        yield _found(variable, "units", f'display unit "{display}" is not defined for "{unit}"')


def _dimensions(declaration: Declaration, variable: Variable) -> Iterator[Finding]:
    for dimension in variable.dimensions:
        reference = dimension.get("valueReference")
        if (reference is None) == (dimension.get("start") is None):
            yield _found(variable, "dimensions", "a dimension needs either a size or a value reference")
        owner = declaration.refer(reference)
        if owner is not None and (owner.type != "UInt64" or owner.causality != "structuralParameter"):
            constant = owner.type == "UInt64" and owner.variability == "constant"
            if not constant:
                message = f'its size is "{owner.name}", which is no structural parameter of type UInt64'
                yield _found(variable, "dimensions", message)


def _references(declaration: Declaration) -> Iterator[Finding]:
    """Find value references that are used twice: in FMI 3 a fault, in FMI 2 one value with two names."""
    groups: defaultdict[tuple[str, int | None], list[Variable]] = defaultdict(list)
    for variable in declaration.variables:
        kind = variable.type if declaration.version == 2 else ""
        groups[kind, variable.reference].append(variable)
    for (_, reference), (first, *others) in groups.items():
        for variable in others:
            if declaration.version == 3:
                message = f'value reference {reference} is that of "{first.name}" (line {first.line}) too'
                yield _found(variable, "value references", message)
        if declaration.version == 2 and others:
            yield from _alias_set(declaration, [first, *others])


def _alias_set(declaration: Declaration, members: list[Variable]) -> Iterator[Finding]:
    first = members[0]
    for variable in members[1:]:
        if declaration.attribute(variable, "unit") != declaration.attribute(first, "unit"):
            message = f'has the value reference of "{first.name}" but another unit'
            yield _found(variable, "value references", message, "warning")
    settable = [variable for variable in members if variable.causality in _SETTABLE]
    for variable in settable[1:]:
        message = f'has the value reference of "{settable[0].name}", and both can be set'
        yield _found(variable, "value references", message)


def _independent(declaration: Declaration) -> Iterator[Finding]:
    independent = [v for v in declaration.variables if v.causality == "independent"]
    for variable in independent[1:]:
        yield _found(
            variable, "variability", f'a second independent variable besides "{independent[0].name}"'
        )
    if declaration.version == 3 and not independent:
        message = "no variable with causality independent, which FMI 3 asks for"
        yield Finding("error", "variability", "model variables", message)


def _number(text: str | None) -> float | int | None:
    """Return a number of XML; whole ones are not rounded."""
    if text is None:
        return None
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return None
