"""What `wheelset inspect` shows, as objects, as tables and as JSON."""

import io
import json
import zipfile

import fmpy
import pytest
from rich.console import Console

import fmu_wheelset
from co_sim import InputError
from co_sim.fmu_summary import summarise
from co_sim.tables import summary_tables
from co_sim.wheelset.cli import main


def shown(path, width=100, **options):
    console = Console(file=io.StringIO(), width=width)
    for table in summary_tables(summarise(path), every=options.get("every", False)):
        console.print(table)
    return console.file.getvalue()


def call(*arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return caught.value.code


@pytest.mark.parametrize("version", [2, 3])
def test_the_summary_of_the_wheelset(version):
    summary = summarise(fmu_wheelset.path(fmi=version))
    assert summary.model == "wheelset"
    assert summary.fmi_version == f"{version}.0"
    assert summary.platforms == ({2: fmpy.platform, 3: fmpy.platform_tuple}[version],)
    assert summary.has_sources
    assert summary.experiment == {"start": 0.0, "stop": 10.0, "step": 0.001}
    assert [(i.kind, i.identifier, i.cannot_run) for i in summary.interfaces] == [
        ("CoSimulation", "wheelset", None),
        ("ModelExchange", "wheelset", None),
    ]
    assert all(i.capabilities["canSerializeFMUstate"] for i in summary.interfaces)
    assert summary.n_states == 8
    speed = next(v for v in summary.of("input") if v.name == "speed")
    assert (speed.kind, speed.unit, speed.start, speed.shape) == ("float64", "m/s", "20.0", ())
    mode = next(v for v in summary.of("parameter") if v.name == "drive_mode")
    assert mode.kind == "enumeration"
    assert "torque_driven" in mode.literals.values()


def test_every_type_has_its_kind_shape_and_start(parrots):
    variables = {v.name: v for v in summarise(parrots[3]).variables}
    assert variables["a_in"].shape == (2, 2)
    assert variables["v_in"].shape == (2,)
    assert variables["texts_in"].start == ["x", "y"]
    assert [variables[name].kind for name in ("uint8_in", "blob", "tick")] == ["uint8", "binary", "clock"]
    assert variables["n"].maximum == "8"
    assert variables["enumeration_in"].literals == {1: "red", 2: "green"}


def test_tables_name_every_port_and_fit_the_terminal(parrot):
    summary = summarise(parrot)
    for width in (80, 120):
        text = shown(parrot, width)
        assert max(map(len, text.splitlines())) <= width
        for variable in summary.of("input", "output", "parameter"):
            assert f" {variable.name} " in text
    assert '"hi"' in text
    assert "(red, green)" in text
    assert "never_back" not in text
    assert "never_back" in shown(parrot, every=True)


def test_the_tables_of_the_wheelset_fit_a_narrow_terminal():
    text = shown(fmu_wheelset.path(fmi=3), 80)
    assert max(map(len, text.splitlines())) <= 80
    # What does not fit is folded, not cut off.
    words = "longitudinal creepage of both wheels at the start, torque driven"
    assert set(words.replace(",", "").split()) <= set(text.replace(",", "").split())
    assert "82000000000" in text


def test_an_fmu_of_another_platform_is_shown_with_the_reason(parrot, tmp_path):
    path = tmp_path / "other.fmu"
    with zipfile.ZipFile(parrot) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            target.writestr(name.replace(fmpy.platform, "win64").replace(fmpy.platform_tuple, "win64"), b""
                            if name.startswith("binaries") else source.read(name))  # fmt: skip
    (interface,) = summarise(path).interfaces
    assert "but for win64" in interface.cannot_run
    assert "have it exported for this platform" in interface.cannot_run
    text = " ".join(shown(path).split())
    assert "no: no binaries/" in text


def test_json_has_everything(capsys):
    path = fmu_wheelset.path(fmi=3)
    assert call("inspect", str(path), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(json.dumps(summarise(path).as_dict()))
    assert {v["causality"] for v in told["variables"]} >= {
        "input",
        "output",
        "parameter",
        "local",
        "independent",
    }


def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, capsys):
    path = tmp_path / "broken.fmu"
    path.write_bytes(b"no archive")
    assert call("inspect", str(path)) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert told.count("\n") == 1
    with pytest.raises(InputError):
        summarise(path)
    assert call("inspect", str(tmp_path / "nowhere.fmu")) == 2
