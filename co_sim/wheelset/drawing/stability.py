"""Paths of poles, and stability over creepage and speed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import SymLogNorm, TwoSlopeNorm

from co_sim.wheelset.drawing.sheet import COLOURS, GREY, Sheet, colour, decades
from co_sim.wheelset.prose.words import power_of_ten

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from estimator.stability import StableSpeeds

    Array = NDArray[np.float64]

__all__ = ["draw_critical_speeds", "draw_pole_paths", "draw_stability_map"]

_WIDTH, _LEFT, _BOTTOM, _GAP, _RIGHT = 8.2, 0.75, 0.6, 0.42, 1.15
_PANEL_HEIGHT = 2.2
#: Where the symmetric logarithmic axes of poles are linear, 1/s; growth rates that saturate the colours, 1/s.
_KNEE = 1.0
_FASTEST_GROWTH = 30.0
#: Distance of real eigenvalues of different speeds on the page, 1/s.
_STEP = 0.16
_STYLES: tuple[Literal["-", "--", ":"], ...] = ("-", "--", ":")


def _panels(conditions: Sequence[str], title: str) -> tuple[Sheet, list[Axes]]:
    """Return a sheet with a panel for each condition, two in a row."""
    columns = min(2, len(conditions))
    rows = -(-len(conditions) // columns)
    sheet = Sheet(_WIDTH, 0.55 + rows * (_PANEL_HEIGHT + 0.42) + _BOTTOM - 0.3, title)
    width = (sheet.width - _LEFT - _RIGHT - (columns - 1) * _GAP) / columns
    every = []
    for i, name in enumerate(conditions):
        row, column = divmod(i, columns)
        bottom = _BOTTOM + (rows - 1 - row) * (_PANEL_HEIGHT + 0.42)
        ax = sheet.axes(_LEFT + column * (width + _GAP), bottom, width, _PANEL_HEIGHT)
        ax.set_title(f"{name.replace('_', ' ')} rail", size=9.5, loc="left")
        last = i + columns >= len(conditions)
        ax.tick_params(labelleft=column == 0, labelbottom=last)
        every.append(ax)
    return sheet, every


def _bar(sheet: Sheet, image: object, label: str) -> Axes:
    """Add a scale of colours right of the panels."""
    ax = sheet.axes(sheet.width - _RIGHT + 0.2, _BOTTOM + 0.1, 0.16, min(1.9, sheet.height - 2.3))
    sheet.figure.colorbar(image, cax=ax)  # type: ignore[arg-type]
    ax.set_ylabel(label)
    return ax


def draw_pole_paths(
    conditions: Sequence[str],
    speeds: Sequence[float],
    relative: Array,
    paths: NDArray[np.complex128],
    title: str,
) -> Sheet:
    """Draw eigenvalues (condition, speed, creepage, 4) in the upper half plane, coloured by creepage."""
    sheet, every = _panels(conditions, title)
    norm = TwoSlopeNorm(1.0, 0.0, 2.0)
    for i, ax in enumerate(every):
        for j in range(len(speeds)):
            for path in _sorted(paths[i, j]).T:
                shown = np.where(path.imag >= 0.0, path, np.nan)
                points = np.column_stack([shown.real, np.where(shown.imag > 0.0, shown.imag, -_STEP * j)])
                segments = np.stack([points[:-1], points[1:]], axis=1)
                lines = LineCollection(
                    list(segments), array=relative[1:], cmap="coolwarm", norm=norm, linestyles=_STYLES[j % 3]
                )
                lines.set_linewidth(1.8)
                ax.add_collection(lines)
            ends = paths[i, j, 0]
            ends = ends[ends.imag >= 0.0]
            ax.plot(
                ends.real,
                np.where(ends.imag > 0.0, ends.imag, -_STEP * j),
                linestyle="none",
                marker="o",
                markersize=3.0,
                color=COLOURS[0],
            )
        _pole_axes(ax, paths)
    for ax in every[-2:]:
        ax.set_xlabel("growth rate (1/s)")
    for ax in every[::2]:
        ax.set_ylabel("angular frequency (rad/s)")
    bar = _bar(sheet, lines, "creepage, of that of the peak")
    bar.set_yticks([0.0, 0.5, 1.0, 1.5, 2.0])
    _explain_speeds(sheet, speeds)
    return sheet


def _sorted(path: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the eigenvalues (creepage, 4) so that each column is one that moves little from row to row."""
    ordered = path.copy()
    for k in range(1, len(ordered)):
        rest = list(ordered[k])
        for j, before in enumerate(ordered[k - 1]):
            nearest = int(np.argmin([abs(s - before) for s in rest]))
            ordered[k, j] = rest.pop(nearest)
    return ordered


def _pole_axes(ax: Axes, paths: NDArray[np.complex128]) -> None:
    ax.set_xscale("symlog", linthresh=_KNEE, linscale=0.6)
    ax.set_yscale("symlog", linthresh=_KNEE, linscale=0.4)
    real, imag = paths.real[np.isfinite(paths)], paths.imag[np.isfinite(paths)]
    ax.set_xlim(2.0 * min(real.min(initial=-1.0), -_KNEE), 2.0 * max(real.max(initial=0.0), _KNEE))
    ax.set_ylim(-_STEP * 4.0, 2.0 * max(imag.max(initial=0.0), _KNEE))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(lambda value, _: power_of_ten(value))
    ax.axvline(0.0, color=GREY, linewidth=1.0)


def _explain_speeds(sheet: Sheet, speeds: Sequence[float]) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color=GREY, linestyle=_STYLES[j % 3], label=f"{v:g} m/s") for j, v in enumerate(speeds)
    ]
    start = Line2D([], [], linestyle="none", marker="o", markersize=3.0, color=COLOURS[0], label="start")
    sheet.figure.legend(
        handles=[*lines, start],
        loc="upper left",
        bbox_to_anchor=((sheet.width - _RIGHT + 0.02) / sheet.width, 1.0 - 0.6 / sheet.height),
        handlelength=1.6,
    )


def draw_stability_map(
    conditions: Sequence[str], speeds: Array, relative: Array, growth: Array, title: str
) -> Sheet:
    """Draw growth rates (condition, speed, creepage) as colours, with the line of no growth."""
    sheet, every = _panels(conditions, title)
    norm = SymLogNorm(0.1, vmin=-_FASTEST_GROWTH, vmax=_FASTEST_GROWTH, base=10)
    for i, ax in enumerate(every):
        shown = np.ma.masked_invalid(growth[i])
        image = ax.pcolormesh(
            relative, speeds, shown, cmap="RdBu_r", norm=norm, shading="nearest", rasterized=True
        )
        if (shown < 0.0).any() and (shown > 0.0).any():
            ax.contour(relative, speeds, shown, levels=[0.0], colors="black", linewidths=1.4)
        ax.grid(visible=False)
        ax.set_xlim(0.0, 2.0)
    for ax in every[-2:]:
        ax.set_xlabel("creepage, of that of the peak")
    for ax in every[::2]:
        ax.set_ylabel("speed (m/s)")
    bar = _bar(sheet, image, "growth rate (1/s)")
    ticks = [-10.0, -1.0, -0.1, 0.0, 0.1, 1.0, 10.0]
    bar.set_yticks(ticks, [power_of_ten(x) if x else "0" for x in ticks])
    bar.minorticks_off()
    return sheet


def draw_critical_speeds(
    conditions: Sequence[str], creepages: Array, limits: Sequence[Sequence[StableSpeeds]], title: str
) -> Sheet:
    """Draw the critical speed over creepage; nothing where it is zero or beyond the search."""
    sheet = Sheet(_WIDTH, 3.4, title)
    ax = sheet.axes(_LEFT, 0.55, sheet.width - _LEFT - _RIGHT - 0.1, sheet.top - 0.65)
    for i, (name, row) in enumerate(zip(conditions, limits, strict=True)):
        values = np.array([s.critical for s in row])
        shown = np.where(np.isfinite(values) & (values > 0.0), values, np.nan)
        ax.plot(
            100.0 * creepages,
            shown,
            color=colour(i),
            marker="o",
            markersize=3.0,
            label=name.replace("_", " "),
        )
    decades(ax, "x")
    ax.set_xlim(100.0 * creepages[0], 100.0 * creepages[-1])
    highest = limits[0][0].searched[1]
    ax.set_ylim(0.0, 1.05 * highest)
    ax.axhline(highest, color=GREY, linestyle="--", linewidth=1.0)
    ax.annotate("fastest speed looked at", (0.01, highest), xycoords=("axes fraction", "data"), va="bottom",
                color=GREY, size=9.0)  # fmt: skip
    ax.set_xlabel("creepage (%)")
    ax.set_ylabel("critical speed (m/s)")
    ax.legend(title="rail", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return sheet
