"""Small FMUs, built once a session for both versions of FMI, and a compiled loop over one component."""

import inspect
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numba
import numpy as np
import pytest
from fmpy import fmi2, fmi3

from co_sim.native import STEP, caller

_UNITS = '<UnitDefinitions><Unit name="s"><BaseUnit s="1"/></Unit><Unit name="V"/></UnitDefinitions>'
_STATUSES = [("ok", 0), ("warning", 1), ("discard", 2), ("error", 3), ("fatal", 4), ("terminate", 5)]
_ITEMS = "".join(f'<Item name="{name}" value="{value}"/>' for name, value in _STATUSES)

_DESCRIPTION_2 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="lag" guid="lag">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/>
  {_UNITS}
  <TypeDefinitions>
    <SimpleType name="Trouble"><Enumeration>{_ITEMS}</Enumeration></SimpleType>
    <SimpleType name="Voltage"><Real unit="V"/></SimpleType>
  </TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" causality="output" description="lagged voltage">
      <Real declaredType="Voltage"/></ScalarVariable>
    <ScalarVariable name="direct" valueReference="1" causality="output"><Real unit="V"/></ScalarVariable>
    <ScalarVariable name="u" valueReference="2" causality="input">
      <Real unit="V" start="0.5"/></ScalarVariable>
    <ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed">
      <Real unit="s" start="1" min="0.001" max="100"/></ScalarVariable>
    <ScalarVariable name="x0" valueReference="4" causality="parameter" variability="fixed">
      <Real unit="V" start="0"/></ScalarVariable>
    <ScalarVariable name="trouble_step" valueReference="5" causality="parameter" variability="fixed">
      <Integer start="-1" min="-1"/></ScalarVariable>
    <ScalarVariable name="trouble" valueReference="6" causality="parameter" variability="fixed">
      <Enumeration declaredType="Trouble" start="0"/></ScalarVariable>
    <ScalarVariable name="negative" valueReference="7" causality="parameter" variability="fixed">
      <Boolean start="false"/></ScalarVariable>
    <ScalarVariable name="label" valueReference="8" causality="parameter" variability="fixed">
      <String start=""/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="1"/><Unknown index="2"/></Outputs></ModelStructure>
</fmiModelDescription>
"""

_DESCRIPTION_3 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="lag" instantiationToken="lag">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/>
  {_UNITS}
  <TypeDefinitions>
    <Float64Type name="Voltage" unit="V"/>
    <EnumerationType name="Trouble">{_ITEMS}</EnumerationType>
  </TypeDefinitions>
  <ModelVariables>
    <Float64 name="time" valueReference="99" causality="independent"/>
    <Float64 name="x" valueReference="0" causality="output" declaredType="Voltage"
      description="lagged voltage"/>
    <Float64 name="direct" valueReference="1" causality="output" unit="V"/>
    <Float64 name="u" valueReference="2" causality="input" unit="V" start="0.5"/>
    <Float64 name="T" valueReference="3" causality="parameter" variability="fixed" unit="s" start="1"
      min="0.001" max="100"/>
    <Float64 name="x0" valueReference="4" causality="parameter" variability="fixed" unit="V" start="0"/>
    <Int32 name="trouble_step" valueReference="5" causality="parameter" variability="fixed" start="-1"
      min="-1"/>
    <Enumeration name="trouble" valueReference="6" causality="parameter" variability="fixed"
      declaredType="Trouble" start="0"/>
    <Boolean name="negative" valueReference="7" causality="parameter" variability="fixed" start="false"/>
    <String name="label" valueReference="8" causality="parameter" variability="fixed">
      <Start value=""/></String>
  </ModelVariables>
  <ModelStructure><Output valueReference="0"/><Output valueReference="1"/></ModelStructure>
</fmiModelDescription>
"""


def _stubs(source: str) -> str:
    """Return a stub for each FMI function that the source does not mention."""
    names = [
        name
        for cls, prefix in ((fmi2.FMU2Slave, "fmi2"), (fmi3.FMU3Slave, "fmi3"))
        for name, _ in inspect.getmembers(cls)
        if name.startswith(prefix)
    ]
    mentioned = set(re.findall(r"\bfmi[23]\w+", source))
    return "".join(f"STUB({name})\n" for name in names if name not in mentioned)


def _build_library(name: str, folder: Path) -> Path:
    source = Path(__file__).with_name(f"{name}.c")
    stubs = folder / "stubs.h"
    stubs.write_text(_stubs(source.read_text(encoding="utf-8")), encoding="utf-8")
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-shared", "-fPIC", "-O1", "-fvisibility=hidden", "-Wall", "-Wextra", f"-isystem{headers}"]
    flags.append(f'-DSTUBS="{stubs.as_posix()}"')
    command = [sys.executable, "-m", "ziglang", "cc", *flags, source, "-o", library]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return library


def _archives(name: str, descriptions: dict[int, str], folder: Path) -> dict[int, Path]:
    library = _build_library(name, folder)
    archives = {}
    for version, description in descriptions.items():
        platform = {2: fmpy.platform, 3: fmpy.platform_tuple}[version]
        archives[version] = folder / f"{name}{version}.fmu"
        with zipfile.ZipFile(archives[version], "w") as archive:
            archive.writestr("modelDescription.xml", description)
            archive.write(library, f"binaries/{platform}/{library.name}")
    return archives


@pytest.fixture(scope="session")
def lag_fmus(tmp_path_factory) -> dict[int, Path]:
    """The archives of the lag by major version of FMI."""
    return _archives("lag", {2: _DESCRIPTION_2, 3: _DESCRIPTION_3}, tmp_path_factory.mktemp("lag"))


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def lag_fmu(request, lag_fmus) -> Path:
    return lag_fmus[request.param]


@pytest.fixture(scope="session")
def parrots(tmp_path_factory) -> dict[int, Path]:
    """The archives of the FMU with ports of every type."""
    folder = Path(__file__).parent
    descriptions = {i: (folder / f"parrot{i}.xml").read_text(encoding="utf-8") for i in (2, 3)}
    return _archives("parrot", descriptions, tmp_path_factory.mktemp("parrot"))


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def parrot(request, parrots) -> Path:
    return parrots[request.param]


@pytest.fixture(scope="session")
def faulty_fmus(tmp_path_factory) -> dict[int, Path]:
    """The archives of the FMU that misbehaves as its instance name says."""
    folder = Path(__file__).parent
    descriptions = {i: (folder / f"faulty{i}.xml").read_text(encoding="utf-8") for i in (2, 3)}
    return _archives("faulty", descriptions, tmp_path_factory.mktemp("faulty"))


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def faulty_fmu(request, faulty_fmus) -> Path:
    return faulty_fmus[request.param]


_call = caller(STEP)


@numba.njit(nogil=True)
def _loop(address, data, t0, h, u, rows):
    for k in range(u.shape[0]):
        status = _call(address, (t0 + k * h, h, u[k].ctypes.data, rows[k].ctypes.data, data))
        if status != 0:
            return status
    return 0


def _outputs(component, n):
    return np.full((n, sum(port.size for port in component.outputs)), np.nan)


@pytest.fixture(scope="session")
def run_native():
    """Step a started component through the rows of `u` in machine code; its outputs, row by row."""

    def run(component, u, t0=0.0, h=0.1):
        rows = _outputs(component, len(u))
        status = _loop(*component.native()[:2], t0, h, np.ascontiguousarray(u, dtype=np.float64), rows)
        if status:
            raise component.failure(status)
        return rows

    return run


@pytest.fixture(scope="session")
def run_python():
    """Do the same step by step in the interpreter."""

    def run(component, u, t0=0.0, h=0.1):
        rows = _outputs(component, len(u))
        for k, row in enumerate(np.array(u, dtype=np.float64)):
            component.step(t0 + k * h, h, row, rows[k])
        return rows

    return run
