"""Figures of one linear model: poles, margins of its modes, Hankel singular values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.drawing.sheet import COLOURS, GREY, Sheet, decades, shorten
from co_sim.wheelset.prose.words import number, power_of_ten

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from estimator.structure import Mode

__all__ = ["MOST_ROWS", "draw_hankel", "draw_margins", "draw_poles"]

#: Rows and columns for which a table of colours has room.
MOST_ROWS, _MOST_COLUMNS = 40, 40
_SHADES = {"decays": COLOURS[0], "undamped": GREY, "grows": COLOURS[1]}
_MARKERS = {"decays": "x", "undamped": "o", "grows": "^"}
#: Margins this far below the largest are as good as none to the eye.
_DECADES = 14


def draw_poles(modes: Sequence[Mode], title: str) -> Sheet:
    """Draw the eigenvalues in the complex plane; both axes are linear near zero and logarithmic beyond."""
    sheet = Sheet(8.2, 4.4, title)
    ax = sheet.axes(0.95, 0.55, sheet.width - 1.15, sheet.top - 0.65)
    poles = np.array([mode.exponent for mode in modes])
    knee = _knee(poles)
    for behaviour, shade in _SHADES.items():
        chosen = np.array([p for p, mode in zip(poles, modes, strict=True) if mode.behaviour == behaviour])
        if chosen.size:
            marker, face = _MARKERS[behaviour], shade if behaviour == "grows" else "none"
            style = {"markerfacecolor": face} if marker != "x" else {"markeredgewidth": 1.6}
            ax.plot(
                chosen.real,
                chosen.imag,
                linestyle="none",
                marker=marker,
                color=shade,
                label=behaviour,
                **style,
            )
    for axis, values in ((ax.xaxis, poles.real), (ax.yaxis, poles.imag)):
        side = "x" if axis is ax.xaxis else "y"
        (ax.set_xscale if side == "x" else ax.set_yscale)("symlog", linthresh=knee, linscale=0.6)
        axis.set_major_formatter(lambda value, _: power_of_ten(value))
        reach = 3.0 * max(float(np.abs(values).max(initial=0.0)), knee)
        low = -reach if side == "y" or (values < 0.0).any() else -knee
        high = reach if side == "y" or (values > 0.0).any() else knee
        (ax.set_xlim if side == "x" else ax.set_ylim)(low, high)
    ax.axvline(0.0, color=GREY, linewidth=1.0)
    ax.set_xlabel("growth rate (1/s); linear around zero, logarithmic beyond")
    ax.set_ylabel("angular frequency (rad/s)")
    ax.legend(loc="upper left", frameon=True, framealpha=0.9, edgecolor="0.9")
    return sheet


def _knee(poles: NDArray[np.complex128]) -> float:
    sizes = np.abs(poles)[np.abs(poles) > 0.0]
    return float(10.0 ** np.floor(np.log10(sizes.min()))) if sizes.size else 1.0


def draw_margins(
    rows: Sequence[str],
    modes: Sequence[Mode],
    margins: NDArray[np.float64],
    lost: NDArray[np.bool_],
    title: str,
) -> Sheet:
    """Draw the margins (row, mode) as colours; a cross where the mode is lost."""
    rows, margins, lost = rows[:MOST_ROWS], margins[:MOST_ROWS], lost[:MOST_ROWS]
    modes, margins, lost = modes[:_MOST_COLUMNS], margins[:, :_MOST_COLUMNS], lost[:, :_MOST_COLUMNS]
    left = 0.3 + 0.072 * max(len(shorten(row, 34)) for row in rows)
    height = 0.24 * len(rows)
    sheet = Sheet(8.2, height + 1.75, title)
    ax = sheet.axes(left, 1.05, sheet.width - left - 1.35, height)
    top = 10.0 ** np.ceil(np.log10(max(float(margins.max(initial=0.0)), 1e-300)))
    seen = margins[~lost]
    least = 10.0 ** np.floor(np.log10(max(float(seen.min(initial=top)), top * 10.0**-_DECADES)))
    low, high = np.log10(min(least, 0.1 * top)), np.log10(top)
    shown = np.log10(np.clip(margins, 10.0**low, None))
    image = ax.imshow(
        np.ma.array(shown, mask=lost),
        aspect="auto",
        cmap="cividis",
        vmin=low,
        vmax=high,
    )
    for i, j in np.argwhere(lost):
        ax.plot(j, i, marker="x", color=COLOURS[1], markersize=6.0, markeredgewidth=1.6)
    ax.grid(visible=False)
    ax.set_yticks(range(len(rows)), [shorten(row, 34) for row in rows])
    labels = [_mode_label(mode) for mode in modes]
    ax.set_xticks(range(len(modes)), labels, rotation=90 if len(modes) > 6 else 0, fontsize=8.0)
    ax.set_xlabel("mode: growth rate (1/s) ± angular frequency (rad/s); × lost")
    bar = sheet.axes(sheet.width - 1.15, 1.05, 0.16, height)
    span = max(round(high - low), 1)
    ticks = np.arange(low, high + 0.5, -(-span // max(int(2.5 * height), 1)))
    sheet.figure.colorbar(image, cax=bar, ticks=ticks, format=lambda value, _: power_of_ten(10.0**value))
    bar.set_ylabel("margin")
    return sheet


def _mode_label(mode: Mode) -> str:
    s = mode.exponent
    return number(s.real, 2) if s.imag == 0.0 else f"{number(s.real, 2)} ± {number(abs(s.imag), 2)}j"


def draw_hankel(hankel: NDArray[np.float64], resolution: float, title: str) -> Sheet:
    """Draw Hankel singular values over the largest, with the level below which they are rounding."""
    sheet = Sheet(8.2, 3.2, title)
    ax = sheet.axes(1.15, 0.55, sheet.width - 1.35, sheet.top - 0.65)
    order = np.arange(1, hankel.size + 1)
    shares = (
        np.maximum(hankel / hankel[0], 0.01 * resolution)
        if hankel[0] > 0.0
        else np.full(hankel.size, resolution)
    )
    ax.bar(order, shares, width=0.6, color=[COLOURS[0] if s > resolution else "0.8" for s in shares])
    ax.axhline(resolution, color=GREY, linestyle="--", linewidth=1.0)
    ax.annotate(
        "rounding below",
        (0.99, resolution),
        xycoords=("axes fraction", "data"),
        ha="right",
        va="bottom",
        color=GREY,
    )
    decades(ax, "y")
    ax.set_xticks(order)
    ax.set_xlabel("direction")
    ax.set_ylabel("Hankel singular value,\nof the largest")
    return sheet
