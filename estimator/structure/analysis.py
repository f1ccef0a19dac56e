"""All questions at once: what a model does, and what sets of inputs and outputs reach and see of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from estimator.structure.distance import Distance, distance_to_uncontrollable, distance_to_unobservable
from estimator.structure.filters import Verdict, reach, sight
from estimator.structure.margins import ModeMargin, controllability_margins, observability_margins
from estimator.structure.modes import Mode, modes
from estimator.structure.scaling import Scales, natural_scales
from estimator.structure.subspaces import Rank, controllability_rank, observability_rank
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Access", "Structure", "analyse"]


@dataclass(frozen=True, eq=False)
class Access:
    """What one set of inputs reaches, or one set of outputs sees.

    Parameters
    ----------
    signals : names. rank : with singular values. margins : of each mode.
    distance : to the nearest model in which a mode is lost.
    critical_distance : to the nearest in which a mode is lost that does not decay: one that no feedback
        stabilises, or no observer follows.
    verdict : stabilisable, or detectable.
    """

    signals: tuple[str, ...]
    rank: Rank
    margins: tuple[ModeMargin, ...]
    distance: Distance
    critical_distance: Distance
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Structure:
    """A model seen as a whole.

    Parameters
    ----------
    system : the model. scales : in which ranks, margins and distances were judged. modes : slowest first.
    reached : by sets of inputs. seen : by sets of outputs.
    """

    system: LinearSystem
    scales: Scales
    modes: tuple[Mode, ...]
    reached: Mapping[str, Access]
    seen: Mapping[str, Access]

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers with names and units, ready for JSON; complex ones as ``[re, im]``."""
        s = self.system
        return {
            "states": _signals(s.states, s.state_units, self.scales.states),
            "inputs": _signals(s.inputs, s.input_units, self.scales.inputs),
            "outputs": _signals(s.outputs, s.output_units, self.scales.outputs),
            "time_scale_s": self.scales.time,
            "sampling_time_s": s.dt,
            "modes": [_mode(mode) for mode in self.modes],
            "reached": {name: _access(access) for name, access in self.reached.items()},
            "seen": {name: _access(access) for name, access in self.seen.items()},
        }


def analyse(
    model: control.StateSpace | LinearSystem,
    *,
    input_sets: Mapping[str, Sequence[str]] | None = None,
    output_sets: Mapping[str, Sequence[str]] | None = None,
    scales: Scales | None = None,
) -> Structure:
    """Return modes, ranks, margins, distances and verdicts of a model.

    Parameters
    ----------
    model : continuous or sampled.
    input_sets, output_sets : name of a set to names of its signals; ``None`` takes each alone and all.
    scales : `natural_scales` of the whole model if ``None``, so that all sets are judged alike.

    Raises
    ------
    ValueError
        If a set has a name that the model has not.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    inputs = _each_and_all(system.inputs) if input_sets is None else input_sets
    outputs = _each_and_all(system.outputs) if output_sets is None else output_sets
    return Structure(
        system,
        scales,
        modes(system, scales=scales),
        {name: _reached(system, chosen, scales) for name, chosen in inputs.items()},
        {name: _seen(system, chosen, scales) for name, chosen in outputs.items()},
    )


def _each_and_all(names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    sets: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    return sets | {"all": names} if len(names) > 1 else sets


def _reached(system: LinearSystem, inputs: Sequence[str], scales: Scales) -> Access:
    margins = controllability_margins(system, inputs, scales=scales)
    return Access(
        tuple(inputs),
        controllability_rank(system, inputs, scales=scales),
        margins,
        distance_to_uncontrollable(system, inputs, scales=scales),
        distance_to_uncontrollable(system, inputs, scales=scales, region="not decaying"),
        reach(margins),
    )


def _seen(system: LinearSystem, outputs: Sequence[str], scales: Scales) -> Access:
    margins = observability_margins(system, outputs, scales=scales)
    return Access(
        tuple(outputs),
        observability_rank(system, outputs, scales=scales),
        margins,
        distance_to_unobservable(system, outputs, scales=scales),
        distance_to_unobservable(system, outputs, scales=scales, region="not decaying"),
        sight(margins),
    )


def _signals(names: Sequence[str], units: Sequence[str], sizes: NDArray[np.float64]) -> list[dict[str, Any]]:
    return [
        {"name": name, "unit": unit, "scale": float(size)}
        for name, unit, size in zip(names, units, sizes, strict=True)
    ]


def _mode(mode: Mode) -> dict[str, Any]:
    finite = math.isfinite(mode.time_constant)
    return {
        "eigenvalue_1_per_s": _pair(mode.exponent),
        "frequency_hz": mode.frequency,
        "damping_ratio": mode.damping_ratio,
        "time_constant_s": mode.time_constant if finite else None,
        "behaviour": mode.behaviour,
        "shape": {name: _pair(x) for name, x in zip(mode.states, mode.shape, strict=True)},
        "participation": {
            name: None if math.isnan(x) else float(x)
            for name, x in zip(mode.states, mode.participation, strict=True)
        },
    }


def _access(access: Access) -> dict[str, Any]:
    return {
        "signals": list(access.signals),
        "rank": access.rank.rank,
        "singular_values": access.rank.singular_values.tolist(),
        "tolerance": access.rank.tolerance,
        "hidden_states": list(access.rank.hidden_states),
        "margins": [m.margin for m in access.margins],
        "lost": [m.lost for m in access.margins],
        "measures": [m.measures.tolist() for m in access.margins],
        "distance": _distance(access.distance),
        "critical_distance": _distance(access.critical_distance),
        "holds": access.verdict.holds,
        "reason": access.verdict.reason,
    }


def _distance(distance: Distance) -> dict[str, Any]:
    return {"value": distance.value, "lower_bound": distance.lower, "at_1_per_s": _pair(distance.at)}


def _pair(z: complex) -> list[float]:
    return [float(z.real), float(z.imag)]
