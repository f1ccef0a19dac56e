"""The creep curve with the operating points on it (the paper's Fig. 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from co_sim.wheelset.drawing.sheet import GREY, Picture, Sheet, colour, label_lines, label_margin, shorten
from co_sim.wheelset.prose.words import listed, number, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from co_sim.wheelset.results import Experiment
    from estimator import CreepCurve

__all__ = ["draw_creep_curve"]

_INK = "0.25"
_FULL_SLIP = 1.0
_MARKERS = "os^DvP"  # one less than there are colours, so that pairs repeat late
#: Number of filters up to which the legend has room inside the axes.
_SPACIOUS = 6
_REGIONS = (("linear", "#E4F0F8"), ("nonlinear", "#FBF3DC"), ("unstable", "#FAE6DD"))


def draw_creep_curve(experiment: Experiment) -> Picture:
    """Draw adhesion over creep for the rail conditions, with the hypotheses of the filters and the runs."""
    curves = experiment.curves
    names = list(curves) if len(curves) > 1 else []
    below = _legend_height(experiment)
    sheet = Sheet(8.2, 4.1 + below, "Where on the creep curve do the filters and the runs stand?")
    margin = label_margin(names) if names else 0.4
    ax = sheet.axes(0.85, 0.55 + below, sheet.width - 0.85 - margin, sheet.top - 0.65 - below)
    ax.set_xlabel("longitudinal creep (%)")
    ax.set_ylabel("adhesion F/N")
    greatest = _greatest_creep(experiment)
    ax.set_ylim(0.0, 1.15 * max(_adhesion(curve, _peak_creep(curve)) for curve in curves.values()))
    if names:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(lambda creep, _: number(creep))
        ax.set_xlim(25.0 * min(design.point.creep for design in experiment.filters), 100.0 * greatest)
        label_lines(ax, names, [_adhesion(c, greatest) for c in curves.values()], [_INK] * len(names))
    else:
        ax.set_xlim(0.0, 100.0 * greatest)
        _shade_regions(ax, next(iter(curves.values())), greatest)
    for curve in curves.values():
        _draw_curve(ax, curve, greatest)
    _mark_points(ax, experiment)
    _explain_points(sheet, ax, experiment)
    return Picture(sheet, _caption(experiment), _alt(experiment))


def _greatest_creep(experiment: Experiment) -> float:
    creeps = [design.point.creep for design in experiment.filters]
    creeps += [2.0 * _peak_creep(curve) for curve in experiment.curves.values()]
    return 1.15 * max(creeps)


def _peak_creep(curve: CreepCurve) -> float:
    """Return the creep of the greatest force, full slip where the force only grows."""
    try:
        return curve.peak_creep
    except ValueError:
        return _FULL_SLIP


def _adhesion(curve: CreepCurve, creep: float) -> float:
    return float(curve.force(creep)) / curve.N


def _linear_limit(curve: CreepCurve) -> float:
    """Return the creep at which the tangent has fallen to half its initial value."""
    return float(
        brentq(lambda creep: float(curve.tangent(creep)) - 0.5 * curve.initial_slope, 0.0, _peak_creep(curve))
    )


def _shade_regions(ax: Axes, curve: CreepCurve, greatest: float) -> None:
    limits = (0.0, _linear_limit(curve), _peak_creep(curve), greatest)
    for (name, shade), low, high in zip(_REGIONS, limits, limits[1:], strict=False):
        ax.axvspan(100.0 * low, 100.0 * high, color=shade, linewidth=0.0, zorder=0)
        upright = high - low > 0.12 * greatest
        ax.annotate(
            name,
            (50.0 * (low + high), 0.98),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="top",
            size=9.0,
            color=GREY,
            rotation=0 if upright else 90,
        )


def _draw_curve(ax: Axes, curve: CreepCurve, greatest: float) -> None:
    """Draw a curve, dashed past its maximum."""
    peak = _peak_creep(curve)
    stable = np.append(0.0, np.geomspace(1e-4 * peak, peak, 250))
    unstable = np.geomspace(peak, greatest, 80)
    for creep, style in ((stable, "-"), (unstable, "--")):
        ax.plot(100.0 * creep, curve.force(creep) / curve.N, color=_INK, linestyle=style, zorder=2)


def _legend_height(experiment: Experiment) -> float:
    """Return the room (inches) that the legend takes below the axes, where it is too long for them."""
    rows = (len(experiment.filters) + 2) // 2
    return 0.0 if len(experiment.filters) <= _SPACIOUS else 0.19 * rows + 0.1


def _explain_points(sheet: Sheet, ax: Axes, experiment: Experiment) -> None:
    """Put the legend where the curves leave room: low at the right, or on a log axis high at the left."""
    if len(experiment.filters) > _SPACIOUS:
        handles, labels = ax.get_legend_handles_labels()
        sheet.figure.legend(handles, labels, loc="lower center", ncols=2, fontsize=8.5, borderaxespad=0.3)
        return
    ax.legend(
        loc="lower right" if len(experiment.curves) == 1 else "upper left",
        handlelength=2.0,
        frameon=True,
        framealpha=0.9,
        edgecolor="0.9",
    )


def _mark_points(ax: Axes, experiment: Experiment) -> None:
    load = {name: curve.N for name, curve in experiment.curves.items()}
    for i, design in enumerate(experiment.filters):
        point = design.point
        ax.plot(
            100.0 * point.creep,
            point.force / load[design.condition],
            linestyle="none",
            marker=_MARKERS[i % len(_MARKERS)],
            markersize=max(11.0 - 1.2 * i, 5.0),
            color=colour(i),
            markeredgecolor="white",
            markeredgewidth=0.8,
            zorder=4 + i,
            label=f"{shorten(design.name)}: creep {quantity(100.0 * point.creep, '%')}, "
            f"F/N {number(point.force / load[design.condition])}",
        )
    points = [run.point for run in experiment.runs if run.point is not None]
    if points:
        N = load[experiment.scenario.rail[0].sides[0]]
        ax.plot(
            [100.0 * point.creep for point in points],
            [point.force / N for point in points],
            linestyle="none",
            marker="o",
            markersize=17.0,
            markerfacecolor="none",
            markeredgecolor=_INK,
            zorder=3,
            label=f"{'runs' if len(points) > 1 else 'run'} {listed([point.name for point in points])}",
        )
        for point in points:
            ax.annotate(
                point.name,
                (100.0 * point.creep, point.force / N),
                xytext=(11, -15),
                textcoords="offset points",
                weight="bold",
            )


def _caption(experiment: Experiment) -> str:
    v = experiment.scenario.drive.speed
    peaks = [f"{name} {_maximum(curve)}" for name, curve in experiment.curves.items()]
    text = (
        f"Longitudinal creep force of one wheel over its load at {quantity(v, 'm/s')}. "
        f"Maxima: {listed(peaks)}. "
    )
    if len(experiment.curves) == 1:
        (curve,) = experiment.curves.values()
        text += (
            f"Linear: the tangent is above half its initial value (creep up to "
            f"{quantity(100.0 * _linear_limit(curve), '%')}). Unstable: past the maximum, where the tangent "
            f"is negative."
        )
    else:
        text += "Dashed past the maximum, where the tangent is negative. The creep axis is logarithmic."
    return text


def _maximum(curve: CreepCurve) -> str:
    creep = _peak_creep(curve)
    if creep == _FULL_SLIP:
        return "none below full slip"
    return f"{number(_adhesion(curve, creep))} at {quantity(100.0 * creep, '%')} creep"


def _alt(experiment: Experiment) -> str:
    points = [
        f"{design.name} at {number(100.0 * design.point.creep)} % creep" for design in experiment.filters
    ]
    return f"Creep curves of {listed(list(experiment.curves))} rail with points: {listed(points)}."
