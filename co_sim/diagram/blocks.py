"""What a block diagram shows, and where its parts are placed; nothing here draws.

Lengths are in points (1/72 inch), x to the right and y downwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Block", "Box", "Diagram", "Line", "Picture", "Point", "Wire", "size_of"]

#: What a block stands for: a component, a system of its own, a connector of the system that is shown, a
#: bus of signals, or a component that cannot be had.
Kind = Literal["component", "system", "input", "output", "bus", "missing"]

#: Height of a row of ports, and of the head of a block with its name and its note.
ROW, HEAD = 12.0, 26.0
#: Width of a character of a port's name, and of a block's.
_CHARACTER, _BIG = 4.6, 5.8
_NARROWEST = 70.0
#: Characters of a name that are shown.
_LONGEST = 40


class Point(NamedTuple):
    """A place in a picture."""

    x: float
    y: float

    def moved(self, by: Point) -> Point:
        """Return it at another place."""
        return Point(self.x + by.x, self.y + by.y)


@dataclass(frozen=True)
class Block:
    """A block with ports.

    Parameters
    ----------
    name : unique in the diagram.
    label, note : what stands in it; the note is smaller.
    inputs, outputs : names of its ports, from the top.
    kind : what it stands for.
    """

    name: str
    label: str
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    note: str = ""
    kind: Kind = "component"

    @property
    def is_border(self) -> bool:
        """Whether it is a connector of the system itself."""
        return self.kind in {"input", "output"}


@dataclass(frozen=True)
class Wire:
    """A connection from an output of a block to an input of one.

    Parameters
    ----------
    source, target : names of block and port.
    label : what is done to the value on the way; empty for nothing.
    """

    source: tuple[str, str]
    target: tuple[str, str]
    label: str = ""


@dataclass(frozen=True)
class Diagram:
    """A diagram of one level; all ports of wires are ports of its blocks."""

    title: str
    blocks: Sequence[Block]
    wires: Sequence[Wire]


@dataclass(frozen=True)
class Box:
    """A block at its place.

    Parameters
    ----------
    block : what is shown. x, y : of the upper left corner. width, height : of the box.
    inputs, outputs : places of its ports.
    """

    block: Block
    x: float
    y: float
    width: float
    height: float
    inputs: Mapping[str, Point]
    outputs: Mapping[str, Point]

    def moved(self, by: Point) -> Box:
        """Return it at another place."""
        inputs, outputs = (
            {name: point.moved(by) for name, point in ports.items()} for ports in (self.inputs, self.outputs)
        )
        return replace(self, x=self.x + by.x, y=self.y + by.y, inputs=inputs, outputs=outputs)


@dataclass(frozen=True)
class Line:
    """A wire along its corners; `dots` are where it leaves another line of the same source."""

    wire: Wire
    points: Sequence[Point]
    dots: Sequence[Point] = ()

    def moved(self, by: Point) -> Line:
        """Return it at another place."""
        points, dots = ([point.moved(by) for point in places] for places in (self.points, self.dots))
        return replace(self, points=points, dots=dots)


@dataclass(frozen=True)
class Picture:
    """A diagram ready to be drawn: everything lies within width and height."""

    title: str
    boxes: Sequence[Box]
    lines: Sequence[Line]
    width: float
    height: float

    @classmethod
    def around(cls, title: str, boxes: Sequence[Box], lines: Sequence[Line], margin: float) -> Picture:
        """Return a picture of boxes and lines wherever they are, moved to where a picture begins."""
        corners = [Point(box.x, box.y) for box in boxes]
        corners += [Point(box.x + box.width, box.y + box.height) for box in boxes]
        corners += [point for line in lines for point in line.points]
        if not corners:
            return cls(title, (), (), 2.0 * margin, 2.0 * margin)
        xs, ys = zip(*corners, strict=True)
        by = Point(margin - min(xs), margin - min(ys))
        moved = [box.moved(by) for box in boxes]
        size = max(xs) - min(xs) + 2.0 * margin, max(ys) - min(ys) + 2.0 * margin
        return cls(title, moved, [line.moved(by) for line in lines], *size)


def size_of(block: Block) -> tuple[float, float]:
    """Return width and height that a block needs."""
    if block.is_border:
        return 16.0 + _CHARACTER * len(shortened(block.label)), ROW
    left, right = (max(map(_length, names), default=0) for names in (block.inputs, block.outputs))
    head = max(_BIG * _length(block.label), _CHARACTER * _length(block.note))
    width = max(_NARROWEST, head + 16.0, _CHARACTER * (left + right) + 24.0)
    return width, HEAD + ROW * max(len(block.inputs), len(block.outputs), 1) + 4.0


def _length(name: str) -> int:
    return len(shortened(name))


def shortened(name: str) -> str:
    """Return a name as it is shown: without its middle where it is very long."""
    half = _LONGEST // 2
    return name if len(name) <= _LONGEST else f"{name[:half]}…{name[1 - half :]}"
