"""Hankel singular values for several points of several creep curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.drawing.sheet import Sheet, colour, decades
from co_sim.wheelset.prose.words import power_of_ten

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["draw_directions"]

_WIDTH, _LEFT, _BOTTOM, _GAP, _RIGHT = 8.2, 0.8, 0.55, 0.15, 0.9
#: Values this far below the largest are rounding.
_DECADES = 8.5


def draw_directions(
    conditions: Sequence[str], points: Sequence[str], values: NDArray[np.float64], title: str
) -> Sheet:
    """Draw values (condition, point, direction) as bars, a panel for each condition."""
    sheet = Sheet(_WIDTH, 3.3, title)
    width = (sheet.width - _LEFT - _RIGHT - _GAP * (len(conditions) - 1)) / len(conditions)
    top = 10.0 ** np.ceil(np.log10(max(float(values.max(initial=0.0)), 1e-300)))
    bar = 0.8 / len(points)
    directions = np.arange(1, values.shape[-1] + 1)
    for i, name in enumerate(conditions):
        ax = sheet.axes(_LEFT + i * (width + _GAP), _BOTTOM, width, sheet.top - _BOTTOM - 0.3)
        for k, point in enumerate(points):
            shown = np.where(values[i, k] > top * 10.0**-_DECADES, values[i, k], np.nan)
            ax.bar(directions + bar * (k - 0.5 * (len(points) - 1)), shown, bar, color=colour(k), label=point)
        decades(ax, "y")
        lowest = np.nanmin(np.where(values > top * 10.0**-_DECADES, values, np.nan), initial=top)
        ax.set_ylim(10.0 ** np.floor(np.log10(0.5 * lowest)), top)
        ax.yaxis.set_major_formatter(lambda value, _: power_of_ten(value))
        ax.set_xticks(directions)
        ax.set_xlim(0.4, values.shape[-1] + 0.6)
        ax.grid(visible=False, axis="x")
        ax.set_title(f"{name.replace('_', ' ')} rail", size=9.5, loc="left")
        ax.set_xlabel("direction")
        ax.tick_params(labelleft=i == 0)
        if i == 0:
            ax.set_ylabel("Hankel singular value (1/mm)")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=1.0)
    return sheet
