"""Two roads to one model: the plant FMU linearised by differences, and (12) in python-control."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from co_sim import Master, System, linearize
from co_sim.fmu import FmuComponent
from estimator import CreepCurve, OperatingPoint, operating_points, wheelset_model
from estimator.linear_models import full_model
from fmu_wheelset import CONDITIONS, WheelsetParameters, path

#: States of (12) as the FMU calls them, with the step of the central difference.
STATES = {"lateral_displacement": 1e-6, "yaw_angle": 1e-7, "lateral_velocity": 1e-5, "yaw_rate": 1e-5}
ACCELERATIONS = ("lateral_acceleration", "der(yaw_rate)")


def accelerations(
    point: OperatingPoint, condition: str, fmi: Literal[2, 3], start: dict[str, float], y_t: float = 0.0
) -> np.ndarray:
    """Accelerations of the FMU at given states, prescribed creep of `point`."""
    plant = FmuComponent(path(fmi=fmi), outputs=ACCELERATIONS, parameters=start)
    u = np.array([port.start for port in plant.inputs])
    names = [port.name for port in plant.inputs]
    u[names.index("speed")] = point.v
    u[names.index("prescribed_creepage")] = point.creep
    u[names.index("track_lateral_offset")] = y_t
    for side in ("left", "right"):
        for name in ("k_A", "k_S", "mu_0", "A", "B"):
            u[names.index(f"rail_{side}.{name}")] = getattr(CONDITIONS[condition], name)
    y = np.empty(2)
    plant.start(0.0, 1e-3)
    try:
        plant.exchange(u, y)
    finally:
        plant.close()
    return y


#: Suspension and contact angles; flanges do not touch.
OPTIONS = {
    "k_y": 8e5, "c_y": 3e4, "c_w": 2e4, "contact_angle": 0.1, "contact_angle_rate": 8.0,
    "flange_stiffness": 1.5e7,
}  # fmt: skip


@pytest.mark.parametrize("options", [{}, OPTIONS], ids=["plain", "sprung"])
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(("condition", "v"), [("dry", 20.0), ("wet", 50.0), ("very_low", 20.0)])
@pytest.mark.parametrize("index", [0, 1, 2], ids=["P1", "P2", "P3"])
def test_fmu_linearised_is_equation_12(
    fmi: Literal[2, 3], condition: str, v: float, index: int, options: dict[str, float]
) -> None:
    point = operating_points(CreepCurve(CONDITIONS[condition], v))[index]
    columns = []
    for name, step in STATES.items():
        plus, minus = (
            accelerations(point, condition, fmi, {name: sign * step, **options}) for sign in (1.0, -1.0)
        )
        columns.append((plus - minus) / (2.0 * step))
    plus, minus = (accelerations(point, condition, fmi, options, sign * 1e-6) for sign in (1.0, -1.0))

    model = wheelset_model(point, WheelsetParameters(**options))
    # Tolerances in units of each row's greatest entry: the yaw spring dwarfs g11 near the peak.
    measured = np.column_stack([*columns, (plus - minus) / 2e-6])
    expected = np.hstack([model.A[2:], model.B[2:]])
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(measured / scale, expected / scale, atol=3e-6)
    poles = np.linalg.eigvals(np.vstack([np.eye(4)[2:], measured[:, :4]]))
    distance = np.abs(np.subtract.outer(poles, model.poles()))
    # At P2 slopes of rounding size make two slow poles of what is one double pole of the model.
    assert (distance.min(axis=0) < 1e-4 * np.abs(poles).max()).all()


def test_no_lateral_motion_no_acceleration() -> None:
    point = operating_points(CreepCurve(CONDITIONS["dry"], 20.0))[0]
    np.testing.assert_allclose(accelerations(point, "dry", 3, {}), 0.0, atol=1e-12)


#: States, inputs and outputs of the torque-driven model as the FMU calls them.
DRIVEN = (
    "lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate", "state.wheel_speed_left",
    "state.wheel_speed_right", "axle_twist",
)  # fmt: skip
INPUTS = ("track_lateral_offset", "traction_torque", "suspension_lateral_force", "suspension_yaw_moment")
OUTPUTS = (
    "yaw_rate",
    "lateral_acceleration",
    "left.wheel_speed",
    "right.wheel_speed",
    "lateral_displacement",
)


@pytest.mark.parametrize(
    "options", [{}, {"c_s": 400.0}, OPTIONS | {"delta_r": 0.002}], ids=["plain", "damped", "sprung"]
)
@pytest.mark.parametrize("v", [20.0, 50.0])
@pytest.mark.parametrize("index", [0, 1, 2], ids=["P1", "P2", "P3"])
def test_directional_derivatives_are_the_torque_driven_model(
    index: int, v: float, options: dict[str, float]
) -> None:
    wheelset = WheelsetParameters(**{k: x for k, x in options.items() if k != "flange_stiffness"})
    point = operating_points(CreepCurve(CONDITIONS["dry"], v))[index]
    plant = FmuComponent(
        path(fmi=3),
        inputs=INPUTS,
        outputs=OUTPUTS,
        parameters={
            "drive_mode": "torque_driven",
            "initial_creepage": point.creep,
            "speed": v,
            **options,
        },
    )
    with Master(System({"w": plant})) as master:
        found = linearize(master, inputs=[f"w.{name}" for name in INPUTS])
    states = [found.states.index(f"w.{name}") for name in DRIVEN]
    inputs = [found.inputs.index(f"w.{name}") for name in INPUTS]
    outputs = [found.outputs.index(f"w.{name}") for name in OUTPUTS]
    expected = full_model(point, wheelset)
    theirs = np.block(
        [
            [found.model.A[np.ix_(states, states)], found.model.B[np.ix_(states, inputs)]],
            [found.model.C[np.ix_(outputs, states)], found.model.D[np.ix_(outputs, inputs)]],
        ]
    )
    ours = np.block([[expected.A, expected.B], [expected.C, expected.D]])
    usual = np.array([1e-3, 1e-3, 1e-2, 1e-2, 0.1, 0.1, 1e-3, 1e-3, 1e3, 1e3, 1e3])
    rows = np.abs(ours * usual).max(axis=1, keepdims=True)
    np.testing.assert_allclose(theirs * usual / rows, ours * usual / rows, atol=1e-9)
