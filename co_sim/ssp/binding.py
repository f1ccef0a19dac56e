"""Which value each variable of an FMU gets from the parameter bindings around it."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from co_sim.fmu_parameters import sizes_of
from co_sim.fmu_variables import kind_of, shape_of
from co_sim.ssp.chain import Chain, MismatchError
from co_sim.ssp.elements import Linear, SystemElement
from co_sim.ssp.network import NO_UNIT, Pin

if TYPE_CHECKING:
    from collections.abc import Iterator

    from co_sim.component import Scalar
    from co_sim.fmu_parameters import Value
    from co_sim.ssp.elements import Element, Measure, Parameter, Path, Transformation, Values
    from co_sim.ssp.fmus import Fmu
    from co_sim.ssp.network import Edge, Network

__all__ = ["Bound", "Reach", "bind", "reaches"]

_REALS = frozenset({"float64", "float32"})

#: Values by component and variable.
Bound = dict["Path", dict[str, "Value"]]


def bind(network: Network) -> Bound:
    """Return the values that the bindings of all levels give to the variables of FMUs.

    Bindings of a system come before those of its elements, and later ones before earlier ones of the
    same level. Names that nothing in the system has are passed over, as the standard has it.
    """
    flat: dict[Path, dict[str, tuple[Parameter, Values]]] = defaultdict(dict)
    for reach in reaches(network):
        for pin, edges in reach.targets:
            values = _converted(network, reach.parameter, pin, edges)
            if values is not None:
                flat[pin.path][pin.name] = (reach.parameter, values)
    return {path: _shaped(network.fmus[path], found) for path, found in flat.items()}


class Reach(NamedTuple):
    """What a bound parameter sets.

    Parameters
    ----------
    path : of the element with the binding. source : the file with the value; empty for one in place.
    parameter : its name and value.
    targets : variables of FMUs, each with the connections on the way to it.
    """

    path: Path
    source: str
    parameter: Parameter
    targets: tuple[tuple[Pin, tuple[Edge, ...]], ...]


def reaches(network: Network) -> Iterator[Reach]:
    """Return what each bound parameter sets; one that counts comes after those that it overrides."""
    for path, element in _from_the_innermost(network.root, ()):
        for binding in element.bindings:
            for parameter in binding.parameters:
                targets = tuple(_targets(network, element, path, parameter.name))
                yield Reach(path, binding.source, parameter, targets)


def _from_the_innermost(element: Element, path: Path) -> Iterator[tuple[Path, Element]]:
    if isinstance(element, SystemElement):
        for name, child in element.elements.items():
            yield from _from_the_innermost(child, (*path, name))
    yield path, element


def _targets(
    network: Network, element: Element, path: Path, name: str
) -> Iterator[tuple[Pin, tuple[Edge, ...]]]:
    """Return all variables of FMUs that a hierarchical name below an element means."""
    if path in network.fmus:
        if name in network.fmus[path].variables:
            yield Pin(path, name), ()
    elif isinstance(element, SystemElement):
        if name in element.connectors:
            yield from _behind(network, Pin(path, name), ())
        for child_name, child in element.elements.items():
            if name.startswith(f"{child_name}."):
                rest = name.removeprefix(f"{child_name}.")
                yield from _targets(network, child, (*path, child_name), rest)


def _behind(network: Network, pin: Pin, edges: tuple[Edge, ...]) -> Iterator[tuple[Pin, tuple[Edge, ...]]]:
    """Return the variables of FMUs that are connected to a connector of a system from within."""
    if pin.path in network.fmus:
        yield pin, edges
    elif len(edges) < 100:
        for edge in network.outgoing.get(pin, ()):
            yield from _behind(network, edge.target, (*edges, edge))
        if network.kind(pin) not in {"input", "parameter", "structuralParameter"}:
            for edge in network.incoming.get(pin, ()):
                yield from _behind(network, edge.source, edges)


def _converted(network: Network, parameter: Parameter, pin: Pin, edges: tuple[Edge, ...]) -> Values | None:
    """Return the values in the unit of the variable, transformed by the mapping and on the way."""
    try:
        return _through(network, parameter, parameter.measure, pin, edges)
    except MismatchError as error:
        if parameter.measure and parameter.measure.name in NO_UNIT:
            # A tool that knows no unit writes one of these; then there is nothing to convert.
            with suppress(MismatchError):
                return _through(network, parameter, None, pin, edges)
        parameter.node.fault(
            f"units that do not fit: {error}",
            "the unit of the parameter",
            "correct it, or say suppressUnitConversion",
        )
        return None


def _through(
    network: Network, parameter: Parameter, measure: Measure | None, pin: Pin, edges: tuple[Edge, ...]
) -> Values | None:
    """Return the values that begin with this unit; a `MismatchError` tells which two do not fit."""
    chain = Chain(measure)
    values = parameter.values
    steps: list[tuple[Pin, Transformation, bool]] = [
        (edges[0].source if edges else pin, parameter.transformation, parameter.suppress),
        *((edge.target, edge.wire.transformation, edge.wire.suppress) for edge in edges),
    ]
    for place, transformation, unconverted in steps:
        linear = transformation if isinstance(transformation, Linear) else Linear()
        chain = chain.to(network.measure(place), linear, suppress=unconverted)
        if not isinstance(transformation, Linear):
            values = tuple(transformation.table.get(value, value) for value in values)
    total = chain.to(network.port_measure(pin)).total
    if total == Linear():
        return values
    if any(isinstance(value, str | bool) for value in values):
        parameter.node.fault("a linear transformation", "none for texts and booleans", "remove it")
        return None
    return tuple(float(value) * total.factor + total.offset for value in values)


def _shaped(fmu: Fmu, found: dict[str, tuple[Parameter, Values]]) -> dict[str, Value]:
    """Return values of the types and shapes that the variables have."""
    plain: dict[str, Value] = {
        name: _typed(kind_of(fmu.variables[name]), values[0])
        for name, (parameter, values) in found.items()
        if not parameter.shape
    }
    sizes = sizes_of(fmu.variables, plain)
    for name, (parameter, values) in found.items():
        variable = fmu.variables[name]
        if parameter.shape or shape_of(variable, sizes):
            typed = [_typed(kind_of(variable), value) for value in values]
            plain[name] = np.array(typed, dtype=object).reshape(parameter.shape or (len(typed),)).tolist()
    return plain


def _typed(kind: str | None, value: Scalar) -> Scalar:
    """Return a value as the type of a variable takes it, if it is one of this type's values."""
    if isinstance(value, bool | str):
        return value
    if kind in _REALS:
        return float(value)
    if kind == "boolean":
        return bool(value) if value in {0, 1} else value
    return int(value) if float(value).is_integer() else value
