"""The master of this package."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar

from co_sim import Connection, FmuComponent, Master, Recorder, System
from masters.contender import Contender

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim import Component
    from masters.cases import Case
    from masters.contender import Trajectory

__all__ = ["Compiled", "Interpreted"]


class Compiled(Contender):
    """The loop without the interpreter."""

    compiled: ClassVar[bool] = True

    def __init__(self, case: Case, folder: Path) -> None:
        super().__init__(case, folder)
        components: dict[str, Component] = {
            fmu.name: FmuComponent(fmu.path, inputs=list(fmu.inputs), outputs=list(fmu.outputs))
            for fmu in case.fmus
        }
        connections = [Connection(source, target) for source, target in case.connections]
        self.system = System(components, connections, step=case.step)
        self._recorder = Recorder()

    def run(self, n: int, *, record: bool) -> float:
        """Run, with a recorder if asked."""
        observers = [self._recorder] if record else []
        with Master(self.system, observers=observers, compiled=self.compiled) as master:
            master.start()
            begin = time.perf_counter()
            master.run(n_steps=n)
            return time.perf_counter() - begin

    def trajectory(self) -> Trajectory:
        """Return the record after its first row."""
        return self._recorder.table[1:]


class Interpreted(Compiled):
    """The same loop in Python."""

    compiled = False
