"""`wheelset report` as a user meets it."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import control
import jsonschema
import numpy as np
import pytest

from co_sim import Connection, Constant, FmuComponent, LinearComponent, Port, System
from co_sim.wheelset.cli import main
from co_sim.wheelset.reporting import Figure, Section, roads, sections
from co_sim.wheelset.reporting.json_text import schema
from co_sim.wheelset.reporting.model_report import report_model, report_system
from co_sim.wheelset.reporting.page import html, write_report
from co_sim.wheelset.reporting.report import Report, with_images
from co_sim.wheelset.reporting.roads_section import roads_section
from estimator import wheelset_model
from estimator.structure import LinearSystem
from fmu_wheelset import path

if TYPE_CHECKING:
    from pathlib import Path


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


class Page(HTMLParser):
    """Collects what a page refers to and its elements."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.tags: set[str] = set()
        self.alts: list[str | None] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        self.tags.add(tag)
        self.references += [found[name] or "" for name in ("src", "href", "srcset", "data") if name in found]
        if tag == "img":
            self.alts.append(found.get("alt"))
        if found.get("id"):
            self.ids.add(found["id"] or "")


def check_folder(folder: Path) -> dict:
    """Check what holds for every report and return its JSON."""
    assert {file.name for file in folder.iterdir()} == {"report.html", "report.json", "figures"}
    text = (folder / "report.json").read_text(encoding="utf-8")
    assert not re.search(r"\b(NaN|Infinity)\b", re.sub(r'"[^"]*"', "", text))
    content = json.loads(text)
    jsonschema.validate(content, schema())
    figures = [figure for section in content["sections"] for figure in section["figures"]]
    files = [file for figure in figures for file in figure["files"]]
    assert {file.name for file in (folder / "figures").iterdir()} == {
        file.removeprefix("figures/") for file in files
    }
    for file in files:
        head = (folder / file).read_bytes()[:5]
        assert head == (b"<?xml" if file.endswith(".svg") else b"\x89PNG\r")
    source = (folder / "report.html").read_text(encoding="utf-8")
    page = Page(source)
    assert all(reference.startswith(("data:image/png;base64,", "#")) for reference in page.references)
    assert not page.tags & {"script", "link", "iframe", "object"}
    assert "url(" not in source
    assert "@import" not in source
    assert len(page.alts) == len(figures)
    assert all(page.alts)
    assert {section["key"] for section in content["sections"]} <= page.ids
    return content


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    arguments = ("--conditions", "dry", "--speeds", "20,60", "--points", "P1,P2", "--out", folder / "out")
    assert call("report", *arguments) == 0
    return folder / "out"


def test_a_report_is_whole(tiny: Path) -> None:
    content = check_folder(tiny)
    assert content["grid"] == {"condition": ["dry"], "speed": [20.0, 60.0], "point": ["P1", "P2"]}
    assert content["faults"] == []
    assert content["summary"]
    assert content["setup"]["wheelset"]["m_w"] == 1250.0
    found = {section["key"]: section for section in content["sections"]}
    values = np.array(found["three_roads"]["numbers"]["difference"]["value"])
    assert values.shape == (3, 1, 2, 2)
    assert values.max() <= found["three_roads"]["numbers"]["bound"]["value"]


def test_all_faults_at_once_and_nothing_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    faulty = {
        "--conditions": "dry,moist", "--speeds": "5:80:x", "--points": "P4", "--sensors": "gyro+gyro",
        "--noise": "radar=1", "--sample-rate": 0, "--track": "mud", "--parameters": tmp_path / "none.toml",
    }  # fmt: skip
    assert call("report", *(part for pair in faulty.items() for part in pair), "--out", out) == 2
    told = capsys.readouterr().err
    for words in ("moist", "5:80:x", '"P4"', "gyro+gyro", '"radar"', "0 Hz", '"mud"', "none.toml"):
        assert words in told
    assert "Traceback" not in told
    assert not out.exists()


def test_a_creep_curve_without_a_peak_is_the_users_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("report", "--speeds", "0.001", "--out", tmp_path / "out") == 2
    assert "dry rail at 0.001 m/s: got a creep curve without a maximum" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_options_of_the_other_kind_of_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("report", "--at", 1, "--set", "a=1", "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err.count("only for a model") == 2
    assert call("report", "--model", path(fmi=3), "--speeds", "20", "--track", "erri_low") == 2
    assert capsys.readouterr().err.count("only for a report over a grid") == 2


def test_parameters_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("m_w = -1.0\nmass = 3.0\n[patch]\nC11 = 4.0\n", encoding="utf-8")
    assert call("report", "--parameters", file, "--out", tmp_path / "out") == 2
    told = capsys.readouterr().err
    assert "mine.toml: m_w: got -1.0" in told
    assert "mine.toml: mass: got an unknown key" in told


def test_rail_conditions_of_a_vehicle_are_refused_not_ignored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[conditions.wet]\nmu_0 = 0.3\n", encoding="utf-8")
    assert call("report", "--parameters", file, "--out", tmp_path / "out") == 2
    assert "mine.toml: conditions: got rail conditions" in capsys.readouterr().err


def wrong(point, wheelset):
    model = wheelset_model(point, wheelset)
    model.A[3, 1] *= 1.001
    return model


def test_a_failed_check_is_loud_and_the_report_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(roads, "wheelset_model", wrong)
    monkeypatch.setattr(sections, "SECTIONS", {"Three roads": roads_section})
    arguments = ("--conditions", "wet", "--speeds", "30", "--points", "P1")
    assert call("report", *arguments, "--out", tmp_path / "out") == 1
    told = capsys.readouterr().err
    assert "check failed: three roads: at wet rail, 30 m/s, P1" in told
    assert "(12): der(psi_dot) over psi" in told
    content = check_folder(tmp_path / "out")
    assert len(content["faults"]) == 2
    assert "do not rely on it" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_a_report_on_an_fmu(tmp_path: Path) -> None:
    settings = ("--set", "drive_mode=prescribed_creep", "--set", "prescribed_creepage=0.001", "--at", 0.1)
    signals = ("--input", "*track*", "--output", "*yaw_rate", "--output", "*acceleration")
    assert call("report", "--model", path(fmi=3), *settings, *signals, "--out", tmp_path / "out") == 0
    content = check_folder(tmp_path / "out")
    assert [section["key"] for section in content["sections"]] == ["motion", "reached", "seen", "energy"]
    assert content["setup"]["states"] == ["lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate"]
    assert content["setup"]["state_units"] == ["m", "rad", "m/s", "rad/s"]
    assert content["setup"]["inputs"] == ["track_lateral_offset"]
    (motion, *_) = content["sections"]
    assert len(motion["numbers"]["eigenvalue"]["value"]) == 4


def test_faults_of_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("report", "--model", tmp_path / "none.fmu", "--out", tmp_path / "out") == 2
    assert call("report", "--model", path(fmi=3), "--at", -1, "--out", tmp_path / "out") == 2
    assert call("report", "--model", path(fmi=3), "--input", "nothing", "--out", tmp_path / "out") == 2
    assert "Traceback" not in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_model_of_python_control_keeps_its_names(tmp_path: Path) -> None:
    model = control.ss(
        [[-1, 0, 0], [0, -2, 0], [0, 0, 0.5]], [[1], [0], [1]], [[1, 1, 0]], 0,
        states=["seen", "hidden", "growing"], inputs=["push"], outputs=["look"],
    )  # fmt: skip
    report = report_model(model)
    write_report(report, tmp_path)
    content = check_folder(tmp_path)
    found = {section["key"]: section["numbers"] for section in content["sections"]}
    assert found["reached"]["rank"]["value"] == [2]
    assert found["seen"]["rank"]["value"] == [2]
    assert found["reached"]["stabilisable"]["value"] == [True]
    assert found["seen"]["detectable"]["value"] == [False]
    assert "1 grows" in content["summary"][0]
    assert "hidden" in content["summary"][1]
    assert "growing" in content["summary"][2]


def test_a_system_of_the_master() -> None:
    wheelset = FmuComponent(
        path(fmi=3),
        inputs=["prescribed_creepage", "suspension_lateral_force", "track_lateral_offset"],
        outputs=["lateral_displacement", "lateral_velocity", "yaw_rate"],
        parameters={"drive_mode": "prescribed_creep"},
    )
    damper = LinearComponent(
        control.ss([[-200.0]], [[1.0]], [[0.0]], [[-3e4]], states=["idle"]),
        [Port("v", "m/s")],
        [Port("force", "N")],
    )
    parts = {"drive": Constant([0.001], [Port("creepage")]), "wheelset": wheelset, "damper": damper}
    wires = [
        Connection("drive.creepage", "wheelset.prescribed_creepage"),
        Connection("wheelset.lateral_velocity", "damper.v"),
        Connection("damper.force", "wheelset.suspension_lateral_force"),
    ]
    report = report_system(
        System(parts, wires), at=0.01, inputs=["*track*"], outputs=["wheelset.yaw_rate", "damper.force"]
    )
    assert report.setup["outputs"] == ["wheelset.yaw_rate", "damper.force"]
    assert ("Left out", "Wheelset.state.wheel_speed_left") not in report.about
    assert any(term == "Left out" for term, _ in report.about)
    assert any("directional derivatives" in text for _, text in report.about)
    assert html(report).startswith("<!DOCTYPE html>")


def test_names_of_the_user_are_text_on_the_page() -> None:
    model = control.ss([[-1.0]], [[1.0]], [[1.0]], 0, states=["<b>$x_1$"], inputs=["$"], outputs=["a&b"])
    page = html(report_model(model))
    assert "&lt;b&gt;$x_1$" in page
    assert "<b>$" not in page


def test_a_model_without_states_or_inputs() -> None:
    gain = control.ss([], [], [], [[2.0]], inputs=["u"], outputs=["y"])
    assert "no states" in report_model(gain).summary[0]
    no_input = np.zeros((1, 0))
    free = LinearSystem(-np.eye(1), no_input, np.eye(1), no_input, ("x",), (), ("y",), ("m",), (), ("m",))
    assert [section.key for section in report_model(free).sections] == ["motion", "seen"]


def test_two_figures_of_one_name_are_refused() -> None:
    def figure() -> Figure:
        from co_sim.wheelset.drawing.sheet import Sheet

        return Figure("same", "What?", "caption", "alt", lambda: Sheet(4.0, 2.0, "What?"))

    made = [Section(key, "What?", (), figures=(figure(),)) for key in ("a", "b")]
    sections_, images = with_images(made)
    with pytest.raises(ValueError, match="figure same twice"):
        Report("t", (), {}, {}, sections_, images)


def test_the_same_report_twice_is_the_same(tmp_path: Path) -> None:
    model = control.ss([[-1.0, 2.0], [0.0, -3.0]], [[1.0], [1.0]], [[1.0, 0.0]], 0)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_report(report_model(model), tmp_path / name)
    files = [file.relative_to(tmp_path / "a") for file in (tmp_path / "a").rglob("*") if file.is_file()]
    assert len(files) > 4
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
