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

from estimator.adhesion.motion import (
    B_A,
    B_G,
    L_L,
    L_R,
    N_X,
    PSI,
    THETA,
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

__all__ = ["Filter", "Noise", "Track", "filter_step", "new_filter"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

N_F = 4
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
    W_s: float
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


@njit(cache=True, nogil=True, error_model="numpy")
def _slow(  # pragma: no cover - compiled
    car: Vehicle, held: bool, v: float, h: float, over_track: Array, x: Array, M: Array
) -> None:
    """Advance the slow states by h with the fast ones held, in x (12,) and the covariance M (12, 12)."""
    e_p, e_q, c_pq = over_track[1], over_track[2], over_track[3]
    w_L = 0.0 if held else -h * v / car.r_L
    w_R = 0.0 if held else h * v / car.r_R
    d_q = e_q - 1.0
    rest = 0.0 if held else w_L + w_R
    x[PSI] += h * x[R]
    x[Y] += h * x[U] - d_q * x[Q] - c_pq * x[P]
    x[THETA] += w_L * x[L_L] + w_R * x[L_R] + rest
    x[Q] = e_q * x[Q] + c_pq * x[P]
    x[P] *= e_p
    for j in range(N_X):
        M[PSI, j] += h * M[R, j]
        M[Y, j] += h * M[U, j] - d_q * M[Q, j] - c_pq * M[P, j]
        M[THETA, j] += w_L * M[L_L, j] + w_R * M[L_R, j]
        M[Q, j] = e_q * M[Q, j] + c_pq * M[P, j]
        M[P, j] *= e_p
    for i in range(N_X):
        M[i, PSI] += h * M[i, R]
        M[i, Y] += h * M[i, U] - d_q * M[i, Q] - c_pq * M[i, P]
        M[i, THETA] += w_L * M[i, L_L] + w_R * M[i, L_R]
        M[i, Q] = e_q * M[i, Q] + c_pq * M[i, P]
        M[i, P] *= e_p


@njit(cache=True, nogil=True, error_model="numpy")
def _exponential(Z: Array, phi: Array, ramp: Array, D: Array) -> None:  # pragma: no cover - compiled
    """Write phi_1(Z) and 2 phi_2(Z) - phi_1(Z) of a 4 x 4 matrix by the (1, 2) Pade approximant of exp.

    phi_1 = (exp(Z) - 1)/Z and phi_2 = (phi_1 - 1)/Z. exp(Z) ~ D^-1 (1 + Z/3) with D = 1 - 2 Z/3 + Z^2/6, so
    phi_1 ~ D^-1 (1 - Z/6) and 2 phi_2 - phi_1 ~ -D^-1 Z/6. D is work space.
    """
    for i in range(N_F):
        for j in range(N_F):
            total = 0.0
            for k in range(N_F):
                total += Z[i, k] * Z[k, j]
            D[i, j] = total / 6.0 - Z[i, j] * (2.0 / 3.0)
            phi[i, j] = 0.0
            ramp[i, j] = -Z[i, j] / 6.0
        D[i, i] += 1.0
        phi[i, i] = 1.0
    for k in range(N_F):
        pivot = 1.0 / D[k, k]
        for i in range(k + 1, N_F):
            factor = D[i, k] * pivot
            for j in range(k + 1, N_F):
                D[i, j] -= factor * D[k, j]
            for j in range(N_F):
                phi[i, j] -= factor * phi[k, j]
                ramp[i, j] -= factor * ramp[k, j]
    for i in range(N_F - 1, -1, -1):
        pivot = 1.0 / D[i, i]
        for j in range(N_F):
            one, other = phi[i, j], ramp[i, j]
            for k in range(i + 1, N_F):
                one -= D[i, k] * phi[k, j]
                other -= D[i, k] * ramp[k, j]
            phi[i, j], ramp[i, j] = one * pivot, other * pivot
    for i in range(N_F):
        for j in range(N_F):
            phi[i, j] += ramp[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _drift(  # pragma: no cover - compiled
    car: Vehicle, held: bool, v: float, h: float, over_track: Array, J: Array, G: Array
) -> None:
    """Write by how much a slow step of h has changed the rates of the fast states, (4, 12).

    As a matrix over the states behind that step.
    """
    e_p, e_q, c_pq = over_track[1], over_track[2], over_track[3]
    w_L = 0.0 if held else -h * v / car.r_L
    w_R = 0.0 if held else h * v / car.r_R
    for i in range(N_F):
        for j in range(N_X):
            G[i, j] = 0.0
        track = J[i, Q] - J[i, Y]
        G[i, U], G[i, R] = h * J[i, Y], h * J[i, PSI]
        G[i, L_L], G[i, L_R] = w_L * J[i, THETA], w_R * J[i, THETA]
        G[i, P], G[i, Q] = track * c_pq / (e_p * e_q), track * (1.0 - 1.0 / e_q)


@njit(cache=True, nogil=True, error_model="numpy")
def _fast(  # pragma: no cover - compiled
    car: Vehicle, held: bool, v: float, h: float, push: float, kept: Filter, work: Array
) -> None:
    """Advance the fast states by h, behind half a step of the slow ones, which go on as they did in it.

    `push` is the torque's share of l_R'.
    """
    x, x0, f, J = kept.x, kept.x0, kept.f, kept.J
    G, phi, ramp, D, M = work[0], work[1], work[2], work[3], work[4]
    for i in range(N_F):
        for j in range(N_F):
            G[i, j] = h * J[i, j]
    _exponential(G, phi, ramp, D)
    _drift(car, held, v, 0.5 * h, kept.over_track, J, G)
    rate, moved = D[0], D[1]
    for i in range(N_F):
        moved[i] = 0.0
        for j in range(N_X):
            moved[i] += J[i, j] * (x[j] - x0[j])
        rate[i] = f[i] + moved[i]
    rate[L_R] += push
    for i in range(N_F):
        for j in range(N_X):
            M[i, j] = 0.0
        for k in range(N_F):
            x[i] += h * (phi[i, k] * rate[k] + ramp[i, k] * moved[k])
            for j in range(N_X):
                M[i, j] += h * (phi[i, k] * J[k, j] + ramp[i, k] * G[k, j])
        M[i, i] += 1.0
    _transform(M, kept.C, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _transform(M: Array, C: Array, MC: Array) -> None:  # pragma: no cover - compiled
    """Replace C by the covariance of M x in its first four rows; MC is work space."""
    for i in range(N_F):
        for j in range(N_X):
            MC[i, j] = 0.0
        for k in range(N_X):
            for j in range(N_X):
                MC[i, j] += M[i, k] * C[k, j]
    for i in range(N_F):
        for j in range(N_F, N_X):
            C[i, j] = MC[i, j]
            C[j, i] = MC[i, j]
        for j in range(i + 1):
            total = 0.0
            for k in range(N_X):
                total += MC[i, k] * M[j, k]
            C[i, j] = total
            C[j, i] = total


@njit(cache=True, nogil=True, error_model="numpy")
def _add_fast_noise(  # pragma: no cover - compiled
    car: Vehicle, noise: Noise, held: bool, W_creep: float, v: float, h: float, change: float, C: Array
) -> None:
    """Add the noise of the fast states over h, before their step, which damps it as it damps them.

    A torque that has changed by `change` since the last sample was somewhere between the two. Behind the
    step noise would stand undamped: at 2 m/s an acceleration of 1e4 1/s times that of the velocity.
    """
    C[U, U] += h * noise.W_u
    C[R, R] += h * noise.W_r
    common = W_creep if held else noise.W_torque * (car.r_R / (v * (car.I_L + car.I_R))) ** 2
    for i in (L_L, L_R):
        for j in (L_L, L_R):
            C[i, j] += h * common
    if not held:
        C[L_R, L_R] += (0.5 * h * change * car.r_R / (v * car.I_R)) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def _add_slow_noise(  # pragma: no cover - compiled
    noise: Noise, h: float, over_track: Array, x: Array, C: Array
) -> None:
    """Add the noise of the slow states over h; the friction returns to its condition, so it grows vague."""
    C[P, P] += over_track[4]
    for i, sign in ((Q, 1.0), (Y, -1.0)):
        C[i, i] += over_track[6]
        C[i, P] += sign * over_track[5]
        C[P, i] += sign * over_track[5]
    C[Q, Y] -= over_track[6]
    C[Y, Q] -= over_track[6]
    keep = 1.0 - h * noise.s_decay
    x[S] *= keep
    for j in range(N_X):
        C[S, j] *= keep
    for j in range(N_X):
        C[j, S] *= keep
    C[S, S] += h * noise.W_s
    C[B_G, B_G] += h * noise.W_bg
    C[B_A, B_A] += h * noise.W_ba


@njit(cache=True, nogil=True, error_model="numpy")
def predict(  # pragma: no cover - compiled
    car: Vehicle, track: Track, noise: Noise, held: bool, W_creep: float,
    v: float, torque: float, h: float, kept: Filter, work: Array,
) -> None:  # fmt: skip
    """Advance x and C of a filter by h; `work` is (5, 4, 12)."""
    x, C, over_track = kept.x, kept.C, kept.over_track
    v = max(v, car.v_min)
    track_step(track, v, h, over_track)
    _slow(car, held, v, 0.5 * h, over_track, x, C)
    change = torque - kept.torque[0]
    _add_fast_noise(car, noise, held, W_creep, v, h, change, C)
    push = 0.0 if held else (torque - 0.5 * change) * car.r_R / (v * car.I_R)
    _fast(car, held, v, h, push, kept, work)
    _slow(car, held, v, 0.5 * h, over_track, x, C)
    _add_slow_noise(noise, h, over_track, x, C)


@njit(cache=True, nogil=True, error_model="numpy")
def _joseph(H: Array, R_e: float, C: Array, c: Array, K: Array) -> None:  # pragma: no cover - compiled
    """Replace C by (1 - K H) C (1 - K H)' + K R_e K', by two products of vectors; c is C H' at first."""
    for i in range(N_X):
        for j in range(N_X):
            C[i, j] -= K[i] * c[j]
    for i in range(N_X):
        total = 0.0
        for j in range(N_X):
            total += C[i, j] * H[j]
        c[i] = R_e * K[i] - total
    for i in range(N_X):
        for j in range(N_X):
            C[i, j] += c[i] * K[j]
    for i in range(N_X):
        for j in range(i):
            mean = 0.5 * (C[i, j] + C[j, i])
            C[i, j] = mean
            C[j, i] = mean


@njit(cache=True, nogil=True, error_model="numpy")
def _correct(  # pragma: no cover - compiled
    H: Array, e: float, R_e: float, x: Array, C: Array, c: Array, K: Array
) -> float:
    """Take an innovation e with the row H (12,) into x and C, Joseph's form; return its variance.

    c and K (12,) are work space.
    """
    for j in range(N_X):
        c[j] = 0.0
    for k in range(N_X):
        for j in range(N_X):
            c[j] += H[k] * C[k, j]
    S_e = R_e
    for j in range(N_X):
        S_e += H[j] * c[j]
    gain = 1.0 / S_e
    for j in range(N_X):
        K[j] = c[j] * gain
        x[j] += K[j] * e
    _joseph(H, R_e, C, c, K)
    return S_e


@njit(cache=True, nogil=True, error_model="numpy")
def _row_of(J: Array, i: int, x: Array, x0: Array, H: Array) -> float:  # pragma: no cover - compiled
    """Copy row i of J to H; return by how much the value of that row has moved from x0 to x."""
    moved = 0.0
    for j in range(N_X):
        H[j] = J[i, j]
        moved += H[j] * (x[j] - x0[j])
    return moved


@njit(cache=True, nogil=True, error_model="numpy")
def _measure(  # pragma: no cover - compiled
    noise: Noise, held: bool, torque: float, z: Array, usable: Flags, kept: Filter, work: Array, told: Array
) -> None:
    """Take a sample z (2,) and the torque of a held creep into the state, one number after the other."""
    x, C, x0, f, J = kept.x, kept.C, kept.x0, kept.f, kept.J
    H, c, K = work[0, 0], work[1, 0], work[2, 0]
    if usable[0]:
        for j in range(N_X):
            H[j] = 0.0
        H[R] = 1.0
        H[B_G] = 1.0
        e = z[0] - x[R] - x[B_G]
        S_e = _correct(H, e, noise.R_yaw, x, C, c, K)
        told[LOG_L] -= 0.5 * (math.log(S_e) + e * e / S_e)
        told[SQUARE] += e * e / S_e
        told[COUNT] += 1.0
        told[E_YAW], told[S_YAW] = e, S_e
    if usable[1]:
        e = z[1] - x[B_A] - f[U] - _row_of(J, U, x, x0, H)
        H[B_A] = 1.0
        S_e = _correct(H, e, noise.R_acc, x, C, c, K)
        told[LOG_L] -= 0.5 * (math.log(S_e) + e * e / S_e)
        told[SQUARE] += e * e / S_e
        told[COUNT] += 1.0
        told[E_ACC], told[S_ACC] = e, S_e
    if held and not math.isnan(torque):
        e = torque - f[TORQUE] - _row_of(J, TORQUE, x, x0, H)
        S_e = _correct(H, e, noise.R_torque, x, C, c, K)
        told[LOG_L] -= 0.5 * e * e / S_e


@njit(cache=True, nogil=True, error_model="numpy")
def filter_step(  # pragma: no cover - compiled
    car: Vehicle, track: Track, noise: Noise, rails: Array, held: bool, W_creep: float, first: bool,
    h: float, v: float, v_dot: float, torque: float, z: Array, usable: Flags, kept: Filter, work: Array,
    told: Array,
) -> None:  # fmt: skip
    """Advance one filter by one sample z (2,).

    Parameters
    ----------
    rails : (2, 5) left and right. held : the creep does not follow the torque.
    W_creep : intensity of the noise of a held creep, 1/s. first : no step before this sample.
    v, v_dot, torque : speed (m/s), its rate and the torque on the axle (N m, NaN: unknown).
    usable : (2,) which of the two numbers may be used.
    work : (5, 4, 12) work space.
    told : (8,) adds the log-likelihood (less its constant), the normalised squares of the innovations and
        their number; writes the last innovations with their variances and the torque on the wheels. The
        acceleration's innovation is what the yaw rate of the same sample has not told.
    """
    x, x0 = kept.x, kept.x0
    if not first:
        predict(car, track, noise, held, W_creep, v, torque, h, kept, work)
    for j in range(N_X):
        x0[j] = x[j]
    linearise(car, rails, held, v, v_dot, x, kept.C, kept.f, kept.J)
    kept.torque[0] = torque
    told[ON_WHEELS] = kept.f[TORQUE]
    # A wheelset that stands says nothing of its rail.
    if v >= car.v_min:
        _measure(noise, held, torque, z, usable, kept, work, told)
    for j in range(N_X):
        x0[j] = x[j]
    linearise(car, rails, held, v, v_dot, x, kept.C, kept.f, kept.J)
