"""The systems of an SSP as diagrams, one for each level."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from co_sim.diagram.blocks import Block, Diagram, Wire
from co_sim.diagram.layered import layered
from co_sim.diagram.placed import Geometry, placed
from co_sim.ssp.elements import Component, Linear, Reference, SystemElement
from co_sim.ssp.geometry import canvas_of, corners_of, extent_of, place_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from co_sim.diagram.blocks import Picture
    from co_sim.ssp.elements import Element
    from co_sim.ssp.elements import Path as ElementPath
    from co_sim.ssp.network import Edge, Network

__all__ = ["on_the_way", "pictures_of"]


def pictures_of(network: Network, title: str) -> list[Picture]:
    """Return a picture of each system, the root first.

    A system whose elements all have a place in the document is shown as the document has it; others are
    laid out in layers.

    Parameters
    ----------
    network : of their connectors. title : of the root; nested systems have their path.
    """
    return [_Level(network, system, path).picture(title) for path, system in _systems(network.root, ())]


def _systems(system: SystemElement, path: ElementPath) -> Iterator[tuple[ElementPath, SystemElement]]:
    yield path, system
    for name, element in system.elements.items():
        if isinstance(element, SystemElement):
            yield from _systems(element, (*path, name))


def on_the_way(network: Network, edge: Edge) -> str:
    """Return what a connection does to a value, in words; empty for nothing."""
    words = []
    if edge.source_index or edge.target_index:
        words.append(f"{edge.source_index or 'all'} → {edge.target_index or 'all'}")
    source, target = network.measure(edge.source), network.measure(edge.target)
    if source and target and source.name != target.name:
        words.append(f"{source.name} → {target.name}{', not converted' if edge.wire.suppress else ''}")
    linear = edge.wire.transformation
    if not isinstance(linear, Linear):
        words.append(f"{linear.kind.lower()} map")
    else:
        words += [f"×{linear.factor:g}"] if linear.factor != 1.0 else []
        words += [f"{'+' if linear.offset > 0.0 else '−'}{abs(linear.offset):g}"] if linear.offset else []
    return ", ".join(words)


@dataclass
class _Ports:
    inputs: dict[str, None] = field(default_factory=dict)
    outputs: dict[str, None] = field(default_factory=dict)


class _Level:
    """The diagram of one system."""

    def __init__(self, network: Network, system: SystemElement, path: ElementPath) -> None:
        self._network = network
        self._system = system
        self._path = path
        self._edges = [edge for wire in system.wires if (edge := network.edge_of(wire))]

    def picture(self, title: str) -> Picture:
        """Return it with all its parts at their places."""
        wires = [self._wire(edge) for edge in self._edges]
        used: dict[str, _Ports] = {}
        for wire in wires:
            used.setdefault(wire.source[0], _Ports()).outputs[wire.source[1]] = None
            used.setdefault(wire.target[0], _Ports()).inputs[wire.target[1]] = None
        blocks = [_block(name, e, used.get(name, _Ports())) for name, e in self._system.elements.items()]
        ends = dict.fromkeys([*self._declared(), *(name for name in used if name[:1] in _MARKS)])
        blocks += [_border(name) for name in ends]
        diagram = Diagram("/".join(self._path) or title, blocks, wires)
        geometry = self._geometry()
        return layered(diagram) if geometry is None else placed(diagram, geometry)

    def _declared(self) -> Iterator[str]:
        """Return the blocks of the system's own inputs and outputs, connected or not."""
        for connector in self._system.connectors.values():
            if connector.kind in {"input", "output"}:
                yield _border_name(connector.name, is_input=connector.kind == "input")

    def _wire(self, edge: Edge) -> Wire:
        source, target = (
            (end.element, end.connector)
            if end.element
            else (_border_name(end.connector, is_input=is_source), "")
            for end, is_source in zip(edge.ends, (True, False), strict=True)
        )
        return Wire(source, target, on_the_way(self._network, edge))

    def _geometry(self) -> Geometry | None:
        extents = {name: extent_of(element.node) for name, element in self._system.elements.items()}
        known = {name: extent for name, extent in extents.items() if extent}
        if not known or len(known) < len(extents):
            return None
        ports = {}
        for name, element in self._system.elements.items():
            for connector in element.connectors.values():
                ports[name, connector.name] = place_of(connector.node)
        for connector in self._system.connectors.values():
            for is_input in (True, False):
                ports[_border_name(connector.name, is_input=is_input), ""] = place_of(connector.node)
        corners = {}
        for i, edge in enumerate(self._edges):
            points = corners_of(edge.wire.node)
            corners[i] = points[::-1] if edge.is_reversed else points
        known_ports = {key: place for key, place in ports.items() if place}
        inside = self._system.inside
        return Geometry(known, canvas_of(inside) if inside else None, known_ports, corners)


#: What the names of connectors of the system begin with, apart from those of its elements.
_MARKS = ("\x01", "\x02")


def _border_name(connector: str, *, is_input: bool) -> str:
    return _MARKS[0 if is_input else 1] + connector


def _border(name: str) -> Block:
    is_input = name[0] == _MARKS[0]
    ports: tuple[tuple[str, ...], tuple[str, ...]] = ((), ("",)) if is_input else (("",), ())
    return Block(name, name[1:], *ports, kind="input" if is_input else "output")


def _block(name: str, element: Element, ports: _Ports) -> Block:
    inputs, outputs = (_in_order(element, names) for names in (ports.inputs, ports.outputs))
    if isinstance(element, SystemElement):
        return Block(name, name, inputs, outputs, "system", "system")
    if isinstance(element, Reference):
        return Block(name, name, inputs, outputs, "signal dictionary", "bus")
    assert isinstance(element, Component)
    if element.fmu is None:
        return Block(name, name, inputs, outputs, "cannot be had", "missing")
    return Block(name, name, inputs, outputs, element.fmu.path.name)


def _in_order(element: Element, names: dict[str, None]) -> tuple[str, ...]:
    """Return ports in the order of the connectors."""
    return tuple([name for name in element.connectors if name in names] + [
        name for name in names if name not in element.connectors
    ])  # fmt: skip
