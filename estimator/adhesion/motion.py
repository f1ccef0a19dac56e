"""The wheelset of the adhesion bank's filters: its states, and its rates with their partial derivatives.

States, fast ones first (`docs/adhesion.md` has the equations)::

    u, r             lateral velocity (m/s) and yaw rate (rad/s)
    l_L, l_R         driving creepages (r_i omega_i - v)/v
    psi, y, theta    yaw angle, offset from the track (m), twist of the axle (rad)
    p, q             shaped noise (m/s) and offset (m) of the track
    s                logarithm of the friction over that of the condition
    b_g, b_a         offsets of the gyro (rad/s) and of the accelerometer (m/s2)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.creep_law import Rail, creep_force, creep_scale

__all__ = ["STATES", "Vehicle", "linearise"]

Array = NDArray[np.float64]
#: A force of one wheel with its partials by the creepages along and across the rail and by the friction.
Force = tuple[float, float, float, float]

#: Names of the states in their order.
STATES = ("u", "r", "l_L", "l_R", "psi", "y", "theta", "p", "q", "s", "b_g", "b_a")
U, R, L_L, L_R, PSI, Y, THETA, P, Q, S, B_G, B_A = range(12)
N_X = 12
#: The fast states.
N_F = 4
#: Rows of a linearisation: rates of the fast states, which come first, and the torque on the wheels.
TORQUE = 4
#: Variance of the creepage over `creep_scale` squared from which forces are averaged over it.
_BEND = 0.01


class Vehicle(NamedTuple):
    """What all filters share, SI units.

    `cone` is gamma/r0, `k_psi` and `k_rel` the stiffnesses that yaw angle and offset from the track meet.
    """

    patch: Array
    m: float
    I_z: float
    L_g: float
    cone: float
    r_L: float
    r_R: float
    I_L: float
    I_R: float
    k_s: float
    c_s: float
    k_psi: float
    c_psi: float
    k_y: float
    c_y: float
    k_rel: float
    v_min: float


@njit(cache=True, nogil=True, error_model="numpy")
def mean_force(  # pragma: no cover - compiled
    rail: Rail, patch: Array, v: float, a: float, variance: float, b: float, s: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return the mean of `creep_force` over a creepage along the rail of mean a and a variance.

    By two points at one standard deviation, exact to the third moment. Where the spread is small against
    the creepage over which the law bends, one point in the middle does.
    """
    if variance < _BEND * creep_scale(rail, patch) ** 2:
        return creep_force(rail, patch, v, a, b, s)
    d = math.sqrt(variance)
    p = creep_force(rail, patch, v, a - d, b, s)
    q = creep_force(rail, patch, v, a + d, b, s)
    return (
        0.5 * (p[0] + q[0]),
        0.5 * (p[1] + q[1]),
        0.5 * (p[2] + q[2]),
        0.5 * (p[3] + q[3]),
        0.5 * (p[4] + q[4]),
        0.5 * (p[5] + q[5]),
        0.5 * (p[6] + q[6]),
        0.5 * (p[7] + q[7]),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _lateral(  # pragma: no cover - compiled
    car: Vehicle, v: float, x: Array, left: Force, right: Force, f: Array, J: Array
) -> None:
    """Write the row of the lateral velocity."""
    (yL, yL_a, yL_b, yL_s), (yR, yR_a, yR_b, yR_s) = left, right
    im, turn = 1.0 / car.m, car.L_g / v
    yb, ya = yL_b + yR_b, yL_a - yR_a
    f[U] = -im * (yL + yR + car.k_y * (x[Y] + x[Q]) + car.c_y * x[U] + car.k_rel * x[Y])
    J[U, U] = -im * (yb / v + car.c_y)
    J[U, R] = -im * ya * turn
    J[U, L_L] = -im * yL_a
    J[U, L_R] = -im * yR_a
    J[U, PSI] = im * yb
    J[U, Y] = -im * (ya * car.cone + car.k_y + car.k_rel)
    J[U, Q] = -im * car.k_y
    J[U, S] = -im * (yL_s + yR_s)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _yaw(  # pragma: no cover - compiled
    car: Vehicle, v: float, x: Array, left: Force, right: Force, f: Array, J: Array
) -> None:
    """Write the row of the yaw rate."""
    (xL, xL_a, xL_b, xL_s), (xR, xR_a, xR_b, xR_s) = left, right
    iI, turn = car.L_g / car.I_z, car.L_g / v
    xb, xa = xR_b - xL_b, xR_a + xL_a
    k_psi, c_psi = car.k_psi / car.I_z, car.c_psi / car.I_z
    f[R] = iI * (xR - xL) - k_psi * x[PSI] - c_psi * x[R]
    J[R, U] = iI * xb / v
    J[R, R] = -iI * xa * turn - c_psi
    J[R, L_L] = -iI * xL_a
    J[R, L_R] = iI * xR_a
    J[R, PSI] = -iI * xb - k_psi
    J[R, Y] = -iI * xa * car.cone
    J[R, S] = iI * (xR_s - xL_s)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _wheels(  # pragma: no cover - compiled
    car: Vehicle, v: float, v_dot: float, x: Array, left: Force, right: Force, f: Array, J: Array
) -> None:
    """Write the rows of the driving creeps; the torque's share is left out."""
    (xL, xL_a, xL_b, xL_s), (xR, xR_a, xR_b, xR_s) = left, right
    rL, rR, turn = car.r_L, car.r_R, car.L_g / v
    k_L, k_R = rL / (v * car.I_L), rR / (v * car.I_R)
    d_L, d_R, growth = car.c_s * v / rL, car.c_s * v / rR, v_dot / v
    twist = car.k_s * x[THETA] + d_R * (1.0 + x[L_R]) - d_L * (1.0 + x[L_L])
    f[L_L] = k_L * (twist - rL * xL) - (1.0 + x[L_L]) * growth
    f[L_R] = -k_R * (twist + rR * xR) - (1.0 + x[L_R]) * growth
    J[L_L, U] = -k_L * rL * xL_b / v
    J[L_L, R] = -k_L * rL * xL_a * turn
    J[L_L, L_L] = -k_L * (rL * xL_a + d_L) - growth
    J[L_L, L_R] = k_L * d_R
    J[L_L, PSI] = k_L * rL * xL_b
    J[L_L, Y] = -k_L * rL * xL_a * car.cone
    J[L_L, THETA] = k_L * car.k_s
    J[L_L, S] = -k_L * rL * xL_s
    J[L_R, U] = -k_R * rR * xR_b / v
    J[L_R, R] = k_R * rR * xR_a * turn
    J[L_R, L_L] = k_R * d_L
    J[L_R, L_R] = -k_R * (rR * xR_a + d_R) - growth
    J[L_R, PSI] = k_R * rR * xR_b
    J[L_R, Y] = k_R * rR * xR_a * car.cone
    J[L_R, THETA] = -k_R * car.k_s
    J[L_R, S] = -k_R * rR * xR_s


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def linearise(  # pragma: no cover - compiled
    car: Vehicle, rails: Array, held: bool, v: float, v_dot: float, x: Array, C: Array, f: Array, J: Array
) -> None:
    """Write the rates f (5,) at x without the torque's share, and their partials J (5, 12)."""
    v = max(abs(v), car.v_min)
    turn = car.L_g / v
    g = turn * x[R] + car.cone * x[Y]
    b = x[U] / v - x[PSI]
    s = x[S]
    spread = turn * turn * C[R, R] + car.cone * car.cone * C[Y, Y] + 2.0 * turn * car.cone * C[R, Y]
    d_L = spread + C[L_L, L_L] + 2.0 * (turn * C[R, L_L] + car.cone * C[Y, L_L])
    d_R = spread + C[L_R, L_R] - 2.0 * (turn * C[R, L_R] + car.cone * C[Y, L_R])
    left = (rails[0, 0], rails[0, 1], rails[0, 2], rails[0, 3], rails[0, 4])
    right = (rails[1, 0], rails[1, 1], rails[1, 2], rails[1, 3], rails[1, 4])
    xL, yL, xL_a, xL_b, yL_a, yL_b, xL_s, yL_s = mean_force(left, car.patch, v, x[L_L] + g, d_L, b, s)
    xR, yR, xR_a, xR_b, yR_a, yR_b, xR_s, yR_s = mean_force(right, car.patch, v, x[L_R] - g, d_R, b, s)

    _lateral(car, v, x, (yL, yL_a, yL_b, yL_s), (yR, yR_a, yR_b, yR_s), f, J)
    _yaw(car, v, x, (xL, xL_a, xL_b, xL_s), (xR, xR_a, xR_b, xR_s), f, J)
    rL, rR = car.r_L, car.r_R
    f[TORQUE] = rL * xL + rR * xR
    J[TORQUE, U] = (rL * xL_b + rR * xR_b) / v
    J[TORQUE, R] = (rL * xL_a - rR * xR_a) * turn
    J[TORQUE, L_L] = rL * xL_a
    J[TORQUE, L_R] = rR * xR_a
    J[TORQUE, PSI] = -(rL * xL_b + rR * xR_b)
    J[TORQUE, Y] = (rL * xL_a - rR * xR_a) * car.cone
    J[TORQUE, S] = rL * xL_s + rR * xR_s

    if not held:
        _wheels(car, v, v_dot, x, (xL, xL_a, xL_b, xL_s), (xR, xR_a, xR_b, xR_s), f, J)
