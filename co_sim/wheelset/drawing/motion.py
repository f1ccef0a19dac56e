"""The motion of the wheelset and what the sensors saw of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from co_sim.wheelset.drawing.sheet import COLOURS, GREY, Picture, Sheet, envelope, thin
from co_sim.wheelset.drawing.timeline import (
    BOTTOM,
    LEFT,
    WIDTH,
    each_stretch,
    mark_rails,
    mark_range,
    set_time_limits,
    stretches_of,
    title_of,
)
from co_sim.wheelset.prose.words import listed, number, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from co_sim.wheelset.results import Experiment, Run, Stretch

__all__ = ["draw_motion"]

Array = NDArray[np.float64]

_PITCH, _HEIGHT = 1.55, 1.3
_MEASURED = "#B9CFE0"
_RANGE: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.0, "linestyle": "--"}


def draw_motion(experiment: Experiment, run: Run) -> Picture:
    """Draw where the wheelset was and what the sensors saw of it; driven by a torque also the adhesion."""
    panels = [_draw_offset, _draw_yaw_rate, _draw_acceleration]
    if experiment.scenario.drive.mode == "torque_driven":
        panels.append(_draw_adhesion)
    several = len(stretches_of(experiment, run)) > 1
    sheet = Sheet(
        WIDTH,
        BOTTOM + _PITCH * len(panels) + (0.65 if several else 0.45),
        f"{title_of(run)}how did the wheelset move, and what did the sensors see of it?",
    )
    limit = quantity(experiment.scenario.identifier.valid_offset * 1e3, "mm")
    sheet.figure.legend(
        [Line2D([], [], color=COLOURS[0]), Patch(color=_MEASURED), Line2D([], [], **_RANGE)],
        ["true", "measured", f"range of the model, ±{limit}"],
        loc="upper left",
        bbox_to_anchor=(LEFT / sheet.width - 0.01, (sheet.top + 0.08) / sheet.height),
        ncols=3,
        borderaxespad=0.0,
    )
    for i, panel in enumerate(panels):
        bottom = BOTTOM + _PITCH * (len(panels) - 1 - i)
        ax = sheet.axes(LEFT, bottom, WIDTH - LEFT - 0.25, _HEIGHT)
        panel(ax, experiment, run)
        mark_range(ax, experiment, run, label=i == 0)
        mark_rails(ax, experiment, run, label=i == 0)
        set_time_limits(ax, run)
        ax.tick_params(labelbottom=i == len(panels) - 1)
    ax.set_xlabel("time (s)")
    sheet.figure.align_ylabels()
    greatest = float(np.max(np.abs(run.signals["plant.relative_displacement"]))) * 1e3
    caption = (
        f"Displacement against the track, yaw rate and lateral acceleration; the measured signals are drawn "
        f"as the range of their samples. The greatest displacement is {quantity(greatest, 'mm', 2)}. "
        + each_stretch(experiment, run, _signal_words)
    )
    return Picture(sheet, caption, "Stacked line plots of the motion and its measurements against time.")


def _draw_offset(ax: Axes, experiment: Experiment, run: Run) -> None:
    limit = experiment.scenario.identifier.valid_offset * 1e3
    offset = run.signals["plant.relative_displacement"] * 1e3
    ax.plot(*thin(run.time, offset), color=COLOURS[0], linewidth=1.2)
    ax.set_ylabel("y − y_t (mm)")
    reach = _scale(run, offset)
    if 4.0 * reach < limit:
        note = f"the range of the model, ±{quantity(limit, 'mm')}, ends outside this axis"
        ax.annotate(note, (0.005, 0.03), xycoords="axes fraction", size=8.0, color=GREY)
    else:
        reach = max(reach, limit)
        for sign in (-1.0, 1.0):
            ax.axhline(sign * limit, **_RANGE)
    _limit(ax, 1.2 * reach, offset, "mm")


def _draw_yaw_rate(ax: Axes, experiment: Experiment, run: Run) -> None:
    _draw_measured(ax, run, "yaw_rate", 1e3, "mrad/s")
    ax.set_ylabel("yaw rate (mrad/s)")


def _draw_acceleration(ax: Axes, experiment: Experiment, run: Run) -> None:
    _draw_measured(ax, run, "lateral_acceleration", 1.0, "m/s²")
    ax.set_ylabel("lateral acc. (m/s²)")


def _draw_measured(ax: Axes, run: Run, name: str, factor: float, unit: str) -> None:
    true, measured = run.signals[f"plant.{name}"] * factor, run.signals[f"sensors.{name}"] * factor
    ax.fill_between(*envelope(run.time, measured), color=_MEASURED, linewidth=0.3)
    ax.plot(*thin(run.time, true), color=COLOURS[0], linewidth=1.0)
    _limit(ax, _scale(run, measured), measured, unit)


def _draw_adhesion(ax: Axes, experiment: Experiment, run: Run) -> None:
    used = np.abs(run.signals["plant.adhesion_used"])
    left, right = (run.signals[f"plant.{side}.adhesion_peak"] for side in ("left", "right"))
    ax.plot(*thin(run.time, used), color=COLOURS[0], linewidth=1.2, label="used, both wheels")
    ax.plot(*thin(run.time, left), color=COLOURS[1], linewidth=1.2, label="available, left")
    ax.plot(*thin(run.time, right), color=COLOURS[1], linewidth=1.2, linestyle=":", label="available, right")
    ax.set_ylim(0.0, 1.35 * max(float(np.max(left)), float(np.max(right)), float(np.max(used)), 1e-6))
    ax.set_ylabel("adhesion F/N")
    ax.legend(loc="upper right", ncols=3, borderaxespad=0.1, fontsize=8.5)


def _scale(run: Run, values: Array) -> float:
    """Return the greatest magnitude within the range of the model."""
    valid = values[run.time <= run.valid_until]
    return float(np.max(np.abs(valid), initial=1e-9))


def _limit(ax: Axes, reach: float, values: Array, unit: str) -> None:
    """Scale the ordinate to `reach`; say so if values lie outside."""
    ax.set_ylim(-1.3 * reach, 1.3 * reach)
    greatest = float(np.max(np.abs(values)))
    if greatest > 1.3 * reach:
        ax.annotate(
            f"up to {quantity(greatest, unit, 2)}, outside this axis",
            (0.995, 0.04),
            xycoords="axes fraction",
            ha="right",
            size=8.0,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0},
        )


def _signal_words(stretch: Stretch) -> str:
    ratios = stretch.signal_to_noise
    if ratios is None:
        return "no window within the range of the model"
    told = [f"{number(ratio, 2)} at the {sensor}" for sensor, ratio in ratios.items()]
    return f"true signal over noise (rms) {listed(told)}"
