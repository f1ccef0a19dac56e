"""One extended Kalman filter of the adhesion bank, compiled.

A step over h is split after Strang: half a step of the slow states with the fast ones held, a step of
the fast ones by an exponential Rosenbrock method, half a step of the slow ones. The fast poles
(-1e3 1/s at 20 m/s, -1.6e4 1/s at 1 m/s) enter through a rational approximation of the exponential that is
damped at infinity and exact in the steady state that they pull to, and that steady state moves with the
slow states over the whole step. Left where these are in the middle of the step, the fast states would lag by
half a step, which the accelerometer sees: at 2 m/s on low rail 10 1/s times the yaw rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.correction import correct
from estimator.adhesion.motion import (
    B_A,
    B_G,
    L_R,
    N_F,
    N_X,
    TORQUE,
    P,
    Q,
    R,
    S,
    U,
    Vehicle,
    Y,
    linearise,
)
from estimator.adhesion.rows import put, quad, row, total
from estimator.adhesion.transition import Slow, add_fast_noise, drift, move_slow, slow_transition, spread

__all__ = ["Filter", "Noise", "Room", "Track", "filter_step", "new_filter", "parted"]

Array = NDArray[np.float64]

#: What a step tells.
LOG_L, SQUARE, COUNT, E_YAW, S_YAW, E_ACC, S_ACC, ON_WHEELS = range(8)


class Noise(NamedTuple):
    """Variances of the measurements (R) and intensities of the noises (W), SI units.

    `s_decay` (1/s) pulls the friction back to its condition.
    """

    R_yaw: float
    R_acc: float
    R_torque: float
    W_u: float
    W_r: float
    W_torque: float
    s_decay: float
    W_bg: float
    W_ba: float


class Track(NamedTuple):
    """Corners (rad/m) of the track's spectrum and its level pi A Wc^2."""

    Wc: float
    Wr: float
    level: float


class Filter(NamedTuple):
    """What one filter keeps.

    State x (12,) and covariance C (12, 12); the rates f (5,) at x0 (12,) and their partials J (5, 12);
    what `track_step` has found (7,); the torque of the last sample (1,).
    """

    x: Array
    C: Array
    x0: Array
    f: Array
    J: Array
    over_track: Array
    torque: Array


class Room(NamedTuple):
    """Work space of a step (5, 4, 12), and its parts."""

    all: Array
    M: Array
    Z: Array
    phi: Array
    ramp: Array
    D: Array


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def parted(work: Array) -> Room:  # pragma: no cover - compiled
    """Return the parts of a work space (5, 4, 12)."""
    return Room(work, work[0], work[1], work[2], work[3], work[4])


def new_filter() -> Filter:
    """Return the memory of a filter before its start."""
    return Filter(
        np.zeros(N_X),
        np.zeros((N_X, N_X)),
        np.zeros(N_X),
        np.zeros(5),
        np.zeros((5, N_X)),
        np.zeros(7),
        np.zeros(1),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _exponential(Z: Array, phi: Array, ramp: Array, D: Array) -> None:  # pragma: no cover - compiled
    """Write phi_1(Z) and 2 phi_2(Z) - phi_1(Z) of a 4 x 4 matrix by the (1, 2) Pade approximant of exp.

    phi_1 = (exp(Z) - 1)/Z and phi_2 = (phi_1 - 1)/Z. exp(Z) ~ D^-1 (1 + Z/3) with D = 1 - 2 Z/3 + Z^2/6, so
    phi_1 ~ D^-1 (1 - Z/6) and 2 phi_2 - phi_1 ~ -D^-1 Z/6. Solved after Gauss and Jordan; D is work space.
    All have twelve columns, of which four are used.
    """
    for i in range(N_F):
        square = (Z[i, 0] * quad(Z, 0) + Z[i, 1] * quad(Z, 1)) + (Z[i, 2] * quad(Z, 2) + Z[i, 3] * quad(Z, 3))
        put(D, i, (1.0 / 6.0) * square - (2.0 / 3.0) * quad(Z, i))
        put(ramp, i, (-1.0 / 6.0) * quad(Z, i))
        put(phi, i, quad(ramp, i))
        D[i, i] += 1.0
        phi[i, i] += 1.0
    for k in range(N_F):
        pivot = 1.0 / D[k, k]
        d, p, r = pivot * quad(D, k), pivot * quad(phi, k), pivot * quad(ramp, k)
        for i in range(N_F):
            if i != k:
                put(phi, i, quad(phi, i) - D[i, k] * p)
                put(ramp, i, quad(ramp, i) - D[i, k] * r)
                put(D, i, quad(D, i) - D[i, k] * d)
        put(phi, k, p)
        put(ramp, k, r)
        put(D, k, d)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def track_step(track: Track, v: float, h: float, out: Array) -> None:  # pragma: no cover - compiled
    """Write what a step over the track needs, (7,): v, decays and coupling of h/2, covariances of h.

    p' = -a p + w and q' = -b q + p with a = W_c v, b = W_r v and w of the intensity pi A v^3 W_c^2:
    the shaping filter of the spectrum, solved exactly.
    """
    if out[0] == v:
        return
    out[0] = v
    a, b = track.Wc * v, track.Wr * v
    e_p, e_q = math.exp(-0.5 * a * h), math.exp(-0.5 * b * h)
    out[1], out[2], out[3] = e_p, e_q, (e_q - e_p) / (a - b)
    e_pp, e_pq, e_qq = e_p**4, (e_p * e_q) ** 2, e_q**4
    pp, pq, qq = (1.0 - e_pp) / (2.0 * a), (1.0 - e_pq) / (a + b), (1.0 - e_qq) / (2.0 * b)
    level = track.level * v**3
    out[4] = level * pp
    out[5] = level * (pq - pp) / (a - b)
    out[6] = level * max(qq - 2.0 * pq + pp, 0.0) / (a - b) ** 2


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _fast(slow: Slow, h: float, push: float, kept: Filter, room: Room) -> None:  # pragma: no cover - compiled
    """Advance the fast states by h, behind half a step of the slow ones, which go on as they did in it.

    `push` is the torque's share of l_R'. Leaves the fast states' rows of the transition in `room.M`.
    """
    x, f, J = kept.x, kept.f, kept.J
    M, Z, phi, ramp, rate = room.M, room.Z, room.phi, room.ramp, room.D
    for i in range(N_F):
        put(Z, i, h * quad(J, i))
    _exponential(Z, phi, ramp, room.D)
    G = room.Z
    drift(slow, J, G)
    change = row(x, 0) - row(kept.x0, 0)
    for i in range(N_F):
        moved = total(row(J, i) * change)
        rate[0, i], rate[1, i] = f[i] + moved, moved
    rate[0, L_R] += push
    for i in range(N_F):
        a, b, c, d = h * phi[i, 0], h * phi[i, 1], h * phi[i, 2], h * phi[i, 3]
        p, q, r, s = h * ramp[i, 0], h * ramp[i, 1], h * ramp[i, 2], h * ramp[i, 3]
        x[i] += a * rate[0, 0] + b * rate[0, 1] + c * rate[0, 2] + d * rate[0, 3]
        x[i] += p * rate[1, 0] + q * rate[1, 1] + r * rate[1, 2] + s * rate[1, 3]
        of_J = (a * row(J, 0) + b * row(J, 1)) + (c * row(J, 2) + d * row(J, 3))
        put(M, i, of_J + ((p * row(G, 0) + q * row(G, 1)) + (r * row(G, 2) + s * row(G, 3))))
        M[i, i] += 1.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _add_slow_noise(  # pragma: no cover - compiled
    noise: Noise, friction: Array, h: float, over_track: Array, x: Array, C: Array
) -> None:
    """Add the noise of the slow states over h.

    The friction, with its mean and deviation (2,), returns to its condition, so it grows vague.
    """
    C[P, P] += over_track[4]
    for i, sign in ((Q, 1.0), (Y, -1.0)):
        C[i, i] += over_track[6]
        C[i, P] += sign * over_track[5]
        C[P, i] += sign * over_track[5]
    C[Q, Y] -= over_track[6]
    C[Y, Q] -= over_track[6]
    left = h * noise.s_decay
    keep = 1.0 - left
    x[S] = keep * x[S] + left * friction[0]
    for j in range(N_X):
        C[S, j] *= keep
    for j in range(N_X):
        C[j, S] *= keep
    C[S, S] += 2.0 * left * friction[1] * friction[1]
    C[B_G, B_G] += h * noise.W_bg
    C[B_A, B_A] += h * noise.W_ba


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def predict(  # pragma: no cover - compiled
    car: Vehicle, track: Track, noise: Noise, friction: Array, held: bool, W_creep: float,
    v: float, torque: float, h: float, kept: Filter, room: Room,
) -> None:  # fmt: skip
    """Advance x and C of a filter by h.

    A torque that has changed since the last sample was somewhere between the two. Branches are of numbers
    only: about others the compiler would count the references of all arrays at each step.
    """
    x, over_track = kept.x, kept.over_track
    v = max(v, car.v_min)
    track_step(track, v, h, over_track)
    slow = slow_transition(car, held, v, 0.5 * h, over_track)
    common = W_creep if held else noise.W_torque * (car.r_R / (v * (car.I_L + car.I_R))) ** 2
    per_torque = car.r_R / (v * car.I_R)
    half = 0.0 if held else 0.5 * (torque - kept.torque[0])
    single = (h * half * per_torque) ** 2
    add_fast_noise(slow, h * noise.W_u, h * noise.W_r, h * common, single, kept.C)
    move_slow(slow, x)
    _fast(slow, h, 0.0 if held else (torque - half) * per_torque, kept, room)
    move_slow(slow, x)
    spread(slow, room.M, kept.C, room.all)
    _add_slow_noise(noise, friction, h, over_track, x, kept.C)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _row_of(J: Array, i: int, x: Array, x0: Array, H: Array) -> float:  # pragma: no cover - compiled
    """Copy row i of J to the first of H; return by how much the value of that row has moved from x0 to x."""
    partials = row(J, i)
    put(H, 0, partials)
    return total(partials * (row(x, 0) - row(x0, 0)))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _measure(  # pragma: no cover - compiled
    noise: Noise, held: bool, moves: bool, torque: float, z_yaw: float, z_acc: float, kept: Filter,
    room: Array, told: Array,
) -> None:  # fmt: skip
    """Take a sample (NaN: not usable) and the torque of a held creep into the state, one after the other.

    A wheelset that stands says nothing of its rail.
    """
    x, C, x0, f, J = kept.x, kept.C, kept.x0, kept.f, kept.J
    if moves and not math.isnan(z_yaw):
        for j in range(N_X):
            room[0, j] = 0.0
        room[0, R] = 1.0
        room[0, B_G] = 1.0
        e = z_yaw - x[R] - x[B_G]
        S_e = correct(e, noise.R_yaw, x, C, room)
        told[LOG_L] -= 0.5 * (math.log(S_e) + e * e / S_e)
        told[SQUARE] += e * e / S_e
        told[COUNT] += 1.0
        told[E_YAW], told[S_YAW] = e, S_e
    if moves and not math.isnan(z_acc):
        e = z_acc - x[B_A] - f[U] - _row_of(J, U, x, x0, room)
        room[0, B_A] = 1.0
        S_e = correct(e, noise.R_acc, x, C, room)
        told[LOG_L] -= 0.5 * (math.log(S_e) + e * e / S_e)
        told[SQUARE] += e * e / S_e
        told[COUNT] += 1.0
        told[E_ACC], told[S_ACC] = e, S_e
    if held and moves and not math.isnan(torque):
        e = torque - f[TORQUE] - _row_of(J, TORQUE, x, x0, room)
        S_e = correct(e, noise.R_torque, x, C, room)
        told[LOG_L] -= 0.5 * e * e / S_e


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def filter_step(  # pragma: no cover - compiled
    car: Vehicle, track: Track, noise: Noise, rails: Array, friction: Array, held: bool, W_creep: float,
    first: bool, h: float, v: float, v_dot: float, torque: float, z_yaw: float, z_acc: float, kept: Filter,
    room: Room, told: Array,
) -> None:  # fmt: skip
    """Advance one filter by one sample.

    Parameters
    ----------
    rails : (2, 5) left and right. friction : (2,) mean and standard deviation of its logarithm.
    held : the creep does not follow the torque.
    W_creep : intensity of the noise of a held creep, 1/s. first : no step before this sample.
    v, v_dot, torque : speed (m/s), its rate and the torque on the axle (N m, NaN: unknown).
    z_yaw, z_acc : yaw rate (rad/s) and lateral acceleration (m/s2), NaN if they may not be used.
    room : work space.
    told : (8,) adds the log-likelihood (less its constant), the normalised squares of the innovations and
        their number; writes the last innovations with their variances and the torque on the wheels. The
        acceleration's innovation is what the yaw rate of the same sample has not told.
    """
    x, x0 = kept.x, kept.x0
    if not first:
        predict(car, track, noise, friction, held, W_creep, v, torque, h, kept, room)
    put(x0, 0, row(x, 0))
    linearise(car, rails, held, v, v_dot, x, kept.C, kept.f, kept.J)
    kept.torque[0] = torque
    told[ON_WHEELS] = kept.f[TORQUE]
    _measure(noise, held, v >= car.v_min, torque, z_yaw, z_acc, kept, room.M, told)
    put(x0, 0, row(x, 0))
    linearise(car, rails, held, v, v_dot, x, kept.C, kept.f, kept.J)
