"""Bounds for creep and peak adhesion, from the information about the slopes of the creep curve."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import null_space

from estimator.contact import CreepCurve
from estimator.identifiability.fisher import bound_of
from estimator.linear_models import OperatingPoint, point_at

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from fmu_wheelset.parameters import RailCondition

__all__ = ["UNKNOWN", "Slopes", "creep_bound", "peak_adhesion_bound", "same_force", "small_signal"]

Array = NDArray[np.float64]
#: Returns force, g11 and g22 (3, n) of a curve at creeps (n,), N.
Slopes: TypeAlias = "Callable[[CreepCurve, Array], Array]"

#: What of a rail condition is unknown unless told otherwise; ``stiffness`` stands for k_A and k_S in a fixed
#: ratio.
UNKNOWN = ("mu_0", "stiffness")
_FIELDS = ("mu_0", "k_A", "k_S", "A", "B")
_STEP = 1e-4


def small_signal(curve: CreepCurve, creep: Array) -> Array:
    """Return force, tangent and secant (3, n) of a curve at creeps (n,), N."""
    return np.stack([curve.force(creep), curve.tangent(creep), curve.secant(creep)])


def creep_bound(
    curve: CreepCurve, creep: ArrayLike, information: Array, *, slopes: Slopes = small_signal
) -> Array:
    """Return the least standard deviation (n,) of the creep at `creep` (n,), of a known curve.

    Parameters
    ----------
    information : (n, 2, 2) about the slopes g11 and g22, 1/N^2.
    slopes : returns force and slopes (3, n) of a curve, small signals or averaged.
    """
    at = np.asarray(creep, dtype=np.float64)
    gradient = _over_creep(curve, at, slopes)[1:].T
    fisher = np.einsum("ni,nij,nj->n", gradient, information, gradient)
    return at * bound_of(fisher[:, None, None], np.ones((at.size, 1)), np.ones(1))


def _over_creep(curve: CreepCurve, creep: Array, slopes: Slopes) -> Array:
    """Return the derivatives (3, n) of force and slopes with respect to ln creep, N."""
    return (slopes(curve, creep * math.exp(_STEP)) - slopes(curve, creep * math.exp(-_STEP))) / (2.0 * _STEP)


def peak_adhesion_bound(
    curve: CreepCurve,
    creep: ArrayLike,
    information: Array,
    *,
    unknown: Sequence[str] = UNKNOWN,
    prior: Mapping[str, float] | None = None,
    slopes: Slopes = small_signal,
) -> Array:
    """Return the least standard deviation (n,) of the peak adhesion of a rail at a known force.

    The force is known from the traction torque, so creep and condition move together on ``F(creep) = const``:
    what the sensors tell of the slopes is all that is left to tell one condition from another.

    Parameters
    ----------
    curve : of the true condition. creep : where the wheelset runs.
    information : (n, 2, 2) about the slopes g11 and g22, 1/N^2.
    unknown : of ``mu_0, k_A, k_S, A, B`` and ``stiffness``, the last for k_A and k_S together.
    prior : relative standard deviations of some of them, known beforehand.
    slopes : as in `creep_bound`.

    Returns
    -------
    Standard deviation, of adhesion; ``inf`` where conditions with other peaks cannot be told from the true
    one.

    Raises
    ------
    ValueError
        If a name is unknown.
    """
    beforehand = _known_before(unknown, prior or {})
    at, peak = np.asarray(creep, dtype=np.float64), np.asarray(curve.peak_creep)
    pairs = [(_changed(curve, name, _STEP), _changed(curve, name, -_STEP)) for name in unknown]
    # Force and slopes over (ln creep, ln unknown ...), (n, 3, 1 + u).
    along = np.stack(
        [_over_creep(curve, at, slopes), *((slopes(a, at) - slopes(b, at)) / (2.0 * _STEP) for a, b in pairs)]
    )
    jacobian = np.moveaxis(along, 2, 0).swapaxes(1, 2)
    # Of the peak, where creep is at its best and does not count.
    rise = [float(a.force(peak) - b.force(peak)) / (2.0 * _STEP * curve.N) for a, b in pairs]
    gradient = np.array([0.0, *rise])
    return np.array(
        [_bound_on_curve(J, I_g, beforehand, gradient) for J, I_g in zip(jacobian, information, strict=True)]
    )


def _known_before(unknown: Sequence[str], prior: Mapping[str, float]) -> Array:
    """Return the information beforehand over (ln creep, ln unknown ...)."""
    wrong = sorted(set(unknown) - {*_FIELDS, "stiffness"}) or sorted(set(prior) - set(unknown))
    if wrong or not unknown:
        raise ValueError(
            f"peak adhesion: got {', '.join(wrong) or 'nothing'} as unknown, expected some of "
            f"{', '.join((*_FIELDS, 'stiffness'))}, and priors of these only; change the names"
        )
    return np.diag([0.0, *(prior.get(name, math.inf) ** -2.0 for name in unknown)])


def _bound_on_curve(jacobian: Array, information: Array, beforehand: Array, gradient: Array) -> float:
    """Return the bound for what has this gradient, along the directions in which the force stays."""
    force = jacobian[0]
    if not (np.isfinite(jacobian).all() and np.isfinite(information).all()):
        return math.nan
    free = null_space(force[None] / np.linalg.norm(force))
    fisher = free.T @ (jacobian[1:].T @ information @ jacobian[1:] + beforehand) @ free
    return float(bound_of(fisher, free.T @ gradient, np.ones(free.shape[1])))


def _changed(curve: CreepCurve, name: str, by: float) -> CreepCurve:
    """Return the curve of a condition with one parameter changed by a small part."""
    names = ("k_A", "k_S") if name == "stiffness" else (name,)
    values = {n: getattr(curve.condition, n) * math.exp(by) for n in names}
    return CreepCurve(replace(curve.condition, **values), curve.v, curve.N, curve.patch)


def same_force(
    curve: CreepCurve, creep: float, conditions: Mapping[str, RailCondition]
) -> dict[str, OperatingPoint]:
    """Return the operating points, below the peak, of all conditions that carry the same force.

    It is that of `curve` at `creep`. With the traction torque known these are the hypotheses that are left;
    the others cannot carry it.
    """
    adhesion = float(curve.force(creep)) / curve.N
    found = {}
    for name, condition in conditions.items():
        other = CreepCurve(condition, curve.v, curve.N, curve.patch)
        if other.peak_adhesion > adhesion:
            found[name] = point_at(other, name, other.creep_at(adhesion))
    return found
