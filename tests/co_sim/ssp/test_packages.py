"""Components that are systems themselves, signal dictionaries, kinds of FMUs, arrays, and the border."""

import io
import zipfile
from dataclasses import replace

import pytest

from co_sim import Constant, ExchangeFmu, FmuComponent, InputError, Master, Port, Recorder, System
from co_sim.ssp import open_ssp, read_ssp, schema_faults
from fmu_wheelset import path as wheelset

from .conftest import (
    NAMESPACES,
    UNITS,
    bindings,
    component,
    connectors,
    inline,
    real,
    ssd,
    system,
    wire,
)
from .test_reading import ends, plain

INNER = system(
    component("lag", bindings(inline(real("x0", 1), real("T", 1)))),
    wire(".in", "lag.u") + wire("lag.x", ".out"),
    name="whatever",
    before=connectors("in:input", "out:output") + bindings(inline(real("lag.T", 2))),
)
OUTER = component(
    "box",
    connectors("in:input", "out:output") + bindings(inline(real("lag.T", 3))),
    source="{}",
    attributes='type="{}"',
)
WIRES = wire("source.x", "box.in") + wire("box.out", "sink.u")


def packed(files):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return data.getvalue()


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("resources/box.ssp", "application/x-ssp-package"),
        ("resources/box.ssp#Other%20One.ssd", "application/x-ssp-package"),
        ("box.ssd", "application/x-ssp-definition"),
        ("#box", "application/x-ssp-definition"),
    ],
)
def test_components_that_are_systems(pack, lag_fmus, source, kind):
    lag = lag_fmus[2].read_bytes()
    files = {
        "box.ssd": ssd(INNER),
        "resources/box.ssp": packed(
            {"SystemStructure.ssd": ssd(INNER), "Other One.ssd": ssd(INNER), "resources/lag.fmu": lag}
        ),
    }
    elements = OUTER.format(source, kind) + component("source") + component("sink")
    if source == "#box":
        elements += INNER.replace('name="whatever"', 'name="whatever" id="box"')
    found = read_ssp(pack(ssd(system(elements, WIRES)), files))
    assert ends(found) == plain("box/lag.x -> sink.u", "source.x -> box/lag.u")
    # The bindings of the component come after those of the system that it stands for.
    assert found.components["box/lag"].parameters == {"x0": 1.0, "T": 3.0}


@pytest.mark.parametrize("source", ["SystemStructure.ssd", "#root", "a.ssd"])
def test_systems_that_contain_themselves(pack, source):
    kind = 'type="application/x-ssp-definition"'
    text = ssd(system(component("box", source=source, attributes=kind), attributes='id="root"'))
    files = {"a.ssd": ssd(system(component("box", source="SystemStructure.ssd", attributes=kind)))}
    with pytest.raises(InputError, match="contains itself"):
        read_ssp(pack(text, files))


def test_variants(pack):
    path = pack(ssd(system(component("a"))), {"B.ssd": ssd(system(component("b")))})
    assert list(read_ssp(path, variant="B.ssd").components) == ["b"]
    with pytest.raises(InputError, match=r"C\.ssd"):
        read_ssp(path, variant="C.ssd")


def test_signal_dictionaries(pack):
    entries = "<ssb:DictionaryEntry name='voltage'><ssc:Real unit='mV'/></ssb:DictionaryEntry>"
    entries += UNITS.replace("ssd:", "ssb:")
    book = f'<ssb:SignalDictionary {NAMESPACES} version="1.0">{entries}</ssb:SignalDictionary>'
    reference = (
        '<ssd:SignalDictionaryReference name="bus" dictionary="book">'
        + connectors("voltage:inout")
        + "</ssd:SignalDictionaryReference>"
    )
    scale = '<ssc:LinearTransformation offset="250"/>'
    inner = system(component("b") + reference, wire("bus.voltage", "b.u"), name="inner")
    for dictionary, files in (
        (f'<ssd:SignalDictionary name="book">{book}</ssd:SignalDictionary>', {}),
        ('<ssd:SignalDictionary name="book" source="resources/bus.ssb"/>', {"resources/bus.ssb": book}),
    ):
        outer = system(
            component("a") + inner + reference,
            wire("a.x", "bus.voltage", scale),
            after=f"<ssd:SignalDictionaries>{dictionary}</ssd:SignalDictionaries>",
        )
        (connection,) = read_ssp(pack(ssd(outer), files)).connections
        assert (connection.source, connection.target) == ("a.x", "inner/b.u")
        assert connection.offset == pytest.approx(0.25, rel=1e-15)
    with pytest.raises(InputError, match='unknown dictionary "book"'):
        read_ssp(pack(ssd(system(component("a") + reference, wire("a.x", "bus.voltage")))))


def test_interface_types(pack, parrots):
    for wanted, kind in (("any", FmuComponent), ("CoSimulation", FmuComponent)):
        text = ssd(system(component("a", attributes=f'implementation="{wanted}"')))
        assert type(read_ssp(pack(text)).components["a"]) is kind
    for wanted in ("ModelExchange", "ScheduledExecution"):
        text = ssd(system(component("a", attributes=f'implementation="{wanted}"')))
        with pytest.raises(InputError, match=f'<Component name="a".*no {wanted}.*choose from CoSimulation'):
            read_ssp(pack(text))


def test_model_exchange(pack):
    body = component("w", source="resources/w.fmu", attributes='implementation="ModelExchange"')
    fmu = wheelset().read_bytes()
    assert type(read_ssp(pack(ssd(system(body)), {"resources/w.fmu": fmu})).components["w"]) is ExchangeFmu


def test_elements_of_arrays(pack):
    both = component("a", source="resources/the%20parrot.fmu") + component(
        "b", source="resources/the%20parrot.fmu"
    )
    wires = (
        wire("a.a_out", "b.a_in")
        + wire("a.float64_out", "b.v_in", attributes='endIndices="2"')
        + wire("a.a_out", "b.float64_in", attributes='startIndices="2 1"')
    )
    found = read_ssp(pack(ssd(system(both, wires), version="2.0")))
    assert {name for name, *_ in ends(found)} == {
        "a.a_out -> b.a_in",
        "a.float64_out -> b.v_in[2]",
        "a.a_out[2,1] -> b.float64_in",
    }


def test_elements_of_arrays_through_a_system(pack):
    parrot = "resources/the%20parrot.fmu"
    inner = system(
        component("b", source=parrot),
        wire(".all", "b.a_in") + wire(".all", "b.float64_in", attributes='startIndices="2 1"'),
        name="inner",
        before=connectors("all:input"),
    )
    whole = read_ssp(
        pack(ssd(system(component("a", source=parrot) + inner, wire("a.a_out", "inner.all")), version="2.0"))
    )
    assert {name for name, *_ in ends(whole)} == {
        "a.a_out -> inner/b.a_in",
        "a.a_out[2,1] -> inner/b.float64_in",
    }
    pieces = wire("a.float64_out", "inner.all", attributes='endIndices="2 1"') + wire(
        "a.sum", "inner.all", attributes='endIndices="1 1"'
    )
    found = read_ssp(pack(ssd(system(component("a", source=parrot) + inner, pieces), version="2.0")))
    assert {name for name, *_ in ends(found)} == {
        "a.float64_out -> inner/b.a_in[2,1]",
        "a.float64_out -> inner/b.float64_in",
        "a.sum -> inner/b.a_in[1,1]",
    }


def test_the_border_of_the_whole(pack):
    scale = '<ssc:LinearTransformation factor="10"/>'
    whole = system(
        component("a") + component("b"),
        wire(".in", "a.u", scale) + wire(".in", "b.u") + wire("a.x", ".out", scale),
        before=connectors("in:input:mV", "out:output"),
    )
    experiment = '<ssd:DefaultExperiment startTime="1" stopTime="2.5"/>'
    model = open_ssp(pack(ssd(whole, UNITS + experiment)), step=0.5)
    assert (model.name, model.start_time, model.stop_time) == ("test", 1.0, 2.5)
    assert model.outputs["out"].source == "a.x"
    assert model.outputs["out"].gain == 10.0
    driven = System(
        {**model.system.components, "driver": Constant([500.0], [Port("v", "mV")])},
        [*model.system.connections, *(replace(c, source="driver.v") for c in model.inputs["in"])],
        step=0.5,
    )
    recorder = Recorder()
    with Master(driven, observers=[recorder]) as master:
        master.run(20.0)
    assert recorder["a.x"][-1] == pytest.approx(5.0)
    assert recorder["b.x"][-1] == pytest.approx(0.5)


def test_the_step_is_that_of_the_fmus(pack, lag_fmus, tmp_path):
    path = tmp_path / "quick.fmu"
    with zipfile.ZipFile(lag_fmus[2]) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                data = data.replace(
                    b"<ModelVariables>", b'<DefaultExperiment stepSize="0.02"/><ModelVariables>'
                )
            new.writestr(name, data)
    both = component("a") + component("b", source="resources/quick.fmu")
    found = open_ssp(pack(ssd(system(both)), {"resources/quick.fmu": path.read_bytes()}))
    assert found.system.step == 0.02
    assert (found.start_time, found.stop_time) == (None, None)


def test_what_other_tools_write_besides(pack):
    """Geometry, annotations, metadata, notes, empty attributes and names of units of their own."""
    geometry = '<ssd:ElementGeometry x1="0" y1="0" x2="1" y2="1" iconSource="resources/icon.svg"/>'
    annotation = (
        '<ssd:Annotations><ssc:Annotation type="com.example"><x:y xmlns:x="urn:x"/></ssc:Annotation>'
        "</ssd:Annotations>"
    )
    meta = '<ssc:MetaData kind="general" type="text/plain"><ssc:Content>words</ssc:Content></ssc:MetaData>'
    torque = (
        '<ssd:Connectors><ssd:Connector name="{}" kind="{}" description=""><ssc:Real unit="{}"/>'
        '<ssd:ConnectorGeometry x="0" y="0.5" systemInnerX="1" systemInnerY="2"/>'
        "</ssd:Connector></ssd:Connectors>"
    )
    empty = bindings(inline(attributes='prefix=""'))
    inner = system(
        component("wheel", torque.format("traction_torque", "input", "Nm") + geometry, "resources/w.fmu"),
        wire(
            ".T",
            "wheel.traction_torque",
            '<ssd:ConnectionGeometry pointsX="1 2" pointsY="3 4"/>' + annotation,
            'suppressUnitConversion="false" description=""',
        ),
        name="drive",
        before=torque.format("T", "input", "Nm") + geometry + empty,
        after='<ssd:SystemGeometry x1="0" y1="0" x2="9" y2="9"/><ssd:GraphicalElements>'
        '<ssd:Note x1="0" y1="0" x2="1" y2="1" text="a note"/></ssd:GraphicalElements>' + annotation,
    )
    source = component(
        "motor", torque.format("axle_torque", "output", "N.m") + geometry + empty + meta, "resources/w.fmu"
    )
    whole = system(inner + source, wire("drive.T", "motor.axle_torque"), before=empty)
    newton = (
        '<ssc:Unit name="{}"><ssc:BaseUnit kg="1" m="2" s="-2" rad="0" factor="1.0" offset="0.0"/></ssc:Unit>'
    )
    units = f"<ssd:Units>{newton.format('Nm')}{newton.format('N.m')}</ssd:Units>"
    times = '<ssd:DefaultExperiment stopTime="1.0">' + annotation + "</ssd:DefaultExperiment>"
    path = pack(
        ssd(whole, units + times + meta + annotation, version="2.0"),
        {"resources/w.fmu": wheelset(fmi=3).read_bytes(), "extra/com.example/notes.txt": "x"},
    )
    assert schema_faults(path) == []
    found = open_ssp(path)
    assert ends(found.system) == plain("motor.axle_torque -> drive/wheel.traction_torque")
    assert (found.start_time, found.stop_time) == (None, 1.0)
    with Master(replace(found.system, step=1e-3)) as master:
        master.run(0.01)
