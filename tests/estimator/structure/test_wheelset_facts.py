"""What the algebra says of the wheelset on its creep curve comes out of the numbers by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator.contact import CreepCurve
from estimator.linear_models import (
    OperatingPoint,
    filter_model,
    full_model,
    operating_points,
    point_at,
    wheelset_model,
)
from estimator.structure import (
    LinearSystem,
    analyse,
    detectable,
    distance_to_unobservable,
    modes,
    observability_rank,
    steady_filter,
)
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    import control

#: Intensities of track, unmodelled accelerations, and of the sensors' noise at 1 kHz.
W, R = np.diag([1.3e-5, 1e-4, 1e-4]), np.diag([1e-9, 2.5e-6])


def as_printed(model: control.StateSpace) -> control.StateSpace:
    """(13) without the symbol that print has lost: y_t drives nothing."""
    import control

    A = np.array(model.A)
    A[4, 3] = 0.0
    return control.ss(
        A,
        model.B,
        model.C,
        model.D,
        states=model.state_labels,
        inputs=model.input_labels,
        outputs=model.output_labels,
    )


@pytest.mark.parametrize("name", ["P1", "P3"])
def test_the_track_offset_of_13_as_printed_is_not_observable(
    name: str, points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    printed = as_printed(filter_model(points[name], wheelset))
    rank = observability_rank(printed)
    assert (rank.rank, rank.hidden_states) == (4, ("y_t",))
    assert detectable(printed)  # only through its own decay
    found = distance_to_unobservable(printed)
    assert found.value == pytest.approx(0.0, abs=1e-14)
    assert found.at == pytest.approx(-0.001, abs=1e-9)


@pytest.mark.parametrize("name", ["P1", "P3"])
def test_the_lost_symbol_makes_the_offset_hardly_more_visible(
    name: str, points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    exact = filter_model(points[name], wheelset)
    assert observability_rank(exact).full
    found = distance_to_unobservable(exact)
    assert 1e-10 < found.value < 1e-6
    assert found.at == pytest.approx(-0.001, abs=1e-5)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_at_the_peak_there_is_no_steady_filter(condition: str, wheelset: WheelsetParameters) -> None:
    p1, p2, p3 = (
        filter_model(p, wheelset) for p in operating_points(CreepCurve(CONDITIONS[condition], 20.0))
    )
    f = steady_filter(p2, W, R)
    assert f.exists.reason == (
        "no steady filter: yaw_rate and lateral_acceleration cannot see the integrator y_rel"
    )
    assert observability_rank(p2).hidden_states == ("y_t", "y_rel")
    assert steady_filter(p1, W, R).exists
    assert steady_filter(p3, W, R).exists
    # Nor does the track reach the wheelset there.
    seen = analyse(wheelset_model(operating_points(CreepCurve(CONDITIONS[condition], 20.0))[1], wheelset))
    assert seen.reached["y_t"].rank.rank == 0


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("v", [10.0, 20.0, 50.0])
def test_past_the_peak_filter_model_and_wheelset_grow(
    condition: str, v: float, wheelset: WheelsetParameters
) -> None:
    point = operating_points(CreepCurve(CONDITIONS[condition], v))[2]
    for model in (wheelset_model(point, wheelset), filter_model(point, wheelset)):
        growing = [m for m in modes(model) if m.behaviour == "grows"]
        assert [m.frequency for m in growing] == pytest.approx([13.45, 13.45, 0.0], abs=0.1)


def test_printed_eigenvalues(dry: CreepCurve, wheelset: WheelsetParameters) -> None:
    found = modes(wheelset_model(point_at(dry, "P1", 0.1 * dry.peak_creep), wheelset))
    assert found[0].exponent == pytest.approx(-9.45 + 8.89j, abs=0.01)
    assert found[0].damping_ratio == pytest.approx(9.45 / abs(-9.45 + 8.89j), rel=1e-3)
    assert [m.exponent.real for m in found[2:]] == pytest.approx([-364, -590], rel=2e-3)


def test_self_excited_torsion_past_the_peak(dry: CreepCurve, wheelset: WheelsetParameters) -> None:
    # Where friction falls with slip the axle is excited: +8.9 +- 366i at twice the creep of the peak.
    found = modes(full_model(operating_points(dry)[2], wheelset))
    torsion = max(found, key=lambda m: m.exponent.imag)
    assert torsion.exponent == pytest.approx(8.9 + 366j, abs=0.6)
    assert torsion.behaviour == "grows"
    assert torsion.dominant.startswith(("theta", "omega"))


def test_sensors_add_up_on_the_driven_wheelset(dry: CreepCurve, wheelset: WheelsetParameters) -> None:
    model = full_model(operating_points(dry)[0], wheelset)
    both = ["yaw_rate", "lateral_acceleration"]
    sets = {"inertial": both, "wheels": [*both, "omega_L", "omega_R"], "all": list(model.output_labels)}
    seen = analyse(model, output_sets=sets).seen
    assert all(access.rank.full for access in seen.values())
    values = [access.distance.value for access in seen.values()]
    assert values == sorted(values)


def test_at_the_peak_gyro_and_accelerometer_do_not_see_the_wheel_speeds(
    dry: CreepCurve, wheelset: WheelsetParameters
) -> None:
    model = full_model(operating_points(dry)[1], wheelset)
    rank = observability_rank(model, ["yaw_rate", "lateral_acceleration"])
    assert set(rank.hidden_states) == {"y", "omega_L", "omega_R", "theta"}
    seen = analyse(model).seen
    assert seen["lateral_displacement"].rank.rank == 4
    assert seen["all"].rank.full


def test_units_come_through(dry: CreepCurve, wheelset: WheelsetParameters) -> None:
    system = LinearSystem.of(
        wheelset_model(operating_points(dry)[0], wheelset),
        state_units=["m", "rad", "m/s", "rad/s"],
        input_units=["m"],
        output_units=["rad/s", "m/s2"],
    )
    numbers = analyse(system).to_dict()
    assert [s["unit"] for s in numbers["states"]] == ["m", "rad", "m/s", "rad/s"]
    assert [s["unit"] for s in numbers["outputs"]] == ["rad/s", "m/s2"]
