"""What is reached and seen: maps of distances, bars of singular values, margins of modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.drawing.sheet import COLOURS, Sheet, colour, decades, shorten
from co_sim.wheelset.prose.words import number, power_of_ten

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Truths = NDArray[np.bool_]

__all__ = ["draw_distances", "draw_mode_margins", "draw_singular_values"]

_WIDTH, _RIGHT, _TOP = 8.2, 1.15, 0.4
_ROW = 0.155
#: Values this many decades below the largest have one colour, that of next to nothing.
_DECADES = 14
_CROSS = COLOURS[1]
_LONGEST = 30


def draw_distances(
    conditions: Sequence[str],
    speeds: Sequence[float],
    points: Sequence[str],
    names: Sequence[str],
    distances: Array,
    lost: Truths,
    title: str,
) -> Sheet:
    """Draw distances (set, condition, speed, point) as colours, a panel for each condition."""
    columns = min(2, len(conditions))
    rows = -(-len(conditions) // columns)
    left, gap = _label_width(names) + 0.42, 0.2
    height = _ROW * (len(names) + 0.6) * len(points)
    sheet = Sheet(_WIDTH, _TOP + rows * (height + 0.4) + 0.42, title)
    width = (sheet.width - left - _RIGHT - gap * (columns - 1)) / columns
    limits = _limits(np.where(lost, 0.0, distances))
    for i, condition in enumerate(conditions):
        row, column = divmod(i, columns)
        bottom = 0.55 + (rows - 1 - row) * (height + 0.4)
        for k, point in enumerate(points):
            block = height / len(points)
            ax = sheet.axes(
                left + column * (width + gap),
                bottom + (len(points) - 1 - k) * block,
                width,
                block - 0.6 * _ROW,
            )
            image = _map(ax, distances[:, i, :, k], lost[:, i, :, k], limits)
            if k == 0:
                ax.set_title(f"{condition.replace('_', ' ')} rail", size=9.5, loc="left")
            _set_labels(ax, names, shown=column == 0)
            last = k == len(points) - 1 and i + columns >= len(conditions)
            _speed_labels(ax, speeds, shown=last)
            if column == 0:
                middle = ax.get_position().y0 + 0.5 * ax.get_position().height
                sheet.figure.text(0.12 / sheet.width, middle, point, va="center", weight="bold")
    if not lost.all():
        _bar(sheet, image, limits, "distance")
    return sheet


def draw_mode_margins(
    points: Sequence[str],
    names: Sequence[str],
    poles: NDArray[np.complex128],
    dominant: NDArray[np.str_],
    margins: Array,
    lost: Truths,
    title: str,
) -> Sheet:
    """Draw margins (set, point, mode) as colours, a panel for each point; one mode of each pair.

    `poles` and `dominant`, the states that participate most, are (point, mode).
    """
    left, below = _label_width(names) + 0.1, 1.05
    height = 1.35 * _ROW * len(names)
    sheet = Sheet(_WIDTH, _TOP + len(points) * (height + below) + 0.25, title)
    limits = _limits(np.where(lost, 0.0, margins))
    for k, point in enumerate(points):
        bottom = below + (len(points) - 1 - k) * (height + below)
        ax = sheet.axes(left, bottom, sheet.width - left - _RIGHT, height)
        chosen = poles[k].imag >= 0.0
        image = _map(ax, margins[:, k][:, chosen], lost[:, k][:, chosen], limits)
        ax.set_title(point, size=9.5, loc="left")
        _set_labels(ax, names, shown=True)
        labels = [_mode_label(s, name) for s, name in zip(poles[k][chosen], dominant[k][chosen], strict=True)]
        ax.set_xticks(range(len(labels)), labels, fontsize=8.0)
    ax.set_xlabel("mode: state that participates most, growth rate (1/s), frequency")
    if not lost.all():
        _bar(sheet, image, limits, "margin")
    return sheet


def draw_singular_values(
    conditions: Sequence[str], points: Sequence[str], names: Sequence[str], values: Array, title: str
) -> Sheet:
    """Draw singular values (set, condition, point, direction) as bars; a panel for each set and point."""
    longest = max(len(line) for name in names for line in _wrapped(name).split("\n"))
    left, height, gap = 0.95 + 0.075 * longest, 0.72, 0.16
    sheet = Sheet(_WIDTH, _TOP + len(names) * (height + gap) + 0.72, title)
    width = (sheet.width - left - _RIGHT - 0.12 * (len(points) - 1)) / len(points)
    lowest = 10.0 ** np.floor(np.log10(np.nanmin(values, initial=1.0)))
    bar = 0.8 / len(conditions)
    for s, name in enumerate(names):
        for k, point in enumerate(points):
            bottom = 0.55 + (len(names) - 1 - s) * (height + gap)
            ax = sheet.axes(left + k * (width + 0.12), bottom, width, height)
            for i in range(len(conditions)):
                order = np.arange(1, values.shape[-1] + 1) + bar * (i - 0.5 * (len(conditions) - 1))
                ax.bar(order, values[s, i, k], width=bar, color=colour(i))
            decades(ax, "y")
            ax.set_ylim(0.3 * lowest, 3.0)
            ax.set_xlim(0.4, values.shape[-1] + 0.6)
            ax.set_xticks(range(1, values.shape[-1] + 1))
            ax.tick_params(labelleft=k == 0, labelbottom=s == len(names) - 1, labelsize=8.0)
            ax.grid(visible=False, axis="x")
            if k == 0:
                ax.set_ylabel("added", size=8.0)
            if s == 0:
                ax.set_title(point, size=9.5, loc="left")
            if s == len(names) - 1:
                ax.set_xlabel("direction")
        sheet.figure.text(
            0.12 / sheet.width,
            (bottom + 0.5 * height) / sheet.height,
            _wrapped(name),
            va="center",
            size=9.0,
        )
    _explain(sheet, conditions)
    return sheet


def _map(ax: Axes, values: Array, lost: Truths, limits: tuple[float, float]) -> AxesImage:
    low, high = limits
    shown = np.log10(np.clip(values, 10.0**low, None))
    image = ax.imshow(np.ma.array(shown, mask=lost), aspect="auto", cmap="cividis", vmin=low, vmax=high)
    i, j = np.nonzero(lost)
    ax.plot(j, i, linestyle="none", marker="x", color=_CROSS, markersize=3.2, markeredgewidth=1.0)
    ax.set_xlim(-0.5, values.shape[1] - 0.5)
    ax.set_ylim(values.shape[0] - 0.5, -0.5)
    ax.grid(visible=False)
    return image


def _limits(values: Array) -> tuple[float, float]:
    """Return the range of colours in decades."""
    high = float(np.ceil(np.log10(max(float(values.max(initial=0.0)), 1e-300))))
    positive = values[values > 10.0 ** (high - _DECADES)]
    low = float(np.floor(np.log10(positive.min(initial=10.0**high))))
    return min(low, high - 1.0), high


def _bar(sheet: Sheet, image: AxesImage, limits: tuple[float, float], label: str) -> None:
    height = max(0.5, min(2.2, sheet.height - 1.9))
    ax = sheet.axes(sheet.width - _RIGHT + 0.2, sheet.top - 0.3 - height, 0.16, height)
    sheet.figure.colorbar(image, cax=ax, format=lambda value, _: power_of_ten(10.0**value))
    low, high = limits
    ax.set_yticks(np.arange(low, high + 1.0, max(1.0, round((high - low) / 6.0))))
    ax.set_ylabel(label)


def _set_labels(ax: Axes, names: Sequence[str], *, shown: bool) -> None:
    labels = [shorten(_plain(name), _LONGEST) for name in names]
    ax.set_yticks(range(len(names)), labels if shown else [""] * len(names), fontsize=8.0)
    ax.tick_params(axis="y", length=0.0)


def _speed_labels(ax: Axes, speeds: Sequence[float], *, shown: bool) -> None:
    step = -(-len(speeds) // 8)
    places = range(step - 1, len(speeds), step)
    ax.set_xticks(places, [f"{speeds[j]:g}" for j in places] if shown else [""] * len(places), fontsize=8.0)
    if shown:
        ax.set_xlabel("speed (m/s)")


def _plain(name: str) -> str:
    return name.replace("_", " ").replace("accelerometer", "accel.").replace("+", " + ")


def _wrapped(name: str) -> str:
    return _plain(name).replace(" + ", " +\n")


def _label_width(names: Sequence[str]) -> float:
    return 0.3 + 0.066 * max(len(shorten(_plain(name), _LONGEST)) for name in names)


def _mode_label(s: complex, dominant: str) -> str:
    text = f"{dominant}\n{number(s.real, 2)}"
    return f"{text}\n{number(s.imag / (2.0 * np.pi), 2)} Hz" if s.imag > 0.0 else text


def _explain(sheet: Sheet, conditions: Sequence[str]) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(color=colour(i), label=name.replace("_", " ")) for i, name in enumerate(conditions)]
    sheet.figure.legend(
        handles=handles,
        title="rail",
        loc="upper left",
        bbox_to_anchor=((sheet.width - _RIGHT + 0.02) / sheet.width, 1.0 - 0.6 / sheet.height),
        handlelength=1.0,
    )
