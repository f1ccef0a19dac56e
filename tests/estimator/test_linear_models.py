from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import brentq

from estimator.contact import CreepCurve
from estimator.linear_models import (
    TRACK_DECAY,
    OperatingPoint,
    critical_speed,
    filter_model,
    klingel_wavelength,
    operating_points,
    point_at,
    wheelset_model,
)
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import control
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def slopes(g11: float, g22: float, v: float) -> OperatingPoint:
    return OperatingPoint("test", creep=0.0, force=0.0, g11=g11, g22=g22, v=v)


def in_order(eigenvalues: Iterable[complex]) -> list[complex]:
    return sorted(eigenvalues, key=lambda s: (s.imag, s.real))


def eigenvalues(model: control.StateSpace) -> list[complex]:
    return in_order(np.linalg.eigvals(model.A))


def growth(point: OperatingPoint, wheelset: WheelsetParameters) -> float:
    return float(np.max(np.linalg.eigvals(wheelset_model(point, wheelset).A).real))


def response(model: control.StateSpace, s: complex) -> NDArray[np.complex128]:
    resolvent = np.linalg.solve(s * np.eye(model.nstates) - model.A, model.B.astype(complex))
    return np.asarray(model.C @ resolvent + model.D)


#: Springs, dampers and contact angles that the paper does not have.
SPRUNG = {"k_y": 8e5, "c_y": 3e4, "c_w": 2e4, "contact_angle": 0.1, "contact_angle_rate": 8.0}


@pytest.fixture(params=[{}, SPRUNG], ids=["plain", "sprung"])
def either(request: pytest.FixtureRequest) -> WheelsetParameters:
    return WheelsetParameters(**request.param)


# Operating points ------------------------------------------------------------------------------------


def test_points_lie_before_at_and_past_the_maximum(dry: CreepCurve) -> None:
    p1, p2, p3 = operating_points(dry, linear=0.2, unstable=1.5)
    assert [p1.creep, p2.creep, p3.creep] == pytest.approx([0.2 * p2.creep, dry.peak_creep, 1.5 * p2.creep])
    assert p1.g11 > 0.0 == p2.g11 > p3.g11
    for point in (p1, p2, p3):
        assert point.force == dry.force(point.creep)
        assert point.g11 == pytest.approx(float(dry.tangent(point.creep)), abs=1e-9 * dry.initial_slope)
        assert point.g22 == pytest.approx(point.force / point.creep, rel=1e-15)
        assert point.v == dry.v


@pytest.mark.parametrize(("linear", "unstable"), [(0.0, 2.0), (1.0, 2.0), (0.1, 1.0), (2.0, 0.1)])
def test_points_on_the_wrong_side_are_refused(dry: CreepCurve, linear: float, unstable: float) -> None:
    with pytest.raises(ValueError, match="expected 0 < linear < 1 < unstable"):
        operating_points(dry, linear=linear, unstable=unstable)


def test_a_curve_without_maximum_has_no_operating_points() -> None:
    with pytest.raises(ValueError, match="no maximum"):
        operating_points(CreepCurve(CONDITIONS["dry"], v=1e-3))


# Values ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("creep", "expected"),
    [
        (0.002484, [-9.45 + 8.89j, -9.45 - 8.89j, -364, -590]),
        (0.02484, [84.52j, -84.52j, 0, -103.6]),
        (0.04968, [4.62 + 84.4j, 4.62 - 84.4j, 0.21, -48.6]),
    ],
)
def test_eigenvalues_on_the_dry_curve(
    creep: float, expected: list[complex], dry: CreepCurve, wheelset: WheelsetParameters
) -> None:
    actual = eigenvalues(wheelset_model(point_at(dry, "test", creep), wheelset))
    # The table has three to four digits.
    assert actual == pytest.approx(in_order(expected), rel=1e-3, abs=0.006)


def test_free_wheelset_is_unstable_as_known() -> None:
    free = wheelset_model(slopes(1e7, 1e7, 20.0), WheelsetParameters(k_w=0.0))
    assert max(eigenvalues(free), key=lambda s: s.real + s.imag) == pytest.approx(0.199 + 12.643j, abs=6e-4)


def test_kinematic_wavelength(wheelset: WheelsetParameters) -> None:
    assert klingel_wavelength(wheelset) == pytest.approx(9.935, abs=5e-4)
    assert 20.0 / klingel_wavelength(wheelset) == pytest.approx(2.013, abs=5e-4)


@pytest.mark.parametrize(("g", "v"), [(1e7, 100.85), (5e6, 132.95), (4e6, 199.0)])
def test_critical_speed(g: float, v: float, wheelset: WheelsetParameters) -> None:
    assert critical_speed(g, g, wheelset) == pytest.approx(v, abs=0.006)


def test_wheelset_of_another_source_loses_stability_at_its_known_speed(
    davis_wheelset: WheelsetParameters,
) -> None:
    assert critical_speed(1e6, 1e6, davis_wheelset) == pytest.approx(48.55, abs=0.01)


# Laws of the wheelset model --------------------------------------------------------------------------


def accelerations(curve: CreepCurve, p: WheelsetParameters, creep: float, q: Array) -> Array:
    """(8) and (9) with the creepages (1)-(3) at common creep; q = (y, psi, y_dot, psi_dot, y_t)."""
    y, psi, y_dot, psi_dot, y_t = q
    steering = p.L_g * psi_dot / curve.v + p.gamma * (y - y_t) / p.r0
    creep_y = y_dot / curve.v - psi
    f_xL, f_yL = curve.forces(creep + steering, creep_y)
    f_xR, f_yR = curve.forces(creep - steering, creep_y)
    spring = -p.k_y * y - p.c_y * y_dot - 2.0 * p.N * p.contact_angle_rate * (y - y_t)
    moment = -p.k_w * psi - p.c_w * psi_dot + 2.0 * p.N * p.contact_angle * p.L_g * psi
    return np.array([(spring - f_yR - f_yL) / p.m_w, ((f_xR - f_xL) * p.L_g + moment) / p.I_w])


def jacobian(f: Callable[[Array], Array], steps: Array) -> Array:
    """Fourth-order derivative of f at zero: central differences, extrapolated once (Richardson)."""

    def central(h: float) -> Array:
        columns = [(f(h * step) - f(-h * step)) / (2.0 * h * step.sum()) for step in np.diag(steps)]
        return np.stack(columns, axis=1)

    return (4.0 * central(0.5) - central(1.0)) / 3.0


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("v", [5.0, 20.0, 60.0])
@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
def test_model_is_the_derivative_of_the_nonlinear_equations(
    condition: str, v: float, name: str, either: WheelsetParameters
) -> None:
    curve = CreepCurve(CONDITIONS[condition], v)
    point = next(p for p in operating_points(curve) if p.name == name)
    creep = 3e-3 * point.creep
    steps = creep * np.array([either.r0 / either.gamma, 1.0, v, v / either.L_g, 1.0])
    steps[4] = steps[0]
    numeric = jacobian(lambda q: accelerations(curve, either, point.creep, q), steps)
    model = wheelset_model(point, either)
    linear = np.hstack([model.A[2:], model.B[2:]])
    # By rows, in creepages: at the maximum whole columns vanish.
    scale = np.max(np.abs(linear * steps), axis=1, keepdims=True)
    assert numeric * steps / scale == pytest.approx(linear * steps / scale, abs=1e-8)
    assert model.A[:2].tolist() == [[0, 0, 1, 0], [0, 0, 0, 1]]
    assert model.C.tolist() == [[0, 0, 0, 1], model.A[2].tolist()]
    assert model.D.tolist() == [[0], model.B[2].tolist()]


log_slopes = st.floats(5.0, 7.5).map(lambda power: 10.0**power)


@given(log_slopes, log_slopes, st.floats(1e5, 1e7), st.floats(0.02, 0.3))
def test_stability_is_lost_at_the_critical_speed_only(
    g11: float, g22: float, k_w: float, gamma: float
) -> None:
    wheelset = WheelsetParameters(k_w=k_w, gamma=gamma)
    v_c = critical_speed(g11, g22, wheelset)

    def growth_at(v: float) -> float:
        return growth(slopes(g11, g22, v), wheelset)

    if math.isinf(v_c):
        assert all(growth_at(v) < 0.0 for v in (1.0, 10.0, 100.0, 1e3))
    else:
        assume(v_c < 2e3)
        assert growth_at(v_c / 2.0) < 0.0 < growth_at(2.0 * v_c)
        assert brentq(growth_at, 0.9 * v_c, 1.1 * v_c, xtol=1e-13) == pytest.approx(v_c, rel=1e-9)


@given(
    log_slopes, log_slopes, st.floats(1e5, 1e7), st.floats(0.0, 3e6), st.floats(0.0, 3e5), st.floats(0.0, 3e5)
)
def test_springs_and_dampers_count_in_the_critical_speed(
    g11: float, g22: float, k_w: float, k_y: float, c_y: float, c_w: float
) -> None:
    wheelset = WheelsetParameters(
        k_w=k_w, k_y=k_y, c_y=c_y, c_w=c_w, contact_angle=0.1, contact_angle_rate=5.0
    )
    v_c = critical_speed(g11, g22, wheelset)

    def growth_at(v: float) -> float:
        return growth(slopes(g11, g22, v), wheelset)

    assert all(growth_at(v) < 0.0 for v in np.geomspace(0.1, min(0.999 * v_c, 1e4), 30))
    if v_c < 1e4:
        assert growth_at(1.001 * v_c) > 0.0


def test_slack_grip_is_stable_at_every_speed(wheelset: WheelsetParameters) -> None:
    assert critical_speed(3e6, 3e6, wheelset) == math.inf


def test_without_a_yaw_spring_no_speed_is_stable() -> None:
    free = WheelsetParameters(k_w=0.0)
    assert critical_speed(1e7, 1e7, free) == 0.0
    assert all(growth(slopes(1e7, 1e7, v), free) > 0.0 for v in (0.1, 1.0, 10.0))


def test_contact_angles_that_outweigh_the_yaw_spring_leave_no_speed_stable() -> None:
    p = WheelsetParameters(contact_angle=0.5, k_w=0.9 * 0.5 * 2.0 * 79.7e3 * 0.75)
    assert critical_speed(1e7, 1e7, p) == 0.0
    assert all(growth(slopes(1e7, 1e7, v), p) > 0.0 for v in (0.1, 1.0, 10.0, 100.0))


@pytest.mark.parametrize(("g11", "g22"), [(0.0, 1e6), (-1e5, 1e6), (1e6, 0.0), (math.nan, 1e6)])
def test_no_critical_speed_past_the_maximum(g11: float, g22: float, wheelset: WheelsetParameters) -> None:
    with pytest.raises(ValueError, match=r"critical speed: got .* expected both > 0"):
        critical_speed(g11, g22, wheelset)


def test_slow_free_motion_is_the_kinematic_one_that_inertia_makes_grow() -> None:
    # With s = i omega (1 + delta) the inertia forces m s and I s/L^2, small against the creep damping
    # 2 g/v, give delta = -i omega v (m + I/L^2)/(4 g) at first order; the frequency follows at second.
    free, g = WheelsetParameters(k_w=0.0), 1e7

    def departure(v: float) -> complex:
        kinematic = 2.0 * math.pi * v / klingel_wavelength(free)
        modes = eigenvalues(wheelset_model(slopes(g, g, v), free))
        slow = min(modes, key=lambda s: abs(s - 1j * kinematic)) / (1j * kinematic)
        inertia = free.m_w + free.I_w / free.L_g**2
        return (slow - 1.0) / (-1j * kinematic * v * inertia / (4.0 * g))

    assert departure(1.0) == pytest.approx(1.0, abs=1e-3)
    # A frequency lower than Klingel's by a term in v^4: here relative to a growth in v^2.
    assert abs(departure(8.0) - 1.0) / abs(departure(4.0) - 1.0) == pytest.approx(4.0, rel=0.01)


def test_signals_are_named(points: dict[str, OperatingPoint], wheelset: WheelsetParameters) -> None:
    plant, hypothesis = (f(points["P3"], wheelset) for f in (wheelset_model, filter_model))
    assert plant.output_labels == hypothesis.output_labels == ["yaw_rate", "lateral_acceleration"]
    assert plant.input_labels == ["y_t"]
    assert hypothesis.input_labels == ["w", "a_y", "a_psi"]
    assert plant.state_labels == ["y", "psi", "y_dot", "psi_dot"]
    assert hypothesis.state_labels == ["psi", "y_dot", "psi_dot", "y_t", "y_rel"]


# The filter model against the wheelset model ---------------------------------------------------------


@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
def test_filter_model_has_the_modes_of_wheelset_and_track(
    name: str, points: dict[str, OperatingPoint], either: WheelsetParameters
) -> None:
    plant = [*eigenvalues(wheelset_model(points[name], either)), -TRACK_DECAY]
    found = eigenvalues(filter_model(points[name], either))
    assert found == pytest.approx(in_order(plant), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
@pytest.mark.parametrize("frequency", [1e-3, 1.0, 12.0, 84.5, 2e3])
def test_filter_model_is_the_wheelset_on_a_track_that_integrates_w(
    name: str, frequency: float, points: dict[str, OperatingPoint], either: WheelsetParameters
) -> None:
    s = 0.3 + 1j * frequency  # off the axis, where P2 has its poles
    track = 1.0 / (s + TRACK_DECAY)
    expected = response(wheelset_model(points[name], either), s)[:, 0] * track
    found = response(filter_model(points[name], either), s)[:, 0]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("column", "row"), [(1, 2), (2, 3)])
def test_unmodelled_accelerations_act_like_forces(
    column: int, row: int, points: dict[str, OperatingPoint], either: WheelsetParameters
) -> None:
    plant = wheelset_model(points["P1"], either)
    forced = np.linalg.solve((0.5 + 7j) * np.eye(4) - plant.A, np.eye(4)[row])
    found = response(filter_model(points["P1"], either), 0.5 + 7j)[:, column]
    assert found == pytest.approx(plant.C @ forced, rel=1e-9)


def test_the_track_offset_shifts_the_wheelset(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    # A wheelset that sits on a shifted track does not feel the shift.
    model = wheelset_model(points["P1"], wheelset)
    assert model.A @ [1.0, 0.0, 0.0, 0.0] + model.B[:, 0] == pytest.approx(0.0, abs=1e-12)


def test_the_speed_of_the_point_counts(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    # Only the creep damping knows the speed, and it is inverse to it.
    slow, fast = (wheelset_model(replace(points["P1"], v=v), wheelset).A for v in (10.0, 30.0))
    damping = np.zeros((4, 4), dtype=bool)
    damping[2, 2] = damping[3, 3] = True
    assert np.array_equal(slow[~damping], fast[~damping])
    assert slow[damping] == pytest.approx(3.0 * fast[damping], rel=1e-14)
