"""Everything that is wrong is told at once, with file, line and element; nothing foreign is fetched."""

import stat
import tempfile
import zipfile

import pytest

from co_sim import InputError
from co_sim.ssp import read_ssp

from .conftest import NAMESPACES, bindings, component, connectors, inline, real, ssd, system, values, wire


def faults(path):
    with pytest.raises(InputError) as caught:
        read_ssp(path)
    return str(caught.value).splitlines()


def test_all_faults_are_told_together(pack):
    table = '<ssc:{0}><ssc:MapEntry source="true" target="false"/></ssc:{0}>'.format(
        "BooleanMappingTransformation"
    )
    elements = (
        component("a", connectors("u:input", "x:output", "y:output", "direct:sideways"))
        + component("b", source="resources/none.fmu")
        + component("c", bindings(inline(real("T", "-1"), real("x", 1))))
        + component("d", source="SystemStructure.ssd", attributes='type="text/x-modelica; path=A.B"')
        + component("e", source="resources/broken.fmu")
        + "<ssd:Component name='f'/>"
        + component("g", bindings(('source="resources/none.ssv"', ""), inline(real("T", "one"))))
    )
    wires = (
        wire("a.x", "c.v")
        + wire("a.x", "nobody.u")
        + wire("a.x", "c.x")
        + wire("a.x", "c.T")
        + wire("a.x", "g.u", table)
        + wire("c.x", "a.u", '<ssc:LinearTransformation factor="two"/>')
        + wire("c.direct", "a.u")
        + wire(".in", "c.u")
        + wire("b.x", "e.u")
    )
    lines = faults(pack(ssd(system(elements, wires)), {"resources/broken.fmu": b"PK"}))
    expected = [
        '<Connector name="direct">: got kind="sideways"',
        '<Component name="b" source="resources/none.fmu">: got "resources/none.fmu", which is not there',
        '<Component name="c" source="resources/lag.fmu">: parameter "T"',
        'parameter "x" of lag.fmu: got',
        '<Component name="d" source="SystemStructure.ssd">: got the type "text/x-modelica"',
        '<Component name="e" source="resources/broken.fmu">: ',
        '<Component name="f">: got no source',
        'got "resources/none.ssv", which is not there',
        'got value="one"',
        'got an unknown connector "v" of "c"',
        'got an unknown element "nobody"',
        "got two connectors that both give a value",
        'got a connection to "T" with causality parameter',
        "got a BooleanMappingTransformation",
        'got factor="two"',
        "got a second connection into a connector",
        'got an unknown connector "in" of the system',
        'got a connector "y" that the FMU does not have',
    ]
    for text in expected:
        assert any(text in line for line in lines), (text, lines)
    assert len(lines) == len(expected), lines
    assert all("test.ssp/SystemStructure.ssd, line " in line for line in lines)


def test_circles(pack):
    inner = system(
        component("lag"), wire(".in", ".out"), name="{}", before=connectors("in:input", "out:output")
    )
    round_and_round = wire("p.out", "q.in") + wire("q.out", "p.in")
    both = inner.format("p") + inner.format("q") + component("lag")
    lines = faults(pack(ssd(system(both, round_and_round + wire("p.out", "lag.u")))))
    assert any("round in a circle" in line for line in lines)


@pytest.mark.parametrize(
    ("document", "told"),
    [
        ("", "Document is empty"),
        ("<a>", "well-formed XML"),
        ("<SystemStructureDescription/>", "the root element"),
        (ssd(""), "no System"),
        (ssd(system(component("a")), version="3.0"), "version 3.0"),
        (f"<ssv:ParameterSet {NAMESPACES}/>", "expected SystemStructureDescription"),
    ],
)
def test_documents_that_are_none(pack, document, told):
    assert told in "\n".join(faults(pack(document)))


def test_entities_are_not_resolved(pack, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("12345")
    for inside in (f'<!ENTITY e SYSTEM "{secret.as_uri()}">', '<!ENTITY e "12345">', '<!ENTITY % p "x">'):
        text = ssd(system(component("a"))).replace(
            "<ssd:SystemStructureDescription", f"<!DOCTYPE x [{inside}]><ssd:SystemStructureDescription", 1
        )
        lines = faults(pack(text))
        assert "a document type declaration" in lines[0]
        data = values(real("T", "1")).replace(
            "<ssv:ParameterSet", f"<!DOCTYPE x [{inside}]><ssv:ParameterSet", 1
        )
        body = ssd(system(component("a", bindings(('source="p.ssv"', "")))))
        assert "a document type declaration" in faults(pack(body, {"p.ssv": data}))[0]


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("../secret.fmu", "leads out of the archive"),
        ("%2e%2e/secret.fmu", "leads out of the archive"),
        ("resources/../../secret.fmu", "leads out of the archive"),
        ("/etc/passwd", "no relative URI"),
        ("file:///etc/passwd", "no relative URI"),
        ("http://localhost/a.fmu", "no relative URI"),
        ("//localhost/a.fmu", "no relative URI"),
        ("..\\secret.fmu", "no relative URI"),
        ("resources", "not there"),
    ],
)
def test_sources_stay_in_the_archive(pack, lag_fmus, tmp_path, monkeypatch, source, told):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    (folder / "secret.fmu").write_bytes(lag_fmus[2].read_bytes())
    assert told in faults(pack(ssd(system(component("a", source=source)))))[0]
    values_elsewhere = bindings((f'source="{source}"', ""))
    assert told in faults(pack(ssd(system(component("a", values_elsewhere)))))[0]


def test_a_bare_description_may_look_around(pack, lag_fmus, tmp_path):
    (tmp_path / "shared.fmu").write_bytes(lag_fmus[2].read_bytes())
    path = pack(ssd(system(component("a", source="../shared.fmu"))), bare=True)
    assert list(read_ssp(path).components) == ["a"]


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "C:/evil", "..\\evil"])
def test_archives_stay_in_their_folder(pack, name):
    path = pack(ssd(system(component("a"))))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, b"")
    assert "leads out of the archive" in faults(path)[0]


def test_links_and_broken_archives(pack, tmp_path):
    path = pack(ssd(system(component("a"))))
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    assert "is a link" in faults(path)[0]
    short = tmp_path / "short.ssp"
    short.write_bytes(pack(ssd(system(component("a")))).read_bytes()[:-30])
    assert "expected a sound archive" in faults(short)[0]
    empty = tmp_path / "empty.ssp"
    with zipfile.ZipFile(empty, "w"):
        pass
    assert "SystemStructure.ssd" in faults(empty)[0]
    assert "no file" in faults(tmp_path / "nowhere.ssp")[0]
