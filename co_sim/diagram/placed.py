"""Layout from coordinates that come with a diagram; only its scale is chosen here, so that texts fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from co_sim.diagram.blocks import HEAD, ROW, Box, Line, Picture, Point, size_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.diagram.blocks import Block, Diagram

__all__ = ["Extent", "Geometry", "placed"]

_MARGIN, _STUB = 14.0, 12.0
#: Side of a picture at most, points: with crowded coordinates texts are cut rather than pictures endless.
_LARGEST = 4000.0


class Extent(NamedTuple):
    """Two opposite corners of a box, y upwards, and its rotation (degrees, left) about its middle.

    With ``x1 > x2`` its left and right are exchanged, with ``y1 > y2`` top and bottom.
    """

    x1: float
    y1: float
    x2: float
    y2: float
    rotation: float = 0.0

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of a point that is given in parts of the box, from 0 to 1."""
        angle = math.radians(self.rotation)
        cx, cy = (self.x1 + self.x2) / 2.0, (self.y1 + self.y2) / 2.0
        dx, dy = (x - 0.5) * (self.x2 - self.x1), (y - 0.5) * (self.y2 - self.y1)
        c, s = math.cos(angle), math.sin(angle)
        return cx + c * dx - s * dy, cy + s * dx + c * dy

    @property
    def upright(self) -> tuple[float, float, float, float]:
        """Left, lower, right and upper side of the upright box around it."""
        xs, ys = zip(*(self.at(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0)), strict=True)
        return min(xs), min(ys), max(xs), max(ys)


@dataclass(frozen=True)
class Geometry:
    """Coordinates of a diagram.

    Parameters
    ----------
    extents : of all blocks but the connectors of the system.
    canvas : of the system; ``None`` is what its blocks need.
    ports : of a block's name and a port's, in parts of the block; of a connector of the system, in
        parts of the canvas.
    corners : of a wire, by its place in the diagram: points between its ends.
    """

    extents: Mapping[str, Extent]
    canvas: Extent | None = None
    ports: Mapping[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    corners: Mapping[int, Sequence[tuple[float, float]]] = field(default_factory=dict)


def placed(diagram: Diagram, geometry: Geometry) -> Picture:
    """Return a diagram whose blocks are where its coordinates put them."""
    inner = [block for block in diagram.blocks if not block.is_border]
    scale = _scale(inner, geometry)
    boxes = {block.name: _box(block, geometry, scale) for block in inner}
    canvas = geometry.canvas or _around([geometry.extents[block.name] for block in inner])
    for kind in ("input", "output"):
        borders = [block for block in diagram.blocks if block.kind == kind]
        for i, block in enumerate(borders):
            boxes[block.name] = _border(block, geometry, canvas, scale, (i + 1.0) / (len(borders) + 1.0))
    lines = []
    for i, wire in enumerate(diagram.wires):
        start = boxes[wire.source[0]].outputs[wire.source[1]]
        end = boxes[wire.target[0]].inputs[wire.target[1]]
        corners = [_point(x, y, scale) for x, y in geometry.corners.get(i, ())]
        between = corners or _corners(start, end, boxes[wire.source[0]], boxes[wire.target[0]], i)
        lines.append(Line(wire, [start, *between, end]))
    return Picture.around(diagram.title, list(boxes.values()), lines, _MARGIN)


def _scale(blocks: Sequence[Block], geometry: Geometry) -> float:
    """Return points for a unit of the coordinates, by which every block holds its texts."""
    if not blocks:
        return 1.0
    needed = 0.0
    for block in blocks:
        left, low, right, high = geometry.extents[block.name].upright
        width, height = size_of(block)
        needed = max(needed, width / (right - left), height / (high - low))
    left, low, right, high = _hull([geometry.extents[block.name] for block in blocks])
    return min(needed, _LARGEST / max(right - left, high - low))


def _hull(extents: Sequence[Extent]) -> tuple[float, float, float, float]:
    """Return left, lower, right and upper side of the box around several."""
    lefts, lows, rights, highs = zip(*(extent.upright for extent in extents), strict=True)
    return min(lefts), min(lows), max(rights), max(highs)


def _around(extents: Sequence[Extent]) -> Extent:
    """Return a canvas with some room beside the blocks."""
    if not extents:
        return Extent(0.0, 0.0, 200.0, 100.0)
    left, low, right, high = _hull(extents)
    room = 0.1 * (right - left)
    return Extent(left - room, low, right + room, high)


def _point(x: float, y: float, scale: float) -> Point:
    return Point(x * scale, -y * scale)


def _box(block: Block, geometry: Geometry, scale: float) -> Box:
    extent = geometry.extents[block.name]
    left, low, right, high = extent.upright
    width, height = scale * (right - left), scale * (high - low)
    ports: list[dict[str, Point]] = []
    for x, names in ((0.0, block.inputs), (1.0, block.outputs)):
        room = max(height - HEAD, 0.5 * height)
        step = min(ROW, room / max(len(names), 1))
        found = {}
        for i, name in enumerate(names):
            below = (height - room + step * (i + 0.5)) / height
            given = geometry.ports.get((block.name, name))
            found[name] = _point(*extent.at(*(given or (x, 1.0 - below))), scale)
        ports.append(found)
    corner = _point(left, high, scale)
    return Box(block, corner.x, corner.y, width, height, *ports)


def _border(block: Block, geometry: Geometry, canvas: Extent, scale: float, share: float) -> Box:
    """Return a connector of the system; those without a place are spread over the left or right side."""
    is_input = block.kind == "input"
    x, y = geometry.ports.get((block.name, ""), (0.0 if is_input else 1.0, 1.0 - share))
    tip = _point(*canvas.at(x, y), scale)
    width, height = size_of(block)
    left = tip.x - width if is_input else tip.x
    ports: tuple[dict[str, Point], dict[str, Point]] = ({}, {"": tip}) if is_input else ({"": tip}, {})
    return Box(block, left, tip.y - height / 2.0, width, height, *ports)


def _corners(start: Point, end: Point, source: Box, target: Box, i: int) -> list[Point]:
    """Return the corners of a wire that has none: out of a block, along, and into the other."""
    out, into = _away(start, source), _away(end, target)
    if out == (1.0, 0.0) and into == (-1.0, 0.0) and end.x > start.x:
        # Wires side by side change their height at different places.
        x = start.x + (end.x - start.x) * (0.3 + 0.4 * ((i * 5) % 8) / 8.0)
        return [Point(x, start.y), Point(x, end.y)]
    first = Point(start.x + _STUB * out[0], start.y + _STUB * out[1])
    last = Point(end.x + _STUB * into[0], end.y + _STUB * into[1])
    middle = (first.y + last.y) / 2.0 + 3.0 * (i % 4)
    for point, (_, up) in ((first, out), (last, into)):
        if (middle - point.y) * up < 0.0:
            # Not back through the block that it has just left.
            middle = point.y
    return [first, Point(first.x, middle), Point(last.x, middle), last]


def _away(port: Point, box: Box) -> tuple[float, float]:
    """Return the direction that leads away from a box at one of its ports."""
    sides = {
        (-1.0, 0.0): abs(port.x - box.x),
        (1.0, 0.0): abs(port.x - box.x - box.width),
        (0.0, -1.0): abs(port.y - box.y),
        (0.0, 1.0): abs(port.y - box.y - box.height),
    }
    return min(sides, key=sides.__getitem__)
