"""The grid and what is assumed: reading, bounds, and all faults at once."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from co_sim import InputError
from co_sim.wheelset.reporting import SENSORS, Grid, Setup
from co_sim.wheelset.reporting.grid import parse_conditions, parse_points, parse_speeds
from co_sim.wheelset.reporting.setup import parse_noise, parse_sensors
from estimator import CreepCurve, operating_points
from fmu_wheelset import CONDITIONS, WheelsetParameters


@pytest.mark.parametrize(
    ("text", "speeds"),
    [
        ("20", (20.0,)),
        ("10, 20,40", (10.0, 20.0, 40.0)),
        ("5:20:5", (5.0, 10.0, 15.0, 20.0)),
        ("5:21:5", (5.0, 10.0, 15.0, 20.0)),
        ("0.1:0.3:0.1", (0.1, 0.2, 0.3)),
        ("5:10:5,30", (5.0, 10.0, 30.0)),
    ],
)
def test_speeds(text: str, speeds: tuple[float, ...]) -> None:
    assert parse_speeds(text) == speeds


@given(st.integers(1, 400), st.integers(1, 40), st.integers(0, 30))
def test_a_range_has_both_ends_and_even_steps(first: int, step: int, count: int) -> None:
    first_, step_ = first / 10.0, step / 10.0
    last = (first + count * step) / 10.0
    speeds = parse_speeds(f"{first_}:{last}:{step_}")
    assert len(speeds) == count + 1
    assert speeds == tuple(round((first + k * step) / 10.0, 12) for k in range(count + 1))


@pytest.mark.parametrize(
    "text", ["x", "5:x:5", "5:1:5", "5:80:0", "5:80:-5", "5:80", "1:inf:1", "0:1e9:1", "5:6:nan"]
)
def test_what_is_no_speed(text: str) -> None:
    with pytest.raises(InputError, match=r"--speeds.*expected speeds in m/s or from:to:by"):
        parse_speeds(text)


def test_points_by_name_and_by_creepage() -> None:
    assert parse_points("P1, P3") == ("P1", "P3")
    assert parse_points("0.5%,0.02,1 %") == (0.005, 0.02, 0.01)
    assert Grid(points=("P1", 0.005)).point_names == ("P1", "0.5 %")
    for text in ("P4", "1%%", "%", "nan"):
        with pytest.raises(InputError, match="--points"):
            parse_points(text)


def test_the_default_grid() -> None:
    assert Grid() == Grid(
        parse_conditions("dry,wet,low,very_low"), parse_speeds("5:80:5"), parse_points("P1,P2,P3")
    )
    assert Grid().shape == (4, 16, 3)
    assert Grid().size == 192


def test_a_grid_tells_all_its_faults() -> None:
    with pytest.raises(InputError) as caught:
        Grid(("dry", "wett", "dry"), (3.0, 1.0, -2.0), ("P4", 2.0))
    told = "\n".join(map(str, caught.value.faults))
    assert 'did you mean "wet"?' in told
    for words in ("dry twice", "-2 m/s", "speeds that fall", '"P4"', "creepage 2"):
        assert words in told
    for axes in (
        {"conditions": ()},
        {"speeds": ()},
        {"points": ()},
        {"speeds": tuple(map(float, range(1, 1001)))},
    ):
        with pytest.raises(InputError):
            Grid(**axes)


def test_points_of_the_grid_are_those_of_the_curve() -> None:
    grid = Grid(("dry", "low"), (20.0, 50.0), ("P1", "P2", 0.001))
    points = grid.resolve(WheelsetParameters())
    assert [at.index for at in points][:4] == [(0, 0, 0), (0, 0, 1), (0, 0, 2), (0, 1, 0)]
    at = points[7]
    assert str(at) == "low rail, 20 m/s, P2"
    assert at.point == operating_points(CreepCurve(CONDITIONS["low"], 20.0))[1]
    assert points[8].point.creep == 0.001
    # Peaks of docs/model.md at 20 m/s, in percent.
    assert 100.0 * points[1].point.creep == pytest.approx(2.48, abs=0.005)
    assert 100.0 * points[7].point.creep == pytest.approx(0.27, abs=0.005)


def test_points_depend_on_load_and_patch() -> None:
    grid = Grid(("dry",), (20.0,), ("P2",))
    light = WheelsetParameters(N=40e3)
    assert grid.resolve(light)[0].point == operating_points(CreepCurve(CONDITIONS["dry"], 20.0, 40e3))[1]


def test_a_curve_without_a_maximum_is_a_fault_of_each_speed() -> None:
    slow = Grid(("dry", "wet"), (1e-3, 2e-3, 20.0))
    with pytest.raises(InputError) as caught:
        slow.resolve(WheelsetParameters())
    assert len(caught.value.faults) == 4
    assert "wet rail at 0.002 m/s: got a creep curve without a maximum" in str(caught.value)
    assert len(Grid(("dry",), (1e-3,), (0.01,)).resolve(WheelsetParameters())) == 1


def test_a_setup_has_defaults_for_what_it_is_not_told() -> None:
    setup = Setup(noise=parse_noise("gyro=2e-4"), sensors=parse_sensors("gyro,gyro + displacement"))
    assert setup.noise["gyro"] == 2e-4
    assert setup.noise["accelerometer"] == SENSORS["accelerometer"].rms
    assert setup.sensors == (("gyro",), ("gyro", "displacement"))
    assert setup.main_sensors == ("gyro",)
    assert Setup().main_sensors == ("gyro", "accelerometer")
    assert pickle.loads(pickle.dumps(setup)) == setup


def test_a_setup_tells_all_its_faults() -> None:
    with pytest.raises(InputError) as caught:
        Setup(
            sensors=(("gyro", "gyro"), ("radar",)), noise={"gyro": 0.0, "giro": 1.0}, window=-1.0, track="mud"
        )
    told = str(caught.value)
    for words in ("gyro+gyro", '"radar"', "noise.gyro", '"giro"', "window: got -1 s", '"mud"'):
        assert words in told
    for text in ("gyro", "gyro=x", "gyro=1,=2=3"):
        with pytest.raises(InputError, match="SENSOR=RMS"):
            parse_noise(text)
