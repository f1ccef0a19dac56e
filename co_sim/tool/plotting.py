"""A picture of recorded signals: one panel for each unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim.observers import Recorder

__all__ = ["plot"]

#: Lines that a panel can show apart from each other, and panels that a page can.
_LINES, _PANELS = 10, 8
_WIDTH, _HEIGHT = 10.0, 2.4


def plot(recorder: Recorder, path: Path, title: str) -> list[str]:
    """Draw the recorded numbers over time into a PNG; return the names of signals that had no room."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    units: dict[str, list[str]] = {}
    for name, unit, kind in zip(recorder.names, recorder.units, recorder.kinds, strict=True):
        if kind != "string":
            units.setdefault(unit, []).append(name)
    panels = list(units.items())[:_PANELS]
    shown = {name for _, names in panels for name in names[:_LINES]}
    with mpl.rc_context(
        {"axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.3}
    ):
        figure = Figure(figsize=(_WIDTH, 0.8 + _HEIGHT * max(len(panels), 1)), layout="constrained")
        figure.suptitle(title)
        axes = figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (unit, names) in zip(axes, panels, strict=False):
            for name in names[:_LINES]:
                ax.plot(recorder.time, recorder[name], label=name, linewidth=1.2)
            ax.set_ylabel(unit if unit != "1" else "–")
            ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize="small")
        axes[-1].set_xlabel("time (s)")
        figure.savefig(path, dpi=120)
    return [name for name in recorder.names if name not in shown]
