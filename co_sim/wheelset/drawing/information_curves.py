"""Errors for pairs of rails: over the window, on the plant, over sets and properties of sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D

from co_sim.wheelset.drawing.sheet import GREY, Sheet, colour, decades

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from co_sim.wheelset.reporting.confirmation import Confirmation
    from co_sim.wheelset.reporting.pairs import Design
    from estimator.identifiability import ErrorProbability

    Array = NDArray[np.float64]

__all__ = ["draw_confirmation", "draw_design", "draw_errors", "draw_ranking"]

_LEAST = 1e-4
_AXES = {"noise": "noise / noise assumed", "bandwidth": "bandwidth (Hz)", "sample_rate": "sample rate (Hz)"}


def draw_errors(
    names: Sequence[str], windows: Array, errors: ErrorProbability, wanted: float, title: str
) -> Sheet:
    """Draw the least errors (pair, window): the estimate as a line within its bounds."""
    sheet = Sheet(8.2, 3.5, title)
    ax = sheet.axes(0.85, 0.55, 4.9, sheet.height - 1.1)
    for i in range(len(names)):
        ax.fill_between(
            windows,
            np.maximum(errors.lower[i], _LEAST / 10.0),
            np.maximum(errors.upper[i], _LEAST / 10.0),
            color=colour(i),
            alpha=0.16,
            linewidth=0.0,
        )
        ax.plot(windows, np.maximum(errors.estimate[i], _LEAST / 10.0), color=colour(i))
    ax.axhline(wanted, color=GREY, linestyle="--", linewidth=1.0)
    ax.axhline(0.5, color=GREY, linewidth=0.8)
    ax.annotate("guessing", (windows[0], 0.5), va="bottom", color=GREY, size=8.5)
    decades(ax, "x")
    decades(ax, "y")
    ax.set_xlim(windows[0], windows[-1])
    ax.set_ylim(_LEAST, 0.9)
    ax.set_xlabel("window (s)")
    ax.set_ylabel("least error probability")
    _names(sheet, names)
    return sheet


def _names(sheet: Sheet, names: Sequence[str]) -> None:
    handles = [Line2D([], [], color=colour(i), label=name) for i, name in enumerate(names)]
    sheet.figure.legend(
        handles=handles, loc="center left", bbox_to_anchor=(5.85 / sheet.width, 0.5), fontsize=8.5
    )


def draw_confirmation(confirmations: Sequence[Confirmation], title: str) -> Sheet:
    """Draw what is possible and what was counted on the plant, a row for each pair."""
    n = len(confirmations)
    sheet = Sheet(7.4, 1.5 + 0.42 * n, title)
    ax = sheet.axes(2.0, 0.55, 5.1, sheet.height - 1.42)
    for i, one in enumerate(confirmations):
        row = n - 1 - i
        low, high = max(one.lower, _LEAST), max(one.upper, _LEAST)
        ax.plot(
            [low, high], [row + 0.14] * 2, color=colour(0), linewidth=5.0, alpha=0.3, solid_capstyle="butt"
        )
        ax.plot(max(one.estimate, _LEAST), row + 0.14, marker="|", markersize=10, color=colour(0))
        ax.plot([max(one.low, _LEAST), one.high], [row - 0.14] * 2, color=colour(1), linewidth=1.4)
        ax.plot(max(one.share, _LEAST), row - 0.14, marker="o", markersize=5, color=colour(1), clip_on=False)
    ax.set_yticks(range(n), [one.pair.name for one in confirmations[::-1]])
    ax.set_ylim(-0.6, n - 0.4)
    decades(ax, "x")
    ax.set_xlim(_LEAST, 1.0)
    ax.axvline(0.5, color=GREY, linewidth=0.8)
    ax.set_xlabel("error probability (at the left edge: that or less)")
    ax.grid(visible=False, axis="y")
    ax.tick_params(axis="y", length=0)
    handles = [
        Line2D([], [], color=colour(0), linewidth=5.0, alpha=0.3, label="possible: bounds"),
        Line2D([], [], color=colour(0), marker="|", linestyle="none", markersize=10, label="estimate"),
        Line2D([], [], color=colour(1), marker="o", markersize=5, label="counted on the plant, and 95 %"),
    ]
    sheet.figure.legend(
        handles=handles,
        loc="upper left",
        ncols=3,
        bbox_to_anchor=(1.9 / sheet.width, 1.0 - 0.4 / sheet.height),
        fontsize=8.5,
    )
    return sheet


def draw_ranking(sets: Sequence[str], names: Sequence[str], rates: Array, title: str) -> Sheet:
    """Draw the Chernoff rates (set, pair) over those of the best set, the sets that tell most on top."""
    share = rates / np.max(rates, axis=0)
    order = np.argsort(np.mean(np.log(share), axis=1))
    sheet = Sheet(9.4, 1.25 + 0.4 * len(sets), title)
    ax = sheet.axes(2.85, 0.55, 3.7, sheet.height - 1.1)
    spread = np.linspace(0.2, -0.2, len(names)) if len(names) > 1 else np.zeros(1)
    for row, k in enumerate(order):
        for i in range(len(names)):
            ax.plot(share[k, i], row + spread[i], marker="o", color=colour(i), markersize=4.5, clip_on=False)
    ax.set_yticks(range(len(sets)), [sets[k].replace("_", " ").replace("+", " + ") for k in order])
    ax.set_ylim(-0.5, len(sets) - 0.5)
    decades(ax, "x")
    ax.set_xlim(min(0.5 * float(np.min(share)), 0.1), 1.15)
    ax.set_xlabel("information per second / that of the best set")
    ax.tick_params(axis="y", length=0)
    handles = [
        Line2D([], [], color=colour(i), marker="o", linestyle="none", markersize=4.5, label=name)
        for i, name in enumerate(names)
    ]
    sheet.figure.legend(
        handles=handles, loc="center left", bbox_to_anchor=(6.65 / sheet.width, 0.5), fontsize=8.5
    )
    return sheet


def draw_design(names: Sequence[str], designs: Mapping[str, Design], wanted: float, title: str) -> Sheet:
    """Draw the least error over each property of the sensors, a panel for each property."""
    sheet = Sheet(10.1, 3.3, title)
    for k, (key, design) in enumerate(designs.items()):
        ax = sheet.axes(0.85 + k * 2.35, 0.55, 2.12, sheet.height - 1.1)
        _panel(ax, design, wanted)
        ax.set_xlabel(_AXES[key])
        ax.tick_params(labelleft=k == 0)
        if k == 0:
            ax.set_ylabel("least error probability")
            ax.annotate(
                "wanted",
                (0.03, wanted),
                xycoords=("axes fraction", "data"),
                va="bottom",
                color=GREY,
                size=8.5,
            )
    handles = [Line2D([], [], color=colour(i), label=name) for i, name in enumerate(names)]
    handles.append(Line2D([], [], color="black", marker="o", linestyle="none", markersize=4.5, label="limit"))
    sheet.figure.legend(
        handles=handles, loc="center left", bbox_to_anchor=(7.9 / sheet.width, 0.5), fontsize=8.0
    )
    return sheet


def _panel(ax: Axes, design: Design, wanted: float) -> None:
    for i, error in enumerate(design.error):
        ax.plot(design.values, np.maximum(error, _LEAST / 10.0), color=colour(i))
        if design.values[0] < design.limit[i] < design.values[-1]:
            ax.plot(design.limit[i], wanted, marker="o", color=colour(i), markersize=4.5)
    ax.axhline(wanted, color=GREY, linestyle="--", linewidth=1.0)
    decades(ax, "x")
    decades(ax, "y")
    ax.set_xlim(design.values[0], design.values[-1])
    ax.set_ylim(_LEAST, 0.9)
