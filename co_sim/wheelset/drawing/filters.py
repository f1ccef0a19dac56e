"""Residuals and probabilities of the filters over time (the paper's Figs. 5 to 7)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from co_sim.wheelset.drawing.sheet import (
    GREY,
    Picture,
    Sheet,
    colour,
    dashes,
    label_lines,
    label_margin,
    thin,
)
from co_sim.wheelset.drawing.timeline import (
    BOTTOM,
    LEFT,
    WIDTH,
    each_stretch,
    mark_rails,
    mark_range,
    rail_name,
    set_time_limits,
    stretches_of,
    title_of,
)
from co_sim.wheelset.prose.words import listed, percent, quantity
from estimator.residuals import equal_level

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from co_sim.wheelset.results import Experiment, Run, Stretch

__all__ = ["draw_probabilities", "draw_residuals"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_RIBBON, _RIBBON_COLUMNS = 0.13, 480
_NOBODY = 0.93  # grey level of a ribbon where no filter is named
_FILLING = "0.95"
#: Room above the lines for words, as a share of the range of the ordinate.
_HEADROOM = 1.12


def draw_residuals(experiment: Experiment, run: Run) -> Picture:
    """Draw the normalised residuals (15) of all filters over time (the paper's Figs. 5 to 7)."""
    names = experiment.filter_names
    level = equal_level(len(names))
    sheet, ax = _filter_sheet(
        experiment,
        run,
        f"{title_of(run)}which filter has the smallest residual?",
        {"true": _expected(experiment, run), "smallest": run.E.argmin(axis=1)},
    )
    _draw_lines(ax, run, run.E, names)
    _draw_level(sheet, ax, level, f"1/√{len(names)} = {level:.3f}: all filters equally good")
    ax.set_ylabel("normalised rms E")
    caption = (
        f"Residuals (15) over a moving window of {quantity(experiment.scenario.identifier.window, 's')}, "
        f"normalised so that their squares sum to one. "
    ) + each_stretch(experiment, run, _residual_words)
    return Picture(sheet, caption + _marks(run), _alt(experiment, "residual"))


def draw_probabilities(experiment: Experiment, run: Run) -> Picture:
    """Draw the fuzzy probabilities of all filters over time."""
    p, names = run.probabilities, experiment.filter_names
    likely = np.where(p.max(axis=1) > 0.5, p.argmax(axis=1), -1)
    sheet, ax = _filter_sheet(
        experiment,
        run,
        f"{title_of(run)}what probability does the fuzzy system give each filter?",
        {"true": _expected(experiment, run), "above ½": likely},
    )
    _draw_lines(ax, run, p, names)
    _draw_level(sheet, ax, 0.5, "½: undecided")
    ax.set_ylabel("fuzzy probability p")
    caption = "Each probability is inferred on its own, so they need not sum to one. "
    caption += each_stretch(experiment, run, _probability_words)
    return Picture(sheet, caption + _marks(run), _alt(experiment, "probability"))


def _filter_sheet(
    experiment: Experiment, run: Run, title: str, ribbons: dict[str, Indices]
) -> tuple[Sheet, Axes]:
    """Return a sheet with axes for one line of each filter, and ribbons above that name filters."""
    width = WIDTH - LEFT - label_margin(experiment.filter_names)
    sheet = Sheet(WIDTH, 3.75, title)
    bottom = sheet.top - 0.22 - _RIBBON
    for name, filters in ribbons.items():
        ribbon = sheet.axes(LEFT, bottom, width, _RIBBON)
        _draw_ribbon(ribbon, name, run, filters)
        bottom -= _RIBBON + 0.05
    for stretch in stretches_of(experiment, run):
        middle = (stretch.since + stretch.until) / 2.0 / max(run.time[-1], 1e-9)
        sheet.figure.text(
            (LEFT + width * middle) / sheet.width,
            (sheet.top - 0.18) / sheet.height,
            rail_name(run, stretch, width),
            ha="center",
            va="bottom",
            size=9.0,
        )
    ax = sheet.axes(LEFT, BOTTOM, width, bottom + _RIBBON - 0.03 - BOTTOM)
    ax.set_ylim(0.0, _HEADROOM)
    ax.set_yticks(np.linspace(0.0, 1.0, 6))
    set_time_limits(ax, run)
    ax.set_xlabel("time (s)")
    _mark_filling(ax, experiment, run)
    mark_range(ax, experiment, run, label=True)
    mark_rails(ax, experiment, run, label=False)
    return sheet, ax


def _draw_ribbon(ax: Axes, name: str, run: Run, filters: Indices) -> None:
    """Draw which filter is named at each time (T,), -1 for none, in the filters' colours."""
    columns = np.linspace(0, len(run.time) - 1, min(_RIBBON_COLUMNS, len(run.time))).astype(int)
    palette = np.array([*(to_rgb(colour(i)) for i in range(max(filters.max() + 1, 1))), (_NOBODY,) * 3])
    ax.imshow(palette[filters[columns]][None], aspect="auto", interpolation="nearest")
    ax.set_axis_off()
    ax.text(-0.01, 0.5, name, transform=ax.transAxes, ha="right", va="center", size=8.5)


def _expected(experiment: Experiment, run: Run) -> Indices:
    """Return the true filter at each time (T,); where there are several, they take turns."""
    filters = np.full(len(run.time), -1)
    turn = np.arange(len(run.time)) * _RIBBON_COLUMNS // (8 * len(run.time))
    for stretch in stretches_of(experiment, run):
        true = [experiment.filter_names.index(name) for name in stretch.expected] or [-1]
        inside = run.time >= stretch.since
        filters[inside] = np.array(true)[turn[inside] % len(true)]
    return filters


def _draw_lines(ax: Axes, run: Run, values: Array, names: Sequence[str]) -> None:
    """Draw one line for each filter, the first ones broader so that they show where lines coincide."""
    for i in range(len(names)):
        width = min(1.4 + 0.5 * (len(names) - 1 - i), 3.0)
        ax.plot(*thin(run.time, values[:, i]), color=colour(i), linewidth=width, linestyle=dashes(i))
    label_lines(ax, names, values[-1], [colour(i) for i in range(len(names))])


def _draw_level(sheet: Sheet, ax: Axes, level: float, meaning: str) -> None:
    """Draw a dashed line, explained beside the abscissa's name."""
    line = ax.axhline(level, color="black", linewidth=1.0, linestyle=(0, (5, 3)), zorder=1.5)
    sheet.figure.legend([line], [meaning], loc="lower right", bbox_to_anchor=(0.995, 0.01), borderaxespad=0.0)


def _mark_filling(ax: Axes, experiment: Experiment, run: Run) -> None:
    """Shade where a window reaches back before its stretch of rail, or before the start."""
    window = experiment.scenario.identifier.window
    for stretch in stretches_of(experiment, run):
        ax.axvspan(stretch.since, stretch.since + window, color=_FILLING, zorder=0)
    ax.text(0.004, 0.985, "first window fills", transform=ax.transAxes, va="top", size=8.0, color=GREY)


def _alt(experiment: Experiment, what: str) -> str:
    return f"Lines over time: {what} of {listed(experiment.filter_names)}; above them the true filter."


def _residual_words(stretch: Stretch) -> str:
    shares = stretch.share_smallest_valid
    if shares is None:
        return "no window within the range of the model"
    best = max(shares, key=lambda name: shares[name])
    text = f"the smallest is {best} in {percent(shares[best])} of the {stretch.valid_windows} valid windows"
    if best in stretch.expected:
        return f"{text}, and it is true"
    true = [f"{name} ({percent(shares[name])})" for name in stretch.expected]
    return f"{text}; true is {listed(true)}" if true else f"{text}; no filter of the bank is true"


def _probability_words(stretch: Stretch) -> str:
    p = stretch.mean_probability_valid
    if p is None:
        return "no window within the range of the model"
    told = [f"{percent(p[name])} for {name}" for name in sorted(p, key=lambda name: -p[name])]
    return f"mean over {stretch.valid_windows} valid windows: {listed(told)}"


def _marks(run: Run) -> str:
    """Say what the grey and the hatched parts of a figure are."""
    text = "Light grey: windows that reach back before the stretch of rail or before the start, not counted."
    if run.valid_until < run.time[-1]:
        text += f" Hatched: after {quantity(run.valid_until, 's')} the model does not hold."
    return text
