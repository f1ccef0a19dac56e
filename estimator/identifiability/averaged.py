"""Slopes of the creep curve averaged over the motion that the track causes: statistical linearisation.

Where the track moves the creep as far as the working creep, the slopes at a point are not what the wheelset
feels. For normally distributed creepages ``lambda_0 + d_x`` and ``d_y`` the linear law that fits best has
``g11 = E[f_x d_x]/E[d_x^2]`` and ``g22 = E[f_y d_y]/E[d_y^2]``, and the mean force is ``E[f_x]`` (Booton
1954). The motion follows from the slopes and the slopes from the motion, so they are found by repetition.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from estimator.identifiability.wheelset import driven_by_track
from estimator.linear_models import OperatingPoint, wheelset_model
from fmu_wheelset.parameters import WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    from estimator.contact import CreepCurve
    from estimator.track_spectrum import TrackSpectrum

__all__ = ["averaged_points", "averaged_same_force"]

Array = NDArray[np.float64]

#: Points in each direction; the law has a corner at zero creep, which sets the accuracy: one per cent.
_NODES = 21
_ROUNDS, _ACCURACY = 100, 1e-7
#: Mean creepages between which a mean force is looked for, over that of the peak.
_SHARES = np.geomspace(2e-3, 1.0, 28)


def averaged_points(
    curve: CreepCurve, creep: ArrayLike, track: TrackSpectrum, wheelset: WheelsetParameters | None = None
) -> tuple[OperatingPoint, ...]:
    """Return mean forces and averaged slopes at mean creepages (n,) on an irregular track.

    With the creepage imposed on both wheels. NaN where the motion has no steady state, as past the peak.
    """
    mean = np.atleast_1d(np.asarray(creep, dtype=np.float64))
    motion = _Motion(curve.v, track, wheelset or WheelsetParameters())
    slopes = np.stack([curve.tangent(mean), curve.secant(mean)])
    # At the peak the first guess must leave the wheelset stable: with no slope at all, nothing would move it.
    slopes[0] = np.maximum(slopes[0], 1e-3 * slopes[1])
    force = np.full_like(mean, np.nan)
    for _ in range(_ROUNDS):
        sigma_x, sigma_y = motion.creep_rms(*slopes)
        force, *found = _averages(curve, mean, sigma_x, sigma_y)
        # Half of the way: more motion makes other slopes, and these less motion, to and fro.
        following = np.sqrt(slopes * np.where(np.array(found) > 0.0, found, np.nan))
        change = np.nanmax(np.abs(following / slopes - 1.0), initial=0.0)
        slopes = following
        if change < _ACCURACY:
            break
    force = np.where(np.isnan(slopes[0]), np.nan, force)
    return tuple(
        OperatingPoint("averaged", float(c), float(F), float(g11), float(g22), curve.v)
        for c, F, g11, g22 in zip(mean, force, *slopes, strict=True)
    )


class _Motion:
    """How much the track moves the creepages, as a function of the slopes; the model is affine in these."""

    def __init__(self, v: float, track: TrackSpectrum, wheelset: WheelsetParameters) -> None:
        def matrices(g11: float, g22: float) -> tuple[Array, Array]:
            point = OperatingPoint("", 0.0, 0.0, g11, g22, v)
            model = driven_by_track(wheelset_model(point, wheelset), track, v)
            return np.asarray(model.A), np.asarray(model.B)

        unit = 1e6
        self._A, B = matrices(0.0, 0.0)
        self._per_g11 = (matrices(unit, 0.0)[0] - self._A) / unit
        self._per_g22 = (matrices(0.0, unit)[0] - self._A) / unit
        self._noise = B @ B.T
        # Creepages over y, psi, y_dot, psi_dot, y_t, y_t_fast: (1) and (3).
        slope = wheelset.gamma / wheelset.r0
        self._creep = np.array(
            [[slope, 0.0, 0.0, wheelset.L_g / v, -slope, 0.0], [0.0, -1.0, 1.0 / v, 0.0, 0.0, 0.0]]
        )

    def creep_rms(self, g11: Array, g22: Array) -> tuple[Array, Array]:
        """Return the rms (n,) of the longitudinal and lateral creepage; NaN without steady state."""
        A = self._A + g11[:, None, None] * self._per_g11 + g22[:, None, None] * self._per_g22
        steady = np.all(np.isfinite(A), axis=(1, 2))
        steady[steady] = np.max(np.linalg.eigvals(A[steady]).real, axis=-1) < 0.0
        rms = np.full((2, len(A)), np.nan)
        if steady.any():
            P = _lyapunov(A[steady], self._noise)
            rms[:, steady] = np.sqrt(np.einsum("is,nst,it->in", self._creep, P, self._creep))
        return rms[0], rms[1]


def _lyapunov(A: Array, W: Array) -> Array:
    """Solve ``A P + P A' + W = 0`` for a batch (n, s, s) of small matrices by Kronecker products."""
    s = A.shape[-1]
    eye = np.eye(s)
    operator = np.einsum("nik,jl->nijkl", A, eye) + np.einsum("ik,njl->nijkl", eye, A)
    flat = np.linalg.solve(
        operator.reshape(-1, s * s, s * s), np.broadcast_to(-W.reshape(-1, 1), (len(A), s * s, 1))
    )
    return np.asarray(flat.reshape(-1, s, s))


def _averages(curve: CreepCurve, creep: Array, sigma_x: Array, sigma_y: Array) -> tuple[Array, Array, Array]:
    """Return E[f_x] and both averaged slopes (n,) by Gauss-Hermite quadrature."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    weights = weights / weights.sum()
    d_x, d_y = sigma_x[:, None, None] * nodes[:, None], sigma_y[:, None, None] * nodes
    f_x, f_y = curve.forces(creep[:, None, None] + d_x, d_y)

    def mean(values: Array) -> Array:
        return np.asarray(np.einsum("i,nij,j->n", weights, values, weights))

    return mean(f_x), mean(f_x * d_x) / sigma_x**2, mean(f_y * d_y) / sigma_y**2


def averaged_same_force(
    force: ArrayLike,
    curves: Mapping[str, CreepCurve],
    track: TrackSpectrum,
    wheelset: WheelsetParameters | None = None,
) -> dict[str, tuple[OperatingPoint | None, ...]]:
    """Return the averaged points at which each curve has mean forces (n,) of one wheel, N.

    ``None`` where the motion leaves less than that force up to the creep of the peak. Slopes are interpolated
    between points of the curve.
    """
    wanted = np.atleast_1d(np.asarray(force, dtype=np.float64))
    found: dict[str, tuple[OperatingPoint | None, ...]] = {}
    for name, curve in curves.items():
        points = averaged_points(curve, _SHARES * curve.peak_creep, track, wheelset)
        table = np.array([(p.force, p.creep, p.g11, p.g22) for p in points if np.isfinite(p.force)])
        if len(table) < 2:
            found[name] = (None,) * wanted.size
            continue
        rising = table[: int(np.argmax(table[:, 0])) + 1]
        along = PchipInterpolator(np.log(rising[:, 0]), np.log(rising[:, 1:]))
        creep, g11, g22 = np.exp(along(np.log(np.clip(wanted, rising[0, 0], rising[-1, 0])))).T
        found[name] = tuple(
            OperatingPoint(name, float(c), float(F), float(a), float(b), curve.v)
            if rising[0, 0] <= F <= rising[-1, 0]
            else None
            for F, c, a, b in zip(wanted, creep, g11, g22, strict=True)
        )
    return found
