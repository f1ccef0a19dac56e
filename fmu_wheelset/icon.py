"""The icon of the FMU: a wheelset on its rails, seen along the track, as SVG and as PNG."""

from __future__ import annotations

import math
import struct
import zlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["png", "svg"]

SIZE = 100.0
STEEL, DARK, RAIL = (122, 132, 145), (64, 72, 84), (176, 108, 64)
Point = tuple[float, float]
Shape = tuple[tuple[int, int, int], tuple[Point, ...]]

#: Left half, from back to front; y points down. The tread is a cone, the flange on its inner side.
HALF: tuple[Shape, ...] = (
    (RAIL, ((13, 82.5), (29, 81), (29, 87), (13, 87))),
    (RAIL, ((19, 87), (23, 87), (23, 95), (19, 95))),
    (RAIL, ((11, 95), (31, 95), (31, 99), (11, 99))),
    (DARK, ((5, 46), (12, 46), (12, 54), (5, 54))),
    (DARK, ((36, 46.5), (50, 46.5), (50, 53.5), (36, 53.5))),
    (STEEL, ((12, 17.5), (31, 19), (31, 81), (12, 82.5))),
    (DARK, ((31, 11), (36, 12.5), (36, 87.5), (31, 89))),
)


def _shapes() -> Iterator[Shape]:
    for colour, points in HALF:
        yield colour, points
        yield colour, tuple((SIZE - x, y) for x, y in points)


def svg() -> str:
    """Return the icon as SVG."""
    polygons = (
        '  <polygon fill="rgb({},{},{})" points="{}"/>\n'.format(
            *colour, " ".join(f"{x:g},{y:g}" for x, y in points)
        )
        for colour, points in _shapes()
    )
    box = f"0 0 {SIZE:g} {SIZE:g}"
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">\n{"".join(polygons)}</svg>\n'


def _span(points: tuple[Point, ...], y: float) -> tuple[float, float]:
    """Return where a horizontal line enters and leaves a convex polygon; an empty interval if it does not."""
    crossings = [
        x1 + (y - y1) * (x2 - x1) / (y2 - y1)
        for (x1, y1), (x2, y2) in zip(points, (*points[1:], points[0]), strict=True)
        if min(y1, y2) <= y < max(y1, y2)
    ]
    return (min(crossings), max(crossings)) if crossings else (0.0, 0.0)


def _paint(image: list[list[list[float]]], colour: tuple[int, int, int], points: tuple[Point, ...]) -> None:
    """Lay a convex polygon over the image, premultiplied RGBA, with smooth edges."""
    size, lines = len(image), 8
    scale = SIZE / size
    for row, pixels in enumerate(image):
        cover = [0.0] * size
        for line in range(lines):
            left, right = (x / scale for x in _span(points, (row + (line + 0.5) / lines) * scale))
            for column in range(math.floor(left), math.ceil(right)):
                cover[column] += (min(right, column + 1) - max(left, column)) / lines
        for column, alpha in enumerate(cover):
            if alpha > 0.0:
                above = [alpha * c for c in (*colour, 255)]
                pixels[column] = [a + (1.0 - alpha) * b for a, b in zip(above, pixels[column], strict=True)]


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(size: int = 128) -> bytes:
    """Return the icon as a square PNG with transparent background.

    Parameters
    ----------
    size : width and height in pixels.
    """
    image = [[[0.0] * 4 for _ in range(size)] for _ in range(size)]
    for colour, points in _shapes():
        _paint(image, colour, points)
    lines = bytearray()
    for pixels in image:
        lines.append(0)  # no filter
        for *colours, alpha in pixels:
            lines += bytes(round(255 * c / alpha) if alpha else 0 for c in colours) + bytes([round(alpha)])
    header = struct.pack(">IIBBBBB", size, size, 8, 6, 0, 0, 0)
    # Level 0 stores: what a compressor makes of the lines depends on its version.
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(lines), 0)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)
