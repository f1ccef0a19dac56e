"""The two FMUs as one: containers of the FMU Manipulation Toolbox and of fmpy, run by fmpy.

A container steps its FMUs itself, in compiled code. Which steps it makes and what it exchanges between them
was decided when it was built; to a master it is one FMU.
"""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import fmpy
import numpy as np
from attrs import evolve
from fmpy.model_description import (
    CoSimulation,
    ModelDescription,
    ModelVariable,
    Unknown,
    read_model_description,
)

from masters.cases import read_fmu
from masters.contender import Contender
from masters.fmpy_masters import opened

if TYPE_CHECKING:
    from masters.cases import Case
    from masters.contender import Trajectory

__all__ = ["FmpyContainer", "ToolboxContainer", "ToolboxContainerAtOnce"]


class _Container(Contender):
    """A container, stepped by fmpy's doStep; recording it reads all outputs by getReal."""

    def __init__(self, case: Case, folder: Path) -> None:
        super().__init__(case, folder)
        self._fmu = read_fmu(self._build(), "container", [], [_exposed(signal) for signal in case.signals])
        fmpy.extract(self._fmu.path, folder / "unpacked")
        self._rows: list[list[float]] = []

    def _build(self) -> Path:
        """Return the archive of the container."""
        raise NotImplementedError

    def run(self, n: int, *, record: bool) -> float:
        """Step the container."""
        h, references = self.case.step, list(self._fmu.outputs.values())
        rows = []
        with ExitStack() as stack:
            container = opened(self._fmu, self.folder / "unpacked", stack)
            begin = time.perf_counter()
            for k in range(n):
                container.doStep(k * h, h)
                if record:
                    rows.append(container.getReal(references))
            seconds = time.perf_counter() - begin
        self._rows = rows
        return seconds

    def trajectory(self) -> Trajectory:
        """Return the recorded rows."""
        return np.array(self._rows)


class ToolboxContainer(_Container):
    """Of the FMU Manipulation Toolbox."""

    def _build(self) -> Path:
        from fmu_manipulation_toolbox.assembly import AssemblyNode

        logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.ERROR)
        case = self.case
        node = AssemblyNode("container.fmu", step_size=case.step, auto_input=False, auto_output=False)
        files = {fmu.name: str(fmu.path) for fmu in case.fmus}
        for file in files.values():
            node.add_fmu(file)
        for source, target in case.connections:
            (a, output), (b, put) = source.split(".", 1), target.split(".", 1)
            node.add_link(files[a], output, files[b], put)
        for signal in case.signals:
            name, output = signal.split(".", 1)
            node.add_output(files[name], output, _exposed(signal))
        node.make_fmu(self.folder)
        return self.folder / "container.fmu"


class ToolboxContainerAtOnce(ToolboxContainer):
    """The same, told to make all steps in one call: nothing in between can be recorded."""

    def run(self, n: int, *, record: bool) -> float:
        """Make one step of the container as long as the run."""
        with ExitStack() as stack:
            container = opened(self._fmu, self.folder / "unpacked", stack)
            begin = time.perf_counter()
            container.doStep(0.0, n * self.case.step)
            seconds = time.perf_counter() - begin
            self._rows = [container.getReal(list(self._fmu.outputs.values()))]
        return seconds


class FmpyContainer(_Container):
    """Of fmpy."""

    def _build(self) -> Path:
        from fmpy.container_fmu import Configuration
        from fmpy.container_fmu.cli import create_container_fmu
        from fmpy.container_fmu.config import Component, Connection

        case = self.case
        descriptions = {fmu.name: read_model_description(fmu.path) for fmu in case.fmus}
        components = {
            fmu.name: Component(fmu.name, Path(fmu.path), descriptions[fmu.name]) for fmu in case.fmus
        }
        # For the variables of connections fmpy 0.3.32 writes the name that their type has in FMI 2, which its
        # own library does not know.
        variables = {
            f"{name}.{v.name}": evolve(v, type="Float64")
            for name, description in descriptions.items()
            for v in description.modelVariables
        }
        outputs = [
            ModelVariable(name=_exposed(s), valueReference=i, type="Real", causality="output")
            for i, s in enumerate(case.signals)
        ]
        description = ModelDescription(
            fmiVersion="2.0",
            modelName="container",
            instantiationToken="container",
            coSimulation=CoSimulation(modelIdentifier="container_fmu", fixedInternalStepSize=case.step),
            # Its library counts the time as its first variable.
            modelVariables=[
                ModelVariable(name="time", valueReference=0, type="Real", causality="independent"),
                *outputs,
            ],
            outputs=[Unknown(variable=variable) for variable in outputs],
        )
        of = {signal: components[signal.partition(".")[0]] for signal in variables}
        connections = [
            Connection(of[source], [variables[source]], of[target], [variables[target]])
            for source, target in case.connections
        ]
        mappings = {
            output: [(of[signal], variables[signal])]
            for output, signal in zip(outputs, case.signals, strict=True)
        }
        configuration = Configuration(
            parallelDoStep=False,
            modelDescription=description,
            components=list(components.values()),
            connections=connections,
            variableMappings=mappings,
        )
        (self.folder / "build").mkdir()
        create_container_fmu(configuration, self.folder / "build", self.folder / "container.fmu")
        return self.folder / "container.fmu"


def _exposed(signal: str) -> str:
    """Return the name of a signal as an output of the container."""
    return signal.replace(".", "_")
