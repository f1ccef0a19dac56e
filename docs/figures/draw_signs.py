"""Draw signs.svg: frames and signs of the wheelset's ports, seen from above, and two wheelsets in a bogie.

    python docs/figures/draw_signs.py [FILE]

writes the file beside this script, or another one; a name that ends in .png gives a picture of dots.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyArrowPatch, Polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, RAIL, STEEL, LOAD, MOTION, GROUND = "#222222", "#9a9a9a", "#fdf1e3", "#a3190f", "#0072B2", "#00674a"


def arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, **style: Any) -> None:
    """Draw an arrow between two points."""
    style = {"arrowstyle": "-|>", "mutation_scale": 13, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0} | style
    ax.add_patch(FancyArrowPatch(start, end, color=colour, **style))


def turn(
    ax: Axes, centre: tuple[float, float], radius: float, angles: tuple[float, float], colour: str
) -> None:
    """Draw an arc with an arrow head at its end, from one angle to the other (degrees, counter-clockwise)."""
    ax.add_patch(
        Arc(centre, 2 * radius, 2 * radius, theta1=angles[0], theta2=angles[1], color=colour, lw=1.6)
    )
    end, before = (math.radians(angles[1] - back) for back in (0.0, 9.0))
    points = [(centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in (before, end)]
    arrow(ax, points[0], points[1], colour)


def box(
    ax: Axes, centre: tuple[float, float], size: tuple[float, float], yaw: float, place: tuple[float, float]
) -> None:
    """Draw a part of a body that has turned: its own place in the body, and where the body is."""
    c, s = math.cos(yaw), math.sin(yaw)
    corners = [
        (place[0] + i * size[0] / 2, place[1] + j * size[1] / 2)
        for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    turned = [(centre[0] + c * x - s * y, centre[1] + s * x + c * y) for x, y in corners]
    ax.add_patch(Polygon(turned, facecolor=STEEL, edgecolor=INK, linewidth=1.2, zorder=3))


def wheelset(ax: Axes, centre: tuple[float, float], yaw: float, half: float = 0.75) -> None:
    """Draw an axle with both wheels, seen from above."""
    box(ax, centre, (0.1, 2 * half + 0.5), yaw, (0.0, 0.0))
    for side in (-1, 1):
        box(ax, centre, (0.8, 0.16), yaw, (0.0, side * half))


def rails(ax: Axes, x: tuple[float, float], offset: float, half: float = 0.75) -> None:
    """Draw both rails, their middle and the straight line that everything counts from."""
    for side in (-1, 1):
        ax.plot(x, [offset + side * half] * 2, color=RAIL, linewidth=3.0, zorder=1)
    ax.plot(x, [offset, offset], color=GROUND, linewidth=1.0, linestyle=(0, (6, 3)), zorder=1)
    ax.plot(x, [0.0, 0.0], color=INK, linewidth=0.8, linestyle=(0, (1, 3)), zorder=1)


def one_wheelset(ax: Axes) -> None:
    """Draw displacements, loads and sides of one wheelset; lengths are exaggerated."""
    y, y_t, yaw = 0.42, 0.17, math.radians(9)
    centre = (0.9, y)
    rails(ax, (-1.6, 3.1), y_t)
    wheelset(ax, centre, yaw)
    arrow(ax, (-1.5, -1.4), (-0.8, -1.4), INK)
    ax.text(-0.75, -1.4, "x, travel", va="center")
    arrow(ax, (-1.5, -1.4), (-1.5, -0.9), INK)
    ax.text(-1.5, -0.85, "y, left", ha="center", va="bottom")
    arrow(ax, (-1.05, 0.0), (-1.05, y_t), GROUND, mutation_scale=8)
    ax.text(-1.12, -0.06, "track_lateral_offset  $y_t$", color=GROUND, va="top", ha="left", size=9.5)
    arrow(ax, (2.0, 0.0), (2.0, y), MOTION, mutation_scale=10)
    ax.plot([centre[0], 2.15], [y, y], color=MOTION, linewidth=0.7)
    ax.text(1.86, -0.06, "lateral_displacement  $y$", color=MOTION, va="top", ha="left", size=9.5)
    reach = 1.35
    ax.plot(
        [centre[0], centre[0] + reach * math.cos(yaw)],
        [y, y + reach * math.sin(yaw)],
        color=MOTION,
        linewidth=0.7,
    )
    turn(ax, centre, 1.25, (0.0, 9.0), MOTION)
    ax.text(2.22, 0.66, "yaw_angle  $\\psi$", color=MOTION, va="bottom", size=9.5)
    arrow(ax, (0.9, 1.62), (0.9, 2.15), LOAD)
    ax.text(1.0, 2.0, "suspension_lateral_force", color=LOAD, va="center")
    turn(ax, centre, 0.36, (110.0, 250.0), LOAD)
    ax.text(0.46, 0.56, "suspension_yaw_moment", color=LOAD, va="center", ha="right", size=9.5)
    for name, x, height in (("left", 1.3, 1.3), ("right", 1.5, -0.42)):
        ax.text(x, height, f"{name} wheel", va="center", size=9.5)
    ax.text(-1.6, 2.4, "One wheelset, from above", weight="bold")
    ax.set(xlim=(-1.8, 3.5), ylim=(-1.95, 2.6))


def a_bogie(ax: Axes) -> None:
    """Draw two wheelsets and the frame, with what passes between them."""
    rails(ax, (-2.6, 2.6), 0.0)
    for x, name in ((1.5, "front"), (-1.5, "rear")):
        wheelset(ax, (x, 0.0), 0.0)
        ax.text(x, -1.35, name, va="top", ha="center")
    for side in (-1, 1):
        ax.add_patch(
            Polygon(
                [(-1.95, side * 1.08), (1.95, side * 1.08), (1.95, side * 1.3), (-1.95, side * 1.3)],
                facecolor="white", edgecolor=INK, linewidth=1.2, zorder=4,
            )
        )  # fmt: skip
    ax.add_patch(
        Polygon(
            [(-0.14, -1.08), (0.14, -1.08), (0.14, 1.08), (-0.14, 1.08)], facecolor="white", ec=INK, lw=1.2
        )
    )
    ax.text(0.22, 0.5, "frame", va="center")
    arrow(ax, (0.0, 1.6), (1.5, 1.6), INK, arrowstyle="<|-|>", mutation_scale=9)
    arrow(ax, (-1.5, 1.6), (0.0, 1.6), INK, arrowstyle="<|-|>", mutation_scale=9)
    for x in (0.75, -0.75):
        ax.text(x, 1.64, "a", ha="center", va="bottom")
    arrow(ax, (-2.4, -1.78), (-1.7, -1.78), INK)
    ax.text(-1.62, -1.78, "v: the rear wheelset meets the same track  2a / v  later", va="center", size=9.5)
    ax.text(-2.6, 2.4, "Two of them under a frame", weight="bold")
    ax.set(xlim=(-2.75, 2.75), ylim=(-1.95, 2.6))


def main(path: Path) -> None:
    """Draw both pictures side by side."""
    mpl.rcParams.update(
        {"svg.fonttype": "none", "svg.hashsalt": "signs", "font.size": 10.5, "font.family": "sans-serif"}
    )
    figure = Figure(figsize=(11.5, 4.7))
    widths = (5.3, 5.5)
    left = 0.01
    for width, draw in zip(widths, (one_wheelset, a_bogie), strict=True):
        share = 0.98 * width / sum(widths)
        ax = figure.add_axes((left, 0.01, share - 0.01, 0.98))
        ax.set_aspect("equal")
        ax.axis("off")
        draw(ax)
        left += share
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("signs.svg"))
