"""`wheelset simulate` on FMUs, as a user meets it."""

import csv

import pytest
import scipy.io

from co_sim import InputError
from co_sim.tool.loading import load, parse_settings, with_settings
from co_sim.wheelset.cli import main
from fmu_wheelset import path

FMU = str(path(fmi=3))


def call(*arguments):
    """Return the exit code of the command."""
    with pytest.raises(SystemExit) as caught:
        main([*map(str, arguments)])
    return caught.value.code


def rows(file):
    with file.open(encoding="utf-8") as lines:
        return list(csv.reader(lines))


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_runs_and_its_signals_are_written(fmi, tmp_path, capsys):
    out = tmp_path / "out"
    chosen = ["--record", "*.yaw_rate", "--record", "*.wheel_speed", "--plot", "--out", out]
    settings = ["--set", "drive_mode=torque_driven", "--set", "traction_torque=2000", "--set", "speed=30"]
    assert call("simulate", path(fmi=fmi), "--stop", "0.2", "--step", "1e-3", *chosen, *settings) == 0
    head, *body = rows(out / "results.csv")
    assert head[:2] == ["time [s]", f"wheelset_fmi{fmi}.yaw_rate [rad/s]"]
    assert len(body) == 201
    assert float(body[0][2]) == pytest.approx(60.0)
    assert float(body[-1][2]) > 60.0
    assert (out / "results.png").read_bytes().startswith(b"\x89PNG")
    assert "times real time" in capsys.readouterr().out


def test_results_in_other_formats_and_every_nth_step(tmp_path):
    assert call("simulate", FMU, "--stop", "0.1", "--every", "10", "--format", "mat", "--out", tmp_path) == 0
    results = scipy.io.loadmat(tmp_path / "results.mat")
    assert results["time"].size == 11


def test_the_error_of_the_coupling_is_shown(tmp_path, capsys):
    assert (
        call("simulate", FMU, "--stop", "0.05", "--check", "--record", "*.yaw_rate", "--out", tmp_path) == 0
    )
    assert "A step of 0.001 s is fine" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["none.fmu"], "none.fmu: got no such file"),
        ([__file__], 'got the ending ".py"'),
        ([FMU, "--set", "drive_mod=1"], 'did you mean "drive_mode"?'),
        ([FMU, "--set", "m_w=-1", "--set", "I_w=x"], 'parameter "I_w" of'),
        ([FMU, "--set", "nothing"], "as in --set mass=1250"),
        ([FMU, "--step", "-1"], "step: got -1.0 s"),
        ([FMU, "--start", "2", "--stop", "1"], "expected 2 s or later"),
        ([FMU, "--stop", "0.0015", "--step", "0.001"], "a multiple of the step"),
        ([FMU, "--record", "*.nothing"], "*.nothing"),
        ([FMU, "--tolerance", "0"], "a positive number"),
    ],
)
def test_mistakes_are_told_and_nothing_is_written(arguments, expected, tmp_path, capsys):
    assert call("simulate", *arguments, "--out", tmp_path / "out") == 2
    assert expected in capsys.readouterr().err
    assert not list(tmp_path.glob("out/results*"))


def test_a_setting_that_is_not_finite_is_refused(tmp_path, capsys):
    assert call("simulate", FMU, "--out", tmp_path, "--set", "prescribed_creepage=nan") == 2
    assert "prescribed_creepage" in capsys.readouterr().err


def test_settings_are_read_as_what_they_look_like():
    texts = ["a=1", "b=1.5", "c=true", "d=two words", "e=1e3", "f=x=y"]
    assert parse_settings(texts) == {"a": 1, "b": 1.5, "c": True, "d": "two words", "e": 1000.0, "f": "x=y"}


def test_a_setting_for_an_input_becomes_a_constant():
    system = with_settings(load(path(fmi=3)).system, {"speed": 30.0, "m_w": 1300.0})
    assert system.parameters == {"wheelset_fmi3.m_w": 1300.0}
    assert [str(wire) for wire in system.connections] == ["set.wheelset_fmi3.speed -> wheelset_fmi3.speed"]


def test_all_settings_without_a_component_are_told():
    with pytest.raises(InputError) as caught:
        parse_settings(["=1", "x"])
    assert len(caught.value.faults) == 2
