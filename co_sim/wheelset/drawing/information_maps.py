"""Maps of what can be known: over speed or noise, and over creep, a panel for each rail."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from co_sim.wheelset.drawing.sheet import GREY, Sheet
from co_sim.wheelset.prose.words import number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from co_sim.wheelset.reporting.information import Limits, NoiseLimits

    Array = NDArray[np.float64]

__all__ = ["draw_bounds", "draw_noise", "draw_windows"]

#: From known well (light) to hardly known (dark), readable in grey and by colour-blind readers.
_COLOURS = ("#f7fbff", "#dcebf7", "#b4d3ea", "#7fb4dc", "#4a8fc4", "#1f63a3", "#08366b")
_WINDOWS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
_BOUNDS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
_MARK = "#E69F00"
_LEFT, _BOTTOM, _PANEL, _TALL, _GAP, _HEAD, _RIGHT = 0.78, 0.82, 1.72, 2.2, 0.14, 0.58, 1.5


def draw_windows(limits: Limits, error: float, title: str) -> Sheet:
    """Draw the window that tells each rail from its nearest rival."""
    sheet, panels = _sheet(limits.conditions, 1, title)
    for i, ax in enumerate(panels[0]):
        window = limits.window[i].T
        _map(ax, limits.speeds, limits.shares, window, _WINDOWS, window > limits.T)
        _force_tells(ax, window)
        ax.set_xlabel("speed (m/s)")
    panels[0][0].set_ylabel("creep / creep of the peak")
    _key(sheet, f"window for {number(100.0 * error)} % errors", _WINDOWS, " s", _undecided(limits.T))
    return sheet


def draw_noise(
    limits: NoiseLimits, conditions: Sequence[str], shares: Sequence[float], T: float, title: str
) -> Sheet:
    """Draw the same window over the noise of all sensors at one speed."""
    sheet, panels = _sheet(conditions, 1, title)
    for i, ax in enumerate(panels[0]):
        window = limits.window[i].T
        _map(ax, limits.factors, shares, window, _WINDOWS, window > T)
        _force_tells(ax, window)
        ax.set_xlabel("noise / noise assumed")
    panels[0][0].set_ylabel("creep / creep of the peak")
    _key(sheet, f"window at {limits.speed:g} m/s", _WINDOWS, " s", _undecided(T))
    return sheet


def draw_bounds(limits: Limits, title: str) -> Sheet:
    """Draw the least relative standard deviations of creep and peak adhesion."""
    sheet, panels = _sheet(limits.conditions, 2, title)
    rows = (("creep", limits.creep), ("peak adhesion", limits.adhesion))
    for (name, values), axes in zip(rows, panels, strict=True):
        for i, ax in enumerate(axes):
            known = values[i].T
            _map(ax, limits.speeds, limits.shares, known, _BOUNDS, known > 1.0)
        axes[0].set_ylabel(f"{name}:\ncreep / creep of the peak")
    for ax in panels[1]:
        ax.set_xlabel("speed (m/s)")
        ax.set_title("")
    for ax in panels[0]:
        ax.tick_params(labelbottom=False)
    percent = tuple(100.0 * bound for bound in _BOUNDS)
    _key(
        sheet, f"standard deviation\nin {limits.T:g} s, of the value", percent, " %", "over 100 %:\nnot known"
    )
    return sheet


def _undecided(T: float) -> str:
    return f"no method decides\nin {T:g} s"


def _sheet(conditions: Sequence[str], rows: int, title: str) -> tuple[Sheet, list[list[Axes]]]:
    n, row_gap = len(conditions), 0.16
    width = _LEFT + n * _PANEL + (n - 1) * _GAP + _RIGHT
    sheet = Sheet(max(width, 7.0), _BOTTOM + rows * _TALL + (rows - 1) * row_gap + _HEAD - 0.1, title)
    panels = []
    for row in range(rows):
        bottom = _BOTTOM + (rows - 1 - row) * (_TALL + row_gap) - 0.28
        axes = [sheet.axes(_LEFT + i * (_PANEL + _GAP), bottom, _PANEL, _TALL) for i in range(n)]
        for i, (ax, condition) in enumerate(zip(axes, conditions, strict=True)):
            ax.tick_params(labelleft=i == 0)
            if row == 0:
                ax.set_title(condition.replace("_", " "), size=10.0, loc="left")
        panels.append(axes)
    return sheet, panels


def _map(
    ax: Axes,
    across: Sequence[float],
    up: Sequence[float],
    values: Array,
    bounds: Sequence[float],
    hatched: Array,
) -> None:
    """Draw values (up, across) as cells of equal size."""
    colours = ListedColormap(_COLOURS).with_extremes(bad="0.8")
    norm = BoundaryNorm([0.0, *bounds, np.inf], len(_COLOURS))
    ax.pcolormesh(
        np.ma.masked_invalid(np.minimum(values, 1e9)),
        cmap=colours,
        norm=norm,
        edgecolor="white",
        linewidth=0.4,
    )
    cells = [(j, k) for k, j in zip(*np.nonzero(hatched), strict=True)]
    ax.add_collection(
        LineCollection([line for cell in cells for line in _strokes(*cell)], colors=_MARK, linewidths=0.9)
    )
    ax.set_xticks(np.arange(len(across)) + 0.5, [f"{x:g}" for x in across])
    ax.set_yticks(np.arange(len(up)) + 0.5, [f"{x:g}" for x in up])
    ax.grid(visible=False)
    ax.tick_params(length=0, labelsize=8.5)
    for spine in ax.spines.values():
        spine.set_visible(False)


def _strokes(j: int, k: int) -> list[list[tuple[float, float]]]:
    """Return the strokes across a cell; hatches of matplotlib have one width for all and fade in SVG."""
    return [
        [(j, k + 0.5), (j + 0.5, k + 1.0)],
        [(j, k), (j + 1.0, k + 1.0)],
        [(j + 0.5, k), (j + 1.0, k + 0.5)],
    ]


def _force_tells(ax: Axes, window: Array) -> None:
    for k, j in zip(*np.nonzero(window == 0.0), strict=True):
        ax.plot(j + 0.5, k + 0.5, marker=".", color=GREY, markersize=4.0)


def _key(sheet: Sheet, title: str, bounds: Sequence[float], unit: str, hatched: str) -> None:
    texts = [f"< {number(bounds[0])}{unit}"]
    texts += [f"{number(a)} – {number(b)}{unit}" for a, b in itertools.pairwise(bounds)]
    texts += [f"> {number(bounds[-1])}{unit}"]
    handles = [
        Patch(facecolor=shade, edgecolor="0.7", linewidth=0.4, label=text)
        for shade, text in zip(_COLOURS, texts, strict=True)
    ]
    handles.append(Patch(facecolor=_COLOURS[4], edgecolor=_MARK, hatch="////", linewidth=0.0, label=hatched))
    if "window" in title:
        from matplotlib.lines import Line2D

        dot = Line2D([], [], linestyle="none", marker=".", color=GREY, markersize=4.0)
        dot.set_label("no other rail has\nthis force")
        handles.append(dot)  # type: ignore[arg-type]
    sheet.figure.legend(
        handles=handles,
        title=title,
        loc="center right",
        bbox_to_anchor=(0.995, 0.47),
        fontsize=8.0,
        title_fontsize=8.5,
        alignment="left",
        handlelength=1.3,
    )
