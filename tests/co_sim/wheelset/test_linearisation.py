"""Two roads to one model: the plant FMU linearised by differences, and (12) in python-control."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from co_sim.fmu import FmuComponent
from estimator import CreepCurve, OperatingPoint, operating_points, wheelset_model
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
