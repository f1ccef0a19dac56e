"""Figures of studies: accuracies, confusions, calibration, latencies, losses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.drawing.sheet import COLOURS, GREY, Sheet, decades, shorten

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from co_sim.wheelset.studies.findings import Calibration, Latency
    from co_sim.wheelset.studies.intervals import Share

    Array = NDArray[np.float64]

__all__ = ["draw_accuracy", "draw_calibration", "draw_confusion", "draw_latency", "draw_losses"]

#: Colour of each bank in all figures.
_SHADE = {
    "adhesion": COLOURS[0],
    "window": COLOURS[5],
    "known": COLOURS[2],
    "exact": COLOURS[3],
    "paper": COLOURS[1],
    "matched": "0.25",
}
_MARK = {"adhesion": "o", "window": "^", "known": "v", "exact": "P", "paper": "s", "matched": "D"}


def _bars(ax: Axes, x: Array, shares: Sequence[Share], bank: str, *, line: bool) -> None:
    """Draw shares in per cent with their intervals."""
    y = 100.0 * np.array([share.value for share in shares])
    ends = 100.0 * np.array([[share.value - share.low, share.high - share.value] for share in shares]).T
    ax.errorbar(
        x,
        y,
        np.maximum(ends, 0.0),
        fmt=_MARK[bank],
        linestyle="-" if line else "none",
        color=_SHADE[bank],
        markersize=4.5,
        capsize=2.5,
        elinewidth=1.0,
        label=bank,
    )


def draw_accuracy(
    title: str, axes: Mapping[str, tuple[Sequence[str] | Sequence[float], Mapping[str, Sequence[Share]]]]
) -> Sheet:
    """Draw accuracy over each quantity of a grid, one panel for each.

    Parameters
    ----------
    axes : by heading with unit: values, and by bank the share right at each of them.
    """
    width = 2.75
    sheet = Sheet(0.75 + len(axes) * (width + 0.3) + 1.0, 3.6, title)
    for i, (heading, (values, by_bank)) in enumerate(axes.items()):
        ax = sheet.axes(0.75 + i * (width + 0.3), 0.75, width, sheet.top - 0.95)
        numeric = not any(isinstance(value, str) for value in values)
        x = np.array(values, dtype=np.float64) if numeric else np.arange(len(values), dtype=np.float64)
        ratio = float(x.max() / x.min()) if numeric and x.min() > 0.0 else 1.0
        for j, (bank, shares) in enumerate(by_bank.items()):
            nudge = 0.0 if numeric else 0.12 * (j - (len(by_bank) - 1) / 2.0)
            _bars(ax, x + nudge, shares, bank, line=numeric)
        if numeric and ratio > 30.0:
            decades(ax, "x")
            shown = _apart(x)
            ax.set_xticks(shown, [f"{value:g}" for value in shown])
        if not numeric:
            ax.set_xticks(x, [str(value).replace("_", " ") for value in values])
            ax.set_xlim(-0.5, len(values) - 0.5)
            ax.grid(visible=False, axis="x")
        ax.set_ylim(0.0, 104.0)
        ax.set_xlabel(heading)
        if i == 0:
            ax.set_ylabel("windows right, %")
        else:
            ax.tick_params(labelleft=False)
    ax.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="bank")
    return sheet


def _apart(x: Array) -> list[float]:
    """Return those of the values (n,), rising, whose labels have room on a logarithmic axis."""
    shown: list[float] = []
    for value in x:
        if not shown or np.log(value / shown[-1]) > 0.1 * np.log(x[-1] / x[0]):
            shown.append(float(value))
    return shown


def draw_confusion(title: str, classes: Sequence[str], counts: Mapping[str, NDArray[np.int64]]) -> Sheet:
    """Draw for each bank which class is taken for which, in per cent of the true class."""
    size = 0.62 * len(classes) + 0.4
    sheet = Sheet(1.1 + len(counts) * (size + 0.45), size + 1.75, title)
    names = [name.replace("_", " ") for name in classes]
    for i, (bank, table) in enumerate(counts.items()):
        ax = sheet.axes(1.0 + i * (size + 0.45), 0.75, size, size)
        total = table.sum(axis=1, keepdims=True)
        share = 100.0 * table / np.maximum(total, 1)
        ax.imshow(np.where(total > 0, share, np.nan), cmap="Blues", vmin=0.0, vmax=130.0)
        for row, column in np.ndindex(*table.shape):
            if total[row, 0]:
                text = f"{share[row, column]:.3g}"
                shade = "white" if share[row, column] > 80.0 else "black"
                ax.text(column, row, text, ha="center", va="center", color=shade, size=9.0)
        ax.set_xticks(range(len(names)), names)
        ax.set_yticks(range(len(names)), names if i == 0 else [""] * len(names))
        ax.grid(visible=False)
        ax.set_title(bank, loc="left", size=10.0)
        ax.set_xlabel("declared")
        if i == 0:
            ax.set_ylabel("true")
    return sheet


def draw_calibration(title: str, found: Mapping[str, Calibration]) -> Sheet:
    """Draw the share right over the probability given."""
    sheet = Sheet(6.4, 4.2, title)
    ax = sheet.axes(0.75, 0.65, 4.2, 3.0)
    ax.plot([0, 100], [0, 100], color=GREY, linewidth=1.0, linestyle=":")
    ax.text(36.0, 30.0, "says what it means", color=GREY, size=8.5, rotation=38.0, ha="center", va="center")
    for bank, calibration in found.items():
        _bars(ax, 100.0 * calibration.probability, calibration.right, bank, line=False)
    ax.set(xlim=(20.0, 102.0), ylim=(0.0, 104.0))
    ax.set_xlabel("probability given, %")
    ax.set_ylabel("answers right, %")
    ax.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="bank")
    return sheet


def draw_latency(title: str, found: Mapping[str, Latency], wanted: Sequence[float]) -> Sheet:
    """Draw the share of drops announced within a time; `wanted` are marks on the time axis, s."""
    sheet = Sheet(6.4, 3.6, title)
    ax = sheet.axes(0.75, 0.65, 4.3, sheet.top - 0.85)
    last = max((one.seconds[-1] for one in found.values() if one.seconds.size), default=1.0)
    end = max(1.1 * float(last), 1.2 * max(wanted))
    for bank, one in found.items():
        n = one.seconds.size + one.missed
        times = np.concatenate([[0.0], one.seconds, [end]])
        shares = np.concatenate([np.arange(one.seconds.size + 1), [one.seconds.size]]) / n
        ax.step(times, 100.0 * shares, where="post", color=_SHADE[bank], label=bank)
    for mark in wanted:
        ax.axvline(mark, color=GREY, linewidth=1.0, linestyle=":")
    ax.set(xlim=(0.0, end), ylim=(0.0, 104.0))
    ax.set_xlabel("time after the drop, s")
    ax.set_ylabel("drops announced, %")
    ax.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="bank")
    return sheet


def draw_losses(title: str, losses: Mapping[str, Mapping[str, tuple[float, float, float]]]) -> Sheet:
    """Draw by bank what each variant changes of the accuracy, the worst of the first bank on top."""
    first = next(iter(losses.values()))
    order = sorted(first, key=lambda variant: first[variant][0])
    sheet = Sheet(7.6, 1.3 + 0.3 * len(order), title)
    left = 0.4 + 0.075 * max(len(shorten(name, 34)) for name in order)
    ax = sheet.axes(left, 0.65, 7.6 - left - 1.2, sheet.top - 0.75)
    for j, (bank, found) in enumerate(losses.items()):
        values = 100.0 * np.array([found[variant] for variant in order])
        y = np.arange(len(order)) + 0.14 * (j - (len(losses) - 1) / 2.0)
        ends = np.abs(values[:, 1:] - values[:, :1]).T
        ax.errorbar(
            values[:, 0], y, xerr=ends, fmt=_MARK[bank], color=_SHADE[bank], markersize=4.0, capsize=2.0,
            elinewidth=1.0, label=bank,
        )  # fmt: skip
    ax.axvline(0.0, color=GREY, linewidth=1.0)
    ax.set_yticks(range(len(order)), [shorten(name, 34) for name in order])
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("change of the windows right, percentage points")
    ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), title="bank")
    return sheet
