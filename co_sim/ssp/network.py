"""The connections of nested systems as one network between the variables of FMUs."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, cast

from co_sim.errors import suggestion
from co_sim.ssp.chain import Chain, MismatchError
from co_sim.ssp.elements import Component, Linear, Measure, Reference, SystemElement
from co_sim.units import UnknownUnitError, define

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from co_sim.ssp.document import Node
    from co_sim.ssp.elements import Element, End, Path, Wire
    from co_sim.ssp.fmus import Fmu

__all__ = ["GIVING", "NO_UNIT", "Edge", "Network", "Pin", "Route"]

#: Kinds of connectors whose values come out of an element; those of a system's own go out of it.
GIVING = frozenset({"output", "calculatedParameter", "constant", "local", "independent"})
_TAKING = frozenset({"input", "parameter", "structuralParameter"})
_PARAMETERS = frozenset({"parameter", "structuralParameter"})
#: A unit that a connector or a parameter has when its tool knows none.
NO_UNIT = frozenset({"1", "-"})


class Pin(NamedTuple):
    """A connector: path of its element from the root system, whose own path is empty, and its name."""

    path: Path
    name: str


class Edge(NamedTuple):
    """A connection in the direction of its values; an index restricts it to an element of an array.

    The end of the wire at the source is its start, unless it `is_reversed`.
    """

    source: Pin
    source_index: str
    target: Pin
    target_index: str
    wire: Wire
    is_reversed: bool

    @property
    def ends(self) -> tuple[End, End]:
        """Its ends as they are written, the source first."""
        start, end = self.wire.start, self.wire.end
        return (end, start) if self.is_reversed else (start, end)


class Route(NamedTuple):
    """The way from a source to one target, or an element of it."""

    source: Pin
    source_index: str
    target_index: str
    edges: tuple[Edge, ...]


@dataclass
class Network:
    """All connectors and connections below a root system.

    Parameters
    ----------
    root : the system.
    fmus : of the components that could be read, by path.
    """

    root: SystemElement
    fmus: Mapping[Path, Fmu]
    incoming: dict[Pin, list[Edge]] = field(default_factory=lambda: defaultdict(list), init=False)
    outgoing: dict[Pin, list[Edge]] = field(default_factory=lambda: defaultdict(list), init=False)
    elements: dict[Path, Element] = field(default_factory=dict, init=False)
    _entries: dict[Pin, Measure | None] = field(default_factory=dict, init=False)
    _by_wire: dict[int, Edge] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._add(self.root, (), {})

    def edge_of(self, wire: Wire) -> Edge | None:
        """Return a connection in the direction of its values; ``None`` if it has a fault."""
        return self._by_wire.get(id(wire))

    def routes(self, pin: Pin, seen: tuple[Pin, ...] = ()) -> Iterator[Route]:
        """Return the ways that lead to a connector, each from a component or a loose end."""
        if pin in seen:
            edge = self.incoming[pin][0]
            edge.wire.node.fault("connections that go round in a circle", "a source of the value")
            return
        edges = self.incoming.get(pin, ())
        if not edges:
            yield Route(pin, "", "", ())
        for edge in edges:
            for route in self._back(edge.source, (*seen, pin)):
                yield from _joined(route, edge)

    def _back(self, pin: Pin, seen: tuple[Pin, ...]) -> Iterator[Route]:
        return iter([Route(pin, "", "", ())]) if pin.path in self.fmus else self.routes(pin, seen)

    def kind(self, pin: Pin) -> str:
        """Return the kind of a connector; that of the FMU's variable where the document has no connector."""
        element = self.elements.get(pin.path, self.root)
        if pin.name in element.connectors:
            return element.connectors[pin.name].kind
        is_variable = pin.path in self.fmus and pin.name in self.fmus[pin.path].variables
        return self.causality(pin) if is_variable else ""

    def knows(self, pin: Pin, node: Node) -> bool:
        """Tell whether an FMU has the variable of a connector, and note a fault where not."""
        variables = self.fmus[pin.path].variables
        if pin.name not in variables:
            known = suggestion(pin.name, variables)
            node.fault(f'a connector "{pin.name}" that the FMU does not have', "one of its variables", known)
        return pin.name in variables

    def causality(self, pin: Pin) -> str:
        """Return the causality of a variable of an FMU."""
        return cast("str", self.fmus[pin.path].variables[pin.name].causality)

    def port_measure(self, pin: Pin) -> Measure | None:
        """Return the unit of a variable of an FMU; the connector for it may add what the FMU leaves open."""
        own, declared = self.fmus[pin.path].measure(pin.name), self._declared(pin)
        if declared is None or (own and (own.definition is not None or own.name != declared.name)):
            return own
        return _as_known(declared)

    def chain(self, route: Route, target: Pin) -> Chain | None:
        """Return what happens to numbers on a way to the connector at its end; ``None`` for a fault told."""
        chain = Chain(None)
        if route.source.path in self.fmus:
            try:
                chain = Chain(self.port_measure(route.source)).to(self.measure(route.source))
            except MismatchError as error:
                connector = self.elements[route.source.path].connectors[route.source.name]
                connector.node.fault(
                    f"units that do not fit: {error}",
                    "a unit of the same dimension as that of the FMU",
                    "correct the unit of the connector",
                )
                return None
        else:
            chain = Chain(self._declared(route.source))
        for edge in route.edges:
            linear = edge.wire.transformation
            if not isinstance(linear, Linear):
                edge.wire.node.fault(
                    f"a {linear.kind}MappingTransformation",
                    "a linear transformation, or none, between running components",
                    "convert in a component between them",
                )
                return None
            try:
                chain = chain.to(self.measure(edge.target), linear, suppress=edge.wire.suppress)
                if edge.target.path in self.fmus:
                    chain = chain.to(self.port_measure(edge.target))
            except MismatchError as error:
                edge.wire.node.fault(
                    f"units that do not fit: {error}",
                    "units of the same dimension at both ends",
                    "correct a unit, or say suppressUnitConversion",
                )
                return None
        return chain

    def _declared(self, pin: Pin) -> Measure | None:
        if pin in self._entries:
            return self._entries[pin]
        connector = self.elements.get(pin.path, self.root).connectors.get(pin.name)
        return connector.measure if connector else None

    def measure(self, pin: Pin) -> Measure | None:
        """Return the unit of a connector, unless it says nothing where the FMU says something."""
        declared = self._declared(pin)
        if pin.path in self.fmus and (declared is None or declared.name in NO_UNIT):
            return self.port_measure(pin)
        return declared

    def _add(self, system: SystemElement, path: Path, dictionaries: dict[str, Path]) -> None:
        """Add the elements and connections of a system and of those within it."""
        self.elements[path] = system
        dictionaries = dictionaries | {name: (*path, f"<{name}>") for name in system.dictionaries}
        for name, entries in system.dictionaries.items():
            self._entries.update({Pin((*path, f"<{name}>"), entry): unit for entry, unit in entries.items()})
        for name, element in system.elements.items():
            if isinstance(element, SystemElement):
                self._add(element, (*path, name), dictionaries)
            else:
                self.elements[*path, name] = element
        for wire in system.wires:
            edge = self._edge(wire, system, path, dictionaries)
            if edge is not None:
                self.incoming[edge.target].append(edge)
                self.outgoing[edge.source].append(edge)
                self._by_wire[id(wire)] = edge
                self._check_single(edge)

    def _check_single(self, edge: Edge) -> None:
        """Refuse a second value for the same connector or element of it."""
        others = [other.target_index for other in self.incoming[edge.target][:-1]]
        if edge.target_index in others or (others and ("" in others or not edge.target_index)):
            edge.wire.node.fault("a second connection into a connector", "one", "remove the others")

    def _edge(
        self, wire: Wire, system: SystemElement, path: Path, dictionaries: Mapping[str, Path]
    ) -> Edge | None:
        """Return a connection in the direction of its values; ``None`` if it has a fault."""
        ends = wire.start, wire.end
        pins = [self._pin(wire, end, system, path, dictionaries) for end in ends]
        sides = [
            pin and self._side(wire, end, pin, system.elements.get(end.element or ""))
            for end, pin in zip(ends, pins, strict=True)
        ]
        if None in sides or None in pins:
            return None
        if "either" in sides:
            known = next((side for side in sides if side != "either"), None)
            other = {"source": "target", "target": "source"}.get(known or "", "target")
            sides = [other if side == "either" else side for side in sides]
            if known is None:
                sides = ["source", "target"]
        if sides[0] == sides[1]:
            wire.node.fault(f"two connectors that both {_SAYS[str(sides[0])]}", "one of each")
            return None
        order = (0, 1) if sides[0] == "source" else (1, 0)
        (source, target), (first, second) = [pins[i] for i in order], [ends[i] for i in order]
        assert source is not None
        assert target is not None
        return Edge(source, first.indices, target, second.indices, wire, order == (1, 0))

    def _pin(
        self, wire: Wire, end: End, system: SystemElement, path: Path, dictionaries: Mapping[str, Path]
    ) -> Pin | None:
        if end.element is None:
            return Pin(path, end.connector)
        element = system.elements.get(end.element)
        if element is None:
            remedy = suggestion(end.element, system.elements)
            wire.node.fault(f'an unknown element "{end.element}"', "an element of this system", remedy)
            return None
        if isinstance(element, Reference):
            if element.dictionary not in dictionaries:
                known = suggestion(element.dictionary, dictionaries)
                element.node.fault(
                    f'an unknown dictionary "{element.dictionary}"', "a signal dictionary", known
                )
                return None
            return Pin(dictionaries[element.dictionary], end.connector)
        return Pin((*path, end.element), end.connector)

    def _side(self, wire: Wire, end: End, pin: Pin, element: Element | None) -> str | None:
        """Return whether values come out of an end, or go into it: a source, a target, or either."""
        if isinstance(element, Component) and not (pin.path in self.fmus or self.kind(pin)):
            # The FMU could not be read, which its own fault tells.
            return None
        if isinstance(element, Reference):
            kind = element.connectors[pin.name].kind if pin.name in element.connectors else "inout"
            known = {entry.name for entry in self._entries if entry.path == pin.path}
            is_known = pin in self._entries
        else:
            kind = self.kind(pin)
            known = set(self.elements[pin.path].connectors)
            known |= set(self.fmus[pin.path].variables) if pin.path in self.fmus else set()
            is_known = bool(kind)
        if not is_known:
            where = f'"{end.element}"' if end.element else "the system"
            remedy = suggestion(pin.name, known)
            wire.node.fault(f'an unknown connector "{pin.name}" of {where}', "a connector", remedy)
            return None
        if kind not in GIVING | _TAKING:
            return "either"
        return "source" if (kind in GIVING) == (end.element is not None) else "target"


def _as_known(measure: Measure) -> Measure:
    """Return a unit without its definition, where that says in fewer digits what is known of the name."""
    with suppress(UnknownUnitError):
        if measure.definition == define(measure.name):
            return Measure(measure.name, None)
    return measure


_SAYS = {"source": "give a value", "target": "take a value"}


def _joined(route: Route, edge: Edge) -> Iterator[Route]:
    """Return a way continued along an edge, with the elements of arrays that both mean."""
    edges = (*route.edges, edge)
    if not route.target_index or not edge.source_index:
        # The whole array comes in, of which the edge takes an element or all; or an element alone does.
        source_index = route.source_index or edge.source_index
        target_index = edge.target_index or ("" if edge.source_index else route.target_index)
        yield Route(route.source, source_index, target_index, edges)
    elif route.target_index == edge.source_index:
        yield Route(route.source, route.source_index, edge.target_index, edges)
