"""The command line, as a user meets it; the README's first line runs this path."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
import pytest

from co_sim.wheelset.cli import main

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SHORT = "[simulation]\nduration = 2.0\n[identifier]\ntraining = 2.0\n[output]\nevery = 10\n"


def wheelset(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    code = "import sys; from co_sim.wheelset.cli import main; main(sys.argv[1:])"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env=None,
    )


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    (folder / "short.toml").write_text(SHORT, encoding="utf-8")
    assert call("run", str(folder / "short.toml"), "--out", str(folder / "out"), "--seed", "3") == 0
    return folder / "out"


def test_files_that_a_run_writes(results: Path) -> None:
    assert {p.name for p in results.iterdir()} == {
        "results.csv",
        "summary.json",
        "report.html",
        "figures",
        "logs",
    }
    figures = {p.name for p in (results / "figures").iterdir()}
    assert {
        "fig2_creep_curve.png",
        "fig5_residuals_P1.png",
        "fig6_residuals_P2.png",
        "fig7_residuals_P3.png",
        "fig8_fuzzy_system.png",
        "fig9_output_membership.png",
        "membership_functions.png",
    } <= figures


def test_csv_has_units_and_all_runs(results: Path) -> None:
    with (results / "results.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:2] == ["run", "time [s]"]
    assert "plant.yaw_rate [rad/s]" in header
    assert "identifier.E.dry-P1 [1]" in header
    assert [row[0] for row in rows] == ["P1"] * 201 + ["P2"] * 201 + ["P3"] * 201
    time = np.array([float(row[1]) for row in rows[:201]])
    np.testing.assert_allclose(time, 0.01 * np.arange(201), atol=1e-12)


def test_summary_holds_scenario_seed_versions_and_the_answer(results: Path) -> None:
    summary = json.loads((results / "summary.json").read_text(encoding="utf-8"))
    assert summary["seed"] == summary["scenario"]["seed"] == 3
    assert summary["scenario"]["simulation"] == {"step": 0.001, "duration": 2.0}
    assert summary["versions"]["wheelset-cosim"] == version("wheelset-cosim")
    assert [s["run"] for s in summary["stretches"]] == ["P1", "P2", "P3"]
    for stretch in summary["stretches"]:
        assert sum(stretch["share_smallest"].values()) == pytest.approx(1.0)
        assert set(stretch["mean_probability"]) == {"dry-P1", "dry-P2", "dry-P3"}
        assert stretch["truth"]["left.adhesion_peak"] == pytest.approx(0.40364, abs=1e-5)


def test_logs_are_what_identify_reads(results: Path) -> None:
    assert {p.name for p in (results / "logs").iterdir()} == {"P1.csv", "P2.csv", "P3.csv"}
    with (results / "logs" / "P1.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["time", "yaw_rate", "lateral_acceleration", "speed"]
    assert len(rows) == 2001


def test_rerun_gives_the_same_bytes(results: Path, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(SHORT, encoding="utf-8")
    assert call("run", str(tmp_path / "short.toml"), "--out", str(tmp_path / "out"), "--seed", "3") == 0
    for name in ("results.csv", "summary.json"):
        assert (tmp_path / "out" / name).read_bytes() == (results / name).read_bytes()


def test_in_a_process_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(SHORT.replace("2.0", "1.5"), encoding="utf-8")
    done = wheelset("run", "short.toml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Share of windows" in done.stdout
    assert done.stderr == ""  # no bar and no spinner where there is no terminal
    assert (tmp_path / "results" / "short" / "report.html").is_file()


@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        ("sed = 1", "error: x.toml: sed: got an unknown key"),
        ("[wheelset]\nm_w = -1.0", "error: x.toml: wheelset.m_w: got -1.0, expected greater than 0"),
        ('[track]\nfile = "nowhere.csv"', "error: nowhere.csv: got "),
    ],
)
def test_bad_input_is_one_line_code_2_and_nothing_written(
    scenario: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.toml").write_text(scenario, encoding="utf-8")
    assert call("run", str(tmp_path / "x.toml"), "--out", str(tmp_path / "out")) == 2
    streams = capsys.readouterr()
    assert streams.err.startswith(said)
    assert streams.err.count("\n") == 1
    assert streams.out == ""
    assert [p.name for p in tmp_path.iterdir()] == ["x.toml"]


def test_out_that_is_a_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").write_text("", encoding="utf-8")
    assert call("run", "--out", str(tmp_path / "taken")) == 2
    assert "expected a folder" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["run", "--seed", "-1"], ["walk"], ["run", "--speed", "3"]])
def test_bad_arguments_exit_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert call(*arguments) == 2
    assert "Error" in capsys.readouterr().err


def test_a_run_that_stops_keeps_its_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The track ends under the wheelset only in the observed runs, half way."""
    from co_sim.wheelset import experiment as module

    class Shortened(module.Laboratory):
        def _cases(self, track):  # type: ignore[no-untyped-def]
            from dataclasses import replace

            from co_sim.wheelset.track import TrackProfile

            short = TrackProfile(track.distance[:200], track.offset[:200])
            return tuple(replace(case, track=short) for case in super()._cases(track))

    monkeypatch.setattr(module, "Laboratory", Shortened)
    (tmp_path / "x.toml").write_text(SHORT, encoding="utf-8")
    assert call("run", str(tmp_path / "x.toml"), "--out", str(tmp_path / "out")) == 1
    assert "P1: track stopped at t = " in capsys.readouterr().err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert 1.2 < summary["runs"][0]["end_s"] < 1.3
    assert "track stopped" in summary["runs"][0]["stopped"]


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("--version") == 0
    assert capsys.readouterr().out == f"wheelset, version {version('wheelset-cosim')}\n"
    for arguments in (["--help"], ["run", "--help"], ["scenario", "-h"]):
        assert call(*arguments) == 0
        assert "Examples:" in capsys.readouterr().out


def test_scenario_command_prints_a_file_that_runs(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("scenario") == 0
    assert capsys.readouterr().out.split() == ["adhesion-drop", "default"]
    assert call("scenario", "default") == 0
    assert "[identifier]" in capsys.readouterr().out
    assert call("scenario", "--fields") == 0
    assert "wheelset.k_w" in capsys.readouterr().out
    assert call("scenario", "nothing") == 2


def test_interrupt_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from co_sim.wheelset import cli

    def interrupted(self: object, k: int, time: Sequence[float], values: object) -> None:
        if k + len(time) >= 100:
            raise KeyboardInterrupt

    monkeypatch.setattr(cli._ProgressBar, "observe", interrupted)
    (tmp_path / "x.toml").write_text(SHORT, encoding="utf-8")
    assert call("run", str(tmp_path / "x.toml"), "--out", str(tmp_path / "out")) == 130
    assert capsys.readouterr().err.strip() == "interrupted; files that are there are complete"
    assert [p.name for p in tmp_path.iterdir()] == ["x.toml"]


def test_an_interrupt_in_a_watched_run_keeps_the_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from co_sim.wheelset import cli

    begun = 0

    def begin(self: object, *_: object) -> None:
        nonlocal begun
        begun += 1

    def interrupted(self: object, k: int, time: Sequence[float], values: object) -> None:
        if begun == 4 and k + len(time) > 1000:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(cli._ProgressBar, "begin", begin)
    monkeypatch.setattr(cli._ProgressBar, "observe", interrupted)
    (tmp_path / "x.toml").write_text(SHORT, encoding="utf-8")
    assert call("run", str(tmp_path / "x.toml"), "--out", str(tmp_path / "out")) == 130
    assert "stopped early, P1: interrupted at t = " in capsys.readouterr().err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert [run["stopped"][:11] for run in summary["runs"]] == ["interrupted"]
    assert "interrupted at" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_export_writes_an_fmu_with_other_start_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], fmi: str
) -> None:
    from fmpy import read_model_description

    parameters, out = tmp_path / "mine.toml", tmp_path / "mine.fmu"
    parameters.write_text('m_w = 1500\ndrive_mode = "free_rolling"\n', encoding="utf-8")
    assert call("export", "--fmi", fmi, "--out", str(out), "--parameters", str(parameters)) == 0
    assert capsys.readouterr().out == f"{out}\n"
    description = read_model_description(str(out))
    assert description.fmiVersion == f"{fmi}.0"
    start = {v.name: v.start for v in description.modelVariables}
    assert (start["m_w"], start["drive_mode"]) == ("1500.0", "2")


def test_export_tells_each_fault_in_a_line_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters, out = tmp_path / "mine.toml", tmp_path / "mine.fmu"
    parameters.write_text("mw = 1.0\nk_w = -1.0\n", encoding="utf-8")
    assert call("export", "--out", str(out), "--parameters", str(parameters)) == 2
    told = capsys.readouterr().err.splitlines()
    assert [line.split(": got")[0] for line in told] == ["error: mw", "error: k_w"]
    assert call("export", "--out", str(tmp_path / "none" / "x.fmu")) == 2
    assert "got no folder" in capsys.readouterr().err
    assert call("export", "--out", str(tmp_path)) == 2
    assert "Is a directory, expected a file to write" in capsys.readouterr().err
    assert call("export", "--fmi", "1", "--out", str(out)) == 2
    assert not out.exists()
