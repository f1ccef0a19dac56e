from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from estimator.linear_models import OperatingPoint, full_model, klingel_wavelength, wheelset_model
from estimator.structure import LinearSystem, Scales, modes, natural_scales, scaled
from fmu_wheelset.parameters import WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

logs = st.floats(-5.0, 5.0)


def test_mass_on_a_spring(make) -> None:
    m, k, d = 2.0, 50.0, 4.0
    slow, other = modes(make([[0, 1], [-k / m, -d / m]]))
    omega, zeta = math.sqrt(k / m), d / (2.0 * math.sqrt(k * m))
    assert slow.exponent == pytest.approx(complex(-zeta * omega, omega * math.sqrt(1.0 - zeta**2)))
    assert other.exponent == slow.exponent.conjugate()
    assert slow.frequency == pytest.approx(omega * math.sqrt(1.0 - zeta**2) / (2.0 * math.pi))
    assert slow.damping_ratio == pytest.approx(zeta)
    assert slow.time_constant == pytest.approx(2.0 * m / d)
    assert slow.shape[1] / slow.shape[0] == pytest.approx(slow.exponent)
    assert slow.behaviour == "decays"


@pytest.mark.parametrize(
    ("A", "behaviour", "ratio", "constant"),
    [([[0.5]], "grows", -1.0, 2.0), ([[-0.25]], "decays", 1.0, 4.0), ([[0.0]], "undamped", 0.0, math.inf)],
)
def test_real_modes(make, A, behaviour, ratio, constant) -> None:
    (mode,) = modes(make(A))
    assert (mode.behaviour, mode.damping_ratio, mode.frequency) == (behaviour, ratio, 0.0)
    assert mode.time_constant == pytest.approx(constant)


def test_rounding_is_not_taken_for_damping(make) -> None:
    # An undamped oscillator in a basis that hides it; the eigenvalue comes out with a real part of 1e-13.
    T = np.random.default_rng(3).standard_normal((4, 4))
    A = np.array([[0, 90, 0, 0], [-90, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, -400]], dtype=float)
    found = modes(make(T @ A @ np.linalg.inv(T)))
    assert [m.behaviour for m in found] == ["undamped", "undamped", "decays", "decays"]
    assert found[0].damping_ratio == 0.0
    assert found[0].time_constant == math.inf


def test_a_chain_of_integrators_has_no_participation(make) -> None:
    first, second = modes(make([[0, 1], [0, 0]], [[0], [1]], [[1, 0]]))
    assert np.isnan(first.participation).all()
    assert first.behaviour == second.behaviour == "undamped"
    assert first.dominant == "x[0]"


def test_a_sampled_model_has_the_modes_of_the_motion_it_samples(make) -> None:
    A, h = np.array([[0.0, 1.0], [-25.0, -2.0]]), 0.05
    from scipy.linalg import expm

    sampled, continuous = modes(make(expm(A * h), dt=h)), modes(make(A))
    for a, b in zip(sampled, continuous, strict=True):
        assert a.exponent == pytest.approx(b.exponent)
        assert (a.frequency, a.damping_ratio) == pytest.approx((b.frequency, b.damping_ratio))
    assert modes(make([[1.0]], dt=h))[0].behaviour == "undamped"
    assert modes(make([[1.5]], dt=h))[0].behaviour == "grows"
    assert modes(make([[0.0]], dt=h))[0].behaviour == "decays"


@given(arrays(np.float64, 4, elements=logs), st.permutations(range(4)), st.integers(0, 2**32 - 1))
def test_units_and_order_of_the_states_do_not_count(make, units: Array, order: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = (rng.standard_normal(shape) for shape in ((4, 4), (4, 2), (2, 4)))
    s = 10.0**units
    A2, B2, C2 = (A / s[:, None] * s)[np.ix_(order, order)], (B / s[:, None])[order], (C * s)[:, order]
    for a, b in zip(modes(make(A, B, C)), modes(make(A2, B2, C2)), strict=True):
        assert b.exponent == pytest.approx(a.exponent, rel=1e-6, abs=1e-9)
        assert b.participation == pytest.approx(a.participation[order], rel=1e-5, abs=1e-9)
        assert np.abs(b.scaled_shape) == pytest.approx(np.abs(a.scaled_shape[order]), rel=1e-5, abs=1e-8)
        assert np.abs(b.adjoint) == pytest.approx(np.abs(a.adjoint[order]), rel=1e-5, abs=1e-8)


@given(st.integers(0, 2**32 - 1))
def test_shapes_are_eigenvectors_and_participations_sum_to_one_or_more(make, seed: int) -> None:
    A = np.random.default_rng(seed).standard_normal((5, 5)) * 10.0 ** np.arange(5)
    for mode in modes(make(A)):
        assert A @ mode.shape == pytest.approx(
            mode.eigenvalue * mode.shape, abs=1e-8 * np.abs(A).max() * np.abs(mode.shape).max()
        )
        assert np.linalg.norm(mode.scaled_shape) == pytest.approx(1.0)
        assert np.sum(mode.participation) >= 1.0 - 1e-9  # |sum w_i v_i| = |w' v|


def test_units_are_kept(wheelset: WheelsetParameters) -> None:
    point = OperatingPoint("", creep=0.0, force=0.0, g11=1e7, g22=1e7, v=20.0)
    units = ["m", "rad", "m/s", "rad/s"]
    system = LinearSystem.of(wheelset_model(point, wheelset), state_units=units)
    assert modes(system)[0].state_units == tuple(units)
    with pytest.raises(ValueError, match=r"state_units: got 1, expected 4"):
        LinearSystem.of(wheelset_model(point, wheelset), state_units=["m"])


def test_kinematic_motion_of_a_slow_free_wheelset() -> None:
    free, v = WheelsetParameters(k_w=0.0), 1.0
    point = OperatingPoint("", creep=0.0, force=0.0, g11=1e7, g22=1e7, v=v)
    slow = modes(wheelset_model(point, free))[0]
    assert slow.frequency == pytest.approx(v / klingel_wavelength(free), rel=1e-4)
    assert slow.behaviour == "grows"
    # Klingel: the wheelset points where it goes, y_dot = v psi.
    assert slow.shape[2] == pytest.approx(v * slow.shape[1], rel=0.02)


def test_axle_twist_swings_at_58_hz(wheelset: WheelsetParameters) -> None:
    # Without creep forces the two wheels swing against each other on the axle.
    point = OperatingPoint("", creep=0.0, force=0.0, g11=0.0, g22=1e6, v=20.0)
    twisting = next(
        m for m in modes(full_model(point, wheelset)) if m.dominant.startswith(("theta", "omega"))
    )
    found = max(m.frequency for m in modes(full_model(point, wheelset)))
    assert found == pytest.approx(58.3, abs=0.05)
    assert twisting.behaviour == "undamped"


# Scales ----------------------------------------------------------------------------------------------


@given(arrays(np.float64, 6, elements=logs), logs, st.integers(0, 2**32 - 1))
def test_scaled_models_do_not_know_the_units(make, units: Array, time: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = (np.round(rng.standard_normal(shape), 1) for shape in ((3, 3), (3, 2), (1, 3)))
    x, u, y, t = 10.0 ** units[:3], 10.0 ** units[3:5], 10.0 ** units[5:], 10.0**time
    here = scaled(LinearSystem.of(make(A, B, C)))
    there = scaled(LinearSystem.of(make(t * A / x[:, None] * x, t * B / x[:, None] * u, C / y[:, None] * x)))
    for name in "ABC":
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=1e-6)


def test_scales_bring_couplings_together(make) -> None:
    # x1' = 1e6 x2, x2' = -1e-4 x1 - 10 x2: in scaled units all couplings are of one size.
    system = LinearSystem.of(make([[0, 1e6], [-1e-4, -10.0]], [[0], [1e3]], [[1e-7, 0]]))
    inner = scaled(system)
    entries = np.abs(np.concatenate([M[M != 0] for M in (inner.A, inner.B, inner.C)]))
    assert entries == pytest.approx(1.0, rel=0.5)
    assert natural_scales(system).time == pytest.approx(0.1, rel=0.5)


@pytest.mark.parametrize("bad", [[1.0, 0.0], [1.0, -1.0], [1.0, np.nan]])
def test_scales_are_positive(bad: list[float]) -> None:
    with pytest.raises(ValueError, match=r"scales of states: got .* expected finite numbers > 0"):
        Scales(np.array(bad), np.ones(1), np.ones(1))


def test_unknown_names_are_refused(make) -> None:
    with pytest.raises(ValueError, match=r"inputs: got 'w', expected some of u\[0\]"):
        LinearSystem.of(make([[1.0]])).select(inputs=["w"])
