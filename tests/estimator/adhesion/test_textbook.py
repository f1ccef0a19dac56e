"""The compiled filter against the same filter in plain numpy, from the equations in docs/adhesion.md.

Forces come from `CreepCurve`, which is another implementation of the creep law, and their partials from
differences; matrices are multiplied and inverted as in a textbook.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import linalg

from estimator.adhesion import Hypothesis
from estimator.adhesion.block import new_memory, take_sample
from estimator.adhesion.ekf import COUNT, LOG_L, SQUARE
from estimator.adhesion.ekf import _exponential as exponential
from estimator.adhesion.motion import STATES, linearise, mean_force
from estimator.contact import CreepCurve
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, RailCondition, WheelsetParameters

from .conftest import BOTH, TORQUE, WHEELSET, H, V, bank, compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.adhesion.block import Design, Memory
    from estimator.track_spectrum import TrackSpectrum

    Array = NDArray[np.float64]

TRACK = ERRI_B176["erri_low"]
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


def phi_functions(Z: Array) -> tuple[Array, Array]:
    """Return phi_1 = (exp(Z) - 1)/Z and phi_2 = (phi_1 - 1)/Z by the (1, 2) approximant of Pade."""
    one = np.eye(len(Z))
    D = one - 2.0 * Z / 3.0 + Z @ Z / 6.0
    return np.linalg.solve(D, one - Z / 6.0), np.linalg.solve(D, 0.5 * one - Z / 6.0)


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


def predict(design: Design, x: Array, C: Array, f: Array, J: Array) -> tuple[Array, Array]:
    """Return state and covariance a step later; `f` and `J` are the rates at x and their partials."""
    car, n = design.car, design.noise
    S = slow_matrix(WHEELSET, TRACK, V, 0.5 * H)
    # Equal driving creeps of unequal wheels twist the axle.
    drift = np.zeros(12)
    drift[I["theta"]] = 0.5 * H * V * (1.0 / car.r_R - 1.0 / car.r_L)
    fast_noise = H * np.diag([n.W_u, n.W_r, *np.zeros(10)])
    fast_noise[2:4, 2:4] = H * n.W_torque * (car.r_R / (V * (car.I_L + car.I_R))) ** 2
    push = np.array([0.0, 0.0, 0.0, car.r_R / (V * car.I_R) * TORQUE])
    # Behind half a step of the slow states; what it changed of the rates goes on changing them.
    phi_1, phi_2 = phi_functions(H * J[:, :4])
    lead = H * (2.0 * phi_2 - phi_1) @ J @ (np.eye(12) - np.linalg.inv(S))
    M = np.eye(12)
    M[:4] += H * phi_1 @ J + lead
    moved, C = S @ x + drift, S @ C @ S.T + fast_noise
    change = J @ (moved - x)
    moved[:4] += H * phi_1 @ (f + push + change) + H * (2.0 * phi_2 - phi_1) @ change
    moved, C = S @ moved + drift, S @ M @ C @ M.T @ S.T
    C += track_noise(TRACK, V, H)
    keep, (mean, deviation) = np.eye(12), design.friction[0]
    keep[9, 9] = 1.0 - H * n.s_decay
    moved = keep @ moved
    moved[9] += H * n.s_decay * mean
    W_s = 2.0 * n.s_decay * deviation**2
    return moved, keep @ C @ keep.T + H * np.diag([*np.zeros(9), W_s, n.W_bg, n.W_ba])


def correct(x: Array, C: Array, H: Array, e: Array, R: Array) -> tuple[Array, Array, float]:
    """Return state, covariance and log-likelihood (less its constant) after innovations e."""
    S = H @ C @ H.T + R
    K = C @ H.T @ np.linalg.inv(S)
    log_l = -0.5 * float(e @ np.linalg.inv(S) @ e + math.log(np.linalg.det(S)))
    left = np.eye(12) - K @ H
    return x + K @ e, left @ C @ left.T + K @ R @ K.T, log_l


def test_linearised_rates_are_those_of_newton_and_euler() -> None:
    # Without a spread the mean of the force is the force.
    design = bank().design([Hypothesis("low")])
    rng = np.random.default_rng(1)
    scale = np.array([5e-3, 3e-3, 3e-4, 3e-4, 3e-4, 1e-3, 1e-4, 1e-3, 1e-3, 0.1, 0.0, 0.0])
    for _ in range(20):
        x = rng.standard_normal(12) * scale
        f, J = np.zeros(5), np.zeros((5, 12))
        linearise(design.car, design.rails[0], False, V, 0.0, x, np.zeros((12, 12)), f, J)
        expected = rates(x, CONDITIONS["low"], WHEELSET, V, 0.0)
        assert f[:4] == pytest.approx(expected, rel=1e-9, abs=1e-9)
        P = partials(x, CONDITIONS["low"], WHEELSET, V, 0.0)
        assert np.allclose(J[:4], P, rtol=1e-5, atol=1e-7 * np.abs(P).max(axis=1, keepdims=True))


@pytest.mark.parametrize("friction", [(0.0, 1.0), (-1.2, 0.5)])
def test_is_the_textbook_filter(z: Array, friction: tuple[float, float]) -> None:
    design = bank().design([Hypothesis("low", friction=friction)])
    memory = compiled(design, z)
    start = compiled(design, z[:1], np.zeros((1, 2), dtype=np.bool_)).filters
    x, C, log_l = start.x[0].copy(), start.C[0].copy(), 0.0
    f, J = np.zeros(5), np.zeros((5, 12))
    for k in range(len(z)):
        if k:
            linearise(design.car, design.rails[0], False, V, 0.0, x, C, f, J)
            x, C = predict(design, x, C, f[:4], J[:4])
        linearise(design.car, design.rails[0], False, V, 0.0, x, C, f, J)
        Hm = np.zeros((2, 12))
        Hm[0, I["r"]], Hm[0, I["b_g"]] = 1.0, 1.0
        Hm[1], Hm[1, I["b_a"]] = J[0], 1.0
        e = z[k] - [x[I["r"]] + x[I["b_g"]], f[0] + x[I["b_a"]]]
        x, C, gained = correct(x, C, Hm, e, np.diag([design.noise.R_yaw, design.noise.R_acc]))
        log_l += gained
    units = np.sqrt(np.diag(C))
    assert np.allclose(memory.filters.x[0] / units, x / units, rtol=0.0, atol=1e-10)
    assert np.allclose(memory.filters.C[0] / np.outer(units, units), C / np.outer(units, units), atol=1e-10)
    assert memory.told[0, LOG_L] == pytest.approx(log_l, rel=1e-10)


def test_small_step_tends_to_the_continuous_model() -> None:
    # The step of the fast states against exp, over what the speeds from 1 m/s up ask for.
    rng = np.random.default_rng(3)
    for size, error in ((0.1, 1e-5), (1.0, 2e-2), (16.0, 0.2)):
        Z = -size * np.diag(rng.uniform(0.2, 1.0, 4)) + 0.02 * size * rng.standard_normal((4, 4))
        phi, ramp, D = np.zeros((3, 4, 12))
        padded = np.zeros((4, 12))
        padded[:, :4] = Z
        exponential(padded, phi, ramp, D)
        phi_1, phi_2 = phi_functions(Z)
        assert np.allclose(phi[:, :4], phi_1, rtol=1e-12)
        assert np.allclose(ramp[:, :4], 2.0 * phi_2 - phi_1, rtol=1e-9, atol=1e-12)
        values, vectors = np.linalg.eig(Z)
        exact = (vectors * np.exp(values)) @ np.linalg.inv(vectors)
        assert np.abs(np.eye(4) + Z @ phi[:, :4] - exact).max() < error


def test_force_is_averaged_over_the_spread_of_the_creepage() -> None:
    design = bank().design([Hypothesis("very_low")])
    rail, patch = design.rails[0, 0], design.car.patch
    curve = CreepCurve(CONDITIONS["very_low"], V)
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    for spread in (2e-5, 4e-5, 8e-5):
        exact = float(weights @ curve.force(2e-4 + spread * nodes)) / math.sqrt(2.0 * math.pi)
        found = mean_force(rail, patch, V, 2e-4, spread**2, 0.0, 0.0)[0]
        plain = float(curve.force(2e-4))
        assert abs(found - exact) < 0.2 * abs(plain - exact)


def test_all_squares_are_those_expected_of_its_own_model() -> None:
    # Data of the filter's own model: normalised squares of innovations (NIS) and errors (NEES) are 1.
    design = bank(friction=1e-3).design([Hypothesis("dry")])
    rng = np.random.default_rng(7)
    squares, errors = [], []
    for _ in range(8):
        truth = new_memory(1)
        work = np.zeros((5, 4, 12))
        take_sample(design, truth, 0, True, V, 0.0, TORQUE, np.zeros(2), ~BOTH, work)
        x, C = truth.filters.x[0].copy(), truth.filters.C[0].copy()
        x += np.linalg.cholesky(C + 1e-24 * np.eye(12)) @ rng.standard_normal(12)
        Q = _process_noise(design)
        filtered = new_memory(1)
        for k in range(1000):
            f, J = np.zeros(5), np.zeros((5, 12))
            linearise(design.car, design.rails[0], False, V, 0.0, x, np.zeros((12, 12)), f, J)
            z = np.array([x[I["r"]] + x[I["b_g"]], f[0] + x[I["b_a"]]])
            z += rng.standard_normal(2) * np.sqrt([design.noise.R_yaw, design.noise.R_acc])
            take_sample(design, filtered, 0, k == 0, V, 0.0, TORQUE, z, BOTH, work)
            if k in {799, 999}:
                kept = filtered.filters
                e = (x - kept.x[0])[:9]
                errors.append(e @ np.linalg.solve(kept.C[0][:9, :9], e) / 9.0)
            x = _advance(design, x, truth, Q, rng)
        squares.append(filtered.told[0, SQUARE] / filtered.told[0, COUNT])
    assert np.mean(squares) == pytest.approx(1.0, abs=0.04)  # 16000 numbers: 0.011
    assert np.mean(errors) == pytest.approx(1.0, abs=0.35)  # 16 of 9 numbers: 0.12


def _process_noise(design: Design) -> Array:
    n = design.noise
    Q = track_noise(TRACK, V, H)
    Q += H * np.diag([n.W_u, n.W_r, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])
    return Q


def _advance(design: Design, x: Array, scratch: Memory, Q: Array, rng: np.random.Generator) -> Array:
    """Return the state a step later: the prediction of a filter that knows it, and noise."""
    kept = scratch.filters
    kept.x[0], kept.C[0] = x, 0.0
    linearise(design.car, design.rails[0], False, V, 0.0, x, kept.C[0], kept.f[0], kept.J[0])
    kept.x0[0] = x
    take_sample(design, scratch, 0, False, V, 0.0, TORQUE, np.zeros(2), ~BOTH, np.zeros((5, 4, 12)))
    values, vectors = np.linalg.eigh(Q)
    return np.asarray(kept.x[0] + vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(12)))


def test_fast_states_come_first() -> None:
    assert [I[name] for name in FAST] == [0, 1, 2, 3]
