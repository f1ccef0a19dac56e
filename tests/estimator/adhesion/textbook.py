"""The filter of the adhesion bank in plain numpy, from the equations in docs/adhesion.md.

Forces come from `CreepCurve`, which is another implementation of the creep law, and their partials from
complex steps or differences of it; matrices are inverted and multiplied as in a textbook.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from estimator.adhesion.motion import STATES
from estimator.contact import CreepCurve
from fmu_wheelset.parameters import RailCondition

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import WheelsetParameters

    Array = NDArray[np.float64]

I = {name: i for i, name in enumerate(STATES)}  # noqa: E741
FAST = ("u", "r", "l_L", "l_R")


def rates(x: Array, condition: RailCondition, wheelset: WheelsetParameters, v: float, torque: float) -> Array:
    """Return the rates of u, r, l_L and l_R: Newton and Euler."""
    w = wheelset
    u, r, l_L, l_R, psi, y, theta, _, q, s = x[:10]
    scaled = RailCondition(
        k_A=condition.k_A, k_S=condition.k_S, mu_0=condition.mu_0 * math.exp(s), A=condition.A, B=condition.B
    )
    curve = CreepCurve(scaled, v, w.N, w.patch)
    g = w.L_g * r / v + w.gamma * y / w.r0
    b = u / v - psi
    f_xL, f_yL = curve.forces(l_L + g, b)
    f_xR, f_yR = curve.forces(l_R - g, b)
    r_L, r_R = w.r0 + w.delta_r / 2.0, w.r0 - w.delta_r / 2.0
    omega_L, omega_R = (1.0 + l_L) * v / r_L, (1.0 + l_R) * v / r_R
    T_s = w.k_s * theta + w.c_s * (omega_R - omega_L)
    return np.array(
        [
            (-f_yL - f_yR - w.k_y * (y + q) - w.c_y * u - 2.0 * w.N * w.contact_angle_rate * y) / w.m_w,
            ((f_xR - f_xL) * w.L_g - (w.k_w - 2.0 * w.N * w.contact_angle * w.L_g) * psi - w.c_w * r) / w.I_w,
            r_L / v * (T_s - r_L * f_xL) / w.I_L,
            r_R / v * (torque - T_s - r_R * f_xR) / w.I_R,
        ]
    )


def partials(x: Array, *model: object) -> Array:
    """Return the partials of `rates` (4, 12) by central differences of fourth order."""
    J = np.zeros((4, 12))
    sizes = [1e-4, 1e-4, 1e-7, 1e-7, 1e-6, 1e-6, 1e-6, 1.0, 1e-3, 1e-3, 1.0, 1.0]
    for j, d in enumerate(sizes):
        step = np.zeros(12)
        step[j] = d * 0.1
        f = [rates(x + n * step, *model) for n in (-2, -1, 1, 2)]  # type: ignore[arg-type]
        J[:, j] = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * step[j])
    return J


def slow_matrix(wheelset: WheelsetParameters, track: TrackSpectrum, v: float, h: float) -> Array:
    """Return the transition of h for slow states while the fast ones stand still."""
    A = np.zeros((12, 12))
    A[I["psi"], I["r"]] = 1.0
    A[I["y"], I["u"]] = 1.0
    A[I["y"], I["p"]], A[I["y"], I["q"]] = -1.0, track.Omega_r * v
    r_L, r_R = wheelset.r0 + wheelset.delta_r / 2.0, wheelset.r0 - wheelset.delta_r / 2.0
    A[I["theta"], I["l_L"]], A[I["theta"], I["l_R"]] = -v / r_L, v / r_R
    A[I["p"], I["p"]] = -track.Omega_c * v
    A[I["q"], I["q"]], A[I["q"], I["p"]] = -track.Omega_r * v, 1.0
    return np.asarray(linalg.expm(A * h))


def phi_1(Z: Array) -> Array:
    """Return (exp(Z) - 1)/Z by the (1, 2) approximant of Pade."""
    one = np.eye(len(Z))
    return np.asarray(np.linalg.inv(one - 2.0 * Z / 3.0 + Z @ Z / 6.0) @ (one - Z / 6.0))


def track_noise(track: TrackSpectrum, v: float, h: float) -> Array:
    """Return the covariance (12, 12) that the track adds in h, by quadrature over its impulse response."""
    t, weight = np.polynomial.legendre.leggauss(20)
    t, weight = 0.5 * h * (t + 1.0), 0.5 * h * weight
    a, b = track.Omega_c * v, track.Omega_r * v
    q = (np.exp(-b * t) - np.exp(-a * t)) / (a - b)
    response = np.zeros((12, t.size))
    response[I["p"]], response[I["q"]], response[I["y"]] = np.exp(-a * t), q, -q
    level = math.pi * track.A * v**3 * track.Omega_c**2
    return np.asarray(level * (response * weight) @ response.T)


def predict(
    x: Array, C: Array, x0: Array, f0: Array, J: Array, S: Array, Q_before: Array, Q_after: Array, h: float
) -> tuple[Array, Array]:
    """Return state and covariance a step h later; `f0` and `J` are rates and partials at `x0`."""
    x, C = S @ x, S @ C @ S.T + Q_before
    phi = phi_1(h * J[:, :4])
    M = np.eye(12)
    M[:4] += h * phi @ J
    moved = x.copy()
    moved[:4] += h * phi @ (f0 + J @ (x - x0))
    return S @ moved, S @ M @ C @ M.T @ S.T + Q_after


def correct(x: Array, C: Array, H: Array, e: Array, R: Array) -> tuple[Array, Array, float]:
    """Return state, covariance and log-likelihood (less its constant) after innovations e."""
    S = H @ C @ H.T + R
    K = C @ H.T @ np.linalg.inv(S)
    log_l = -0.5 * float(e @ np.linalg.inv(S) @ e + math.log(np.linalg.det(S)))
    left = np.eye(12) - K @ H
    return x + K @ e, left @ C @ left.T + K @ R @ K.T, log_l
