"""The equations of motion in C against the same equations in Python, and their exact derivatives."""

from __future__ import annotations

import ctypes
import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmu_wheelset import CONDITIONS, WheelsetParameters
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    Make = Callable[..., ctypes.Structure]

STEP = 1e-30
#: Ordinary magnitudes of the states: y, psi, their rates, wheel speeds, twist, speed.
SCALE = np.array([2e-3, 1e-3, 2e-2, 2e-2, 0.5, 0.5, 1e-3, 5.0])

#: All options on; the states reach from free running through the flange's transition to beyond it.
OPTIONS = {
    "delta_r": 2e-3, "k_y": 3e5, "c_y": 2e4, "c_w": 5e3, "contact_angle": 0.1, "contact_angle_rate": 12.0,
    "flange_stiffness": 1.5e7, "flange_clearance": 5e-4, "flange_transition": 5e-4, "flange_damping": 40.0,
}  # fmt: skip

modes = st.sampled_from(list(DriveMode))
switches = st.booleans()
speeds = st.one_of(st.floats(-60.0, 100.0), st.floats(-0.2, 0.2))
units = st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8).map(np.array)
names = st.sampled_from(sorted(CONDITIONS))


class Point:
    """A reference model, states and inputs at which derivatives are taken."""

    def __init__(
        self, reference: Any, mode: DriveMode, forward: bool, options: bool, v: float, unit: Any, rails: Any
    ) -> None:
        chosen = OPTIONS if options else {}
        self.model = reference.Model(mode, forward, WheelsetParameters(c_s=33.0, **chosen))
        rolling = np.array([0, 0, 0, 0, v / 0.5, v / 0.5, 0, v])
        self.x = rolling + SCALE * unit * (np.arange(8) < 7)
        sides = {**reference.with_rail(CONDITIONS[rails[0]], "left")}
        sides |= reference.with_rail(CONDITIONS[rails[1]], "right")
        self.u = (
            reference.INPUTS
            | sides
            | {
                "speed": v,
                "prescribed_creepage": 4e-3 * unit[7],
                "traction_torque": 5e3,
                "suspension_lateral_force": -3e3,
                "suspension_yaw_moment": 2e3,
                "curve_force": 1e3,
                "curvature": 2e-3,
                "cant": -0.1,
                "running_resistance": 4e2,
                "track_lateral_offset": 5e-4,
                "normal_load_right": 7e4,
            }
        )


@pytest.fixture(scope="module")
def evaluate(core: SimpleNamespace, wheelset_struct: Make) -> Callable[[Point], tuple[Any, Any, Any]]:
    """The C evaluation and outputs at a point."""

    def call(point: Point) -> tuple[Any, Any, Any]:
        wheelset, e, y = wheelset_struct(point.model, point.x, point.u), core.Evaluation(), core.Outputs()
        core.library.wheelset_evaluate(ctypes.byref(wheelset), wheelset.x, ctypes.byref(e))
        core.library.wheelset_outputs(ctypes.byref(wheelset), wheelset.x, ctypes.byref(e), ctypes.byref(y))
        return wheelset, e, y

    return call


@pytest.fixture(scope="module")
def tangent(core: SimpleNamespace, evaluate: Any) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Directional derivatives of x_dot and of the outputs in C."""

    def call(point: Point, d_x: np.ndarray, d_u: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        wheelset, e, _ = evaluate(point)
        seed_x = core.vector(*d_x)
        seed_u = core.filled(core.Inputs, np.array(list(d_u.values())))
        d, dy = core.Evaluation(), core.Outputs()
        arguments = (ctypes.byref(e), seed_x, ctypes.byref(seed_u), ctypes.byref(d))
        core.library.wheelset_tangent(ctypes.byref(wheelset), wheelset.x, *arguments)
        core.library.wheelset_outputs_tangent(ctypes.byref(wheelset), *arguments, ctypes.byref(dy))
        return np.array(d.x_dot), core.flat(dy)

    return call


@given(modes, switches, switches, speeds, units, names, names)
def test_state_derivatives_agree_with_the_reference(
    reference: SimpleNamespace,
    evaluate: Any,
    mode: DriveMode,
    forward: bool,
    options: bool,
    v: float,
    unit: Any,
    a: str,
    b: str,
) -> None:
    point = Point(reference, mode, forward, options, v, unit, (a, b))
    expected = point.model.x_dot(list(point.x), point.u)
    assert list(evaluate(point)[1].x_dot) == pytest.approx(expected, rel=1e-10, abs=1e-9)


@given(modes, switches, switches, speeds, units, names)
def test_cheap_derivatives_have_the_same_bits(
    core: SimpleNamespace, reference: SimpleNamespace, evaluate: Any,
    mode: DriveMode, forward: bool, options: bool, v: float, unit: Any, name: str,
) -> None:  # fmt: skip
    wheelset, e, _ = evaluate(Point(reference, mode, forward, options, v, unit, (name, name)))
    x_dot = core.vector(*[0.0] * 8)
    core.library.wheelset_derivatives(ctypes.byref(wheelset), wheelset.x, x_dot)
    assert list(x_dot) == list(e.x_dot)


def complex_derivative(point: Point, d_x: np.ndarray, d_u: dict[str, float]) -> np.ndarray:
    x = [complex(value, STEP * d) for value, d in zip(point.x, d_x, strict=True)]
    u = {name: complex(value, STEP * d_u[name]) for name, value in point.u.items()}
    return np.array([complex(value).imag / STEP for value in point.model.x_dot(x, u)])


@given(modes, switches, switches, speeds, units, units, st.randoms(use_true_random=False), names)
def test_tangent_of_state_derivatives_is_exact(
    reference: SimpleNamespace, tangent: Any,
    mode: DriveMode, forward: bool, options: bool, v: float,
    unit: Any, direction: Any, random: Any, name: str,
) -> None:  # fmt: skip
    unit = np.where(np.abs(unit) < 1e-3, 0.5, unit)  # at zero creep the law has no derivative
    point = Point(reference, mode, forward, options, v, unit, (name, name))
    d_x = SCALE * direction
    d_u = {name: random.uniform(-1, 1) * max(abs(value), 1e-3) for name, value in point.u.items()}
    expected = complex_derivative(point, d_x, d_u)
    assert tangent(point, d_x, d_u)[0] == pytest.approx(
        expected, rel=1e-8, abs=1e-10 * np.abs(expected).max()
    )


@pytest.mark.parametrize("mode", list(DriveMode))
@pytest.mark.parametrize("forward", [False, True])
@pytest.mark.parametrize("options", [False, True])
@pytest.mark.parametrize("v", [20.0, 0.05, -20.0])
def test_tangent_of_outputs_is_exact(
    core: SimpleNamespace, reference: SimpleNamespace, evaluate: Any, tangent: Any,
    mode: DriveMode, forward: bool, options: bool, v: float,
) -> None:  # fmt: skip
    rng = np.random.default_rng(1)
    point = Point(reference, mode, forward, options, v, rng.uniform(0.2, 1.0, 8), ("dry", "wet"))
    if v < 1.0:
        point.x = point.x * 0.01 + [0, 0, 0, 0, 0, 0, 0, v]
    relative = 1e-4 if abs(v) > 1.0 else 1e-5
    d_x = relative * SCALE * rng.uniform(-1, 1, 8)
    d_u = {n: relative * rng.uniform(-1, 1) * (abs(value) or 1e-3) for n, value in point.u.items()}

    def outputs(k: float) -> np.ndarray:
        moved = Point(reference, mode, forward, options, v, np.zeros(8), ("dry", "wet"))
        moved.x = point.x + k * d_x
        moved.u = {n: value + k * d_u[n] for n, value in point.u.items()}
        return core.flat(evaluate(moved)[2])

    pairs = [outputs(k) - outputs(-k) for k in (1.0, 2.0, 3.0)]
    expected = (45 * pairs[0] - 9 * pairs[1] + pairs[2]) / 60
    scale = np.abs(outputs(0.0)) + np.abs(expected)
    found = tangent(point, d_x, d_u)[1]
    assert np.abs(found - expected).max() > 0.0  # different roundings, so both were really computed
    assert (np.abs(found - expected) <= 1e-6 * np.abs(expected) + 1e-11 * scale).all()


@given(modes, switches, switches, speeds, units, names)
def test_jacobian_holds_the_tangents_of_moving_states(
    core: SimpleNamespace, reference: SimpleNamespace, evaluate: Any, tangent: Any,
    mode: DriveMode, forward: bool, options: bool, v: float, unit: Any, name: str,
) -> None:  # fmt: skip
    point = Point(reference, mode, forward, options, v, unit, (name, name))
    wheelset, e, _ = evaluate(point)
    J = core.vector(*[np.nan] * 64)
    core.library.wheelset_jacobian(ctypes.byref(wheelset), wheelset.x, ctypes.byref(e), J)
    J = np.array(J).reshape(8, 8)
    moving = (ctypes.c_int * 8)()
    n = core.library.wheelset_moving_states(ctypes.byref(wheelset.p), moving)
    still = dict.fromkeys(point.u, 0.0)
    for j in range(8):
        if j in list(moving)[:n]:
            assert (J[:, j] == tangent(point, np.eye(8)[j], still)[0]).all()
        else:
            assert np.isnan(J[:, j]).all()


@pytest.mark.parametrize(("mode", "forward", "expected"), [
    (DriveMode.PRESCRIBED_CREEP, False, [0, 1, 2, 3]),
    (DriveMode.FREE_ROLLING, True, [0, 1, 2, 3, 7]),
    (DriveMode.TORQUE_DRIVEN, False, [0, 1, 2, 3, 4, 5, 6]),
    (DriveMode.TORQUE_DRIVEN, True, [0, 1, 2, 3, 4, 5, 6, 7]),
])  # fmt: skip
def test_only_states_that_can_move_are_integrated(
    core: SimpleNamespace, reference: SimpleNamespace, evaluate: Any,
    mode: DriveMode, forward: bool, expected: list[int],
) -> None:  # fmt: skip
    point = Point(reference, mode, forward, False, 20.0, np.linspace(0.2, 0.9, 8), ("dry", "low"))
    wheelset, e, _ = evaluate(point)
    moving = (ctypes.c_int * 8)()
    n = core.library.wheelset_moving_states(ctypes.byref(wheelset.p), moving)
    assert list(moving)[:n] == expected
    assert [i for i in range(8) if e.x_dot[i] != 0.0] == expected


def test_declared_dependencies_are_the_true_ones(reference: SimpleNamespace, tangent: Any) -> None:
    """An output depends on what can change it in some drive mode, and on nothing else."""
    from_c = {
        f"x_dot[{s}]": i
        for i, s in enumerate(("Y", "PSI", "Y_DOT", "PSI_DOT", "OMEGA_L", "OMEGA_R", "THETA", "V"))
    }
    axle = ("forward_speed", "relative_displacement", "axle_torque", "adhesion_used", "flange_force")
    wheel = (
        "wheel_speed",
        "creepage_x",
        "creepage_y",
        "creep_force_x",
        "creep_force_y",
        "adhesion_used",
        "g11",
        "g22",
    )
    from_c |= {f"outputs.{name}": 8 + i for i, name in enumerate(axle)}
    for k, side in enumerate(("LEFT", "RIGHT")):
        from_c |= {f"outputs.wheel[{side}].{name}": 13 + 8 * k + i for i, name in enumerate(wheel)}
    rows = {v.name: from_c[v.field] for v in VARIABLES if v.field in from_c}
    states = [v.name for v in VARIABLES if v.is_state]

    found: dict[str, set[str]] = {name: set() for name in rows}
    unit = np.array([0.6, 0.3, -0.5, 0.6, 0.7, -0.4, 0.3, 0.5])
    for mode in DriveMode:
        for forward, options in itertools.product((False, True), repeat=2):
            point = Point(reference, mode, forward, options, 20.0, unit, ("dry", "wet"))
            for name in (*point.u, *states):
                d_x = np.array([float(state == name) for state in states])
                d_u = {n: float(n == name) for n in point.u}
                values = np.concatenate(tangent(point, d_x, d_u))
                for output, row in rows.items():
                    if values[row] != 0.0:
                        found[output].add(name)
    for name, known in found.items():
        assert known == set(VARIABLES[REFERENCES[name]].depends_on), name
