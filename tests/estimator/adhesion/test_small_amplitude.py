"""On a track that is nearly straight the extended filter is the linear one.

Track, noise of the sensors and everything that a filter does not know are made smaller by one factor. What
is left of the nonlinearity goes with it; what is left of the step goes with the square of the step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest

from estimator import ERRI_B176, CreepCurve, Disturbances, coloured_filter, coloured_model
from estimator.adhesion import AdhesionBank, Hypothesis, Unknowns
from estimator.adhesion.block import begin_filter, new_memory, take_sample
from estimator.adhesion.ekf import COUNT, E_ACC, E_YAW, LOG_L, S_ACC, S_YAW
from estimator.adhesion.motion import STATES, linearise
from estimator.discretisation import discretise
from estimator.linear_models import point_at
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.adhesion.block import Design

    Array = NDArray[np.float64]

V, CONDITION, TRACK = 40.0, "low", ERRI_B176["erri_low"]
NO_BIAS = Unknowns(bias=(0.0, 0.0))
W = WheelsetParameters()
CURVE = CreepCurve(CONDITIONS[CONDITION], V)
I = {name: i for i, name in enumerate(STATES)}  # noqa: E741
#: Above them averaging over the spread of the creepage sets in.
AMPLITUDES = (1.0 / 128.0, 1.0 / 256.0)


class Said(NamedTuple):
    """Normalised innovations (T, 2), log-likelihood per sample, final covariance."""

    innovations: Array
    log_l: float
    C: Array


class Linear(NamedTuple):
    """x' = A x + G w with intensities 1, measured by H with covariances R; `start` is the covariance."""

    A: Array
    G: Array
    H: Array
    start: Array


def small(design: Design, amplitude: float) -> Design:
    """Return a design whose noises are small, and that knows the friction."""
    n, quiet = design.noise, amplitude**2
    noise = n._replace(
        **{
            name: quiet * getattr(n, name)
            for name in ("R_yaw", "R_acc", "R_torque", "W_u", "W_r", "W_torque")
        },
    )
    track = design.track._replace(level=quiet * design.track.level)
    known = 0.0 * design.friction
    return design._replace(noise=noise, track=track, friction=known, W_creep=0.0 * design.W_creep)


def extended(
    hypothesis: Hypothesis, torque: float, z: Array, h: float, amplitude: float, start: Array
) -> Said:
    """Run the extended filter over z (T, 2), made small."""
    design = small(AdhesionBank(W, h=h, unknown=NO_BIAS).design([hypothesis]), amplitude)
    memory, work = new_memory(1), np.zeros((5, 4, 12))
    begin_filter(design, memory, 0, V, torque)
    f = memory.filters
    f.C[0] = amplitude**2 * start
    linearise(design.car, design.rails[0], design.held[0], V, 0.0, f.x[0], f.C[0], f.f[0], f.J[0])
    innovations, both = np.empty(z.shape), np.ones(2, dtype=np.bool_)
    for k, sample in enumerate(amplitude * z):
        take_sample(design, memory, 0, False, V, 0.0, torque, sample, both, work)
        told = memory.told[0]
        innovations[k] = told[E_YAW] / math.sqrt(told[S_YAW]), told[E_ACC] / math.sqrt(told[S_ACC])
    # Densities of smaller numbers are greater.
    log_l = memory.told[0, LOG_L] / memory.told[0, COUNT] + math.log(amplitude)
    return Said(innovations, log_l, f.C[0] / amplitude**2)


def textbook(model: Linear, z: Array, h: float) -> Said:
    """Run the linear filter over z (T, 2): predict, take one number after the other."""
    F, Q = discretise(model.A, model.G, np.eye(model.G.shape[1]), h)
    R = np.array([1e-3, 0.05]) ** 2
    x, P = np.zeros(len(F)), model.start
    innovations, log_l = np.empty(z.shape), 0.0
    for k, sample in enumerate(z):
        x, P = F @ x, F @ P @ F.T + Q
        for i, row in enumerate(model.H):
            S = row @ P @ row + R[i]
            e = sample[i] - row @ x
            K = P @ row / S
            x, P = x + K * e, P - np.outer(K, row @ P)
            innovations[k, i] = e / math.sqrt(S)
            log_l -= 0.5 * (math.log(S) + e * e / S)
    return Said(innovations, log_l / z.size, P)


def simulated(model: Linear, T: int, h: float) -> Array:
    """Return samples of the model itself, (T, 2)."""
    rng = np.random.default_rng(4)
    F, Q = discretise(model.A, model.G, np.eye(model.G.shape[1]), h)
    values, vectors = np.linalg.eigh(Q)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    x, z = np.zeros(len(F)), np.empty((T, 2))
    for k in range(T):
        x = F @ x + root @ rng.standard_normal(len(F))
        z[k] = model.H @ x + [1e-3, 0.05] * rng.standard_normal(2)
    return z


def start_of(names: tuple[str, ...]) -> Array:
    """Return a covariance (12, 12) to start from, of motions with an amplitude of 1."""
    sd = dict(zip(STATES, (2e-3, 2e-3, 1e-6, 1e-6, 3e-4, 5e-4, 1e-6, 2e-3, 1e-3), strict=False))
    return np.diag([sd[name] ** 2 if name in names else 0.0 for name in STATES])


def over_states(states: tuple[str, ...]) -> Array:
    """Return the states of `coloured_model` over those of the extended filter, (6, 12)."""
    names = {"psi": "psi", "y_dot": "u", "psi_dot": "r", "y_rel": "y", "y_t": "q", "y_t_dot": "p"}
    to = np.zeros((6, 12))
    for i, state in enumerate(states):
        to[i, I[names[state]]] = 1.0
    to[states.index("y_t_dot"), I["q"]] = -TRACK.Omega_r * V
    return to


def of_held(creep: float) -> tuple[Linear, Array]:
    """Return `coloured_model` at a creep, and where both filters start."""
    start = start_of(("u", "r", "psi", "y", "p", "q"))
    model = coloured_model(point_at(CURVE, "", creep), W, TRACK)
    to = over_states(tuple(model.state_labels))
    design = AdhesionBank(W, unknown=NO_BIAS).design([Hypothesis(CONDITION)])
    G = np.asarray(model.B) * np.sqrt([1.0, design.noise.W_u, design.noise.W_r])
    return Linear(np.asarray(model.A), G, np.asarray(model.C), to @ start @ to.T), start


def of_driven(creep: float) -> tuple[Linear, Array]:
    """Return the linear model in which torque and inertia of the wheels decide the creep; see adhesion.md."""
    point = point_at(CURVE, "", creep)
    g11, g22, cone, r0 = point.g11, point.g22, W.gamma / W.r0, W.r0
    names = STATES[:9]
    A, one = np.zeros((9, 9)), np.eye(9)
    u, r, l_L, l_R, psi, y, theta, p, q = one
    g, b = W.L_g / V * r + cone * y, u / V - psi
    a, slow = TRACK.Omega_c * V, TRACK.Omega_r * V
    A[I["u"]] = -2.0 * g22 * b / W.m_w
    A[I["r"]] = (W.L_g * g11 * (l_R - l_L - 2.0 * g) - W.k_w * psi) / W.I_w
    A[I["l_L"]] = r0 / V * (W.k_s * theta - r0 * g11 * (l_L + g)) / W.I_L
    A[I["l_R"]] = r0 / V * (-W.k_s * theta - r0 * g11 * (l_R - g)) / W.I_R
    A[I["psi"]] = r
    A[I["y"]] = u - (p - slow * q)
    A[I["theta"]] = V / r0 * (l_R - l_L)
    A[I["p"]] = -a * p
    A[I["q"]] = p - slow * q
    noise = AdhesionBank(W, unknown=NO_BIAS).design([Hypothesis(CONDITION)]).noise
    push = math.sqrt(noise.W_torque) * r0 / (V * (W.I_L + W.I_R))
    G = np.column_stack(
        [
            math.sqrt(math.pi * TRACK.A * V**3) * TRACK.Omega_c * p,
            math.sqrt(noise.W_u) * u,
            math.sqrt(noise.W_r) * r,
            push * (l_L + l_R),
        ]
    )
    start = start_of(names)
    return Linear(A, G, np.array([r, A[I["u"]]]), start[:9, :9]), start


CASES = {
    "held": (Hypothesis(CONDITION, "held", 0.5), math.nan, of_held, 0.5),
    "held past the peak": (Hypothesis(CONDITION, "held", 1.3), math.nan, of_held, 1.3),
    "driven": (Hypothesis(CONDITION), 0.7, of_driven, None),
}


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Hypothesis, float, Linear, Array]:
    hypothesis, drive, model, creep = CASES[request.param]
    if creep is None:
        used = drive * CURVE.peak_adhesion
        return hypothesis, 2.0 * W.r0 * W.N * used, *model(CURVE.creep_at(used))
    # The bank reads the creep of the peak from its table.
    design, memory = AdhesionBank(W, unknown=NO_BIAS).design([hypothesis]), new_memory(1)
    begin_filter(design, memory, 0, V, drive)
    started = memory.filters.x[0, I["l_L"]]
    assert started == pytest.approx(creep * CURVE.peak_creep, rel=1e-3)
    return hypothesis, drive, *model(float(started))


def apart(one: Array, other: Array) -> float:
    return float(np.sqrt(np.mean((one - other) ** 2)))


def test_nonlinearity_shrinks_with_the_amplitude(case: tuple[Hypothesis, float, Linear, Array]) -> None:
    # With its square where left and right mirror each other; a driven axle has the torque on one wheel.
    hypothesis, torque, model, start = case
    h = 1e-3
    z = simulated(model, 300, h)
    limit = extended(hypothesis, torque, z, h, 1e-4, start)
    errors = [
        apart(extended(hypothesis, torque, z, h, amplitude, start).innovations, limit.innovations)
        for amplitude in AMPLITUDES
    ]
    assert 1e-9 < errors[0] < 1e-2
    assert errors[0] / errors[1] == pytest.approx(2.0 if hypothesis.branch == "driven" else 4.0, rel=0.15)


def test_limit_is_the_linear_filter(case: tuple[Hypothesis, float, Linear, Array]) -> None:
    hypothesis, torque, model, start = case
    errors, likelihoods = [], []
    for h in (1e-3, 5e-4, 2.5e-4):
        z = simulated(model, round(0.15 / h), h)
        there, here = textbook(model, z, h), extended(hypothesis, torque, z, h, 1e-4, start)
        errors.append(apart(here.innovations, there.innovations))
        likelihoods.append(abs(here.log_l - there.log_l))
    assert errors[-1] < 3e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.4)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.4)
    assert likelihoods[-1] < 1e-4


def test_covariance_of_the_coloured_filter_stays() -> None:
    # The filter that the package makes for this creep, by another equation: that of Riccati.
    hypothesis, torque, _, creep = CASES["held"]
    h = 5e-4
    noise = AdhesionBank(W, unknown=NO_BIAS).design([hypothesis]).noise
    disturbances = Disturbances(TRACK, acceleration=noise.W_u, lever=math.sqrt(noise.W_u / noise.W_r))
    steady = coloured_filter(point_at(CURVE, "", float(creep or 0.0) * CURVE.peak_creep), W, disturbances, h)
    assert steady.P is not None
    H = steady.H
    S = H @ steady.P @ H.T + steady.R
    after = steady.P - steady.P @ H.T @ np.linalg.solve(S, H @ steady.P)
    to = over_states(steady.states)
    assert np.linalg.matrix_rank(to) == 6
    start = np.linalg.pinv(to) @ after @ np.linalg.pinv(to).T
    stayed = to @ extended(hypothesis, torque, np.zeros((1000, 2)), h, 1e-4, start).C @ to.T
    units = np.sqrt(np.diag(after))
    assert np.allclose(stayed / np.outer(units, units), after / np.outer(units, units), atol=5e-3)
