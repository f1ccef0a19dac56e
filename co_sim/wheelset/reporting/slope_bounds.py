"""Cramer-Rao bounds of the slopes at the points of the grid, for small signals, steady or not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.reporting.information import curve_of, sensors_of
from estimator.identifiability import SLOPES, cramer_rao, fisher_rate, fisher_window, slope_family

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["SlopeBounds", "slope_bounds"]

Array = NDArray[np.float64]

#: Without a steady state the whole window is one dense matrix: sampled every so often, s, with the noise
#: that the mean of the samples in between has; and no longer than this, s, as an unstable wheelset is gone
#: by then.
_STEP, _LONGEST = 0.01, 1.0


@dataclass(frozen=True, eq=False)
class SlopeBounds:
    """Least standard deviations over the grid (condition, speed, point), over the initial slope of the curve.

    ``inf`` where a slope cannot be known; NaN where an unstable wheelset outgrows every number in the window.
    """

    g11: Array
    g22: Array


def slope_bounds(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> SlopeBounds:
    """Compute the bounds of a window of the setup; where no steady state exists, from rest."""
    std = np.full((*grid.shape, 2), np.nan)
    sensors = sensors_of(setup, setup.main_sensors)
    thinned = max(_STEP, 1.0 / setup.sample_rate)
    quiet = [replace(s, noise=s.noise / np.sqrt(thinned * setup.sample_rate)) for s in sensors]
    points = grid.resolve(setup.wheelset)
    for i, at in enumerate(points):
        scale = curve_of(at.condition, at.speed, setup).initial_slope
        common = {"wheelset": setup.wheelset, "sensors": quiet, "h": thinned}
        family = slope_family([at.point], setup.spectrum, scale, **common)[0]  # type: ignore[arg-type]
        try:
            if family.process.steady():
                information = setup.window * fisher_rate(family)
            else:
                samples = max(round(min(setup.window, _LONGEST) / thinned), 1)
                information = fisher_window(family, samples)
        except ValueError:
            continue
        std[at.index] = cramer_rao(information, SLOPES, family.scale).std / scale
        progress((i + 1) / len(points))
    return SlopeBounds(std[..., 0], std[..., 1])
