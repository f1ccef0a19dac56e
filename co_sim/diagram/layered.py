"""Layout in layers from left to right, after Sugiyama: order, place, route.

Wires that close a circle run back above or below the blocks. Each of the four steps is the usual one: the
greedy order of Eades, Lin and Smyth (1993) to choose those wires, longest paths for the layers,
barycentres for the order within them, and isotonic regression for the heights.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from co_sim.diagram.blocks import HEAD, ROW, Block, Box, Picture, Point, size_of
from co_sim.diagram.routing import Channels, CrowdedError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from co_sim.diagram.blocks import Diagram, Wire
    from co_sim.diagram.routing import Way

__all__ = ["layered"]

#: Between two boxes of a layer, and around all.
_GAP, _MARGIN = 20.0, 14.0
_SWEEPS = 12


@dataclass(eq=False)
class _Slot:
    """A place in a layer: of a block, or of a wire that passes it."""

    block: Block | None
    layer: int
    width: float = 0.0
    height: float = 0.0
    y: float = 0.0
    ports: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def port(self, key: tuple[str, str]) -> float:
        """Height of a port below the top."""
        return self.ports.get(key, 0.0)


#: A wire with the slots that it touches and the ports at both ends.
_Path = tuple["Wire", list[_Slot]]


def layered(diagram: Diagram) -> Picture:
    """Return a diagram with its blocks in layers and its wires along horizontal and vertical lines."""
    layers_of = _layers(diagram)
    slots = {block.name: _slot(block, layers_of[block.name]) for block in diagram.blocks}
    layers: list[list[_Slot]] = [[] for _ in range(1 + max(layers_of.values(), default=0))]
    for slot in slots.values():
        layers[slot.layer].append(slot)
    paths = [_path(wire, slots, layers) for wire in diagram.wires]
    joints = [joint for path in paths for joint in _joints(path)]
    _arrange(layers, joints)
    _lift(layers, joints)
    _straighten(layers, paths)
    return _picture(diagram, slots, layers, paths)


def _heights_of_ports(names: Iterable[str]) -> dict[str, float]:
    """Return how far below the top of its block each port is."""
    return {name: HEAD + ROW * (i + 0.5) for i, name in enumerate(names)}


def _slot(block: Block, layer: int) -> _Slot:
    width, height = size_of(block)
    ports: dict[tuple[str, str], float] = {}
    for side, names in (("in", block.inputs), ("out", block.outputs)):
        middle = dict.fromkeys(names, height / 2.0)
        heights = middle if block.is_border else _heights_of_ports(names)
        ports |= {(side, name): y for name, y in heights.items()}
    return _Slot(block, layer, width, height, ports=ports)


def _layers(diagram: Diagram) -> dict[str, int]:
    """Return the layer of each block; connectors of the system are first and last."""
    position = {name: i for i, name in enumerate(_order(diagram))}
    graph = nx.DiGraph()
    graph.add_nodes_from(position)
    for wire in diagram.wires:
        source, target = wire.source[0], wire.target[0]
        if position[source] < position[target]:
            graph.add_edge(source, target)
    layer = {name: i for i, names in enumerate(nx.topological_generations(graph)) for name in names}
    last = max(layer.values(), default=0)
    for block in diagram.blocks:
        followers = [layer[name] for name in graph.successors(block.name)]
        if block.kind == "output":
            layer[block.name] = max(last, 1)
        elif not block.is_border and not graph.in_degree(block.name) and followers:
            # What nothing feeds stands close to what it feeds.
            layer[block.name] = min(followers) - 1
    return layer


def _order(diagram: Diagram) -> list[str]:
    """Return an order of the blocks in which few wires lead backwards."""
    graph = nx.DiGraph()
    graph.add_nodes_from(block.name for block in diagram.blocks)
    for wire in diagram.wires:
        source, target = wire.source[0], wire.target[0]
        if source != target:
            weight = graph.get_edge_data(source, target, {"weight": 0})["weight"]
            graph.add_edge(source, target, weight=weight + 1)
    first: list[str] = []
    last: list[str] = []
    while graph:
        sinks = [name for name in graph if not graph.out_degree(name)]
        sources = [name for name in graph if not graph.in_degree(name) and name not in sinks]
        if sinks:
            last = sinks + last
        elif not sources:
            gain = {
                name: graph.out_degree(name, "weight") - graph.in_degree(name, "weight") for name in graph
            }
            sources = [max(gain, key=gain.__getitem__)]
        first += sources
        graph.remove_nodes_from([*sinks, *sources])
    return first + last


def _path(wire: Wire, slots: Mapping[str, _Slot], layers: Sequence[list[_Slot]]) -> _Path:
    """Return the slots of a wire, with new ones in the layers that it passes."""
    source, target = slots[wire.source[0]], slots[wire.target[0]]
    a, b = source.layer, target.layer
    passed = range(a + 1, b) if b > a else range(a, b - 1, -1)
    between = [_Slot(None, layer, height=2.0) for layer in passed]
    for slot in between:
        layers[slot.layer].append(slot)
    return wire, [source, *between, target]


@dataclass(frozen=True, eq=False)
class _Joint:
    """Two neighbours on a wire, and how far below their tops it meets them; the left one is first."""

    slots: tuple[_Slot, _Slot]
    offsets: tuple[float, float]


def _joints(path: _Path) -> list[_Joint]:
    wire, slots = path
    ends = {0: ("out", wire.source[1]), len(slots) - 1: ("in", wire.target[1])}
    offsets = [slot.port(ends[i]) if i in ends else 1.0 for i, slot in enumerate(slots)]
    found = []
    for i, (one, other) in enumerate(pairwise(slots)):
        joint = _Joint((one, other), (offsets[i], offsets[i + 1]))
        if one.layer > other.layer:
            joint = _Joint((other, one), (offsets[i + 1], offsets[i]))
        found.append(joint)
    return found


def _arrange(layers: list[list[_Slot]], joints: Sequence[_Joint]) -> None:
    """Order each layer by the mean position of its neighbours, to and fro, and keep the best order seen."""
    best, fewest = [list(layer) for layer in layers], np.inf
    for sweep in range(_SWEEPS):
        n = _crossings(layers, joints)
        if n < fewest:
            best, fewest = [list(layer) for layer in layers], n
        rightwards = sweep % 2 == 0
        for layer in layers if rightwards else reversed(layers):
            place = _places(layers)
            ranks: defaultdict[_Slot, list[float]] = defaultdict(list)
            for joint in joints:
                left, right = joint.slots
                own, other = (right, left) if rightwards else (left, right)
                which = 0 if rightwards else 1
                # A slot that returns to its own layer is drawn towards its other end as well.
                ranks[own].append(place[other] + joint.offsets[which] / (other.height + 1.0))
                if own.layer == other.layer:
                    ranks[other].append(place[own])
            layer.sort(key=lambda slot: np.mean(ranks[slot]) if ranks[slot] else place[slot])
    layers[:] = best


def _places(layers: Sequence[Sequence[_Slot]]) -> dict[_Slot, float]:
    """Return positions in the layers, from 0 to 1."""
    return {slot: (i + 0.5) / len(layer) * 10.0 for layer in layers for i, slot in enumerate(layer)}


def _crossings(layers: Sequence[Sequence[_Slot]], joints: Sequence[_Joint]) -> int:
    """Return how many pairs of joints between the same two layers cross."""
    index = {slot: i for layer in layers for i, slot in enumerate(layer)}
    found: defaultdict[tuple[int, int], list[list[float]]] = defaultdict(list)
    for joint in joints:
        ends = [index[slot] + offset * 1e-4 for slot, offset in zip(joint.slots, joint.offsets, strict=True)]
        found[joint.slots[0].layer, joint.slots[1].layer].append(ends)
    total = 0
    for pairs in found.values():
        a, b = np.array(pairs).T
        total += int(np.sum((a[:, None] < a) & (b[:, None] > b)))
    return total


def _lift(layers: Sequence[Sequence[_Slot]], joints: Sequence[_Joint]) -> None:
    """Give each slot a height near those of its neighbours, in the order of its layer and without overlap."""
    for layer in layers:
        y = 0.0
        for slot in layer:
            slot.y, y = y, y + slot.height + _gap(slot)
    for sweep in range(_SWEEPS):
        rightwards = sweep % 2 == 0
        for layer in layers if rightwards else layers[::-1]:
            wanted: defaultdict[_Slot, list[float]] = defaultdict(list)
            for joint in joints:
                (left, right), (low, high) = joint.slots, joint.offsets
                wanted[right].append(left.y + low - high)
                wanted[left].append(right.y + high - low)
            _settle(layer, wanted)
    top = min((slot.y for layer in layers for slot in layer), default=0.0)
    for layer in layers:
        for slot in layer:
            slot.y = round((slot.y - top) / ROW) * ROW + _phase(slot)


def _straighten(layers: Sequence[Sequence[_Slot]], paths: Sequence[_Path]) -> None:
    """Have each wire pass all layers at one height, the outer wires first, where there is room."""
    runs = [slots[1:-1] for _, slots in paths if len(slots) > 3]
    for run in sorted(runs, key=lambda run: -max(slot.y for slot in run)):
        for y in sorted({slot.y for slot in run}, reverse=True):
            if all(_fits(slot, y, layers[slot.layer]) for slot in run):
                for slot in run:
                    slot.y = y
                break


def _fits(slot: _Slot, y: float, layer: Sequence[_Slot]) -> bool:
    i = layer.index(slot)
    above = layer[i - 1].y + layer[i - 1].height if i else -np.inf
    below = layer[i + 1].y if i + 1 < len(layer) else np.inf
    return bool(above + _gap(slot) / 2.0 <= y <= below - _gap(slot) / 2.0 - slot.height)


def _phase(slot: _Slot) -> float:
    """Return where it stands in the grid, so that all wires are level with the ports of blocks."""
    if slot.block is None:
        return (HEAD + 0.5 * ROW) % ROW - 1.0
    return HEAD % ROW if slot.block.is_border else 0.0


def _gap(slot: _Slot) -> float:
    return 10.0 if slot.block is None else 4.0 if slot.block.is_border else _GAP


def _settle(layer: Sequence[_Slot], wanted: Mapping[_Slot, list[float]]) -> None:
    """Move the slots of a layer to where they are wanted, as far as their order lets them."""
    from scipy.optimize import isotonic_regression

    if not layer:
        return
    sizes = np.array([np.ceil((slot.height + _gap(slot)) / ROW) * ROW for slot in layer])
    above = np.concatenate([[0.0], np.cumsum(sizes[:-1])])
    heights = np.array([np.mean(wanted[slot]) if wanted.get(slot) else slot.y for slot in layer])
    settled = isotonic_regression(heights - above).x + above
    for slot, y in zip(layer, settled, strict=True):
        slot.y = float(y)


def _picture(
    diagram: Diagram, slots: Mapping[str, _Slot], layers: Sequence[Sequence[_Slot]], paths: Sequence[_Path]
) -> Picture:
    widths = [max((slot.width for slot in layer), default=0.0) for layer in layers]
    while True:
        channels, ways = _routed(layers, paths)
        try:
            lefts = channels.spread(widths)
        except CrowdedError as error:
            # Between two ports of the next layer, no height is one of this layer.
            for layer in layers[error.args[0] :]:
                for slot in layer:
                    slot.y += ROW / 3.0
        else:
            break
    boxes = {name: _box(slot, lefts[slot.layer], widths[slot.layer]) for name, slot in slots.items()}
    lines = channels.lines(ways, boxes)
    return Picture.around(diagram.title, list(boxes.values()), lines, _MARGIN)


def _routed(layers: Sequence[Sequence[_Slot]], paths: Sequence[_Path]) -> tuple[Channels, list[Way]]:
    """Return the channels between layers and how the wires go through them."""
    channels = Channels(len(layers) + 1)
    ways = []
    for wire, slots in paths:
        heights = [slots[0].y + slots[0].port(("out", wire.source[1]))]
        heights += [slot.y + 1.0 for slot in slots[1:-1]]
        heights.append(slots[-1].y + slots[-1].port(("in", wire.target[1])))
        ways.append(channels.add(wire, [slot.layer for slot in slots], heights))
    return channels, ways


def _box(slot: _Slot, left: float, width: float) -> Box:
    assert slot.block is not None
    block = slot.block
    x = left if block.kind == "input" else left + width - slot.width if block.kind == "output" else (
        left + (width - slot.width) / 2.0
    )  # fmt: skip
    inputs = {name: Point(x, slot.y + slot.port(("in", name))) for name in block.inputs}
    outputs = {name: Point(x + slot.width, slot.y + slot.port(("out", name))) for name in block.outputs}
    return Box(block, x, slot.y, slot.width, slot.height, inputs, outputs)
