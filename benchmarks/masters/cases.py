"""The coupled systems that every master runs: two FMUs each, built here."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import fmpy
from fmpy.model_description import read_model_description

import fmu_wheelset

__all__ = ["Case", "Fmu", "compile_library", "masses", "read_fmu", "vehicle"]

SOURCES = Path(__file__).parent / "sources"
#: Value references of ``mass.c``.
_REFERENCES = (
    "displacement",
    "velocity",
    "force",
    "neighbour_displacement",
    "neighbour_velocity",
    "pushed_by",
)
_UNITS = ("m", "m/s", "N", "m", "m/s", "N")
_UNIT_DEFINITIONS = (
    '<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit>'
    '<Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>'
    '<Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit></UnitDefinitions>'
)


@dataclass(frozen=True, slots=True)
class Fmu:
    """An FMU and what of it takes part: value references by name."""

    name: str
    path: Path
    guid: str
    identifier: str
    inputs: dict[str, int]
    outputs: dict[str, int]


@dataclass(frozen=True, slots=True)
class Case:
    """Two FMUs that feed each other.

    Parameters
    ----------
    connections : output and input, each as ``"fmu.variable"``. step : communication step, s.
    """

    title: str
    fmus: tuple[Fmu, Fmu]
    connections: tuple[tuple[str, str], ...]
    step: float = 1e-3

    @property
    def signals(self) -> list[str]:
        """Outputs in the order of the columns of every trajectory."""
        return [f"{fmu.name}.{output}" for fmu in self.fmus for output in fmu.outputs]


def masses(folder: Path, substeps: int) -> Case:
    """Build two masses joined by a spring, each with so many internal steps in a communication step.

    With one internal step the FMUs cost next to nothing, and what the master costs is all there is to see;
    more are what a simulation tool exports whose internal step is finer than the communication step.
    """
    left = _mass(folder, "left", ["pushed_by"], list(_MOTION), PUSH=0, STIFFNESS=50, SUBSTEPS=substeps)
    right = _mass(
        folder, "right", _MOTION_OF_NEIGHBOUR, ["force", "displacement"], STIFFNESS=30, SUBSTEPS=substeps
    )
    title = f"two masses, {substeps} internal step{'s' * (substeps > 1)}"
    return Case(title, (left, right), _connections("left", "pushed_by", "right", _MOTION))


def vehicle(folder: Path) -> Case:
    """Build a wheelset under the suspension of a bogie: the wheelset's own cost dominates."""
    archive = fmu_wheelset.export(
        folder / "wheelset.fmu", fmi=2, start_values={"drive_mode": "free_rolling", "speed": 20.0}
    )
    outputs = ["lateral_displacement", "lateral_velocity", "yaw_angle", "yaw_rate"]
    wheelset = read_fmu(archive, "wheelset", ["suspension_lateral_force"], outputs)
    bogie = _mass(
        folder,
        "bogie",
        _MOTION_OF_NEIGHBOUR,
        ["force", "displacement"],
        MASS=3000,
        STIFFNESS=2e5,
        DAMPING=2e4,
        COUPLING_STIFFNESS=1e5,
        COUPLING_DAMPING=1e4,
        PUSH=500,
    )
    motion = ("lateral_displacement", "lateral_velocity")
    return Case(
        "wheelset and bogie",
        (wheelset, bogie),
        _connections("wheelset", "suspension_lateral_force", "bogie", motion),
    )


_MOTION = ("displacement", "velocity")
_MOTION_OF_NEIGHBOUR = ["neighbour_displacement", "neighbour_velocity"]


def _connections(a: str, pushed: str, b: str, motion: tuple[str, str]) -> tuple[tuple[str, str], ...]:
    pairs = zip(motion, _MOTION_OF_NEIGHBOUR, strict=True)
    return ((f"{b}.force", f"{a}.{pushed}"), *((f"{a}.{y}", f"{b}.{u}") for y, u in pairs))


def _mass(folder: Path, name: str, inputs: list[str], outputs: list[str], **numbers: float) -> Fmu:
    """Build the FMU of a mass."""
    values = {"MASS": 1, "STIFFNESS": 0, "DAMPING": 0.5, "COUPLING_STIFFNESS": 20, "COUPLING_DAMPING": 0.5}
    values |= {"PUSH": 1, "SUBSTEPS": 1, "COUPLED": int("force" in outputs)} | numbers
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    defines = [f"-D{key}={value}" for key, value in values.items()]
    compile_library(SOURCES / "mass.c", library, [*defines, f'-DGUID="{name}"'])
    archive = folder / f"{name}.fmu"
    with zipfile.ZipFile(archive, "w") as opened:
        opened.writestr("modelDescription.xml", _description(name, inputs, outputs))
        opened.write(library, f"binaries/{fmpy.platform}/{library.name}")
    return read_fmu(archive, name, inputs, outputs)


def _description(name: str, inputs: list[str], outputs: list[str]) -> str:
    variables = [
        f'<ScalarVariable name="{variable}" valueReference="{i}" causality="{causality}" '
        f'variability="continuous"{initial}><Real unit="{_UNITS[i]}"{start}/></ScalarVariable>'
        for names, causality, initial, start in (
            (inputs, "input", "", ' start="0"'),
            (outputs, "output", ' initial="calculated"', ""),
        )
        for variable in names
        for i in [_REFERENCES.index(variable)]
    ]
    unknowns = "".join(
        # At a communication point the force depends on the neighbour's motion, nothing else on anything.
        f'<Unknown index="{i}" dependencies="{"1 2" if output == "force" else ""}"/>'
        for i, output in enumerate(outputs, len(inputs) + 1)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">'
        f'<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>'
        f"{_UNIT_DEFINITIONS}<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>\n"
    )


def read_fmu(archive: Path, name: str, inputs: list[str], outputs: list[str]) -> Fmu:
    """Return an FMU of which these inputs and outputs take part."""
    description = read_model_description(archive)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    return Fmu(
        name,
        archive,
        description.guid,
        description.coSimulation.modelIdentifier,
        {variable: references[variable] for variable in inputs},
        {variable: references[variable] for variable in outputs},
    )


def compile_library(source: Path, library: Path, defines: list[str]) -> None:
    """Compile one C file to a shared library with zig."""
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-shared", "-fPIC", "-O2", "-ffp-contract=off", "-fvisibility=hidden", f"-isystem{headers}"]
    command = [sys.executable, "-m", "ziglang", "cc", *flags, *defines, source, "-o", library]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{source.name} does not compile:\n{done.stderr}")
