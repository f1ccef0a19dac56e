"""Where the time of `wheelset run` goes: each part of the default scenario, against simulated time.

    python benchmarks/run_cost.py

The parts are timed in one process after a warm-up, so compiling and importing do not count. "x real
time" is simulated time over wall time, for runs of 10 s at 1 kHz.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim.master import Master
from co_sim.observers import Recorder
from co_sim.wheelset.assembly import assemble
from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.output import write
from co_sim.wheelset.scenario_file import load_scenario

if TYPE_CHECKING:
    from collections.abc import Callable

REPEATS = 3


def best(action: Callable[[], object]) -> float:
    """Return the shortest of a few wall times, s."""
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Print one line for each part."""
    scenario, folder = load_scenario("default")
    laboratory = Laboratory(scenario, "default", folder)
    experiment = laboratory.run()
    case = laboratory.cases[0]

    def plant_and_sensors() -> None:
        with Master(assemble(scenario, case, None), observers=[Recorder()]) as master:
            master.run(case.duration)

    one_run = best(plant_and_sensors)
    whole = best(laboratory.run)
    with tempfile.TemporaryDirectory() as out:
        writing = best(lambda: write(experiment, Path(out)))
    simulated = laboratory.steps * scenario.simulation.step
    rows = [
        ("plant, track, sensors, recorder: one run", one_run, case.duration),
        ("experiment: three training runs, tuning, three runs with the identifier", whole, simulated),
        ("results.csv, summary.json, figures, report", writing, 0.0),
    ]
    for name, wall, covered in rows:
        multiple = f"{covered / wall:7.1f} x real time" if covered else ""
        print(f"{name:74} {wall:7.2f} s {multiple}")


if __name__ == "__main__":
    main()
