"""The numbers of the sections on information for the JSON file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.reporting.information import ERROR
from co_sim.wheelset.reporting.section import GRID_AXES, Quantity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.wheelset.reporting.confirmation import Confirmation
    from co_sim.wheelset.reporting.information import Limits, NoiseLimits
    from co_sim.wheelset.reporting.pairs import Design
    from co_sim.wheelset.reporting.slope_bounds import SlopeBounds
    from estimator.identifiability import ErrorProbability

__all__ = ["information_numbers", "sensor_numbers"]

Array = NDArray[np.float64]

_MAP = ("condition", "map_speed", "share")
_UNKNOWABLE = "nothing that is measured depends on it to first order"
_OUTGROWN = "the unstable wheelset outgrows every number within the window"
_UNSTEADY = "the motion has no steady state here"


def _over_map(value: Array, meaning: str, unit: str = "1") -> Quantity:
    return Quantity(value, unit, meaning, _MAP, {"nan": _UNSTEADY, "inf": _UNKNOWABLE})


def information_numbers(
    found: Limits,
    bounds: SlopeBounds,
    noise: NoiseLimits,
    windows: Array,
    errors: ErrorProbability,
    confirmations: Sequence[Confirmation],
) -> dict[str, Quantity]:
    """Return the numbers of the section on what can be known."""
    slope = "least standard deviation of {} for small signals, over the initial slope of the creep curve"
    missing = {"inf": _UNKNOWABLE, "nan": _OUTGROWN}
    return {
        "window": Quantity(found.T, "s", "length of the record of all standard deviations"),
        "error": Quantity(ERROR, "1", "error probability at which two rails count as told apart"),
        "g11_std": Quantity(bounds.g11, "1", slope.format("the tangent g11"), GRID_AXES, missing),
        "g22_std": Quantity(bounds.g22, "1", slope.format("the secant g22"), GRID_AXES, missing),
        "utilisation": _over_map(found.utilisation, "mean force over the greatest force of the curve"),
        "creep_amplitude": _over_map(
            found.amplitude, "rms of the creepage by the track over the creep of the peak"
        ),
        "small_signals": Quantity(
            found.small,
            "1",
            "whether the track moves the creep by less than half the way to zero or the peak",
            _MAP,
        ),
        "averaged_g11_std": _over_map(
            found.g11, "least standard deviation of the averaged g11, over the initial slope"
        ),
        "averaged_g22_std": _over_map(
            found.g22, "least standard deviation of the averaged g22, over the initial slope"
        ),
        "creep_std": _over_map(found.creep, "least standard deviation of the creep, over the creep"),
        "peak_adhesion_std": _over_map(
            found.adhesion, "least standard deviation of the peak adhesion, over itself"
        ),
        "window_needed": _over_map(
            found.window,
            "record that tells the rail from its nearest rival; 0 where the force alone tells",
            "s",
        ),
        "nearest_rival": Quantity(found.rival, "1", "rail that is hardest to tell from the true one", _MAP),
        "window_needed_over_noise": Quantity(
            noise.window,
            "s",
            f"the same at {noise.speed:g} m/s when the noise of all sensors is multiplied",
            ("condition", "noise_factor", "share"),
            {"nan": _UNSTEADY, "inf": _UNKNOWABLE},
        ),
        "least_error": Quantity(
            errors.estimate, "1", "least error probability, estimate", ("pair", "window")
        ),
        "least_error_lower": Quantity(errors.lower, "1", "the same, lower bound", ("pair", "window")),
        "least_error_upper": Quantity(errors.upper, "1", "the same, upper bound", ("pair", "window")),
        **_counted(confirmations),
    }


def _counted(confirmations: Sequence[Confirmation]) -> dict[str, Quantity]:
    kinds = {
        "window": ("s", "window of the decisions on the plant"),
        "lower": ("1", "least error probability in that window, lower bound"),
        "estimate": ("1", "the same, estimate"),
        "upper": ("1", "the same, upper bound"),
        "share": ("1", "share of errors counted on the plant"),
        "low": ("1", "lower end of the 95 % interval of the error probability on the plant"),
        "high": ("1", "upper end of that interval"),
        "decisions": ("1", "number of decisions"),
    }
    return {
        f"plant_{name}": Quantity(
            [getattr(one, name) for one in confirmations], unit, meaning, ("confirmed",)
        )
        for name, (unit, meaning) in kinds.items()
        if confirmations
    }


def sensor_numbers(rates: Array, designs: Mapping[str, Design]) -> dict[str, Quantity]:
    """Return the numbers of the section on sensors."""
    units = {"noise": "1", "bandwidth": "Hz", "sample_rate": "Hz"}
    meanings = {
        "noise": "factor on the noise of all sensors",
        "bandwidth": "bandwidth of all sensors",
        "sample_rate": "sample rate of all sensors",
    }
    numbers = {
        "chernoff_rate": Quantity(rates, "1/s", "rate at which the least error falls", ("sensor_set", "pair"))
    }
    for name, design in designs.items():
        numbers[f"error_over_{name}"] = Quantity(
            design.error,
            "1",
            f"least error probability over the {meanings[name]}",
            ("pair", f"{name}_values"),
        )
        numbers[f"{name}_limit"] = Quantity(
            design.limit,
            units[name],
            f"{meanings[name]} at which the wanted error is reached; the easiest looked at where all will do",
            ("pair",),
            "no value that was looked at is enough",
        )
    return numbers
