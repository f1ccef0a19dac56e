"""What supervision costs `wheelset run`: the packaged default with and without it.

    python benchmarks/supervised_experiment.py

Six co-simulations each (three that tune a filter, three that are watched), and the results compared.
"""

from __future__ import annotations

import time
from statistics import median

from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.scenario_file import load_scenario

REPEATS = 3


def main() -> None:
    """Print both times, and what the server needs to start, once for each process."""
    scenario, folder = load_scenario("default")
    begin = time.perf_counter()
    Laboratory(scenario, "default", folder).run()
    print(f"first run of a process, with the start of the server: {time.perf_counter() - begin:.1f} s")
    times: dict[bool, list[float]] = {True: [], False: []}
    tables = {}
    for _ in range(REPEATS):
        for in_process, measured in times.items():
            laboratory = Laboratory(scenario, "default", folder, in_process=in_process)
            begin = time.perf_counter()
            experiment = laboratory.run()
            measured.append(time.perf_counter() - begin)
            tables[in_process] = [run.table.tobytes() for run in experiment.runs]
    alone, watched = median(times[True]), median(times[False])
    print(f"in process {alone:.2f} s, supervised {watched:.2f} s, ratio {watched / alone:.2f}")
    n = len(laboratory.cases) + len(laboratory.points)
    print(f"that is {1e3 * (watched - alone) / n:.0f} ms for each of {n} co-simulations")
    print(f"results {'identical to the bit' if tables[True] == tables[False] else 'DIFFERENT'}")


if __name__ == "__main__":
    main()
