"""The figures of an identified log: what was recorded, what the bank says, what is wrong with the sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np

from co_sim.wheelset.drawing.sheet import COLOURS, GREY, STYLE, Picture, Sheet, envelope, thin
from co_sim.wheelset.figures import Drawing
from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS
from co_sim.wheelset.prose.words import percent
from estimator.advice import LEVELS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.results import Identified

    Array = NDArray[np.float64]

__all__ = ["draw"]

_WIDTH, _LEFT, _RIGHT, _BOTTOM = 8.2, 0.95, 1.5, 0.55
_BINS = 500
_BAD = "#B3261E"
_REGION_COLOURS = {"linear": COLOURS[2], "peak": COLOURS[4], "unstable": COLOURS[1]}
_CONDITION_COLOURS = {"dry": COLOURS[2], "wet": COLOURS[0], "low": COLOURS[4], "very_low": COLOURS[1]}
_UNTRUSTED: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.35", "hatch": "///", "linewidth": 0.0}


def draw(done: Identified, folder: Path) -> list[Drawing]:
    """Draw all figures into `folder`, which must exist, and return them in reading order."""
    drawings = []
    with mpl.rc_context(STYLE):
        for key, picture in _pictures(done):
            file = folder / f"{key}.png"
            picture.sheet.save(file)
            drawings.append(Drawing(key, file, picture.sheet.title, picture.caption, picture.alt))
    return drawings


def _pictures(done: Identified) -> Iterator[tuple[str, Picture]]:
    yield "regions", _regions(done)
    if done.answer.p_condition is not None:
        yield "conditions", _conditions(done)
    if done.answer.mu_max is not None:
        yield "adhesion", _adhesion(done)
    yield "advice", _advice(done)
    yield "log", _log(done)
    if done.status.found():
        yield "sensor_status", _status(done)


def _axes(
    sheet: Sheet, done: Identified, bottom: float, height: float, *, last: bool, left: float = _LEFT
) -> Axes:
    """Add axes over the time of the log."""
    ax = sheet.axes(left, bottom, _WIDTH - left - _RIGHT, height)
    ax.set_xlim(done.log.time[0], done.log.time[-1])
    ax.tick_params(labelbottom=last)
    if last:
        since = f" since {done.clock.offset:.15g} s" if done.clock.offset else ""
        ax.set_xlabel(f"time{since} (s)")
    return ax


def _binned(time: Array, table: Array) -> tuple[Array, Array]:
    """Return the edges (b + 1,) of at most `_BINS` bins and the means (b, columns) of the rows in each."""
    starts = np.arange(0, len(time), -(-len(time) // _BINS))
    counts = np.diff([*starts, len(time)])
    step = time[1] - time[0] if len(time) > 1 else 1.0
    edges = np.concatenate([time[starts] - step, time[-1:]])
    return edges, np.add.reduceat(table, starts, axis=0) / counts[:, None]


def _stack(done: Identified, title: str, p: Array, colours: dict[str, str], caption: str) -> Picture:
    """Draw probabilities as stacked areas, hatched where they are not to be trusted."""
    sheet = Sheet(_WIDTH, 3.1, title)
    ax = _axes(sheet, done, _BOTTOM, 2.0, last=True)
    edges, means = _binned(done.answer.time, p)
    tops = np.cumsum(means, axis=1)
    lower = np.zeros(len(means))
    for i, (name, shade) in enumerate(colours.items()):
        ax.stairs(tops[:, i], edges, baseline=lower, fill=True, color=shade, label=name.replace("_", " "))
        lower = tops[:, i]
    _hatch(ax, done, 1.0)
    ax.set_ylim(0.0, 1.0)
    ax.set_ylabel("probability")
    _legend(ax)
    return Picture(sheet, caption, caption)


def _hatch(ax: Axes, done: Identified, top: float) -> None:
    edges, trusted = _binned(done.answer.time, done.answer.identifiable[:, None].astype(np.float64))
    starts, ends = _stretches(trusted[:, 0] < 0.5)
    for i, (a, b) in enumerate(zip(starts, ends, strict=True)):
        label = "not identifiable" if i == 0 else None
        ax.axvspan(edges[a], edges[b], 0.0, top, label=label, **_UNTRUSTED)


def _stretches(where: NDArray[np.bool_]) -> tuple[list[int], list[int]]:
    """Return the first places of the stretches that hold, and those after their last."""
    change = np.diff(where.astype(np.int8), prepend=0, append=0)
    return np.flatnonzero(change == 1).tolist(), np.flatnonzero(change == -1).tolist()


def _legend(ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.01, 0.5), handlelength=1.4)


def _regions(done: Identified) -> Picture:
    shares = done.region_shares
    said = ", ".join(f"{name} in {percent(share)}" for name, share in (shares or {}).items() if share > 0.0)
    caption = (
        f"Probability of each region of the creep curve. Most probable among the identifiable rows: {said}."
        if said
        else "Probability of each region of the creep curve. No row is identifiable."
    )
    colours = {name: _REGION_COLOURS[name] for name in REGIONS}
    return _stack(done, "In which region of the creep curve?", done.answer.p_region, colours, caption)


def _conditions(done: Identified) -> Picture:
    said = ", ".join(
        f"{name.replace('_', ' ')} in {percent(share)}"
        for name, share in (done.condition_shares or {}).items()
        if share > 0.0
    )
    caption = "Probability of each condition of the rail."
    caption += f" Most probable among the identifiable rows: {said}." if said else " No row is identifiable."
    p = done.answer.p_condition
    colours = {name: _CONDITION_COLOURS[name] for name in CONDITION_NAMES}
    return _stack(done, "On which rail?", np.asarray(p), colours, caption)


def _adhesion(done: Identified) -> Picture:
    answer = done.answer
    table = np.column_stack(
        [np.asarray(x) for x in (answer.mu_used, answer.mu_max, answer.mu_max_low, answer.mu_max_high)]
    )
    table[:, 0] = np.abs(table[:, 0])
    edges, means = _binned(answer.time, table)
    sheet = Sheet(_WIDTH, 3.3, "How much adhesion is used, and how much is there?")
    ax = _axes(sheet, done, _BOTTOM, 2.2, last=True)
    ax.stairs(
        means[:, 3],
        edges,
        baseline=means[:, 2],
        fill=True,
        color=COLOURS[0],
        alpha=0.25,
        label="its interval",
    )
    ax.stairs(means[:, 1], edges, baseline=None, color=COLOURS[0], linewidth=1.4, label="available")
    ax.stairs(means[:, 0], edges, baseline=None, color=COLOURS[1], linewidth=1.4, label="used")
    ax.set_ylim(0.0, 1.08 * float(np.nanmax(means, initial=1e-3)))
    _hatch(ax, done, 1.0)
    ax.set_ylabel("adhesion (1)")
    _legend(ax)
    caption = (
        "Used adhesion and estimated available adhesion with its interval; hatched where not to be trusted."
    )
    return Picture(sheet, caption, caption)


def _advice(done: Identified) -> Picture:
    sheet = Sheet(_WIDTH, 2.7, "What to do with the torque?")
    ax = _axes(sheet, done, _BOTTOM, 1.6, last=True)
    bounds = [-1.0, *list(LEVELS.values())[1:], 1.0]
    for i, (name, shade) in enumerate(zip(LEVELS, (_BAD, COLOURS[1], GREY, COLOURS[2]), strict=True)):
        ax.axhspan(bounds[i], bounds[i + 1], color=shade, alpha=0.13, linewidth=0.0)
        middle = (bounds[i] + bounds[i + 1]) / 2.0
        ax.annotate(name, (1.01, middle), xycoords=("axes fraction", "data"), va="center", size=8.5)
    t, low, high = envelope(done.answer.time, done.advice.score, _BINS)
    ax.fill_between(t, low, high, color=COLOURS[0], alpha=0.35, linewidth=0.0)
    ax.plot(t, high, color=COLOURS[0], linewidth=1.0)
    ax.plot(t, low, color=COLOURS[0], linewidth=1.0)
    ax.set_ylim(-1.0, 1.0)
    ax.set_yticks([-1, 0, 1])
    ax.set_ylabel("advice")
    shares = {name: share for name, share in done.advice.shares.items() if share > 0.0}
    said = ", ".join(f"{name} in {percent(share)}" for name, share in shares.items())
    caption = (
        f"Advice of the fuzzy system from -1 to 1; no line where it makes no statement. Of all rows: {said}."
    )
    return Picture(sheet, caption, caption)


def _log(done: Identified) -> Picture:
    log = done.log
    panels: list[tuple[str, Array, int | None]] = [
        ("yaw rate\n(mrad/s)", 1e3 * log.yaw_rate, 0),
        ("lateral accel-\neration (m/s²)", log.lateral_acceleration, 1),
        ("speed (m/s)", log.speed, None),
    ]
    if log.traction_torque is not None:
        panels.append(("torque (kN m)", 1e-3 * log.traction_torque, None))
    sheet = Sheet(_WIDTH, _BOTTOM + 1.25 * len(panels) + 0.5, "What was recorded?")
    for i, (label, values, sensor) in enumerate(panels):
        last = i == len(panels) - 1
        ax = _axes(sheet, done, _BOTTOM + 1.25 * (len(panels) - 1 - i), 1.05, last=last)
        usable = np.isfinite(values) if sensor is None else np.asarray(log.usable)[:, sensor]
        _panel(ax, log.time, values, usable)
        ax.set_ylabel(label)
        if i == 0:
            _legend(ax)
    sheet.figure.align_ylabels()
    caption = "The log on its uniform grid; red marks: samples that the filters do not use."
    return Picture(sheet, caption, caption)


def _panel(ax: Axes, time: Array, values: Array, usable: NDArray[np.bool_]) -> None:
    """Draw what can be used as a line, and mark what cannot at the bottom."""
    good = values[usable]
    shown = np.where(np.isfinite(values), values, good[0] if good.size else 0.0)
    if good.size:
        # A wild sample must not hide all others.
        middle, half = (good.min() + good.max()) / 2.0, 0.6 * max(float(np.ptp(good)), 1e-6)
        ax.set_ylim(middle - half, middle + half)
    t, x = thin(time, shown)
    there = np.isfinite(values)[np.searchsorted(time, t)]
    ax.plot(t, np.where(there, x, np.nan), color=COLOURS[0], linewidth=0.8)
    bad = np.flatnonzero(~usable)
    if bad.size:
        starts, ends = _stretches(~usable)
        spans = [
            (time[a], time[b - 1] - time[a] + (time[1] - time[0])) for a, b in zip(starts, ends, strict=True)
        ]
        _bars(ax, spans, label="not used")


def _bars(ax: Axes, spans: Sequence[tuple[float, float]], label: str) -> None:
    """Mark stretches of time at the bottom, each wide enough to be seen."""
    low, high = ax.get_xlim()
    least = (high - low) / 400.0
    merged: list[list[float]] = []
    for start, width in spans:
        end = start + max(width, least)
        if merged and start <= merged[-1][1]:
            merged[-1][1] = max(end, merged[-1][1])
        else:
            merged.append([start, end])
    wide = [(a, b - a) for a, b in merged]
    ax.broken_barh(wide, (0.0, 0.07), transform=ax.get_xaxis_transform(), color=_BAD, label=label, zorder=3)


def _status(done: Identified) -> Picture:
    found = done.status.found()
    sheet = Sheet(_WIDTH, _BOTTOM + 0.3 * len(found) + 0.55, "What is wrong with the sensors, and when?")
    ax = _axes(sheet, done, _BOTTOM, 0.3 * len(found), last=True, left=1.9)
    ax.set_ylim(-0.5, len(found) - 0.5)
    ax.grid(visible=False, axis="y")
    time = done.log.time
    low, high = ax.get_xlim()
    for i, fault in enumerate(reversed(found)):
        starts, ends = _stretches(done.status.where(fault.source, fault.fault))
        least = (high - low) / 400.0
        spans = [(time[a], max(time[b - 1] - time[a], least)) for a, b in zip(starts, ends, strict=True)]
        ax.broken_barh(spans, (i - 0.3, 0.6), color=_BAD, linewidth=0.0)
        text = f"{fault.samples} samples"
        ax.annotate(text, (1.01, i), xycoords=("axes fraction", "data"), va="center", size=8.5)
    ax.set_yticks(range(len(found)), [f"{fault.source}: {fault.fault}" for fault in reversed(found)])
    caption = "Stretches with a fault, drawn wide enough to be seen."
    return Picture(sheet, caption, caption)
