"""The style that all figures share, on matplotlib's Agg canvas and without its global state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from co_sim.files import whole_file
from co_sim.wheelset.prose.words import power_of_ten

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

__all__ = [
    "COLOURS",
    "GREY",
    "STYLE",
    "Picture",
    "Sheet",
    "colour",
    "dashes",
    "decades",
    "envelope",
    "label_lines",
    "label_margin",
    "shorten",
    "spread",
    "thin",
]

Array = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers (Okabe and Ito 2008), one for each filter in turn.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
GREY = "0.45"

#: Settings of matplotlib under which the figures are drawn.
STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 11.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "hatch.linewidth": 0.5,
    # Names of filters and rail conditions are the user's: a dollar sign in them is no formula.
    "text.parse_math": False,
}

_DOTS_PER_INCH = 150
_TITLE_HEIGHT = 0.42
_LABEL_PITCH = 0.17


class Sheet:
    """A figure laid out in inches, with its title at the top left.

    Parameters
    ----------
    width, height : inches. title : what question the figure answers.
    """

    def __init__(self, width: float, height: float, title: str) -> None:
        self.width = width
        self.height = height
        self.title = title
        self.figure = Figure(figsize=(width, height), dpi=_DOTS_PER_INCH)
        FigureCanvasAgg(self.figure)
        self.figure.text(
            0.12 / width, 1.0 - 0.14 / height, title, ha="left", va="top", size=11.5, weight="bold"
        )

    @property
    def top(self) -> float:
        """Height above which the title stands, inches."""
        return self.height - _TITLE_HEIGHT

    def axes(self, left: float, bottom: float, width: float, height: float) -> Axes:
        """Add axes at a place in inches from the lower left corner."""
        return self.figure.add_axes(
            (left / self.width, bottom / self.height, width / self.width, height / self.height)
        )

    def save(self, path: Path) -> None:
        """Write the figure as a PNG that is whole or not there."""
        with whole_file(path) as temporary:
            self.figure.savefig(temporary, format="png")


@dataclass(frozen=True, slots=True)
class Picture:
    """A drawn sheet with its caption, and what a reader who cannot see it must know."""

    sheet: Sheet
    caption: str
    alt: str


def colour(index: int) -> str:
    """Return the colour of a filter, by its position in the bank."""
    return COLOURS[index % len(COLOURS)]


def dashes(index: int) -> str:
    """Return the line style of a filter: solid until the colours are used up."""
    return ("-", "--", ":", "-.")[index // len(COLOURS) % 4]


def shorten(name: str, length: int = 20) -> str:
    """Return `name`, with an ellipsis in its middle if it is longer than `length` characters."""
    if len(name) <= length:
        return name
    head = (length - 1) // 2
    return f"{name[:head]}…{name[len(name) - (length - 1 - head) :]}"


def decades(ax: Axes, which: Literal["x", "y"]) -> None:
    """Make an axis logarithmic with labels such as 10⁻³: matplotlib's own are formulas (see `STYLE`)."""
    (ax.set_xscale if which == "x" else ax.set_yscale)("log")
    axis = ax.xaxis if which == "x" else ax.yaxis
    axis.set_major_formatter(lambda value, _: power_of_ten(value))
    axis.set_minor_formatter(lambda value, _: "")


def thin(t: Array, x: Array, bins: int = 600) -> tuple[Array, Array]:
    """Return the least and the greatest sample of each of `bins` bins of the series (T,), in order."""
    m = -(-len(t) // bins)
    if m <= 2:
        return t, x
    blocks = np.pad(x, (0, -len(x) % m), mode="edge").reshape(-1, m)
    ends = np.column_stack([blocks.argmin(axis=1), blocks.argmax(axis=1)])
    kept = np.unique(np.minimum(ends + m * np.arange(len(blocks))[:, None], len(t) - 1))
    return t[kept], x[kept]


def envelope(t: Array, x: Array, bins: int = 600) -> tuple[Array, Array, Array]:
    """Return (time, least, greatest) of the series (T,) in each of at most `bins` bins."""
    starts = np.arange(0, len(t), -(-len(t) // bins))
    return t[starts], np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)


def spread(positions: Sequence[float], gap: float, low: float, high: float) -> Array:
    """Move positions apart until neighbours are `gap` from each other, within [low, high].

    The order stays, and what has room stays in place. If they cannot all fit, they share the room evenly.
    """
    order = np.argsort(positions, kind="stable")
    placed = np.clip(np.asarray(positions, dtype=np.float64)[order], low, high)
    if len(placed) > 1:
        gap = min(gap, (high - low) / (len(placed) - 1))
    ladder = gap * np.arange(len(placed))
    # With the ladder taken off, neighbours apart by `gap` means no more than rising order.
    placed = np.clip(_rising(placed - ladder), low, high - gap * max(len(placed) - 1, 0)) + ladder
    result = np.empty(len(placed))
    result[order] = placed
    return result


def _rising(values: Array) -> Array:
    """Return the rising sequence closest to `values` in the least-squares sense."""
    blocks: list[tuple[float, int]] = []
    for value in values:
        mean, count = float(value), 1
        while blocks and blocks[-1][0] > mean:
            earlier, n = blocks.pop()
            mean, count = (mean * count + earlier * n) / (count + n), count + n
        blocks.append((mean, count))
    return np.array([mean for mean, count in blocks for _ in range(count)])


def label_margin(names: Sequence[str]) -> float:
    """Return the width (inches) that `label_lines` needs right of the axes."""
    return 0.35 + 0.085 * max(len(shorten(name)) for name in names)


def label_lines(ax: Axes, names: Sequence[str], values: Sequence[float], colours: Sequence[str]) -> None:
    """Write each line's name beside its last value, right of the axes, without overlap."""
    low, high = ax.get_ylim()
    height = ax.get_position().height * ax.get_figure(root=True).get_figheight()  # type: ignore[union-attr]
    fractions = [(value - low) / (high - low) for value in values]
    places = spread(fractions, _LABEL_PITCH / height, 0.0, 1.0)
    for name, fraction, place, shade in zip(names, fractions, places, colours, strict=True):
        ax.annotate(
            shorten(name),
            (1.0, fraction),
            xytext=(1.025, place),
            xycoords="axes fraction",
            va="center",
            color=shade,
            weight="bold",
            size=9.0,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": shade,
                "linewidth": 0.7,
                "shrinkA": 1,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )
