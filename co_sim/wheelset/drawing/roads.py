"""How far the linear models of three roads are apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.drawing.sheet import GREY, Sheet, colour, decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from co_sim.wheelset.reporting.grid import Grid

__all__ = ["FLOOR", "draw_roads"]

#: Differences below this are drawn here: a logarithmic axis has no place for none.
FLOOR = 1e-17
_MARKERS = "os^DvPX*"
_WIDTH, _LEFT, _BOTTOM, _PANEL, _GAP, _TOP, _RIGHT = 8.2, 0.72, 0.55, 2.0, 0.15, 0.75, 1.15


def draw_roads(
    grid: Grid, pairs: tuple[str, ...], values: NDArray[np.float64], bound: float, title: str
) -> Sheet:
    """Draw the differences (pair, condition, speed, point) over speed, a panel for each pair."""
    sheet = Sheet(_WIDTH, 3.6, title)
    for i, pair in enumerate(pairs):
        left = _LEFT + i * (_PANEL + _GAP)
        ax = sheet.axes(left, _BOTTOM, _PANEL, sheet.height - _BOTTOM - _TOP)
        _panel(ax, grid, values[i], bound)
        ax.set_title(pair, size=9.5, loc="left")
        ax.set_xlabel("speed (m/s)")
        ax.tick_params(labelleft=i == 0)
        if i == 0:
            ax.set_ylabel("difference, relative to its row")
    _explain(sheet, ax, grid)
    return sheet


def _panel(ax: Axes, grid: Grid, values: NDArray[np.float64], bound: float) -> None:
    shown = np.maximum(values, FLOOR)
    n = max(len(grid.conditions), 1)
    width = 0.5 * min(np.diff(grid.speeds), default=2.0) / n
    for i in range(len(grid.conditions)):
        for k in range(len(grid.points)):
            ax.plot(
                np.array(grid.speeds) + width * (i - 0.5 * (n - 1)),
                shown[i, :, k],
                linestyle="none",
                marker=_MARKERS[k % len(_MARKERS)],
                markersize=3.2,
                color=colour(i),
                alpha=0.8,
                markeredgewidth=0.0,
            )
    ax.axhline(bound, color=GREY, linestyle="--", linewidth=1.0)
    ax.annotate("bound", (0.02, bound), xycoords=("axes fraction", "data"), va="bottom", color=GREY, size=9.0)
    decades(ax, "y")
    greatest = float(np.nanmax(shown)) if np.isfinite(shown).any() else bound
    ax.set_ylim(0.3 * FLOOR, 30.0 * max(bound, greatest))
    ax.set_xlim(0.0, 1.05 * grid.speeds[-1])


def _explain(sheet: Sheet, ax: Axes, grid: Grid) -> None:
    from matplotlib.lines import Line2D

    rails = [
        Line2D([], [], linestyle="none", marker="s", color=colour(i), label=name.replace("_", " "))
        for i, name in enumerate(grid.conditions)
    ]
    points = [
        Line2D([], [], linestyle="none", marker=_MARKERS[k % len(_MARKERS)], color=GREY, label=name)
        for k, name in enumerate(grid.point_names)
    ]
    right = 1.0 - _RIGHT / sheet.width
    sheet.figure.legend(
        handles=[*rails, *points],
        loc="center left",
        bbox_to_anchor=(right, 0.5),
        handletextpad=0.2,
    )
