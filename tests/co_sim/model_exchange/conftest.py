"""Small FMUs for Model Exchange, built once a session for both versions of FMI."""

import inspect
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmpy import fmi2, fmi3

#: Variables by value reference: name, causality, variability, start, unit and the state of a derivative.
_VARIABLES = [
    ("x", "output", "continuous", None, "m", None),
    ("v", "output", "continuous", None, "m/s", None),
    ("der(x)", "local", "continuous", None, "m/s", 0),
    ("der(v)", "local", "continuous", None, "m/s2", 1),
    ("u", "input", "continuous", 0.0, "m/s2", None),
    ("d", "input", "discrete", 0.0, "1", None),
    ("total", "output", "continuous", None, "m", None),
    ("count", "output", "discrete", None, "1", None),
    ("sample", "output", "discrete", None, "1", None),
    ("settings", "output", "discrete", None, "1", None),
    ("p1", "parameter", "fixed", 0.0, "1", None),
    ("p2", "parameter", "fixed", 0.0, "1", None),
    ("p3", "parameter", "fixed", 0.0, "1", None),
    ("trouble", "parameter", "fixed", 1e300, "s", None),
    ("endless", "parameter", "fixed", 0.0, "1", None),
]
_N_STATES = {"oscillator": 2, "ball": 2, "counter": 0, "saw": 1, "relay": 1}
_N_INDICATORS = {"ball": 1, "relay": 1}
_OUTPUTS = {0: "", 1: "", 6: "0 4", 7: "", 8: "", 9: ""}
_UNITS = "".join(f'<Unit name="{unit}"/>' for unit in ("m", "m/s", "m/s2", "s", "1"))
#: The ports of other types of the counter, with the value references from 20 on.
_OTHER_TYPES_2 = """
    <ScalarVariable name="flag" valueReference="20" causality="input" variability="discrete">
      <Boolean start="false"/></ScalarVariable>
    <ScalarVariable name="level" valueReference="21" causality="output" variability="discrete">
      <Integer/></ScalarVariable>
    <ScalarVariable name="word" valueReference="22" causality="input" variability="discrete">
      <String start=""/></ScalarVariable>
    <ScalarVariable name="echo" valueReference="23" causality="output" variability="discrete">
      <String/></ScalarVariable>"""
_OTHER_TYPES_3 = """
    <Boolean name="flag" valueReference="20" causality="input" start="false"/>
    <Int32 name="level" valueReference="21" causality="output"/>
    <String name="word" valueReference="22" causality="input"><Start value=""/></String>
    <String name="echo" valueReference="23" causality="output"/>"""


def _attributes(**values) -> str:
    return " ".join(f'{name}="{value}"' for name, value in values.items() if value is not None)


def _description2(model: str, flags: str) -> str:
    variables = ""
    for reference, (name, causality, variability, start, unit, state) in enumerate(_VARIABLES):
        head = _attributes(name=name, valueReference=reference, causality=causality, variability=variability)
        real = _attributes(start=start, unit=unit, derivative=None if state is None else state + 1)
        variables += f"<ScalarVariable {head}><Real {real}/></ScalarVariable>"
    if model == "counter":
        variables += _OTHER_TYPES_2
    outputs = "".join(
        f'<Unknown index="{i + 1}" dependencies="{" ".join(str(int(k) + 1) for k in known.split())}"/>'
        for i, known in _OUTPUTS.items()
    )
    outputs += '<Unknown index="17"/><Unknown index="19"/>' if model == "counter" else ""
    derivatives = "".join(f'<Unknown index="{i + 3}"/>' for i in range(_N_STATES[model]))
    derivatives = f"<Derivatives>{derivatives}</Derivatives>" if derivatives else ""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{model}" guid="{model}"
    numberOfEventIndicators="{_N_INDICATORS.get(model, 0)}">
  <ModelExchange modelIdentifier="models" {flags}/>
  <UnitDefinitions>{_UNITS}</UnitDefinitions>
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure><Outputs>{outputs}</Outputs>{derivatives}</ModelStructure>
</fmiModelDescription>"""


def _description3(model: str, flags: str) -> str:
    variables = '<Float64 name="time" valueReference="99" causality="independent"/>'
    for reference, (name, causality, variability, start, unit, state) in enumerate(_VARIABLES):
        head = _attributes(name=name, valueReference=reference, causality=causality, variability=variability)
        variables += f"<Float64 {head} {_attributes(start=start, unit=unit, derivative=state)}/>"
    if model == "counter":
        variables += _OTHER_TYPES_3
    if model in _N_INDICATORS:
        variables += '<Float64 name="z" valueReference="50" causality="local"/>'
    structure = "".join(f'<Output valueReference="{i}" dependencies="{k}"/>' for i, k in _OUTPUTS.items())
    if model == "counter":
        structure += '<Output valueReference="21"/><Output valueReference="23"/>'
    structure += "".join(
        f'<ContinuousStateDerivative valueReference="{i + 2}"/>' for i in range(_N_STATES[model])
    )
    if model in _N_INDICATORS:
        structure += '<EventIndicator valueReference="50"/>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{model}" instantiationToken="{model}">
  <ModelExchange modelIdentifier="models" {flags}/>
  <UnitDefinitions>{_UNITS}</UnitDefinitions>
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure>{structure}</ModelStructure>
</fmiModelDescription>"""


def _stubs(source: str) -> str:
    """Return a stub for each FMI function that the source does not define."""
    defined = set(re.findall(r"\bfmi[23]\w+(?=\()", source))
    defined |= {f"fmi{v}{name}" for name in re.findall(r"\bBOTH\((\w+)", source) for v in (2, 3)}
    names = {
        name
        for cls, prefix in ((fmi2.FMU2Model, "fmi2"), (fmi3.FMU3Model, "fmi3"))
        for name, _ in inspect.getmembers(cls)
        if name.startswith(prefix)
    }
    return "".join(f"STUB({name})\n" for name in sorted(names - defined))


def _build_library(folder: Path) -> Path:
    source = Path(__file__).with_name("models.c")
    stubs = folder / "stubs.h"
    stubs.write_text(_stubs(source.read_text(encoding="utf-8")), encoding="utf-8")
    library = folder / f"models{fmpy.sharedLibraryExtension}"
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-shared", "-fPIC", "-O1", "-fvisibility=hidden", "-Wall", "-Wextra", f"-isystem{headers}"]
    flags.append(f'-DSTUBS="{stubs.as_posix()}"')
    command = [sys.executable, "-m", "ziglang", "cc", *flags, source, "-o", library]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return library


@pytest.fixture(scope="session")
def build(tmp_path_factory):
    """Return the function that packs a model for a version of FMI, with or without saved states."""
    folder = tmp_path_factory.mktemp("models")
    library = _build_library(folder)

    def pack(model: str, version: int, *, saves: bool = True) -> Path:
        path = folder / f"{model}{version}{'' if saves else '_plain'}.fmu"
        letter, describe = {2: ("s", _description2), 3: ("S", _description3)}[version]
        platform = fmpy.platform if version == 2 else fmpy.platform_tuple
        flags = (
            {f"canGetAndSetFMU{letter}tate": "true", f"canSerializeFMU{letter}tate": "true"} if saves else {}
        )
        if version == 3:
            flags["needsCompletedIntegratorStep"] = "true"
        if not path.exists():
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("modelDescription.xml", describe(model, _attributes(**flags)))
                archive.write(library, f"binaries/{platform}/{library.name}")
        return path

    return pack


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def fmu(request, build):
    """Return the function that packs a model for one version of FMI."""
    return lambda model, **options: build(model, request.param, **options)
