"""Bounds for creep and peak adhesion, from the information about the slopes of the creep curve."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import null_space

from estimator.contact import CreepCurve
from estimator.identifiability.fisher import bound_of
from estimator.linear_models import OperatingPoint, point_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fmu_wheelset.parameters import RailCondition

__all__ = ["UNKNOWN", "creep_bound", "peak_adhesion_bound", "same_force"]

Array = NDArray[np.float64]

#: What of a rail condition is unknown unless told otherwise; ``stiffness`` stands for k_A and k_S in a fixed
#: ratio.
UNKNOWN = ("mu_0", "stiffness")
_FIELDS = ("mu_0", "k_A", "k_S", "A", "B")
_STEP = 1e-5


def creep_bound(curve: CreepCurve, creep: ArrayLike, information: Array) -> Array:
    """Return the least standard deviation (...) of the creep at `creep` (...), of a known curve.

    Parameters
    ----------
    information : (..., 2, 2) about the slopes g11 and g22, 1/N^2.
    """
    at = np.asarray(creep, dtype=np.float64)
    gradient = _slopes_over_creep(curve, at)
    fisher = np.einsum("...i,...ij,...j->...", gradient, information, gradient)
    return bound_of(fisher[..., None, None], np.ones((*at.shape, 1)), at[..., None])


def _slopes_over_creep(curve: CreepCurve, creep: Array) -> Array:
    """Return d(g11, g22)/d creep (..., 2), N."""
    step = _STEP * creep
    bend = (curve.tangent(creep + step) - curve.tangent(creep - step)) / (2.0 * step)
    return np.stack([bend, (curve.tangent(creep) - curve.secant(creep)) / creep], axis=-1)


def peak_adhesion_bound(
    curve: CreepCurve,
    creep: float,
    information: Array,
    *,
    unknown: Sequence[str] = UNKNOWN,
    prior: Mapping[str, float] | None = None,
) -> float:
    """Return the least standard deviation of the peak adhesion of a rail, at `creep` and a known force.

    The force is known from the traction torque, so creep and condition move together on ``F(creep) =
    const``: what the sensors tell of the slopes is all that is left to tell one condition from another.

    Parameters
    ----------
    curve : of the true condition. creep : where the wheelset runs.
    information : (2, 2) about the slopes g11 and g22, 1/N^2.
    unknown : of ``mu_0, k_A, k_S, A, B`` and ``stiffness``, the last for k_A and k_S together.
    prior : relative standard deviations of some of them, known beforehand.

    Returns
    -------
    Standard deviation, of adhesion; ``inf`` where conditions with other peaks cannot be told from the true
    one.

    Raises
    ------
    ValueError
        If a name is unknown.
    """
    wrong = sorted(set(unknown) - {*_FIELDS, "stiffness"}) or sorted(set(prior or {}) - set(unknown))
    if wrong or not unknown:
        raise ValueError(
            f"peak adhesion: got {', '.join(wrong) or 'nothing'} as unknown, expected some of "
            f"{', '.join((*_FIELDS, 'stiffness'))}, and priors of these only; change the names"
        )
    at, peak = np.asarray(creep), np.asarray(curve.peak_creep)
    pairs = [(_changed(curve, name, _STEP), _changed(curve, name, -_STEP)) for name in unknown]

    def slope(value: str, where: Array) -> Array:
        return np.array(
            [float(getattr(a, value)(where) - getattr(b, value)(where)) / (2.0 * _STEP) for a, b in pairs]
        )

    # Over (ln creep, ln unknown ...): the slopes, the force that stays, and the peak, where creep is at its
    # best.
    along = _slopes_over_creep(curve, at) * creep
    jacobian = np.column_stack([along, np.stack([slope("tangent", at), slope("secant", at)])])
    force = np.concatenate([[float(curve.tangent(at)) * creep], slope("force", at)])
    gradient = np.concatenate([[0.0], slope("force", peak) / curve.N])
    known = np.array([0.0, *((prior or {}).get(name, math.inf) for name in unknown)])
    beforehand = np.diag([0.0, *(1.0 / np.square(known[1:]))])
    free = null_space(force[None] / np.linalg.norm(force))
    fisher = free.T @ (jacobian.T @ information @ jacobian + beforehand) @ free
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
