"""fmpy: a loop by hand over its functions, and its `simulate_ssp`."""

from __future__ import annotations

import time
import zipfile
from contextlib import ExitStack
from typing import TYPE_CHECKING

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from masters.contender import Contender
from masters.ssp import write_ssp

if TYPE_CHECKING:
    from pathlib import Path

    from masters.cases import Case, Fmu
    from masters.contender import Trajectory

__all__ = ["FmpyLoop", "FmpySsp", "opened"]


def opened(fmu: Fmu, folder: Path, stack: ExitStack) -> FMU2Slave:
    """Return an instance in step mode that is terminated and freed with `stack`."""
    slave = FMU2Slave(guid=fmu.guid, unzipDirectory=str(folder), modelIdentifier=fmu.identifier)
    slave.instantiate()
    stack.callback(slave.freeInstance)
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    stack.callback(slave.terminate)
    return slave


class FmpyLoop(Contender):
    """The loop that fmpy's examples write: setReal, doStep and getReal for each FMU."""

    def __init__(self, case: Case, folder: Path) -> None:
        super().__init__(case, folder)
        for fmu in case.fmus:
            fmpy.extract(fmu.path, folder / fmu.name)
        self._rows: list[list[float]] = []

    def run(self, n: int, *, record: bool) -> float:
        """Run the loop."""
        h, (first, second) = self.case.step, self.case.fmus
        inputs = [list(fmu.inputs.values()) for fmu in (first, second)]
        outputs = [list(fmu.outputs.values()) for fmu in (first, second)]
        sources = [_sources(self.case, fmu) for fmu in (first, second)]
        rows = []
        with ExitStack() as stack:
            a, b = (opened(fmu, self.folder / fmu.name, stack) for fmu in (first, second))
            row = [*a.getReal(outputs[0]), *b.getReal(outputs[1])]
            begin = time.perf_counter()
            for k in range(n):
                a.setReal(inputs[0], [row[i] for i in sources[0]])
                b.setReal(inputs[1], [row[i] for i in sources[1]])
                a.doStep(k * h, h)
                b.doStep(k * h, h)
                row = [*a.getReal(outputs[0]), *b.getReal(outputs[1])]
                if record:
                    rows.append(row)
            seconds = time.perf_counter() - begin
        self._rows = rows
        return seconds

    def trajectory(self) -> Trajectory:
        """Return the recorded rows."""
        return np.array(self._rows)


def _sources(case: Case, fmu: Fmu) -> list[int]:
    """Return the column that feeds each input."""
    feeding = {target: source for source, target in case.connections}
    return [case.signals.index(feeding[f"{fmu.name}.{name}"]) for name in fmu.inputs]


class FmpySsp(Contender):
    """`fmpy.ssp.simulation.simulate_ssp`; unpacking the FMUs is in its time, some milliseconds."""

    def __init__(self, case: Case, folder: Path) -> None:
        super().__init__(case, folder)
        self._ssp = write_ssp(case, folder / "system.ssp")
        zipfile.ZipFile(self._ssp).close()
        self._result = np.empty(0)

    def run(self, n: int, *, record: bool) -> float:
        """Run the package."""
        from fmpy.ssp.simulation import simulate_ssp

        # Its time is a sum of steps: half a step less makes sure of their number.
        begin = time.perf_counter()
        self._result = simulate_ssp(
            str(self._ssp), stop_time=(n - 0.5) * self.case.step, step_size=self.case.step
        )
        return time.perf_counter() - begin

    def trajectory(self) -> Trajectory:
        """Return its record: the row of a time has the values of the end of the step that begins there."""
        return np.column_stack([self._result[signal] for signal in self.case.signals])
