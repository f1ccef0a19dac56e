"""Directional and adjoint derivatives through the FMU, against differences and the linear model."""

from __future__ import annotations

import ctypes
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from estimator import CreepCurve, wheelset_model
from estimator.linear_models import point_at
from fmu_wheelset import CONDITIONS, WheelsetParameters
from fmu_wheelset.variables import VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    MakePlant = Callable[..., Any]

both = pytest.mark.parametrize("fmi", [2, 3])
modes = pytest.mark.parametrize("mode", list(DriveMode))
INPUTS = tuple(v.name for v in VARIABLES if v.causality == "input")
SET_STATES = tuple(v.name for v in VARIABLES if v.is_state and v.initial == "exact")
STATES = tuple(v.name for v in VARIABLES if v.is_state)
OUTPUTS = tuple(v.name for v in VARIABLES if v.causality == "output" or v.derivative_of)
LATERAL = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")
LATERAL_DERIVATIVES = ("lateral_velocity", "yaw_rate", "lateral_acceleration", "der(yaw_rate)")


def in_motion(plant: MakePlant, fmi: int, mode: DriveMode, speed: float, **start: float) -> Any:
    """An instance away from all symmetries, with all options of the physics on."""
    one = plant(fmi, drive_mode=mode, forward_dynamics=True, speed=speed, c_s=40.0, initial_creepage=2e-3)
    one.set(lateral_displacement=1e-3, yaw_angle=2e-4, lateral_velocity=5e-3, yaw_rate=-2e-3, axle_twist=1e-4)
    one.set(track_lateral_offset=3e-4, prescribed_creepage=3e-3, traction_torque=2e3, normal_load_left=7e4)
    one.set(delta_r=1e-3, contact_angle=0.05, contact_angle_rate=10.0, curvature=2e-3, cant=0.1)
    one.set(flange_stiffness=1e6, flange_clearance=4e-4, k_y=2e5, c_y=1e4, c_w=5e3)
    one.set(**start)
    return one.rail(CONDITIONS["wet"], "right")


def initialising(one: Any) -> Any:
    if one.fmi == 2:
        one.slave.setupExperiment(startTime=0.0)
    one.slave.enterInitializationMode()
    return one


def differences(one: Any, unknowns: Sequence[str], knowns: Sequence[str]) -> np.ndarray:
    """The Jacobian by central differences of the values that the FMU returns."""
    columns = []
    for name in knowns:
        at = one.get(name)[0]
        h = 1e-5 * max(abs(at), 1e-3)
        values = []
        for x in (at + h, at - h):
            one.set_named(name, x)
            values.append(np.array(one.get(*unknowns)))
        one.set_named(name, at)
        columns.append((values[0] - values[1]) / (2 * h))
    return np.column_stack(columns)


def assert_same(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Equal to the relative tolerance, or to a thousandth of it in units of the largest entry of the row."""
    size = np.abs(expected).max(axis=1, keepdims=True) + 1e-300
    relative = np.abs(found - expected) / np.maximum(np.abs(expected), 1e-3 * size)
    worst = np.unravel_index(relative.argmax(), relative.shape)
    assert relative.max() < tolerance, (worst, found[worst], expected[worst])


@both
@modes
@pytest.mark.parametrize("speed", [20.0, 0.05])
def test_derivatives_are_those_of_the_values(
    plant: MakePlant, fmi: int, mode: DriveMode, speed: float
) -> None:
    """Before the run, when the speeds of wheels and vehicle still follow the input."""
    one, knowns = initialising(in_motion(plant, fmi, mode, speed)), (*INPUTS, *SET_STATES)
    assert_same(one.jacobian(OUTPUTS, knowns), differences(one, OUTPUTS, knowns), 2e-5)


@both
@modes
def test_derivatives_by_inputs_during_the_run(plant: MakePlant, fmi: int, mode: DriveMode) -> None:
    one = in_motion(plant, fmi, mode, 20.0).initialise()
    one.run(5)
    assert_same(one.jacobian(OUTPUTS, INPUTS), differences(one, OUTPUTS, INPUTS), 2e-5)


def test_structure_holds_exactly_the_derivatives_that_can_differ_from_zero(plant: MakePlant) -> None:
    """No dependency is missing in any mode, and each declared one is there in some mode."""
    knowns = (*INPUTS, *STATES)
    declared = {v.name: {name for name in v.depends_on if name in knowns} for v in VARIABLES}
    found: dict[str, set[str]] = {name: set() for name in OUTPUTS}
    for forward in (False, True):
        for mode in DriveMode:
            one = in_motion(plant, 3, mode, 20.0, forward_dynamics=forward).initialise()
            for name, row in zip(OUTPUTS, one.jacobian(OUTPUTS, knowns), strict=True):
                found[name] |= {knowns[j] for j in np.flatnonzero(row)}
    assert found == {name: declared[name] for name in OUTPUTS}


@pytest.mark.parametrize("mode", [DriveMode.PRESCRIBED_CREEP, DriveMode.TORQUE_DRIVEN])
def test_both_standards_and_sums_of_seeds_agree(plant: MakePlant, mode: DriveMode) -> None:
    knowns = (*INPUTS, *STATES)
    J2, J3 = (in_motion(plant, fmi, mode, 20.0).initialise().jacobian(OUTPUTS, knowns) for fmi in (2, 3))
    assert np.array_equal(J2, J3)
    seed = np.random.default_rng(1).normal(size=len(knowns))
    one = in_motion(plant, 3, mode, 20.0).initialise()
    along = one.derivatives(OUTPUTS, knowns, seed)
    assert along == pytest.approx(J3 @ seed, rel=1e-9, abs=1e-9 * np.abs(J3).max())
    twice = one.derivatives(OUTPUTS, knowns * 2, [*seed, *seed])
    assert twice == pytest.approx(2 * along, rel=1e-12)


@modes
def test_adjoint_derivatives_are_the_transpose(plant: MakePlant, mode: DriveMode) -> None:
    one, knowns = in_motion(plant, 3, mode, 20.0).initialise(), (*INPUTS, *STATES)
    J, seed = one.jacobian(OUTPUTS, knowns), np.random.default_rng(2).normal(size=len(OUTPUTS))
    table = {v.name: i for i, v in enumerate(VARIABLES)}
    found = one.slave.getAdjointDerivative(
        [table[name] for name in OUTPUTS], [table[name] for name in knowns], list(seed), len(knowns)
    )
    size = np.abs(seed) @ np.abs(J)
    assert np.abs(np.array(found) - seed @ J).max() <= 1e-13 * size.max()
    assert (np.abs(np.array(found) - seed @ J) <= 1e-12 * size).all()


@both
@pytest.mark.parametrize("ratio", [0.1, 1.0, 2.0])
def test_state_matrix_is_that_of_the_linear_model(plant: MakePlant, fmi: int, ratio: float) -> None:
    """Equation (12) as the estimator implements it, in closed form."""
    curve = CreepCurve(CONDITIONS["dry"], v=20.0)
    point = point_at(curve, "", ratio * curve.peak_creep)
    model = wheelset_model(point, WheelsetParameters())
    one = plant(fmi, prescribed_creepage=point.creep).initialise()
    found = one.jacobian(LATERAL_DERIVATIVES, (*LATERAL, "track_lateral_offset"))
    assert_same(found, np.column_stack([model.A, model.B[:, 0]]), 1e-9)


@both
@pytest.mark.parametrize(
    ("creepage", "expected"),
    [
        (0.00248, [-590, -364, -9.45 - 8.89j, -9.45 + 8.89j]),
        (0.02484, [-103.6, 0, -84.52j, 84.52j]),
        (0.04968, [-48.6, 0.21, 4.62 - 84.4j, 4.62 + 84.4j]),
    ],
)
def test_poles_of_the_lateral_motion(
    plant: MakePlant, fmi: int, creepage: float, expected: list[complex]
) -> None:
    one = plant(fmi, prescribed_creepage=creepage).initialise()
    found = np.linalg.eigvals(one.jacobian(LATERAL_DERIVATIVES, LATERAL))
    for pole in expected:
        assert np.abs(found - pole).min() < 0.02 + 2e-3 * abs(pole)


def test_poles_of_the_axle_torsion(plant: MakePlant) -> None:
    """Twice the peak creep on dry rail at 20 m/s: self-excited at 58.3 Hz."""
    p = WheelsetParameters()
    one = plant(drive_mode=DriveMode.TORQUE_DRIVEN, initial_creepage=2 * 0.024845).initialise()
    spin = ("state.wheel_speed_left", "state.wheel_speed_right", "axle_twist")
    poles = np.linalg.eigvals(one.jacobian([f"der({name})" for name in spin], spin))
    torsion = poles[poles.imag.argmax()]
    assert torsion == pytest.approx(8.86 + 366.4j, abs=0.06)
    free = np.sqrt(p.k_s * (1 / p.I_L + 1 / p.I_R))
    assert torsion.imag == pytest.approx(free, rel=1e-2)


def test_fast_poles_at_low_speed(plant: MakePlant) -> None:
    fastest = []
    for speed in (20.0, 1.0):
        one = plant(speed=speed, drive_mode=DriveMode.TORQUE_DRIVEN).initialise()
        derivatives = [next(v.name for v in VARIABLES if v.derivative_of == name) for name in STATES]
        fastest.append(np.linalg.eigvals(one.jacobian(derivatives, STATES)).real.min())
    assert fastest[1] == pytest.approx(20.0 * fastest[0], rel=0.02)
    assert fastest[1] < -1e4


# Wrong calls -----------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize(
    ("unknown", "known", "message"),
    [
        ("left.g11", "m_w", "m_w: got it as a known of a derivative, expected an input or a state"),
        ("left.g11", "time", "time: got it as a known"),
        ("left.g11", "left.g22", "left.g22: got it as a known"),
        ("speed", "speed", "speed: got it as an unknown of a derivative, expected a state derivative or"),
        ("time", "speed", "time: got it as an unknown"),
        ("k_w", "speed", "k_w: got it as an unknown"),
        ("left.g11", "drive_mode", "drive_mode: got access as float"),
    ],
)
def test_wrong_variables(plant: MakePlant, fmi: int, unknown: str, known: str, message: str) -> None:
    one = plant(fmi).initialise()
    with pytest.raises(FMICallException):
        one.derivatives([unknown], [known], [1.0])
    assert len(one.messages) == 1
    assert re.match(message, one.messages[0])


@both
def test_not_before_initialisation(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    with pytest.raises(FMICallException):
        one.derivatives(["left.g11"], ["speed"], [1.0])
    assert "Derivative: not allowed while the instance is instantiated" in one.messages[0]
    initialising(one)
    with pytest.raises(FMICallException):
        one.derivatives(["left.g11"], ["state.forward_speed"], [1.0])
    assert "expected an input or a state that is set" in one.messages[1]
    one.slave.exitInitializationMode()
    one.derivatives(["left.g11"], ["state.forward_speed"], [1.0])


def test_number_of_seeds_must_match_in_fmi_3(plant: MakePlant) -> None:
    one = plant(3).initialise()
    references, values = (ctypes.c_uint32 * 2)(24, 25), (ctypes.c_double * 3)()
    one_, two, three = (ctypes.c_size_t(n) for n in (1, 2, 3))
    library, instance = ctypes.CDLL(one.slave.dll._name), ctypes.c_void_p(one.slave.component)
    for name, n, m in (("Directional", three, one_), ("Adjoint", one_, three)):
        one.messages.clear()
        call = getattr(library, f"fmi3Get{name}Derivative")
        assert call(instance, references, one_, references, two, values, n, values, m) == 3
        assert "derivatives: got" in one.messages[0]
