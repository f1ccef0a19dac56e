"""The creep curve with the operating points on it (the paper's Fig. 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from co_sim.wheelset.drawing.sheet import GREY, Picture, Sheet, colour, shorten
from co_sim.wheelset.prose.words import listed, number, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from co_sim.wheelset.results import Experiment
    from estimator import CreepCurve

__all__ = ["draw_creep_curve"]

_MARKERS = "os^DvPX"
_REGIONS = (("linear", "#E4F0F8"), ("nonlinear", "#FBF3DC"), ("unstable", "#FAE6DD"))


def draw_creep_curve(experiment: Experiment) -> Picture:
    """Draw adhesion over creep for the rail conditions, with the hypotheses of the filters and the runs."""
    sheet = Sheet(8.2, 4.1, "Where on the creep curve do the filters and the runs stand?")
    ax = sheet.axes(0.85, 0.55, 6.95, sheet.top - 0.65)
    ax.set_xlabel("longitudinal creep (%)")
    ax.set_ylabel("adhesion F/N")
    one = len(experiment.curves) == 1
    greatest = _greatest_creep(experiment)
    if one:
        (curve,) = experiment.curves.values()
        _shade_regions(ax, curve, greatest)
        ax.set_xlim(0.0, 100.0 * greatest)
        ax.set_ylim(0.0, 1.18 * curve.peak_adhesion)
    else:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(lambda creep, _: number(creep))
        least = min(design.point.creep for design in experiment.filters) / 4.0
        ax.set_xlim(100.0 * least, 100.0 * greatest * 2.2)
        ax.set_ylim(0.0, 1.1 * max(curve.peak_adhesion for curve in experiment.curves.values()))
    for name, curve in experiment.curves.items():
        _draw_curve(ax, name if not one else "", curve, greatest)
    _mark_points(ax, experiment)
    ax.legend(
        loc="lower right" if one else "upper left",
        handlelength=2.0,
        frameon=True,
        framealpha=0.9,
        edgecolor="0.9",
    )
    return Picture(sheet, _caption(experiment), _alt(experiment))


def _greatest_creep(experiment: Experiment) -> float:
    creeps = [design.point.creep for design in experiment.filters]
    creeps += [2.0 * curve.peak_creep for curve in experiment.curves.values()]
    return 1.15 * max(creeps)


def _linear_limit(curve: CreepCurve) -> float:
    """Return the creep at which the tangent has fallen to half its initial value."""
    return float(
        brentq(lambda creep: float(curve.tangent(creep)) - 0.5 * curve.initial_slope, 0.0, curve.peak_creep)
    )


def _shade_regions(ax: Axes, curve: CreepCurve, greatest: float) -> None:
    limits = (0.0, _linear_limit(curve), curve.peak_creep, greatest)
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


def _draw_curve(ax: Axes, name: str, curve: CreepCurve, greatest: float) -> None:
    """Draw a curve, dashed past its maximum."""
    stable = np.append(0.0, np.geomspace(1e-3 * curve.peak_creep, curve.peak_creep, 200))
    unstable = np.geomspace(curve.peak_creep, greatest, 80)
    for creep, style in ((stable, "-"), (unstable, "--")):
        ax.plot(100.0 * creep, curve.force(creep) / curve.N, color="0.25", linestyle=style, zorder=2)
    if name:
        ax.annotate(
            shorten(name),
            (100.0 * greatest, float(curve.force(greatest)) / curve.N),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
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
            label=f"{shorten(design.name)}: creep {number(100.0 * point.creep)} %, "
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
            markeredgecolor="0.25",
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
    peaks = [
        f"{name} {number(curve.peak_adhesion)} at {quantity(100.0 * curve.peak_creep, '%')}"
        for name, curve in experiment.curves.items()
    ]
    text = (
        f"Longitudinal creep force of one wheel over its load at {quantity(v, 'm/s')}. "
        f"Maxima: {listed(peaks)} creep. "
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


def _alt(experiment: Experiment) -> str:
    points = [
        f"{design.name} at {number(100.0 * design.point.creep)} % creep" for design in experiment.filters
    ]
    return f"Creep curves of {listed(list(experiment.curves))} rail with points: {listed(points)}."
