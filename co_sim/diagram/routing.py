"""The channels between layers, in which wires change their height: each has lanes side by side."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from co_sim.diagram.blocks import Line, Point

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from co_sim.diagram.blocks import Box, Wire

__all__ = ["Channels", "CrowdedError", "Way"]

#: Between two lanes, and between the outer ones and the boxes.
_LANE, _EDGE = 7.0, 16.0
#: Width of a character of a wire's label.
_CHARACTER = 4.0
#: What it costs if two wires run upon each other, in crossings.
_OVERLAP = 10_000
#: A port: names of block and port.
_Source = tuple[str, str]


@dataclass(frozen=True)
class _Leg:
    """The part of a wire in one channel: from a height at one side of it to a height at a side of it."""

    channel: int
    start: float
    comes_from_left: bool
    end: float
    leaves_to_left: bool


#: A wire and its legs.
Way = tuple["Wire", "list[_Leg]"]


@dataclass(eq=False)
class _Net:
    """The legs in one channel that begin at one place: they share a lane."""

    legs: list[_Leg] = field(default_factory=list)
    lane: int = 0

    @property
    def span(self) -> tuple[float, float]:
        heights = [height for leg in self.legs for height in (leg.start, leg.end)]
        return min(heights), max(heights)

    @property
    def is_straight(self) -> bool:
        """Whether it needs no lane."""
        low, high = self.span
        return low == high and not any(leg.comes_from_left == leg.leaves_to_left for leg in self.legs)

    def heights(self, *, left: bool) -> set[float]:
        """Return where it meets a side of the channel."""
        starts = {leg.start for leg in self.legs if leg.comes_from_left == left}
        return starts | {leg.end for leg in self.legs if leg.leaves_to_left == left}

    def dots(self) -> list[float]:
        """Return the heights in its lane at which three lines meet."""
        low, high = self.span
        ends = {leg.end for leg in self.legs}
        start = self.legs[0].start
        inner = {height for height in ends if low < height < high and height != start}
        if low < start < high or (start in ends and len(ends) > 1):
            inner.add(start)
        return sorted(inner)


def _cost(one: _Net, other: _Net) -> int:
    """Return how often two nets cross if the first has the lane to the left of the other."""
    lefts, rights = other.heights(left=True), one.heights(left=False)
    crossings = sum(one.span[0] <= height <= one.span[1] for height in lefts)
    crossings += sum(other.span[0] <= height <= other.span[1] for height in rights)
    return crossings + _OVERLAP * len(lefts & rights)


class CrowdedError(Exception):
    """Two wires exchange their heights in a channel, whose number is the argument."""


class Channels:
    """The channels of a picture: channel c lies to the left of layer c.

    Parameters
    ----------
    n : their number.
    """

    def __init__(self, n: int) -> None:
        self._nets: list[dict[tuple[_Source, float, bool], _Net]] = [{} for _ in range(n)]
        self._x: list[float] = []
        self._labels = [0.0] * n

    def add(self, wire: Wire, layers: Sequence[int], heights: Sequence[float]) -> Way:
        """Return a wire with its legs, from its height in each layer that it touches."""
        legs = []
        pairs = list(pairwise(zip(layers, heights, strict=True)))
        is_backward = len(layers) > 2 and layers[1] == layers[0]
        for i, ((layer, start), (_, end)) in enumerate(pairs):
            first, last = i == 0, i == len(pairs) - 1
            channel = layer + 1 if not is_backward or first else layer
            leg = _Leg(channel, start, not is_backward or first, end, is_backward and not last)
            legs.append(leg)
            self._nets[channel].setdefault(_key(wire, leg), _Net()).legs.append(leg)
        self._labels[channel] = max(self._labels[channel], _CHARACTER * len(wire.label))
        return wire, legs

    def spread(self, widths: Sequence[float]) -> list[float]:
        """Give every net a lane; return the left sides of layers of these widths.

        Raises
        ------
        CrowdedError
            If two wires would run upon each other wherever they are.
        """
        lefts, x = [], 0.0
        for i, nets in enumerate(self._nets):
            n = _assign([net for net in nets.values() if not net.is_straight])
            if n is None:
                raise CrowdedError(i)
            self._x.append(x + _EDGE)
            is_outer = i in {0, len(widths)}
            x += 2.0 * _EDGE + _LANE * max(n - 1, 0) + self._labels[i] if n or not is_outer else 0.0
            if i < len(widths):
                lefts.append(x)
                x += widths[i]
        return lefts

    def lines(self, ways: Sequence[Way], boxes: Mapping[str, Box]) -> list[Line]:
        """Return wires with all their corners."""
        dots = self._dots()
        found = []
        for wire, legs in ways:
            points = [boxes[wire.source[0]].outputs[wire.source[1]]]
            for leg in legs:
                net = self._nets[leg.channel][_key(wire, leg)]
                if not net.is_straight:
                    x = self._x[leg.channel] + _LANE * net.lane
                    points += [Point(x, leg.start), Point(x, leg.end)]
            points.append(boxes[wire.target[0]].inputs[wire.target[1]])
            found.append(Line(wire, _without_repetition(points), dots.pop(wire.source, ())))
        return found

    def _dots(self) -> dict[_Source, list[Point]]:
        found: defaultdict[_Source, list[Point]] = defaultdict(list)
        for x, nets in zip(self._x, self._nets, strict=True):
            for (source, *_), net in nets.items():
                if not net.is_straight:
                    found[source] += [Point(x + _LANE * net.lane, y) for y in net.dots()]
        return dict(found)


def _key(wire: Wire, leg: _Leg) -> tuple[_Source, float, bool]:
    return wire.source, leg.start, leg.comes_from_left


def _assign(nets: list[_Net]) -> int | None:
    """Order nets so that few of them cross, give them lanes, and return the number of lanes.

    ``None`` is returned if two of them would run upon each other in any order.
    """
    cost = np.array([[_cost(one, other) for other in nets] for one in nets]).reshape(2 * (len(nets),))
    np.fill_diagonal(cost, 0)
    order = _swapped(sorted(range(len(nets)), key=lambda i: nets[i].span), cost)
    graph = nx.DiGraph()
    graph.add_nodes_from(order)
    # The right order of those that would run upon each other in the wrong one.
    graph.add_edges_from((int(i), int(k)) for k, i in zip(*np.nonzero(cost >= _OVERLAP), strict=True))
    try:
        order = list(nx.lexicographical_topological_sort(graph, key=order.index))
    except nx.NetworkXUnfeasible:
        return None
    for place, i in enumerate(_swapped(order, cost)):
        low, high = nets[i].span
        beside = [
            nets[k].lane
            for k in order[:place]
            if nets[k].span[0] <= high + _LANE and nets[k].span[1] >= low - _LANE
        ]
        nets[i].lane = max(beside, default=-1) + 1
    return max((net.lane for net in nets), default=-1) + 1


def _swapped(order: list[int], cost: NDArray[np.int64]) -> list[int]:
    """Exchange neighbours in an order, which is changed, until that makes nothing better."""
    improved = True
    while improved:
        improved = False
        for i in range(len(order) - 1):
            a, b = order[i], order[i + 1]
            if cost[b, a] < cost[a, b]:
                order[i], order[i + 1], improved = b, a, True
    return order


def _without_repetition(points: Sequence[Point]) -> list[Point]:
    kept = list(points[:1])
    for point in points[1:]:
        if point != kept[-1]:
            kept.append(point)
    return kept
