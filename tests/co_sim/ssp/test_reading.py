"""Structures, connections and units of packages written by hand."""

import os
import tempfile
import zipfile
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from co_sim import Connection, FmuComponent, InputError, Master, Recorder, System
from co_sim.ssp import read_ssp
from co_sim.units import Unit

from .conftest import UNITS, component, connectors, ssd, system, wire

TWO = component("a", connectors("u:input", "x:output")) + component("b", connectors("u:input", "x:output"))


def ends(found):
    return sorted((str(c), c.gain, c.offset, c.convert_units) for c in found.connections)


def plain(*wires):
    return sorted((name, 1.0, 0.0, True) for name in wires)


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("bare", [False, True], ids=["archive", "bare"])
def test_a_system_runs(pack, lag_fmus, version, bare):
    path = pack(ssd(system(TWO, wire("a.x", "b.u")), version=version), bare=bare)
    found = read_ssp(path, step=0.25)
    assert list(found.components) == ["a", "b"]
    parts = {"a": FmuComponent(lag_fmus[2], outputs=["x"]), "b": FmuComponent(lag_fmus[2], outputs=["x"])}
    written = System(parts, [Connection("a.x", "b.u")], step=0.25)
    runs = []
    for one in (found, written):
        recorder = Recorder()
        with Master(one, observers=[recorder]) as master:
            master.run(2.0)
        runs.append(np.stack([recorder[name] for name in ("a.x", "b.x")]))
    assert np.array_equal(*runs)
    assert runs[0][1, -1] > 0.1


def test_archives_stay_unpacked_as_long_as_they_are_of_use(pack, tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    found = read_ssp(pack(ssd(system(TWO))))
    parts = [replace(found, step=0.1).components["a"]]
    del found
    assert len(list(folder.iterdir())) == 1
    parts.clear()
    assert not list(folder.iterdir())
    # A process that has forked from this one leaves the folder to it.
    monkeypatch.setattr(os, "getpid", lambda: 0)
    found = read_ssp(pack(ssd(system(TWO))))
    monkeypatch.undo()
    del found
    assert len(list(folder.iterdir())) == 1


def test_what_may_be_left_out_may_be_left_out(pack):
    # No type, no implementation, no connectors, no version; connections that name the end first.
    text = ssd(system(component("a") + component("b"), wire("b.u", "a.x"))).replace(
        'version="1.0" name="test"', ""
    )
    found = read_ssp(pack(text))
    assert ends(found) == plain("a.x -> b.u")
    assert [port.name for port in found.components["a"].outputs] == ["x", "direct"]
    assert found.step == 1e-3


def test_nested_systems_are_flattened(pack):
    border = connectors("in:input", "out:output")
    innermost = system(
        component("lag"), wire(".in", "lag.u") + wire("lag.x", ".out"), name="core", before=border
    )
    middle = system(innermost, wire(".in", "core.in") + wire("core.out", ".out"), name="shell", before=border)
    outer = system(
        middle + component("source") + component("sink"),
        wire("source.x", "shell.in") + wire("shell.out", "sink.u"),
    )
    found = read_ssp(pack(ssd(outer)))
    assert list(found.components) == ["shell/core/lag", "source", "sink"]
    assert ends(found) == plain("shell/core/lag.x -> sink.u", "source.x -> shell/core/lag.u")
    found.check()


def test_a_value_passes_through_a_system_and_to_several_places(pack):
    through = system(
        component("lag"),
        wire(".in", ".out") + wire(".in", "lag.u"),
        name="through",
        before=connectors("in:input", "out:output"),
    )
    outer = system(TWO + through, wire("a.x", "through.in") + wire("through.out", "b.u"))
    assert ends(read_ssp(pack(ssd(outer)))) == plain("a.x -> b.u", "a.x -> through/lag.u")


def test_dots_and_slashes_in_names(pack):
    inner = system(component("b"), name="a")
    found = read_ssp(pack(ssd(system(component("a.b") + inner))))
    assert list(found.components) == ["a%2Eb", "a/b"]
    with pytest.raises(InputError, match='a second component "a/b"'):
        read_ssp(pack(ssd(system(component("a/b") + inner))))


LINEAR = '<ssc:LinearTransformation factor="-2" offset="3"/>'


@pytest.mark.parametrize(
    ("start", "end", "attributes", "inside", "expected"),
    [
        ("V", "V", "", LINEAR, (-2.0, 3.0, True)),
        ("V", "V", "", '<ssc:LinearTransformation offset="3"/>', (1.0, 3.0, True)),
        # Units before the transformation, which counts in the unit of the target connector, mV: 1 V is
        # 1000 mV, then -1997 mV, then -1.997 V.
        ("V", "mV", "", LINEAR, (-2.0, 0.003, True)),
        ("mV", "V", "", LINEAR, (-2.0, 3.0, True)),
        # Without conversion the number of V is taken for one of mV.
        ("V", "mV", 'suppressUnitConversion="true"', "", (0.001, 0.0, False)),
        ("V", "mV", 'suppressUnitConversion="1"', LINEAR, (-0.002, 0.003, False)),
        ("mV", "V", 'suppressUnitConversion="true"', "", (1000.0, 0.0, False)),
        # An offset of the unit: y V are y - 5 shifted.
        ("shifted", "shifted", "", '<ssc:LinearTransformation factor="2"/>', (2.0, -5.0, True)),
        ("V", "m", 'suppressUnitConversion="true"', "", None),
    ],
)
def test_units_and_transformations(pack, start, end, attributes, inside, expected):
    elements = component("a", connectors(f"x:output:{start}")) + component("b", connectors(f"u:input:{end}"))
    text = ssd(system(elements, wire("a.x", "b.u", inside, attributes)), UNITS)
    if expected is None:
        with pytest.raises(InputError, match='"m" into "V"'):
            read_ssp(pack(text))
        return
    (connection,) = read_ssp(pack(text)).connections
    assert connection.convert_units is expected[2]
    np.testing.assert_allclose((connection.gain, connection.offset), expected[:2], rtol=1e-15)


def test_units_that_the_fmu_leaves_open(pack, parrots):
    parrot = "resources/the%20parrot.fmu"
    elements = component(
        "a", connectors("float64_out:output:ell", "sum:output", "float32_out:output"), parrot
    ) + component("b", connectors("a_in:input", "float64_in:input:m", "float32_in:input"), parrot)
    wires = (
        wire("a.float64_out", "b.float64_in")
        + wire("a.sum", "b.float32_in")
        + wire("a.float32_out", "b.a_in", attributes='endIndices="1 1"')
    )
    found = read_ssp(pack(ssd(system(elements, wires), UNITS, version="2.0")))
    ports = {
        port.name: port
        for name in "ab"
        for port in (*found.components[name].inputs, *found.components[name].outputs)
    }
    assert ports["float64_out"].definition == Unit(m=1, factor=0.5)
    # Where one end has no unit, numbers pass as they are.
    assert ends(found) == [
        ("a.float32_out -> b.a_in[1,1]", 1.0, 0.0, False),
        ("a.float64_out -> b.float64_in", 1.0, 0.0, True),
        ("a.sum -> b.float32_in", 1.0, 0.0, False),
    ]
    assert found.links()[0].gain == 0.5


def test_a_unit_that_only_the_description_defines(pack, parrots, tmp_path):
    data = {}
    with zipfile.ZipFile(parrots[3]) as old, zipfile.ZipFile(tmp_path / "p.fmu", "w") as new:
        for name in old.namelist():
            new.writestr(
                name, old.read(name).replace(b'name="m"', b'name="ell"').replace(b'unit="m"', b'unit="ell"')
            )
    data["resources/p.fmu"] = (tmp_path / "p.fmu").read_bytes()
    elements = component("a", connectors("sum:output:ell"), "resources/p.fmu") + component(
        "b", connectors("float64_in:input:m"), "resources/p.fmu"
    )
    found = read_ssp(pack(ssd(system(elements, wire("a.sum", "b.float64_in")), UNITS), data))
    assert [link.gain for link in found.links()] == [0.5]


@st.composite
def nestings(draw):
    """Draw components, each with a path of systems around it, and who feeds whom."""
    n = draw(st.integers(2, 5))
    paths = [tuple(draw(st.lists(st.sampled_from("pqr"), max_size=3))) for _ in range(n)]
    sources = [draw(st.sampled_from([None, *(j for j in range(n) if j != i)])) for i in range(n)]
    flips = draw(st.lists(st.booleans(), min_size=64, max_size=64))
    return paths, sources, flips


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(nestings())
def test_any_nesting_of_the_same_connections_is_the_same_system(pack, drawn):
    paths, sources, flips = drawn
    flips = iter(flips)
    borders, wires = defaultdict(dict), defaultdict(set)
    for i, j in enumerate(sources):
        if j is not None:
            lead(paths[j], paths[i], j, i, borders, wires)

    def build(path):
        inside = "".join(component(f"c{i}") for i, where in enumerate(paths) if where == path)
        below = {
            where[: len(path) + 1] for where in paths if where[: len(path)] == path and len(where) > len(path)
        }
        inside += "".join(build(child) for child in sorted(below))
        text = "".join(wire(*(pair[::-1] if next(flips, False) else pair)) for pair in sorted(wires[path]))
        before = connectors(*(f"{name}:{kind}" for name, kind in borders[path].items()))
        name = path[-1] if path else "root"
        return system(inside, text, name=name, before=before if borders[path] else "")

    found = read_ssp(pack(ssd(build(())), bare=True))
    names = ["/".join((*path, f"c{i}")) for i, path in enumerate(paths)]
    assert set(found.components) == set(names)
    assert ends(found) == plain(
        *(f"{names[j]}.x -> {names[i]}.u" for i, j in enumerate(sources) if j is not None)
    )


def lead(source, target, j, i, borders, wires):
    """Lead a value out of the systems around its source and into those around its target."""
    common = 0
    while common < min(len(source), len(target)) and source[common] == target[common]:
        common += 1
    start = f"c{j}.x"
    for depth in range(len(source), common, -1):
        borders[source[:depth]][f"x{j}"] = "output"
        wires[source[:depth]].add((start, f".x{j}"))
        start = f"{source[depth - 1]}.x{j}"
    for depth in range(common, len(target)):
        wires[target[:depth]].add((start, f"{target[depth]}.u{j}"))
        borders[target[: depth + 1]][f"u{j}"] = "input"
        start = f".u{j}"
    wires[target].add((start, f"c{i}.u"))
