from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.kalman import design_filter, discretise
from estimator.linear_models import OperatingPoint, filter_model
from estimator.structure import detectable, stabilisable, steady_filter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fmu_wheelset.parameters import WheelsetParameters

    Array = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)


# Stabilisable, detectable ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("poles", "holds", "reason"),
    [
        ([-1.0, -2.0], True, r"y\[0\] sees every mode that does not decay"),
        ([-1.0, 2.0], False, r"y\[0\] cannot see the growing mode of x\[1\] \(2 1/s\)"),
        ([-1.0, 0.0], False, r"y\[0\] cannot see the integrator x\[1\]"),
        ([1.0, -2.0], True, "sees every"),
    ],
)
def test_what_does_not_decay_must_be_seen(make, poles, holds: bool, reason: str) -> None:
    import re

    model = make(np.diag(poles), [[1.0], [0.0]], [[1.0, 0.0]])
    for verdict in (detectable(model), stabilisable(model)):
        assert verdict.holds is bool(verdict) is holds
    assert re.search(reason, detectable(model).reason)
    assert [o.mode.eigenvalue for o in detectable(model).obstacles] == ([] if holds else [poles[1]])


def test_an_oscillation_is_named_once(make) -> None:
    A = np.array([[-1, 0, 0], [0, 0, 6.0], [0, -6.0, 0]])
    reason = detectable(make(A, None, [[1, 0, 0]])).reason
    assert reason == "y[0] cannot see the undamped oscillation at 0.9549 Hz (x[1])"


def test_sampled_models_decay_within_the_unit_circle(make) -> None:
    assert detectable(make(np.diag([0.5, -0.9]), None, [[0.0, 0.0]], dt=0.1))
    assert not detectable(make(np.diag([0.5, -1.1]), None, [[1.0, 0.0]], dt=0.1))
    assert not stabilisable(make(np.diag([0.5, 1.0]), [[1.0], [0.0]], dt=0.1))


# Steady-state filter ---------------------------------------------------------------------------------


def test_scalar_filter(make) -> None:
    a, w, r = 0.7, 2.0, 0.5
    f = steady_filter(make([[a]]), [[w]], [[r]])
    P = r * (a + math.sqrt(a**2 + w / r))
    assert f.covariance == pytest.approx(P)
    assert f.gain == pytest.approx(P / r)
    assert f.error_modes == pytest.approx([-math.sqrt(a**2 + w / r)])


def test_a_mode_that_grows_need_not_be_excited(make) -> None:
    f = steady_filter(make([[2.0]]), [[0.0]], [[1.0]])
    assert f.exists
    assert f.error_modes == pytest.approx([-2.0])  # the mirror image
    assert f.covariance == pytest.approx(4.0)


def test_an_undamped_mode_must_be_excited(make) -> None:
    model = make(np.diag([0.0, -1.0]), np.eye(2), [[1.0, 1.0]])
    f = steady_filter(model, np.diag([0.0, 1.0]), [[1.0]])
    assert not f.exists
    assert "no noise excites the integrator x[0]" in f.exists.reason
    assert (f.gain, f.covariance, f.error_modes) == (None, None, ())
    assert steady_filter(model, np.diag([1e-20, 1.0]), [[1.0]]).exists
    # Noises that are one and the same excite in one direction only.
    twins = make([[0.0]], [[1.0, -1.0]], [[1.0]])
    assert not steady_filter(twins, np.ones((2, 2)), [[1.0]]).exists
    assert steady_filter(twins, np.eye(2), [[1.0]]).exists


def test_what_is_not_seen_has_no_filter(make) -> None:
    model = make(np.diag([0.5, -1.0]), np.eye(2), [[0.0, 1.0]])
    f = steady_filter(model, np.eye(2), [[1.0]])
    assert f.exists.reason == "no steady filter: y[0] cannot see the growing mode of x[0] (0.5 1/s)"


@settings(max_examples=25)
@given(seeds)
def test_it_solves_its_riccati_equation_and_forgets(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-4, 4, 4)
    A, B, C = rng.standard_normal((4, 4)), rng.standard_normal((4, 2)), rng.standard_normal((2, 4))
    A, B, C = A / units[:, None] * units, B / units[:, None], C * units
    W, R = np.diag([1e-3, 10.0]), np.diag([1e-6, 1e2])
    f = steady_filter(make(A, B, C), W, R)
    assert f.exists
    P, one = f.covariance * np.outer(units, units), np.diag(units)
    residual = (A @ f.covariance + f.covariance @ A.T + B @ W @ B.T - f.gain @ R @ f.gain.T) * np.outer(
        units, units
    )
    size = np.abs(one @ (f.gain @ R @ f.gain.T) @ one).max()
    assert residual == pytest.approx(0.0, abs=1e-7 * size)
    assert np.linalg.eigvalsh(P).min() > -1e-9 * np.linalg.norm(P)
    assert max(s.real for s in f.error_modes) < 0.0
    assert f.error_modes[0].real == max(s.real for s in f.error_modes)


def test_sampled_filter_is_that_of_the_bank(points: dict[str, OperatingPoint], wheelset: WheelsetParameters):
    import control

    W, R, h = np.diag([1.3e-5, 1e-4, 1e-4]), np.diag([1e-6, 2.5e-3]), 1e-3
    for name in ("P1", "P3"):
        model = filter_model(points[name], wheelset)
        ours = design_filter(model, W, R, h, name=name)
        F, Q = discretise(model.A, model.B, W, h)
        f = steady_filter(control.ss(F, np.eye(5), model.C, np.zeros((2, 5)), h), Q, R)
        assert f.exists
        assert f.gain == pytest.approx(ours.K, rel=1e-6)
        assert f.covariance == pytest.approx(ours.P, rel=1e-6, abs=1e-9 * ours.P.max())
        # The continuous filter with the same noise a second is near: 1 kHz is fast against its modes.
        continuous = steady_filter(model, W, R * h)
        decays = sorted(np.log(np.abs(f.error_modes)) / h)
        assert decays[-1] == pytest.approx(continuous.error_modes[0].real, rel=1e-3)


@pytest.mark.parametrize(
    ("W", "R", "match"),
    [
        ([[1.0, 0.0], [0.0, 1.0]], [[1.0]], r"(?s)W: got .* shape \(1, 1\)"),
        ([[-1.0]], [[1.0]], "W: got .* positive semidefinite"),
        ([[1.0]], [[0.0]], "R: got .* positive definite"),
        ([[1.0]], [[np.nan]], "R: got"),
    ],
)
def test_noise_that_cannot_be_is_refused(make, W, R, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        steady_filter(make([[-1.0]]), W, R)


def test_noise_straight_to_an_output_is_refused() -> None:
    import control

    model = control.ss([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
    with pytest.raises(ValueError, match="reaches an output directly, expected D = 0"):
        steady_filter(model, [[1.0]], [[1.0]])
