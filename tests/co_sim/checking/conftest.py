"""Descriptions without a fault to start from, and archives of them."""

import platform
import zipfile

import fmpy
import lief
import pytest

DESCRIPTION_2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="lag" guid="lag" variableNamingConvention="structured">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions>
    <Unit name="s"/>
    <Unit name="V"><DisplayUnit name="mV" factor="1000"/></Unit>
    <Unit name="V/s"/>
  </UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="Trouble">
      <Enumeration><Item name="none" value="0"/><Item name="some" value="3"/></Enumeration>
    </SimpleType>
    <SimpleType name="Voltage"><Real unit="V" displayUnit="mV" min="-100" max="100"/></SimpleType>
  </TypeDefinitions>
  <DefaultExperiment startTime="1" stopTime="2" stepSize="0.02"/>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" causality="output">
      <Real declaredType="Voltage"/></ScalarVariable>
    <ScalarVariable name="direct" valueReference="1" causality="output"><Real unit="V"/></ScalarVariable>
    <ScalarVariable name="u" valueReference="2" causality="input">
      <Real unit="V" start="0.5"/></ScalarVariable>
    <ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed">
      <Real unit="s" start="1" min="0.001" max="100"/></ScalarVariable>
    <ScalarVariable name="steps" valueReference="5" causality="parameter" variability="fixed">
      <Integer start="-1" min="-1"/></ScalarVariable>
    <ScalarVariable name="trouble" valueReference="6" causality="parameter" variability="fixed">
      <Enumeration declaredType="Trouble" start="0"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="9"><Real unit="V/s" derivative="1"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs>
      <Unknown index="1" dependencies=""/>
      <Unknown index="2" dependencies="3" dependenciesKind="constant"/>
    </Outputs>
    <Derivatives><Unknown index="7" dependencies="1 3"/></Derivatives>
    <InitialUnknowns><Unknown index="1"/><Unknown index="2"/><Unknown index="7"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""

DESCRIPTION_3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="lag" instantiationToken="lag"
    variableNamingConvention="structured">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions>
    <Unit name="s"/>
    <Unit name="V"><DisplayUnit name="mV" factor="1000"/></Unit>
    <Unit name="V/s"/>
  </UnitDefinitions>
  <TypeDefinitions>
    <Float64Type name="Voltage" unit="V" displayUnit="mV" min="-100" max="100"/>
    <EnumerationType name="Trouble"><Item name="none" value="0"/>
      <Item name="some" value="3"/></EnumerationType>
  </TypeDefinitions>
  <DefaultExperiment startTime="1" stopTime="2" stepSize="0.02"/>
  <ModelVariables>
    <Float64 name="time" valueReference="99" causality="independent"/>
    <Float64 name="x" valueReference="0" causality="output" declaredType="Voltage"/>
    <Float64 name="direct" valueReference="1" causality="output" unit="V"/>
    <Float64 name="u" valueReference="2" causality="input" unit="V" start="0.5"/>
    <Float64 name="T" valueReference="3" causality="parameter" variability="fixed" unit="s" start="1"
      min="0.001" max="100"/>
    <Int32 name="steps" valueReference="5" causality="parameter" variability="fixed" start="-1" min="-1"/>
    <Enumeration name="trouble" valueReference="6" causality="parameter" variability="fixed"
      declaredType="Trouble" start="0"/>
    <UInt64 name="n" valueReference="20" causality="structuralParameter" variability="fixed" start="2"/>
    <Float64 name="v" valueReference="21" causality="parameter" variability="fixed" start="1 2">
      <Dimension valueReference="20"/></Float64>
    <Float64 name="der(x)" valueReference="9" unit="V/s" derivative="0"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="0" dependencies=""/>
    <Output valueReference="1" dependencies="2" dependenciesKind="constant"/>
    <ContinuousStateDerivative valueReference="9" dependencies="0 2"/>
    <InitialUnknown valueReference="0"/><InitialUnknown valueReference="1"/>
    <InitialUnknown valueReference="9"/>
  </ModelStructure>
</fmiModelDescription>
"""


@pytest.fixture
def packed(lag_fmus, tmp_path):
    """Pack a description with the library of the lag, after replacements in it that each must change it."""

    def pack(version, *changes, library=None, name="lag", folder=None, extra=()):
        text = {2: DESCRIPTION_2, 3: DESCRIPTION_3}[version]
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        own = {2: fmpy.platform, 3: fmpy.platform_tuple}[version]
        if library is None:
            library = library_of(lag_fmus[version])
        path = tmp_path / "a.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", text)
            archive.writestr(f"binaries/{folder or own}/{name}{fmpy.sharedLibraryExtension}", library)
            for entry, content in extra:
                archive.writestr(entry, content)
        return path

    return pack


def library_of(path):
    with zipfile.ZipFile(path) as archive:
        return archive.read(next(name for name in archive.namelist() if name.startswith("binaries/")))


@pytest.fixture(scope="session")
def patched(lag_fmus):
    """The library of the lag with other machine code in one of its functions."""

    def patch(function, code):
        if platform.machine() != "x86_64":
            pytest.skip("the code is for x86_64")
        data = bytearray(library_of(lag_fmus[2]))
        binary = lief.parse(bytes(data))
        address = binary.get_function_address(function)
        start = binary.virtual_address_to_offset(address)
        data[start : start + len(code)] = code
        return bytes(data)

    return patch


@pytest.fixture(scope="session")
def renamed(lag_fmus):
    """The library of the lag that calls a function otherwise."""

    def rename(function, other):
        data = library_of(lag_fmus[2])
        assert function.encode() in data
        assert len(function) == len(other)
        return data.replace(function.encode(), other.encode())

    return rename
