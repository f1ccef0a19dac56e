"""What all figures over time share: how stretches of rail and the range of the model are marked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from co_sim.wheelset.drawing.sheet import GREY, shorten
from co_sim.wheelset.prose.findings import place
from co_sim.wheelset.prose.words import capital, quantity

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes

    from co_sim.wheelset.results import Experiment, Run, Stretch

__all__ = [
    "BOTTOM",
    "LEFT",
    "WIDTH",
    "each_stretch",
    "mark_rails",
    "mark_range",
    "rail_name",
    "set_time_limits",
    "stretches_of",
    "title_of",
]

#: Width of the figures and their margins at the left and at the bottom, inches.
WIDTH, LEFT, BOTTOM = 8.2, 0.85, 0.55

_BEYOND: dict[str, Any] = {"facecolor": "0.94", "edgecolor": "0.78", "hatch": "///", "linewidth": 0.0}


def title_of(run: Run) -> str:
    """Return how the title of a figure of this run begins."""
    stopped = f", stopped at {quantity(run.time[-1], 's')}" if run.stopped else ""
    name = f"Run {run.name}" if run.point else run.name.replace("_", " ").capitalize()
    return f"{name}{stopped}: "


def stretches_of(experiment: Experiment, run: Run) -> list[Stretch]:
    """Return the stretches of rail of one run, in order."""
    return [stretch for stretch in experiment.stretches if stretch.run == run.name]


def rail_name(run: Run, stretch: Stretch, width: float) -> str:
    """Return the name of a stretch, as long as it fits on axes of that width (inches)."""
    share = (stretch.until - stretch.since) / max(run.time[-1], 1e-9)
    return shorten(stretch.condition, max(int(share * width / 0.095), 3))


def mark_rails(ax: Axes, experiment: Experiment, run: Run, *, label: bool) -> None:
    """Draw where the rail changes; with `label`, write its condition above the axes."""
    stretches = stretches_of(experiment, run)
    for stretch in stretches:
        if stretch.since > 0.0:
            ax.axvline(stretch.since, color=GREY, linewidth=0.8)
        if label and len(stretches) > 1:
            middle = (stretch.since + stretch.until) / 2.0
            ax.annotate(
                rail_name(run, stretch, WIDTH - LEFT),
                (middle, 1.03),
                xycoords=("data", "axes fraction"),
                ha="center",
                size=9.0,
            )


def set_time_limits(ax: Axes, run: Run) -> None:
    """Let the abscissa span the record, even if it is a single sample."""
    ax.set_xlim(run.time[0], max(run.time[-1], run.time[0] + 1e-9))


def mark_range(ax: Axes, experiment: Experiment, run: Run, *, label: bool) -> None:
    """Hatch what lies after the wheelset left the range of a model without flanges."""
    end = float(run.time[-1])
    if run.valid_until >= end:
        return
    ax.axvspan(run.valid_until, end, zorder=0, **_BEYOND)
    ax.axvline(run.valid_until, color=GREY, linewidth=0.8)
    if not label:
        return
    limit = experiment.scenario.identifier.valid_offset * 1e3
    where = "filters" if experiment.scenario.has_flanges else "model"
    fits = run.valid_until < 0.6 * end
    ax.annotate(
        f"beyond {quantity(limit, 'mm')}: no flange in the {where}",
        ((run.valid_until + end) / 2.0 if fits else run.valid_until, 0.985),
        xytext=(0 if fits else -4, 0),
        textcoords="offset points",
        xycoords=("data", "axes fraction"),
        ha="center" if fits else "right",
        va="top",
        size=8.5,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0},
    )


def each_stretch(experiment: Experiment, run: Run, words: Callable[[Stretch], str]) -> str:
    """Return a sentence for each stretch, which begins with its place if there are several."""
    stretches = stretches_of(experiment, run)
    if len(stretches) == 1:
        return f"{capital(words(stretches[0]))}. "
    return "".join(f"{capital(place(experiment, s))}: {words(s)}. " for s in stretches)
