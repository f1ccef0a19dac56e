"""Checks of the model structure: outputs, derivatives of states, initial unknowns and their dependencies."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from co_sim.checking.findings import Finding
from co_sim.fmu_elements import FLOATS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from co_sim.fmu_elements import Declaration, Unknown, Variable

__all__ = ["structure_findings"]

_TOPIC = "model structure"
_CALCULATED = {"calculated", "approx"}
#: What an output or derivative may depend on besides states: parameters only where they change in a run.
_KNOWN = {"input", "independent", "structuralParameter", "parameter"}


def structure_findings(declaration: Declaration) -> Iterator[Finding]:
    """Find what is wrong with the model structure, and with derivatives of states."""
    yield from _complete(declaration)
    yield from _derivatives(declaration)
    states = {declaration.state_of(v) for v in declaration.variables if v.get("derivative")}
    for unknown in declaration.unknowns:
        yield from _dependencies(unknown, states)


def _listed(declaration: Declaration, name: str) -> list[Variable]:
    """Return the variables in a list of the structure; reported elsewhere if they do not exist."""
    return [u.variable for u in declaration.unknowns if u.list == name and u.variable is not None]


def _complete(declaration: Declaration) -> Iterator[Finding]:
    """Compare the lists with what the variables say."""
    outputs = [v for v in declaration.variables if v.causality == "output"]
    yield from _compare("output", "error", outputs, _listed(declaration, "output"))
    # Faults here have no effect on most masters, and many exporters have them.
    listed = _listed(declaration, "initial unknown")
    yield from _compare("initial unknown", "warning", _initial_unknowns(declaration), listed)
    for name in ("derivative", "clocked state", "event indicator"):
        variables = _listed(declaration, name)
        yield from _compare(name, "error", variables, variables)


def _compare(
    name: str, severity: str, expected: Iterable[Variable], listed: Iterable[Variable]
) -> Iterator[Finding]:
    expected, count = dict.fromkeys(expected), Counter(listed)
    for variable in expected:
        if variable not in count:
            yield _found(variable, f"is missing from the {name}s", severity)
    for variable, n in count.items():
        if n > 1:
            yield _found(variable, f"is {n} times among the {name}s", "error")
        if variable not in expected:
            yield _found(variable, f"is among the {name}s but is none", severity)


def _initial_unknowns(declaration: Declaration) -> list[Variable]:
    """Return the variables that the initialisation calculates and a master may ask for."""
    derivatives = _listed(declaration, "derivative")
    states = [state for v in derivatives if (state := declaration.state_of(v)) is not None]
    moving = {id(v) for v in (*derivatives, *states)}
    return [
        v
        for v in declaration.variables
        if v.causality == "calculatedParameter"
        or ((v.causality == "output" or id(v) in moving) and v.initial in _CALCULATED and not v.get("clocks"))
    ]


def _derivatives(declaration: Declaration) -> Iterator[Finding]:
    listed = {id(v) for v in _listed(declaration, "derivative")}
    exchange = any(kind == "ModelExchange" for kind, _ in declaration.interfaces())
    for variable in declaration.variables:
        state = declaration.state_of(variable)
        if state is None:
            continue
        if state is variable:
            yield _found(variable, "is declared to be its own derivative", "error")
        for part in (variable, state):
            if part.type not in FLOATS or part.variability != "continuous":
                message = f"is a {part.variability} {part.type}, but a state or its derivative is continuous"
                yield _found(part, message, "error")
        if declaration.shape(variable) != declaration.shape(state):
            yield _found(variable, f'has another shape than its state "{state.name}"', "error")
        if exchange and id(variable) not in listed:
            yield _found(variable, "is a derivative that is not in the model structure", "warning")


def _dependencies(unknown: Unknown, states: Collection[Variable | None]) -> Iterator[Finding]:
    where = f"line {unknown.line}"
    name = f'{unknown.list} "{unknown.variable.name}"' if unknown.variable else unknown.list
    if unknown.kinds is not None:
        if unknown.dependencies is None:
            yield Finding("error", _TOPIC, where, f"{name} has dependency kinds but no dependencies")
        elif len(unknown.kinds) != len(unknown.dependencies):
            n, m = len(unknown.dependencies), len(unknown.kinds)
            yield Finding("error", _TOPIC, where, f"{name} has {n} dependencies and {m} kinds of them")
    known = [v for v in unknown.dependencies or () if v is not None]
    for variable, n in Counter(known).items():
        if n > 1:
            yield Finding("error", _TOPIC, where, f'{name} depends {n} times on "{variable.name}"')
    if unknown.list == "initial unknown":
        return
    for variable in known:
        discrete = variable.variability == "discrete"
        if not (variable.causality in _KNOWN or variable in states or discrete):
            message = f'{name} depends on "{variable.name}", which is neither an input nor a state'
            yield Finding("warning", _TOPIC, where, message)


def _found(variable: Variable, message: str, severity: str) -> Finding:
    where = f'line {variable.line}, "{variable.name}"'
    return Finding("error" if severity == "error" else "warning", _TOPIC, where, message)
