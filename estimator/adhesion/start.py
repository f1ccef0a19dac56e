"""Where a filter starts, and starts again when it has lost the wheelset."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.creep_law import creep_force, creep_scale
from estimator.adhesion.motion import (
    B_A,
    B_G,
    L_L,
    L_R,
    N_X,
    PSI,
    THETA,
    P,
    Q,
    R,
    S,
    U,
    Vehicle,
    Y,
    linearise,
)

if TYPE_CHECKING:
    from estimator.adhesion.ekf import Filter, Track

__all__ = ["Prior", "start_creep", "start_filter"]

Array = NDArray[np.float64]


class Prior(NamedTuple):
    """Standard deviations at the start.

    Of the yaw angle (rad), of the offset from the track (m), of the guiding and of the lateral creepage
    over `creep_scale`, of the creep over its value, of the axle's twist (rad), and of the sensors'
    offsets.
    """

    psi: float = 0.5e-3
    y: float = 1e-3
    guidance: float = 0.3
    lateral: float = 0.1
    creep: float = 0.1
    theta: float = 3e-5
    b_g: float = 0.0
    b_a: float = 0.0


#: Of the interval in which the creep is sought: to 1e-7 of it, where the prior leaves a tenth of the creep.
_HALVINGS = 24
#: The guiding creepage is held back by the yaw stiffness, whatever the rail.
_GUIDANCE = 3e-4
_LATERAL = 1e-3


@njit(cache=True, nogil=True, error_model="numpy")
def _rolling_torque(
    car: Vehicle, rails: Array, v: float, creep: float, s: float
) -> float:  # pragma: no cover - compiled
    """Return the torque on both wheels that run straight at a driving creep with the friction s."""
    left = creep_force(rails[0], car.patch, v, creep, 0.0, s)
    right = creep_force(rails[1], car.patch, v, creep, 0.0, s)
    return car.r_L * left[0] + car.r_R * right[0]


@njit(cache=True, nogil=True, error_model="numpy")
def start_creep(  # pragma: no cover - compiled
    car: Vehicle, rails: Array, v: float, torque: float, peak: float, held: bool, creep: float, s: float
) -> float:
    """Return the driving creep with which a filter starts whose friction has the logarithm s.

    Where the curve balances the torque: below the creep of the `peak`, or past it for a held creep > 1; at
    the peak, or at `creep` times it, if it does so nowhere. Without a torque (NaN) at `creep` times it.
    """
    if math.isnan(torque):
        return creep * peak
    past = held and creep > 1.0
    lower, upper = (peak, 1.0) if past else (0.0, peak)
    wanted = abs(torque)
    lowest, highest = (upper, lower) if past else (lower, upper)
    least, most = _rolling_torque(car, rails, v, lowest, s), _rolling_torque(car, rails, v, highest, s)
    if not least <= wanted <= most:
        return math.copysign(creep * peak if held else peak, torque)
    for _ in range(_HALVINGS):
        middle = 0.5 * (lower + upper)
        if (_rolling_torque(car, rails, v, middle, s) < wanted) == past:
            upper = middle
        else:
            lower = middle
    return math.copysign(0.5 * (lower + upper), torque)


@njit(cache=True, nogil=True, error_model="numpy")
def start_filter(  # pragma: no cover - compiled
    car: Vehicle,
    track: Track,
    prior: Prior,
    rails: Array,
    held: bool,
    v: float,
    torque: float,
    creep: float,
    s: float,
    kept: Filter,
) -> None:
    """Write the state and covariance of a filter that has seen nothing, at a driving creep and a friction.

    The fast motions have died out: lateral velocity and yaw rate follow yaw angle and offset but for small
    creepages. Spread freely they would put the first samples where the creep law is saturated.
    """
    v = max(v, car.v_min)
    x, C = kept.x, kept.C
    x[:] = 0.0
    C[:, :] = 0.0
    scale = max(creep_scale(rails[0], car.patch), creep_scale(rails[1], car.patch))
    psi2, y2 = prior.psi**2, prior.y**2
    b2 = (prior.lateral * min(scale, _LATERAL)) ** 2
    g2 = min(prior.guidance * scale, _GUIDANCE) ** 2
    # u = v (psi + b) and r = (g - cone y) v/L_g with b the lateral and g the guiding creepage.
    turn = v / car.L_g
    C[PSI, PSI], C[Y, Y] = psi2, y2
    C[U, U], C[R, R] = v * v * (psi2 + b2), turn * turn * (g2 + car.cone**2 * y2)
    C[U, PSI] = C[PSI, U] = v * psi2
    C[R, Y] = C[Y, R] = -turn * car.cone * y2

    x[S] = s
    x[L_L] = x[L_R] = creep
    l2 = (prior.creep * max(abs(creep), 0.1 * scale)) ** 2
    for i in (L_L, L_R):
        for j in (L_L, L_R):
            C[i, j] = l2
    C[L_L, L_L] += 0.1 * l2
    if not math.isnan(torque):
        x[THETA] = 0.5 * torque / car.k_s
    C[THETA, THETA] = prior.theta**2 + (prior.creep * x[THETA]) ** 2

    a, b = track.Wc * v, track.Wr * v
    level = track.level * v**3
    C[P, P] = level / (2.0 * a)
    C[P, Q] = C[Q, P] = level / (2.0 * a * (a + b))
    C[Q, Q] = level / (2.0 * a * b * (a + b))
    C[B_G, B_G] = prior.b_g**2
    C[B_A, B_A] = prior.b_a**2
    kept.torque[0] = torque
    for i in range(N_X):
        kept.x0[i] = x[i]
    linearise(car, rails, held, v, 0.0, x, C, kept.f, kept.J)
