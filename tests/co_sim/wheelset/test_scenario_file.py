"""Scenario files: the packaged ones are right, and every fault is told in one line with its remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from co_sim.errors import InputError
from co_sim.wheelset.scenario import Scenario
from co_sim.wheelset.scenario_file import field_table, load_scenario, packaged_names, packaged_text, parse
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from pathlib import Path

FILTER = '[[identifier.filters]]\ncondition = "dry"\n'
LEAVES = "[conditions.leaves]\nk_A = 1.0\nk_S = 0.9\nmu_0 = 0.02\nA = 0.4\nB = 0.1\n"
TORQUE = '[drive]\nmode = "torque_driven"\n'


def faults_of(text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        parse(text, "x.toml")
    return str(caught.value).splitlines()


def test_packaged_scenarios_are_the_two_promised() -> None:
    assert packaged_names() == ["adhesion-drop", "default"]
    default, _ = load_scenario("default")
    assert default.model_dump(exclude={"title"}) == Scenario().model_dump(exclude={"title"})
    drop, _ = load_scenario("adhesion-drop")
    assert [rail.sides[0] for rail in drop.rail] == ["dry", "wet", "low", "dry"]
    assert drop.drive.mode == "torque_driven"


def test_default_scenario_is_the_paper() -> None:
    scenario, _ = load_scenario("default")
    assert scenario.parameters == WheelsetParameters()
    assert [f.name for f in scenario.filters] == ["dry-P1", "dry-P2", "dry-P3"]
    assert (scenario.sensors.gyro.noise_rms, scenario.sensors.accelerometer.noise_rms) == (1e-3, 0.05)
    assert scenario.simulation.steps * len(("P1", "P2", "P3")) == 30_000


def test_packaged_text_of_an_unknown_name_says_which_there_are() -> None:
    with pytest.raises(InputError, match="adhesion-drop, default"):
        packaged_text("nothing")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seeed = 1", ["x.toml: seeed: got an unknown key", 'did you mean "seed"?']),
        ("seed = -1", ["seed: got -1", "greater than or equal to 0"]),
        ('seed = "1"', ["seed: got '1'", "integer"]),
        ("[wheelset]\nm_w = -3", ["wheelset.m_w: got -3", "greater than 0", "mass of the wheelset, kg"]),
        ("[wheelset]\nm_w = inf", ["wheelset.m_w", "finite"]),
        ("[wheelset.patch]\na = true", ["wheelset.patch.a: got True", "semi-axis"]),
        ("[simulation]\nstep = 0", ["simulation.step: got 0", "greater than 0"]),
        ("[simulation]\nstep = 0.003", ["simulation: got 0.003 s in 10 s", "divides", "9.999 s"]),
        ('[drive]\nmode = "fast"', ["drive.mode: got 'fast'", "torque_driven"]),
        ("[drive]\nspeed = 1.0", ["drive.mode: got None"]),
        (TORQUE + "times = [0.0, 1.0]\ntorque = [0.0]", ["2 times and 1 torques"]),
        (TORQUE + "times = [1.0, 0.0]\ntorque = [0.0, 1.0]", ["times in rising order"]),
        ('[drive]\nmode = "free_rolling"\npoints = ["P1"]', ["drive.points: got an unknown key"]),
        ('[drive]\nmode = "prescribed_creep"\npoints = ["P9"]', ["drive.points.0: got 'P9'"]),
        ('[drive]\nmode = "prescribed_creep"\npoints = []', ["drive.points", "at least 1"]),
        ('[[rail]]\ncondition = "drry"', ["'drry'", "dry, wet, low, very_low", "use dry"]),
        ('[[rail]]\nleft = "dry"', ["rail.0: got no condition for a wheel"]),
        ('[[rail]]\nsince = 1.0\ncondition = "dry"', ["first rail since 0"]),
        ('[[rail]]\ncondition = "dry"\n[[rail]]\nsince = 10.0\ncondition = "wet"', ["within the duration"]),
        ("[sensors.gyro]\nbias = 1.0", ["sensors.gyro.noise_rms: got nothing", "add noise_rms"]),
        (
            "[conditions.leaves]\nk_A = 1.0\nk_S = 1.0\nmu_0 = 0.1\nA = 2.0\nB = 0.1",
            ["conditions.leaves.A: got 2"],
        ),
        (FILTER + 'point = "P1"', ["at least 2"]),
        (FILTER + 'point = "P1"\n' + FILTER, ["identifier.filters.1", "exactly one"]),
        (FILTER + 'point = "P1"\n' + FILTER + 'point = "P1"', ["dry-P1 more than once"]),
        ("[identifier]\nwindow = 11.0", ["identifier.window = 11 s", "at most the duration"]),
        ("[identifier]\ntraining = 1e-4", ["identifier.training = 0.0001 s", "at least the step"]),
        ("a = =\nb = 1", ["not TOML", "line 1"]),
    ],
)
def test_faults_say_what_got_expected_remedy(text: str, said: list[str]) -> None:
    (line,) = faults_of(text)
    assert line.startswith("x.toml: ")
    for part in (*said, "got ", ", expected ", "; "):
        assert part in line


def test_all_faults_are_told_at_once() -> None:
    lines = faults_of("sed = 1\n[wheelset]\nm_w = 0\n[simulation]\nduration = -1.0")
    assert {line.split(": ")[1] for line in lines} == {"sed", "wheelset.m_w", "simulation.duration"}


def test_missing_file_names_the_packaged_scenarios() -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml: got No such file.*adhesion-drop, default"):
        load_scenario("nowhere.toml")


def test_file_is_read_with_its_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("seed = 5", encoding="utf-8")
    scenario, folder = load_scenario(str(tmp_path / "mine.toml"))
    assert (scenario.seed, folder) == (5, tmp_path)


def test_condition_of_ones_own_is_used_on_one_side() -> None:
    scenario = parse(
        LEAVES + '[[rail]]\nleft = "dry"\nright = "leaves"',
        "x.toml",
    )
    assert scenario.rail[0].sides == ("dry", "leaves")
    assert scenario.condition("leaves").k_S == 0.9
    assert scenario.condition("dry") == CONDITIONS["dry"]


def test_every_field_is_documented() -> None:
    rows = list(field_table())
    assert all(meaning for _, _, meaning in rows)
    fields = {field for field, _, _ in rows}
    assert {"seed", "rail.condition", "wheelset.m_w", "wheelset.patch.G", "conditions.NAME.mu_0"} <= fields


@given(st.floats(1.0, 1e5), st.floats(0.0, 1e9))
def test_parameters_arrive_in_the_plant_as_written(m_w: float, k_w: float) -> None:
    parameters = parse(f"[wheelset]\nm_w = {m_w!r}\nk_w = {k_w!r}", "x.toml").parameters
    assert (parameters.m_w, parameters.k_w) == (m_w, k_w)
