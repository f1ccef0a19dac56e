"""What a report assumes, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from co_sim.wheelset.prose.words import listed, quantity
from co_sim.wheelset.reporting.setup import SENSORS
from fmu_wheelset import WheelsetParameters

if TYPE_CHECKING:
    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["described"]

_SPECTRA = {"erri_low": "ERRI B176, low level", "erri_high": "ERRI B176, high level"}
_POINTS = {"P1": "a tenth of", "P2": "at", "P3": "twice"}


def described(setup: Setup, grid: Grid) -> tuple[tuple[str, str], ...]:
    """Return what is assumed as (subject, sentences)."""
    return (
        ("Wheelset", _wheelset(setup)),
        ("Grid", _grid(grid)),
        ("Points", _points(grid)),
        ("Sensors", _sensors(setup)),
        ("Track", f"Random lateral alignment of the spectrum {_SPECTRA[setup.track]}."),
    )


def _wheelset(setup: Setup) -> str:
    own = "of the paper" if setup.wheelset == WheelsetParameters() else "as given"
    return (
        f"The FMU's wheelset with Polach's creep law and the parameters {own}; wheel loads "
        f"{quantity(setup.wheelset.N / 1e3, 'kN')}."
    )


def _grid(grid: Grid) -> str:
    low, high = grid.speeds[0], grid.speeds[-1]
    speeds = (
        f"{len(grid.speeds)} speeds from {low:g} to {quantity(high, 'm/s')}"
        if len(grid.speeds) > 1
        else f"the speed {quantity(low, 'm/s')}"
    )
    names = listed([name.replace("_", " ") for name in grid.conditions])
    return f"{grid.size} points: {names} rail, {speeds}, {listed(list(grid.point_names))}."


def _points(grid: Grid) -> str:
    named = [name for name in grid.point_names if name in _POINTS]
    if len(named) < len(grid.point_names):
        return "The same longitudinal creepage of both wheels at each speed."
    told = listed([f"{name} {_POINTS[name]}" for name in named])
    return f"{told} the creepage of the greatest force, on the curve of the rail condition at that speed."


def _sensors(setup: Setup) -> str:
    used = dict.fromkeys(name for names in setup.sensors for name in names)
    noise = [f"{_plain(name)} {quantity(setup.noise[name], SENSORS[name].unit)}" for name in used]
    return f"White noise in each sample (rms): {listed(noise)}; {quantity(setup.sample_rate, 'Hz')}."


def _plain(name: str) -> str:
    return name.replace("_", " ")
