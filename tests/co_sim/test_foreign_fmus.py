"""FMUs as other tools describe them, on the library of lag.c: what the standards allow must run.

Each description has what one family of exporters is known for; none is a copy of theirs.
"""

import io
import time
import warnings
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import fmu_wheelset
from co_sim import (
    Connection,
    Constant,
    ExchangeFmu,
    FmuComponent,
    InputError,
    Master,
    Port,
    Recorder,
    RunError,
    StepSizeWarning,
    System,
)
from co_sim.ssp import read_ssp, write_ssp

T = 0.5

#: ISO-8859-1, flat names with spaces, quotes, backslashes and umlauts, no units, an empty model structure.
FLAT = """<?xml version="1.0" encoding="ISO-8859-1"?>
<!-- wie exportiert -->
<fmiModelDescription fmiVersion="2.0" modelName="Verzögerung 1. Ordnung" guid="lag" generationTool="20-sim"
    numberOfEventIndicators="0" copyright="" license="-" variableNamingConvention="flat">
  <CoSimulation modelIdentifier="lag" needsExecutionTool="false" canHandleVariableCommunicationStepSize="true"
      canInterpolateInputs="false" maxOutputDerivativeOrder="0" canRunAsynchronuously="false"
      canBeInstantiatedOnlyOncePerProcess="true" canNotUseMemoryManagementFunctions="true"
      canGetAndSetFMUstate="false" canSerializeFMUstate="false" providesDirectionalDerivative="false"/>
  <DefaultExperiment startTime="0.0" stopTime="1000.0"/>
  <ModelVariables>
    <ScalarVariable name="Störung &quot;u&quot;, Eingang" valueReference="2" variability="continuous"
      causality="input"><Real start="0.0"/></ScalarVariable>
    <ScalarVariable name="Regler\\Ausgang.x" valueReference="0" variability="continuous" causality="output">
      <Real/></ScalarVariable>
    <ScalarVariable name="Zeitkonstante T" valueReference="3" variability="tunable" causality="parameter"
      initial="exact"><Real start="1.0"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure></ModelStructure>
</fmiModelDescription>
"""

#: No variability or causality where they can be left out, comments between, arrays as scalars, dependencies.
SPARSE = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription
  fmiVersion = "2.0"
  modelName  = "lag"
  guid       = "lag"
  generationDateAndTime = "2018-10-25T13:24:11Z"
  variableNamingConvention = "structured">
  <CoSimulation modelIdentifier="lag"/>
  <UnitDefinitions><Unit name="degC"/><Unit name="K"/></UnitDefinitions>
  <ModelVariables>
    <ScalarVariable name="internalTime" valueReference="99" causality="independent"><Real unit="s"/>
    </ScalarVariable> <!--index="1" -->
    <ScalarVariable name="inputs[1]" valueReference="2" causality="input"><Real unit="degC" start="0"/>
    </ScalarVariable>
    <ScalarVariable name="outputs[1]" valueReference="0" initial="calculated" causality="output">
      <Real unit="degC"/></ScalarVariable>
    <ScalarVariable name="outputs[2]" valueReference="0" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed">
      <Real start="1.00000000000000000e+00"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="17"><Real derivative="7"/></ScalarVariable>
    <ScalarVariable name="x" valueReference="0"><Real/></ScalarVariable>
    <ScalarVariable name="'local 1'.b[1,2].c" valueReference="18"><Real/></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs>
      <Unknown index="3" dependencies=""/><Unknown index="4" dependencies="" dependenciesKind=""/>
    </Outputs>
  </ModelStructure>
</fmiModelDescription>
"""

#: Annotations of vendors, declared types with attributes of their own, units that only the file explains.
TYPED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Plant.lag" guid="lag" description="" author=""
    variableNamingConvention="structured">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="false"/>
  <UnitDefinitions>
    <Unit name="notch"><BaseUnit factor="0.125"/><DisplayUnit name="%" factor="100"/></Unit>
    <Unit name="V"><BaseUnit kg="1" m="2" s="-3" A="-1"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="Modelica.Units.SI.Time"><Real quantity="Time" unit="s" min="0.0"/></SimpleType>
    <SimpleType name="Plant.Notch"><Real unit="notch" relativeQuantity="false" nominal="1.0"/></SimpleType>
    <SimpleType name="Plant.Mode" description=""><Enumeration quantity="Plant.Mode">
      <Item name="off" value="0" description=""/><Item name="warnen" value="1"/></Enumeration></SimpleType>
  </TypeDefinitions>
  <LogCategories><Category name="logEvents"/></LogCategories>
  <DefaultExperiment startTime="0" stopTime="1" tolerance="0.0001"/>
  <VendorAnnotations><Tool name="Dymola"><dymola:x xmlns:dymola="urn:d"><any thing="1">text</any></dymola:x>
  </Tool><Tool name="Other"/></VendorAnnotations>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="2" causality="input" canHandleMultipleSetPerTimeInstant="true">
      <Real declaredType="Plant.Notch" start="0"/><Annotations><Tool name="Dymola"/></Annotations>
    </ScalarVariable>
    <ScalarVariable name="x" valueReference="0" causality="output"><Real unit="V"/></ScalarVariable>
    <ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed">
      <Real declaredType="Modelica.Units.SI.Time" start="1"/></ScalarVariable>
    <ScalarVariable name="mode" valueReference="6" causality="parameter" variability="fixed">
      <Enumeration declaredType="Plant.Mode" start="0" min="0" max="1"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="2"/></Outputs>
    <InitialUnknowns><Unknown index="2" dependencies="1" dependenciesKind="dependent"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""

#: FMI 3: aliases, annotations, fixed steps inside, event mode and early return offered but not used.
ALIASED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="lag" instantiationToken="lag" generationTool="some tool 7.1">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="false"
      fixedInternalStepSize="0.01" hasEventMode="true" mightReturnEarlyFromDoStep="true"
      providesIntermediateUpdate="true" needsExecutionTool="false">
    <Annotations><Annotation type="urn:x"><y/></Annotation></Annotations></CoSimulation>
  <UnitDefinitions>
    <Unit name="league"><BaseUnit m="1" factor="4828.0"/></Unit>
    <Unit name="m"><BaseUnit m="1"/></Unit>
  </UnitDefinitions>
  <ModelVariables>
    <Float64 name="time" valueReference="99" causality="independent"/>
    <Float64 name="u" valueReference="2" causality="input" unit="m" start="0">
      <Annotations><Annotation type="org.example"/></Annotations><Alias name="sea.depth"/></Float64>
    <Float64 name="x" valueReference="0" causality="output" unit="m">
      <Alias name="mean depth" description="as it is called elsewhere"/><Alias name="y[1]"/></Float64>
    <Float64 name="T" valueReference="3" causality="parameter" variability="tunable" start="1"/>
  </ModelVariables>
  <ModelStructure><Output valueReference="0"/></ModelStructure>
</fmiModelDescription>
"""


@pytest.fixture(scope="module")
def foreign(lag_fmus, tmp_path_factory):
    """Return a function that packs a description with the library of the lag, under a name of its own."""
    folder = tmp_path_factory.mktemp("Fremde FMUs ä")

    def pack(description, name="foreign", *, library=None, place=None):
        version = 3 if 'fmiVersion="3' in description else 2
        encoding = "latin-1" if "ISO-8859-1" in description else "utf-8"
        path = folder / f"{name}.fmu"
        with zipfile.ZipFile(lag_fmus[version]) as source, zipfile.ZipFile(path, "w") as archive:
            (own,) = [item for item in source.namelist() if item.startswith("binaries/")]
            archive.writestr("modelDescription.xml", description.encode(encoding))
            archive.writestr(place or own, source.read(own) if library is None else library)
        return path

    return pack


def response(fmu, u, x, value=3.0, step=0.1, unit="1"):
    """Return the output over time for a held input, from 0 to 1 s."""
    system = System(
        {"source": Constant([value], [Port("u", unit)]), "fmu": fmu},
        [Connection("source.u", f"fmu.{u}")],
        step=step,
    )
    recorder = Recorder()
    with Master(system, observers=[recorder]) as master:
        master.run(1.0)
    return recorder[f"fmu.{x}"]


def exact(value=3.0, step=0.1):
    return value * (1.0 - np.exp(-step * np.arange(round(1.0 / step) + 1) / T))


def test_flat_names_with_blanks_quotes_and_umlauts(foreign, tmp_path):
    fmu = FmuComponent(foreign(FLAT, "Verzögerung 1"), parameters={"Zeitkonstante T": T})
    name = 'Störung "u", Eingang'
    assert [port.name for port in fmu.inputs] == [name]
    assert fmu.feedthrough is None
    np.testing.assert_allclose(response(fmu, name, "Regler\\Ausgang.x"), exact(), atol=1e-12)


def test_odd_names_come_back_from_a_csv_file(foreign, tmp_path):
    import csv

    recorder = Recorder()
    with Master(System({"fmu": FmuComponent(foreign(FLAT))}, step=0.1), observers=[recorder]) as master:
        master.run(0.2)
    recorder.write_csv(tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.reader(file)) == ["time [s]", "fmu.Regler\\Ausgang.x [1]"]


def test_two_instances_of_an_fmu_that_allows_one_in_a_process(foreign):
    path = foreign(FLAT)
    recorder = Recorder()
    parts = {name: FmuComponent(path) for name in ("a", "b")}
    with Master(System(parts, step=0.1), observers=[recorder]) as master:
        master.run(0.1)
    assert len(recorder.names) == 2


def test_sparse_descriptions_and_scalars_named_like_elements_of_arrays(foreign):
    fmu = FmuComponent(foreign(SPARSE), outputs=["outputs[1]", "outputs[2]", "x"], parameters={"T": T})
    assert all(port.continuous for port in (*fmu.inputs, *fmu.outputs))
    assert [port.unit for port in fmu.outputs] == ["degC", "1", "1"]
    assert not fmu.feedthrough["outputs[1]"]
    np.testing.assert_allclose(response(fmu, "inputs[1]", "outputs[2]", unit="degC"), exact(), atol=1e-12)


def test_units_without_a_definition_mean_what_they_commonly_mean(foreign):
    fmu = FmuComponent(foreign(SPARSE), outputs=["x"], parameters={"T": T})
    warm = response(fmu, "inputs[1]", "x", value=276.15, unit="K")
    np.testing.assert_allclose(warm, exact(), atol=1e-9)


def test_annotations_types_and_units_of_the_file_itself(foreign):
    fmu = FmuComponent(foreign(TYPED), parameters={"T": T, "mode": "off"})
    assert [port.unit for port in fmu.inputs] == ["notch"]
    # Eight notches are all there is.
    np.testing.assert_allclose(response(fmu, "u", "x", value=0.375, unit="1"), exact(), atol=1e-12)
    with pytest.raises(InputError, match=r'"m" into "notch"'):
        response(FmuComponent(foreign(TYPED)), "u", "x", unit="m")


def test_the_variables_of_fmi_3_go_by_their_aliases_too(foreign):
    path = foreign(ALIASED)
    assert [port.name for port in FmuComponent(path).inputs] == ["u"]
    assert [port.name for port in FmuComponent(path).outputs] == ["x"]
    fmu = FmuComponent(path, inputs=["sea.depth"], outputs=["mean depth", "x", "y[1]"], parameters={"T": T})
    assert fmu.outputs[0].description == "as it is called elsewhere"
    assert fmu.outputs[1].name == "x"
    deep = response(fmu, "sea.depth", "mean depth", value=3.0, unit="m")
    np.testing.assert_allclose(deep, exact(), atol=1e-12)


def test_an_ssp_may_connect_by_aliases(foreign, tmp_path):
    path = foreign(ALIASED)

    def lag(inputs, outputs):
        return FmuComponent(
            path, inputs=inputs, outputs=outputs, parameters={"T": T, **dict.fromkeys(inputs, 3.0)}
        )

    parts = {"first": lag(["sea.depth"], ["mean depth"]), "then": lag(["u"], ["y[1]"])}
    system = System(parts, [Connection("first.mean depth", "then.u")], step=0.1)
    write_ssp(system, tmp_path / "aliases.ssp")
    runs = []
    for each in (system, read_ssp(tmp_path / "aliases.ssp")):
        recorder = Recorder()
        with Master(each, observers=[recorder]) as master:
            master.run(1.0)
        runs.append(recorder)
    np.testing.assert_array_equal(runs[0]["then.y[1]"], runs[1]["then.y[1]"])
    assert runs[1]["first.mean depth"][-1] == pytest.approx(exact()[-1])


def test_units_that_a_description_defines_are_converted(foreign):
    parts = {
        "leagues": FmuComponent(foreign(ALIASED.replace('unit="m"', 'unit="league"'), "leagues")),
        "metres": FmuComponent(foreign(ALIASED, "metres")),
    }
    (link,) = System(parts, [Connection("leagues.x", "metres.u")]).links()
    assert link.gain == 4828.0


@pytest.mark.parametrize(("step", "fits"), [(0.01, True), (0.1, True), (0.025, False), (0.004, False)])
def test_a_step_that_the_fixed_steps_inside_do_not_fill_is_told(foreign, step, fits):
    system = System({"fmu": FmuComponent(foreign(ALIASED))}, step=step)
    with warnings.catch_warnings(record=True) as caught, Master(system) as master:
        warnings.simplefilter("always")
        master.step()
    assert [w.category for w in caught] == ([] if fits else [StepSizeWarning])
    if not fits:
        assert f"fixed steps of 0.01 s inside, of which {step:g} s is no multiple" in str(caught[0].message)


def test_a_rate_makes_the_step_of_an_fmu_a_multiple(foreign):
    system = System({"fmu": FmuComponent(foreign(ALIASED))}, step=0.002, rates={"fmu": 5})
    with warnings.catch_warnings(), Master(system) as master:
        warnings.simplefilter("error")
        master.step()


def test_tens_of_thousands_of_variables_are_read_in_seconds(foreign):
    n = 30_000
    variables = "".join(
        f'<ScalarVariable name="sub[{i}].signal" valueReference="{1000 + i}" causality="local"><Real/>'
        f"</ScalarVariable>\n"
        for i in range(n)
    )
    path = foreign(SPARSE.replace("</ModelVariables>", f"{variables}</ModelVariables>"), "large")
    begin = time.perf_counter()
    fmu = FmuComponent(path, parameters={"T": T})
    assert time.perf_counter() - begin < 20.0
    np.testing.assert_allclose(response(fmu, "inputs[1]", "outputs[2]", unit="degC"), exact(), atol=1e-12)


def test_an_fmu_without_a_library_for_this_platform_says_so(foreign):
    with pytest.raises(InputError, match="a library for this platform"):
        FmuComponent(foreign(FLAT, place="binaries/win64/lag.dll"))


def test_an_fmu_whose_library_does_not_load_says_why(foreign):
    system = System({"plant": FmuComponent(foreign(FLAT, library=b"MZ" + bytes(4000)))}, step=0.1)
    with pytest.raises(RunError, match=r"plant .* its library cannot be loaded: .*lag.*invalid ELF header"):
        Master(system).start()


def test_an_fmu_that_needs_its_tool_says_which(foreign):
    needy = FLAT.replace('needsExecutionTool="false"', 'needsExecutionTool="true"')
    path = foreign(needy.replace('guid="lag"', 'guid="licence"'))
    with pytest.raises(RunError, match=r"wrong token licence.*needs its tool on this machine \(20-sim\)"):
        Master(System({"plant": FmuComponent(path)}, step=0.1)).start()


def test_the_other_interface_is_named_where_an_fmu_has_only_that(foreign):
    exchange = SPARSE.replace(
        '<CoSimulation modelIdentifier="lag"/>', '<ModelExchange modelIdentifier="lag"/>'
    )
    with pytest.raises(InputError, match=r"without co-simulation, .*; use ExchangeFmu"):
        FmuComponent(foreign(exchange))
    with pytest.raises(InputError, match=r"without Model Exchange, .*; use FmuComponent"):
        ExchangeFmu(foreign(SPARSE))


def test_an_fmu_may_be_named_by_a_text_and_lie_in_a_folder_with_blanks(foreign):
    path = foreign(SPARSE, "ein FMU mit Leerzeichen ß")
    assert " " in str(Path(path).parent.name)
    assert len(response(FmuComponent(str(path)), "inputs[1]", "outputs[1]", unit="degC")) == 11


def stripped(path, target):
    """Copy an FMU without anything in its description that may be left out, under other names."""
    gone = {"unit", "displayUnit", "quantity", "description", "generationTool", "generationDateAndTime"}
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(target, "w") as archive:
        for item in source.infolist():
            if item.filename.startswith("binaries/"):
                archive.writestr(item, source.read(item))
        root = ElementTree.fromstring(source.read("modelDescription.xml"))
        for optional in ("UnitDefinitions", "LogCategories", "DefaultExperiment", "VendorAnnotations"):
            for element in root.findall(optional):
                root.remove(element)
        structure = root.find("ModelStructure")
        for element in (*structure.findall("InitialUnknowns"), *structure.findall("InitialUnknown")):
            structure.remove(element)
        for element in root.iter():
            for name in gone & set(element.attrib):
                del element.attrib[name]
            for name in {"dependencies", "dependenciesKind"} & set(element.attrib):
                del element.attrib[name]
        for element in root.find("ModelVariables"):
            if element.get("variability") == "continuous":
                del element.attrib["variability"]
            if element.get("causality") == "local":
                del element.attrib["causality"]
            element.set("name", odd(element.get("name")))
        root.set("variableNamingConvention", "flat")
        archive.writestr("modelDescription.xml", ElementTree.tostring(root, encoding="utf-8"))
    return target


def odd(name):
    return f"Rad & Achse/{name} 'ü'"


@pytest.mark.parametrize("kind", [FmuComponent, ExchangeFmu])
@pytest.mark.parametrize("fmi", [2, 3])
def test_nothing_that_is_optional_is_needed(tmp_path, fmi, kind):
    """The wheelset with a bare description makes the same motion to the bit."""
    outputs = ["lateral_displacement", "yaw_rate", "left.creep_force_x"]
    values = {"lateral_displacement": 2e-3, "drive_mode": "free_rolling", "k_w": 1e6}
    runs = []
    for path, name in (
        (fmu_wheelset.path(fmi=fmi), str),
        (stripped(fmu_wheelset.path(fmi=fmi), tmp_path / "bare.fmu"), odd),
    ):
        fmu = kind(
            path, outputs=list(map(name, outputs)), parameters={name(key): v for key, v in values.items()}
        )
        recorder = Recorder()
        with Master(System({"w": fmu}, step=1e-3), observers=[recorder]) as master:
            master.run(0.05)
        runs.append(recorder)
    assert runs[1].names == tuple(f"w.{odd(name)}" for name in outputs)
    assert set(runs[1].units) == {"1"}
    np.testing.assert_array_equal(runs[0].table, runs[1].table)
    assert np.ptp(runs[0].table[:, 0]) > 1e-5


class _Stream(io.RawIOBase):
    """A file that cannot be rewound: archives written into it tell sizes behind their entries."""

    def __init__(self):
        self.data = bytearray()

    def writable(self):
        return True

    def write(self, data):
        self.data += data
        return len(data)


@pytest.mark.parametrize("manner", ["mark", "utf-16", "undeclared", "stream", "stub in front"])
def test_encodings_and_archives_in_the_manner_of_others(lag_fmu, tmp_path, manner):
    changes = {
        "mark": lambda data: b"\xef\xbb\xbf" + data,
        "utf-16": lambda data: data.decode().replace("UTF-8", "UTF-16").encode("utf-16"),
        "undeclared": lambda data: data.partition(b"?>")[2].strip(),
    }
    stream = _Stream()
    with zipfile.ZipFile(lag_fmu) as source, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            data = source.read(name)
            change = changes.get(manner, bytes)
            target.writestr(name, change(data) if name == "modelDescription.xml" else data)
        target.writestr("resources/", b"")
        target.writestr("resources/Kennfeld für Räder.txt", b"")
    stub = b"#!/bin/sh\n" if manner == "stub in front" else b""
    path = tmp_path / "a folder ü #%" / "mo del.fmu"
    path.parent.mkdir()
    path.write_bytes(stub + bytes(stream.data))
    with Master(System({"lag": FmuComponent(path)}, step=0.25)) as master:
        master.run(0.5)
        assert master.values[0] == pytest.approx(0.5 * (1.0 - np.exp(-0.5)))
