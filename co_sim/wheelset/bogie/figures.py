"""The figures of the bogie: how the bodies move, and what the suspension does to the wheelsets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl

from co_sim.wheelset.bogie.assembly import WHEELSETS
from co_sim.wheelset.drawing.sheet import COLOURS, GREY, STYLE, Sheet, label_lines, label_margin, thin

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from matplotlib.axes import Axes

    from co_sim.observers import Recorder
    from co_sim.wheelset.drawing.sheet import Array

__all__ = ["draw"]

_WIDTH, _LEFT, _BOTTOM, _PITCH, _HEIGHT = 8.2, 0.85, 0.55, 2.0, 1.7
_NAMES = (*WHEELSETS, "frame")
_SHADES = dict(zip((*_NAMES, "track, front"), (*COLOURS[:3], GREY), strict=True))


def draw(record: Recorder, folder: Path) -> list[Path]:
    """Draw the figures into `folder`, which must exist, and return their files in reading order."""
    files = []
    with mpl.rc_context(STYLE):
        for name, sheet in _sheets(record):
            file = folder / f"{name}.png"
            sheet.save(file)
            files.append(file)
    return files


def _sheets(record: Recorder) -> Iterator[tuple[str, Sheet]]:
    track = {"track, front": 1e3 * record["track_front.lateral_offset"]}
    lateral = {name: 1e3 * record[f"{name}.lateral_displacement"] for name in _NAMES}
    yaw = {name: 1e3 * record[f"{name}.yaw_angle"] for name in _NAMES}
    yield (
        "bogie_motion",
        _sheet(
            "How does the bogie follow the track?",
            record.time,
            [("lateral displacement (mm)", track | lateral), ("yaw (mrad)", yaw)],
        ),
    )
    forces = {name: 1e-3 * record[f"frame.{name}.lateral_force"] for name in WHEELSETS}
    moments = {name: 1e-3 * record[f"frame.{name}.yaw_moment"] for name in WHEELSETS}
    yield (
        "bogie_loads",
        _sheet(
            "What does the primary suspension do to the wheelsets?",
            record.time,
            [("lateral force (kN)", forces), ("yaw moment (kN m)", moments)],
        ),
    )


def _sheet(title: str, time: Array, panels: list[tuple[str, dict[str, Array]]]) -> Sheet:
    """Return one panel for each label and its lines, below each other."""
    sheet = Sheet(_WIDTH, _BOTTOM + _PITCH * len(panels) + 0.2, title)
    names = [name for _, lines in panels for name in lines]
    for i, (label, lines) in enumerate(panels):
        bottom = _BOTTOM + _PITCH * (len(panels) - 1 - i)
        ax = sheet.axes(_LEFT, bottom, _WIDTH - _LEFT - label_margin(names), _HEIGHT)
        _panel(ax, time, label, lines)
        ax.tick_params(labelbottom=i == len(panels) - 1)
    ax.set_xlabel("time (s)")
    sheet.figure.align_ylabels()
    return sheet


def _panel(ax: Axes, time: Array, label: str, lines: dict[str, Array]) -> None:
    for name, values in lines.items():
        ax.plot(*thin(time, values), color=_SHADES[name], linewidth=1.1)
    ax.set_ylabel(label)
    ax.set_xlim(float(time[0]), float(time[-1]))
    ax.margins(y=0.08)
    label_lines(ax, list(lines), [values[-1] for values in lines.values()], [_SHADES[n] for n in lines])
