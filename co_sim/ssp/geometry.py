"""Where the documents of SSP put elements, connectors and connections in a diagram."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from co_sim.diagram.placed import Extent

if TYPE_CHECKING:
    from co_sim.ssp.document import Node

__all__ = ["canvas_of", "corners_of", "extent_of", "place_of"]


def extent_of(element: Node) -> Extent | None:
    """Return where an element is; ``None`` if it does not tell, or tells a box without an inside."""
    return _extent(element.child("ElementGeometry"))


def canvas_of(system: Node) -> Extent | None:
    """Return the extent of a system seen from within."""
    return _extent(system.child("SystemGeometry"))


def place_of(connector: Node) -> tuple[float, float] | None:
    """Return where a connector is, in parts of its element."""
    found = _numbers(connector.child("ConnectorGeometry"), "x", "y")
    return None if found is None else (found[0], found[1])


def corners_of(connection: Node) -> list[tuple[float, float]]:
    """Return the points of a connection between its start and its end."""
    geometry = connection.child("ConnectionGeometry")
    if geometry is None:
        return []
    try:
        xs, ys = ([float(text) for text in geometry.get(name).split()] for name in ("pointsX", "pointsY"))
    except ValueError:
        return []
    return list(zip(xs, ys, strict=False))


def _extent(geometry: Node | None) -> Extent | None:
    corners = _numbers(geometry, "x1", "y1", "x2", "y2")
    if geometry is None or corners is None:
        return None
    x1, y1, x2, y2 = corners
    rotation = _numbers(geometry, "rotation") or [0.0]
    return Extent(x1, y1, x2, y2, rotation[0]) if x1 != x2 and y1 != y2 else None


def _numbers(node: Node | None, *names: str) -> list[float] | None:
    """Return attributes that are numbers, or ``None``: a picture that is wrong is no fault of a system."""
    if node is None:
        return None
    try:
        found = [float(node.get(name)) for name in names]
    except ValueError:
        return None
    return found if all(map(math.isfinite, found)) else None
