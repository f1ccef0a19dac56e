"""`wheelset inspect` and `wheelset check` on SSPs: all is shown, and all that is wrong is told at once."""

import io
import json
import re
import zipfile

import pytest
from rich.console import Console

from co_sim import InputError
from co_sim.checking import check_ssp
from co_sim.ssp.summary import summarise
from co_sim.ssp.tables import ssp_tables
from co_sim.wheelset.cli import main

from .conftest import UNITS, bindings, component, connectors, inline, real, ssd, system, wire

INNER = system(
    component("lag", connectors("u:input", "x:output") + bindings(inline(real("T", 2)))),
    wire(".in", "lag.u") + wire("lag.x", ".out"),
    name="inner",
    before=connectors("in:input:V", "out:output") + bindings(inline(real("lag.T", 3), real("lag.no", 1))),
)
SCALED = '<ssc:LinearTransformation factor="2" offset="-1"/>'
NESTED = ssd(
    system(
        INNER + component("after", connectors("u:input:mV", "x:output", "direct:output")),
        wire(".start", "inner.in") + wire("after.u", "inner.out", SCALED),
        name="outer",
        before=connectors("start:input"),
    ),
    UNITS + '<ssd:DefaultExperiment startTime="1" stopTime="3"/>',
)


def call(*arguments):
    with pytest.raises(SystemExit) as caught:
        main([*map(str, arguments)])
    return caught.value.code


def shown(path, width=100, *, every=False):
    console = Console(file=io.StringIO(), width=width)
    for table in ssp_tables(summarise(path), every=every):
        console.print(table)
    return console.file.getvalue()


def told(path, **arguments):
    return [
        f"{f.severity} {f.topic} {f.where} {f.message}"
        for f in check_ssp(path, **{"run": False} | arguments).findings
    ]


def test_the_summary_of_nested_systems(pack):
    summary = summarise(pack(NESTED))
    assert [part.name for part in summary.parts] == ["inner/lag", "after"]
    assert summary.experiment == {"start": 1.0, "stop": 3.0}
    assert [socket.name for socket in summary.inputs] == ["start"]
    assert [(link.system, link.source, link.target) for link in summary.links] == [
        ("", "start", "inner.in"),
        # Written from its end, shown in the direction of the values.
        ("", "inner.out", "after.u"),
        ("inner", "in", "lag.u"),
        ("inner", "lag.x", "out"),
    ]
    assert summary.links[1].on_the_way == "×2, −1"
    inner, outer, nowhere = summary.settings
    assert (inner.element, inner.value, inner.overridden) == ("inner/lag", 2.0, ("inner/lag.T",))
    assert (outer.element, outer.value, outer.sets) == ("inner", 3.0, ("inner/lag.T",))
    assert nowhere.sets == nowhere.overridden == ()
    u = summary.parts[1].sockets[0]
    assert (u.name, u.kind, u.unit, u.is_connected, u.is_bound) == ("u", "input", "mV", True, False)
    assert [picture.title for picture in summary.pictures] == ["test", "inner"]
    assert {box.block.label for box in summary.pictures[0].boxes} == {"start", "inner", "after"}
    assert summary.faults == ()


def test_tables_fit_the_terminal_and_name_everything(pack):
    path = pack(NESTED)
    for width in (80, 120):
        text = shown(path, width)
        assert max(map(len, text.splitlines())) <= width
        for word in ("inner/lag", "start", "×2, −1", "overridden", "nothing has this name", "2.0"):
            assert word in text
    assert " direct " not in text
    assert " direct " in shown(path, every=True)


def test_what_is_missing_is_shown_and_told(pack, tmp_path, capsys):
    elements = component("a", connectors("x:output")) + component(
        "b", connectors("u:input"), source="resources/none.fmu"
    )
    path = pack(ssd(system(elements, wire("a.x", "b.u"))))
    picture = tmp_path / "out.svg"
    assert call("inspect", path, "--diagram", picture) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert '<Component name="b" source="resources/none.fmu">: got "resources/none.fmu", which is not' in text
    assert picture.read_bytes().startswith(b"<?xml")
    summary = summarise(path)
    (level,) = summary.pictures
    assert [box.block.kind for box in level.boxes] == ["component", "missing"]
    assert len(level.lines) == 1


def test_json_has_everything_but_pictures(pack, capsys):
    assert call("inspect", pack(NESTED), "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == set(summarise(pack(NESTED)).__slots__) - {"pictures"}
    assert found["parts"][0]["sockets"][0]["name"] == "u"


def test_a_diagram_where_the_document_has_it(pack):
    place = '<ssd:ElementGeometry x1="{}" y1="0" x2="{}" y2="10"/>'
    elements = "".join(
        component(name, connectors("u:input", "x:output") + place.format(x, x + 20))
        for name, x in (("right", 100), ("left", 0))
    )
    points = '<ssd:ConnectionGeometry pointsX="60 60" pointsY="50 5"/>'
    (picture,) = summarise(pack(ssd(system(elements, wire("right.x", "left.u", points))))).pictures
    right, left = picture.boxes
    assert right.x > left.x
    assert len(picture.lines[0].points) == 4


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--diagram", "x.gif"], "got the ending '.gif'"),
        (["--diagram", "/none/x.png"], "No such file or directory"),
    ],
)
def test_mistakes_of_diagrams(pack, capsys, arguments, expected):
    assert call("inspect", pack(NESTED), *arguments) == 2
    assert expected in capsys.readouterr().err


def test_an_fmu_has_no_diagram(lag_fmus, capsys):
    assert call("inspect", lag_fmus[2], "--diagram", "x.png") == 2
    assert "an SSP, which has components to draw" in capsys.readouterr().err


@pytest.mark.parametrize("bare", [False, True], ids=["archive", "bare"])
def test_a_sound_system_passes_and_runs(pack, bare):
    text = ssd(system(component("a") + component("b"), wire("a.x", "b.u")))
    report = check_ssp(pack(text, bare=bare))
    assert report.passed
    assert "100 steps of" in report.findings[-1].message
    notes = [finding.message for finding in report.of("note") if finding.topic == "inputs"]
    assert notes == ["not connected, so that they keep their values: a.u"]


def test_everything_is_found_at_once(pack):
    enumeration = (
        '<ssd:Connector name="direct" kind="parameter"><ssc:Boolean/></ssd:Connector></ssd:Connectors>'
    )
    elements = (
        component("a", connectors("x:output:m", "u:input:nm").replace("</ssd:Connectors>", enumeration))
        + component("b", bindings(inline(real("T", 1), real("tau", 2)), inline(real("T", 2))))
        + component("c", source="resources/gone.fmu")
        + component("d", bindings(('source="broken.ssv"', "")), source="resources/broken.fmu")
        + '<ssd:Unknown name="u"/>'
    )
    wires = wire("a.x", "b.v") + wire("a.x", "b.u")
    text = ssd(system(elements, wires), UNITS + '<ssd:DefaultExperiment startTime="2" stopTime="1"/>')
    lines = told(pack(text, {"resources/broken.fmu": b"PK", "broken.ssv": "<a"}))
    expected = [
        "error schema test.ssp/SystemStructure.ssd, line",
        "error schema test.ssp/broken.ssv",
        'error connections test.ssp/SystemStructure.ssd, line 3, <Connection startElement="a"',
        'error types test.ssp/SystemStructure.ssd, line 3, <Connector name="direct"> is Boolean',
        "warning connectors",
        'unit "nm" is not among the Units of the document',
        '"resources/gone.fmu", which is not there',
        '<Component name="d" source="resources/broken.fmu">',
        'warning parameters test.ssp/SystemStructure.ssd, line 3, <Parameter name="tau"> "tau": nothing',
        "a second value for b.T; this one counts",
        "warning experiment DefaultExperiment stops at 1 s, not after its start at 2 s",
        "error archive resources/broken.fmu",
    ]
    for text in expected:
        assert any(text in line for line in lines), (text, lines)


def test_a_document_that_is_none_is_told_once(pack):
    lines = told(pack("<a"))
    assert len(lines) == 1
    assert "SystemStructure.ssd" in lines[0]


def test_each_fmu_is_checked_once(pack, broken_output):
    lines = told(
        pack(ssd(system(component("a", source="bad.fmu") + component("b", source="bad.fmu"))), broken_output)
    )
    found = [line for line in lines if "model structure bad.fmu: " in line]
    assert found
    assert len(found) == len(set(found))


@pytest.fixture
def broken_output(lag_fmus, tmp_path):
    """A file for packages: an FMU whose model structure leaves out its outputs."""
    path = tmp_path / "bad.fmu"
    with zipfile.ZipFile(lag_fmus[2]) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml":
                data = re.sub(rb"<Outputs>.*?</Outputs>", b"", data, flags=re.DOTALL)
            target.writestr(name, data)
    return {"bad.fmu": path.read_bytes()}


def test_a_system_that_fails_when_it_runs(pack):
    trouble = bindings(
        inline(("trouble", "Enumeration", 'value="error"'), ("trouble_step", "Integer", 'value="3"'))
    )
    report = check_ssp(pack(ssd(system(component("a") + component("b", trouble)))))
    (finding,) = report.of("error")
    assert (finding.topic, finding.where) == ("short run", "b")
    assert "step 3" in finding.message


def test_nested_archives_are_validated(pack, tmp_path):
    inner = pack(ssd(system(component("a")) + "<ssd:Wrong/>"), name="inner").read_bytes()
    kind = 'type="application/x-ssp-package"'
    lines = told(
        pack(ssd(system(component("box", source="inner.ssp", attributes=kind))), {"inner.ssp": inner})
    )
    assert any("error schema test.ssp/inner.ssp/SystemStructure.ssd" in line for line in lines)


def test_archives_that_are_none(tmp_path, capsys):
    path = tmp_path / "none.ssp"
    path.write_bytes(b"PK")
    assert call("check", path) == 1
    assert "error" in capsys.readouterr().out
    assert call("inspect", path) == 2
    with pytest.raises(InputError, match=r"none\.ssp"):
        summarise(path)


def test_encodings_and_prefixes_are_free(pack):
    text = ssd(system(component("Rädsatz") + component("b"), wire("Rädsatz.x", "b.u")))
    plain = text.replace("xmlns:ssd=", "xmlns=").replace("<ssd:", "<").replace("</ssd:", "</")
    for data in (
        b"\xef\xbb\xbf" + text.encode(),
        text.replace("UTF-8", "UTF-16").encode("utf-16"),
        text.replace("UTF-8", "ISO-8859-1").encode("latin-1"),
        plain.encode(),
    ):
        summary = summarise(pack(data))
        assert summary.faults == ()
        assert [part.name for part in summary.parts] == ["Rädsatz", "b"]


def test_a_value_that_does_not_fit_is_a_finding_about_parameters(pack):
    lines = told(pack(ssd(system(component("lag", bindings(inline(real("T", "INF"))))))))
    assert any(line.startswith("error parameters") and 'parameter "T"' in line for line in lines)


def test_fmus_for_other_platforms_only_are_shown_told_and_refused(pack, lag_fmus, tmp_path, capsys):
    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(lag_fmus[2]) as source, zipfile.ZipFile(other, "w") as target:
        for name in source.namelist():
            target.writestr(re.sub("binaries/[^/]*", "binaries/win64", name), source.read(name))
    path = pack(ssd(system(component("lag", source="other.fmu"))), {"other.fmu": other.read_bytes()})
    (part,) = summarise(path).parts
    assert "but for win64" in part.cannot_run
    assert "runs here" in shown(path)
    assert any("it has libraries for win64" in line for line in told(path))
    assert call("simulate", path, "--out", tmp_path / "out") == 2
    assert "for win64" in capsys.readouterr().err
