"""Draws block diagrams with matplotlib, as PNG, SVG or PDF."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

from co_sim.diagram.blocks import shortened

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from co_sim.diagram.blocks import Box, Line, Picture, Point

__all__ = ["FORMATS", "draw"]

FORMATS = (".png", ".svg", ".pdf")
#: Fills and frames by kind of block.
_COLOURS = {
    "component": ("#eef3fa", "#2f5d8c"),
    "system": ("#fdf3e1", "#a8690a"),
    "input": ("#e7f4ea", "#2e7d43"),
    "output": ("#e7f4ea", "#2e7d43"),
    "bus": ("#f2f2f2", "#555555"),
    "missing": ("#fdeaea", "#b3261e"),
}
_WIRE, _TEXT, _FAINT = "#3a3a3a", "#1a1a1a", "#5f5f5f"
_TITLE, _BETWEEN = 24.0, 14.0
#: Pixels of a PNG on a side at most: beyond it has fewer for each inch.
_MOST_PIXELS = 12_000
_DPI = 150


def draw(pictures: Sequence[Picture], path: Path) -> None:
    """Draw pictures one above the other into a file.

    Parameters
    ----------
    pictures : at least one.
    path : its ending is one of `FORMATS`.
    """
    from matplotlib.figure import Figure

    width = max(max(picture.width, 7.0 * len(picture.title)) for picture in pictures)
    height = sum(picture.height + _TITLE + _BETWEEN for picture in pictures)
    figure = Figure(figsize=(width / 72.0, height / 72.0), facecolor="white")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(height, 0.0))
    ax.set_axis_off()
    y = 0.0
    for picture in pictures:
        _text(ax, 14.0, y + _TITLE / 2.0 + 4.0, picture.title, size=10, weight="bold")
        _picture(ax, picture, y + _TITLE)
        y += picture.height + _TITLE + _BETWEEN
    dpi = min(_DPI, _MOST_PIXELS * 72.0 / max(width, height))
    with warnings.catch_warnings():
        # A script that the font does not have is shown as boxes, which is no reason to show nothing.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(path, dpi=dpi)


def _picture(ax: Any, picture: Picture, y: float) -> None:
    for line in picture.lines:
        _line(ax, line, y)
    for box in picture.boxes:
        _box(ax, box, y)
    for line in picture.lines:
        _label(ax, line, y)


def _line(ax: Any, line: Line, y: float) -> None:
    xs, ys = zip(*line.points, strict=True)
    ax.plot(xs, [value + y for value in ys], color=_WIRE, linewidth=0.8, solid_joinstyle="miter", zorder=1)
    _arrow(ax, line.points[-2:], y)
    for dot in line.dots:
        ax.plot([dot.x], [dot.y + y], "o", color=_WIRE, markersize=2.6, zorder=2)


def _arrow(ax: Any, end: Sequence[Point], y: float) -> None:
    if len(end) == 2:
        (x0, y0), (x1, y1) = end
        ax.annotate(
            "",
            (x1, y1 + y),
            (x0, y0 + y),
            arrowprops={"arrowstyle": "-|>,head_width=0.14,head_length=0.28", "color": _WIRE, "lw": 0.8,
                        "shrinkA": 0, "shrinkB": 0},
            zorder=2,
        )  # fmt: skip


def _label(ax: Any, line: Line, y: float) -> None:
    """Write what is done to the value beside the end of its wire."""
    if not line.wire.label:
        return
    end, before = line.points[-1], line.points[-2]
    if abs(end.x - before.x) >= abs(end.y - before.y):
        sign = -1.0 if end.x >= before.x else 1.0
        place, side = (end.x + 8.0 * sign, end.y - 5.0), "right" if sign < 0.0 else "left"
    else:
        place, side = (end.x - 4.0, end.y + (10.0 if end.y < before.y else -10.0)), "right"
    background = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6}
    _text(
        ax, place[0], place[1] + y, line.wire.label, size=6, ha=side, color="#8c2f5d", bbox=background,
        zorder=2.5,
    )  # fmt: skip


def _box(ax: Any, box: Box, y: float) -> None:
    from matplotlib.patches import FancyBboxPatch, Polygon

    fill, frame = _COLOURS[box.block.kind]
    style: dict[str, Any] = {"facecolor": fill, "edgecolor": frame, "linewidth": 1.0, "zorder": 3}
    left, top, width, height = box.x, box.y + y, box.width, box.height
    middle = left + width / 2.0
    if box.block.is_border:
        tip = min(6.0, height / 2.0)
        corners = [(left, top), (left + width - tip, top), (left + width, top + height / 2.0)]
        corners += [(left + width - tip, top + height), (left, top + height)]
        ax.add_patch(Polygon(corners, closed=True, **style))
        _text(ax, middle - tip / 3.0, top + height / 2.0, shortened(box.block.label), size=7, ha="center")
        return
    if box.block.kind == "missing":
        style["linestyle"] = "--"
    shape = "round,pad=0,rounding_size=4" if box.block.kind == "system" else "square,pad=0"
    ax.add_patch(FancyBboxPatch((left, top), width, height, boxstyle=shape, **style))
    is_crossed = any(_is_across(box, point) for point in (*box.inputs.values(), *box.outputs.values()))
    head = top + (height / 2.0 - 5.0 if is_crossed else 9.0)
    _text(ax, middle, head, shortened(box.block.label), size=8.5, weight="bold", ha="center")
    _text(ax, middle, head + 10.0, shortened(box.block.note), size=6, color=_FAINT, ha="center")
    for name, point in (*box.inputs.items(), *box.outputs.items()):
        _port(ax, box, shortened(name), point, y)


def _port(ax: Any, box: Box, name: str, port: Point, y: float) -> None:
    """Write the name of a port beside it, within the box; along the upper and lower side upright."""
    if not _is_across(box, port):
        is_left = port.x < box.x + box.width / 2.0
        place = port.x + (5.0 if is_left else -5.0), port.y
        style: dict[str, Any] = {"ha": "left" if is_left else "right"}
    else:
        is_top = port.y < box.y + box.height / 2.0
        place = port.x, port.y + (5.0 if is_top else -5.0)
        style = {"rotation": 90.0, "ha": "center", "va": "top" if is_top else "bottom"}
    _text(ax, place[0], place[1] + y, name, size=7, **style)


def _is_across(box: Box, port: Point) -> bool:
    """Tell whether a port is on the upper or lower side."""
    across = min(port.x - box.x, box.x + box.width - port.x)
    return 1.0 <= across > min(port.y - box.y, box.y + box.height - port.y)


def _text(ax: Any, x: float, y: float, text: str, **style: Any) -> None:
    if text:
        style = {"color": _TEXT, "va": "center", "zorder": 4, "parse_math": False} | style
        ax.text(x, y, "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text), **style)
