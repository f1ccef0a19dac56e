"""What else a run costs: a plain Python component, and the compiler the first time."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim import Component, Connection, Master, Port, System
from masters.ours import Compiled

if TYPE_CHECKING:
    from co_sim.component import Vector
    from masters.cases import Case

__all__ = ["first_run", "python_component"]

_FIRST_RUN = Path(__file__).with_name("first_run.py")


class Damper(Component):
    """A plain Python component: one input, one output, one line."""

    def __init__(self) -> None:
        super().__init__([Port("velocity", "m/s")], [Port("force", "N")])

    def exchange(self, u: Vector, y: Vector) -> None:
        """Compute the force at the start."""
        y[0] = -3.0 * u[0]

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Compute the force."""
        y[0] = -3.0 * u[0]


def python_component(case: Case, steps: int, rounds: int) -> list[float]:
    """Return what a Python component adds to a step of `case`, s, in each round."""
    bare = Compiled(case, Path()).system
    velocity = next(signal for signal in case.signals if signal.endswith("velocity"))
    damped = System(
        {**bare.components, "damper": Damper()},
        [*bare.connections, Connection(velocity, "damper.velocity")],
        step=bare.step,
    )
    return [(_time(damped, steps) - _time(bare, steps)) / steps for _ in range(rounds)]


def _time(system: System, steps: int) -> float:
    with Master(system) as master:
        master.start()
        begin = time.perf_counter()
        master.run(n_steps=steps)
        return time.perf_counter() - begin


def first_run(case: Case, repeats: int = 3) -> list[tuple[str, dict[str, float]]]:
    """Time a short run in new processes: with nothing compiled yet, then with what the first left on disk.

    Returns
    -------
    for each of the two, what took how long, s; for the second the median of `repeats` processes.
    """
    with tempfile.TemporaryDirectory() as cache:
        compiling = _in_new_process(case, cache)
        loading = [_in_new_process(case, cache) for _ in range(repeats)]
    medians = {what: statistics.median(each[what] for each in loading) for what in compiling}
    return [("nothing compiled yet", compiling), ("compiled before", medians)]


def _in_new_process(case: Case, cache: str) -> dict[str, float]:
    command = [sys.executable, str(_FIRST_RUN), *(str(fmu.path) for fmu in case.fmus)]
    for fmu in case.fmus:
        command += [",".join(fmu.inputs), ",".join(fmu.outputs)]
    command += [",".join(connection) for connection in case.connections]
    folders = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    times: dict[str, float] = json.loads(done.stdout)
    return times
