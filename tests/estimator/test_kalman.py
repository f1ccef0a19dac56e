from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import linalg, stats

from estimator.bank import FilterBank
from estimator.contact import CreepCurve
from estimator.kalman import LinearFilter, design_filter, discretise, observable_part
from estimator.linear_models import OperatingPoint, filter_model, operating_points
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    import control
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Simulate = Callable[[LinearFilter, int, int], Array]

matrices = arrays(np.float64, (3, 3), elements=st.floats(-5.0, 5.0).map(lambda x: round(x, 3)))
steps = st.floats(1e-3, 0.5)


def covariance_integral(A: Array, G: Array, W: Array, h: float) -> Array:
    """The defining integral of e^(A t) G W G' e^(A' t) over one step by Gauss-Legendre quadrature.

    The panels halve towards zero, where fast modes live.
    """
    nodes, weights = np.polynomial.legendre.leggauss(12)
    edges = h * np.append(0.0, 2.0 ** np.arange(-12, 1))
    total = np.zeros_like(A)
    for left, right in pairwise(edges):
        half = (right - left) / 2.0
        for node, weight in zip(nodes, weights, strict=True):
            B = linalg.expm(A * (left + half * (node + 1.0))) @ G
            total += half * weight * B @ W @ B.T
    return total


def in_own_scale(Q: Array, reference: Array) -> Array:
    """Q with unit diagonal, so that small and large states count alike."""
    d = np.sqrt(np.diag(reference))
    return np.asarray(Q / np.outer(d, d))


# Discretisation --------------------------------------------------------------------------------------


def test_double_integrator_with_white_acceleration() -> None:
    h, q = 0.7, 2.3
    F, Q = discretise(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[q]]), h)
    assert np.array([[1.0, h], [0.0, 1.0]]) == pytest.approx(F, abs=1e-15)
    assert np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]) * q == pytest.approx(Q, rel=1e-14)


@pytest.mark.parametrize("a", [1e-6, 1.0, 40.0, 1e5])
def test_first_order_noise_fast_and_slow(a: float) -> None:
    F, Q = discretise(np.array([[-a]]), np.eye(1), np.array([[3.0]]), 0.01)
    assert np.exp(-0.01 * a) == pytest.approx(F[0, 0], rel=1e-12)
    assert -3.0 * np.expm1(-0.02 * a) / (2.0 * a) == pytest.approx(Q[0, 0], rel=1e-12)


@pytest.mark.parametrize("v", [0.5, 20.0])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_filter_model_at_low_and_high_speed(v: float, h: float, wheelset: WheelsetParameters) -> None:
    # At walking pace the creep damping is fast enough for exp(-A h) to overflow what Q can resolve.
    W = np.diag([1.3e-5, 1e-4, 1e-4])
    for point in operating_points(CreepCurve(CONDITIONS["low"], v)):
        model = filter_model(point, wheelset)
        F, Q = discretise(model.A, model.B, W, h)
        reference = covariance_integral(model.A, model.B, W, h)
        assert linalg.expm(model.A * h) == pytest.approx(F, rel=1e-9, abs=1e-13 * np.abs(F).max())
        assert in_own_scale(Q, reference) == pytest.approx(in_own_scale(reference, reference), abs=1e-12)
        assert np.array_equal(Q, Q.T)


@given(matrices, matrices, steps, steps)
def test_two_steps_make_one(A: Array, G: Array, h1: float, h2: float) -> None:
    (F1, Q1), (F2, Q2), (F, Q) = (discretise(A, G, np.eye(3), h) for h in (h1, h2, h1 + h2))
    both, noise = F2 @ F1, F2 @ Q1 @ F2.T + Q2
    assert both == pytest.approx(F, abs=1e-12 * np.abs(F).max())
    assert noise == pytest.approx(Q, abs=1e-12 * np.abs(Q).max())


# Observable part -------------------------------------------------------------------------------------

INTEGRATORS = np.eye(4, k=1)  # x1' = x2, x2' = x3, ...
OSCILLATOR = np.array([[0.0, 1.0], [-9.0, 0.0]])
DRIVING = np.block([[OSCILLATOR, np.array([[0.0, 0.0], [1.0, 0.0]])], [np.zeros((2, 2)), 4 * OSCILLATOR]])


@pytest.mark.parametrize(
    ("A", "C", "seen"),
    [
        (INTEGRATORS, [[1, 0, 0, 0]], [0, 1, 2, 3]),
        (INTEGRATORS, [[0, 0, 1, 0]], [2, 3]),
        (INTEGRATORS, [[0, 0, 0, 1], [0, 1, 0, 0]], [1, 2, 3]),
        (np.diag([-1.0, -2.0, -3.0]), [[1, 1, 1]], [0, 1, 2]),
        (np.diag([-1.0, -2.0, -3.0]), [[1, 0, 1]], [0, 2]),
        (DRIVING, [[1, 0, 0, 0]], [0, 1, 2, 3]),
        (DRIVING, [[0, 0, 1, 0]], [2, 3]),
        (np.zeros((3, 3)), [[0, 1, 0]], [1]),
        (np.eye(3), [[0, 0, 0]], []),
        (np.eye(2), [[0, 0], [0, 2]], [1]),
    ],
)
def test_observable_part_of_textbook_systems(A: Array, C: list[list[float]], seen: list[int]) -> None:
    assert observable_part(A, np.array(C, dtype=float)) == seen


def test_equal_modes_are_seen_as_one() -> None:
    assert len(observable_part(-np.eye(3), np.ones((1, 3)))) == 1
    assert len(observable_part(-np.eye(3), np.array([[1.0, 1.0, 1.0], [1.0, 2.0, 3.0]]))) == 2


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("v", [1.0, 20.0, 100.0])
def test_sensors_see_everything_but_at_the_maximum(
    condition: str, v: float, wheelset: WheelsetParameters
) -> None:
    for point in operating_points(CreepCurve(CONDITIONS[condition], v)):
        model = filter_model(point, wheelset)
        seen = [model.state_labels[i] for i in observable_part(model.A, model.C)]
        all_but_position = ["psi", "y_dot", "psi_dot"]
        assert seen == (all_but_position if point.name == "P2" else [*all_but_position, "y_t", "y_rel"])


@given(
    st.sampled_from(["P1", "P2", "P3"]),
    arrays(np.float64, 5, elements=st.floats(-6.0, 6.0)),
    arrays(np.float64, 2, elements=st.floats(-6.0, 6.0)),
    st.permutations(range(5)),
    st.floats(-3.0, 3.0),
)
def test_observable_part_knows_no_units_and_no_order(
    points: dict[str, OperatingPoint],
    wheelset: WheelsetParameters,
    name: str,
    states: Array,
    outputs: Array,
    order: list[int],
    time: float,
) -> None:
    model = filter_model(points[name], wheelset)
    units = 10.0**states
    A = 10.0**time * (model.A / units[:, None] * units)[np.ix_(order, order)]
    C = (10.0 ** outputs[:, None] * model.C * units)[:, order]
    expected = observable_part(model.A, model.C)
    assert sorted(order[i] for i in observable_part(A, C)) == expected


# Design ----------------------------------------------------------------------------------------------


def model_of(A: Array, B: Array, C: Array) -> control.StateSpace:
    import control

    return control.ss(A, B, C, np.zeros((C.shape[0], B.shape[1])))


def riccati_step(f: LinearFilter, P: Array) -> tuple[Array, Array, Array]:
    """One step of the textbook recursion: predicted covariance, gain and innovation covariance."""
    S = f.H @ P @ f.H.T + f.R
    K = P @ f.H.T @ np.linalg.inv(S)
    I_KH = np.eye(P.shape[0]) - K @ f.H
    updated = I_KH @ P @ I_KH.T + K @ f.R @ K.T  # Joseph's form
    return f.F @ updated @ f.F.T + f.Q, K, S


@settings(max_examples=20)
@given(matrices, st.integers(0, 2**32 - 1))
def test_filter_is_the_limit_of_the_textbook_recursion(A: Array, seed: int) -> None:
    rng = np.random.default_rng(seed)
    C = rng.standard_normal((2, 3))
    C[0, 0] += 10.0
    A = A - 3.0 * np.eye(3) * (seed % 2)  # stable and unstable models
    A[0, 1], A[1, 2] = 4.0, 4.0  # a chain seen from its end
    W, R = np.diag([1.0, 0.1, 3.0]), np.diag([0.5, 2.0])
    f = design_filter(model_of(A, np.eye(3), C), W, R, 0.2, name="test")
    P = np.eye(3)
    for _ in range(200):
        P, K, S = riccati_step(f, P)
    for found, expected in ((f.P, P), (f.K, K), (f.S, S)):
        assert found == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("i", range(3), ids=["P1", "P2", "P3"])
def test_wheelset_filter_is_steady_and_forgets(i: int, filters: tuple[LinearFilter, ...]) -> None:
    f = filters[i]
    P, gain, innovation = riccati_step(f, f.P)
    assert in_own_scale(P, f.P) == pytest.approx(in_own_scale(f.P, f.P), abs=1e-9)
    assert gain == pytest.approx(f.K, rel=1e-9)
    assert innovation == pytest.approx(f.S, rel=1e-9)
    assert np.max(np.abs(np.linalg.eigvals(f.F - f.F @ f.K @ f.H))) < 1.0


def test_filter_leaves_out_what_cannot_be_seen(filters: tuple[LinearFilter, ...]) -> None:
    assert [f.name for f in filters] == ["P1", "P2", "P3"]
    assert filters[0].dropped == filters[2].dropped == ()
    assert filters[1].states == ("psi", "y_dot", "psi_dot")
    assert filters[1].dropped == ("y_t", "y_rel")
    assert filters[1].F.shape == (3, 3)


def test_no_filter_where_an_undamped_mode_is_not_excited(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    model = filter_model(points["P2"], wheelset)
    with pytest.raises(ValueError, match=r"^P2: got no steady-state .* some process noise$"):
        design_filter(model, np.diag([1e-5, 0.0, 0.0]), np.diag([1e-6, 1e-3]), 1e-3, name="P2")


def test_no_filter_for_an_oscillator_that_nothing_excites() -> None:
    ringing = model_of(OSCILLATOR, np.eye(2), np.eye(2)[:1])
    with pytest.raises(ValueError, match=r"^ringing: got no steady-state .* some process noise$"):
        design_filter(ringing, np.zeros((2, 2)), np.eye(1), 0.1, name="ringing")


def test_no_filter_for_noise_that_reaches_a_measurement_directly() -> None:
    import control

    direct = control.ss(-np.eye(1), np.eye(1), np.eye(1), np.eye(1))
    with pytest.raises(ValueError, match=r"^direct: got a model with feedthrough, expected D = 0"):
        design_filter(direct, np.eye(1), np.eye(1), 0.1, name="direct")


def test_no_filter_on_a_mixture_of_states() -> None:
    twins = model_of(-np.eye(2), np.eye(2), np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"^twins: got .* mixture of states, .* Kalman decomposition"):
        design_filter(twins, np.eye(2), np.eye(1), 0.1, name="twins")


@pytest.mark.parametrize("i", range(2), ids=["P1", "P2"])
def test_innovations_of_the_own_model_are_white(
    i: int, filters: tuple[LinearFilter, ...], simulate: Simulate
) -> None:
    f, samples = filters[i], 20_000
    e = FilterBank([f]).innovations(simulate(f, samples, 7))[:, 0]
    nis = float(np.sum(e * np.linalg.solve(f.S, e.T).T))
    low, high = stats.chi2(e.size).ppf([1e-5, 1.0 - 1e-5])
    assert low < nis < high
    white = np.linalg.solve(np.linalg.cholesky(f.S), e.T)
    bound = stats.norm.isf(1e-6) / np.sqrt(samples)
    assert white @ white.T / samples == pytest.approx(np.eye(2), abs=1.5 * bound)
    for lag in (1, 2, 5, 50):
        assert white[:, lag:] @ white[:, :-lag].T / samples == pytest.approx(0.0, abs=bound)
