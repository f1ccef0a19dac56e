"""PathSim with the FMU blocks of pathsim-fmi."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from pathsim import Connection, Simulation
from pathsim.blocks import Scope
from pathsim.solvers import EUF
from pathsim_fmi import CoSimulationFMU

from masters.contender import Contender

if TYPE_CHECKING:
    from masters.cases import Case
    from masters.contender import Trajectory

__all__ = ["PathSim"]


class PathSim(Contender):
    """FMUs as blocks of a diagram that step at events, one after the other."""

    def run(self, n: int, *, record: bool) -> float:
        """Run the diagram, with a scope on all outputs if asked."""
        case = self.case
        blocks = {fmu.name: CoSimulationFMU(str(fmu.path), fmu.name, dt=case.step) for fmu in case.fmus}
        scope = Scope()
        ends = {name: blocks[block][variable] for name, block, variable in map(_split, _names(case))}
        connections = [Connection(ends[source], ends[target]) for source, target in case.connections]
        if record:
            connections += [Connection(ends[signal], scope[i]) for i, signal in enumerate(case.signals)]
        everything = [*blocks.values(), *([scope] if record else [])]
        simulation = Simulation(everything, connections, dt=case.step, log=False, Solver=EUF)
        begin = time.perf_counter()
        # The step that begins at t = 0 is its first event; half a step less makes sure of their number.
        simulation.run((n - 0.5) * case.step)
        seconds = time.perf_counter() - begin
        if record:
            self._values = np.array(scope.read()[1]).T[:n]
        return seconds

    def trajectory(self) -> Trajectory:
        """Return what the scope saw; its first row follows the step that begins at t = 0."""
        return self._values


def _names(case: Case) -> set[str]:
    return {*case.signals, *(end for connection in case.connections for end in connection)}


def _split(name: str) -> tuple[str, str, str]:
    block, _, variable = name.partition(".")
    return name, block, variable
