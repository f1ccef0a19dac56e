"""What a campaign costs: cases per second with dask against plain processes that do the same work.

    python benchmarks/campaign_cost.py [--cases 60] [--rounds 3] [--workers 1 2]

All ways compute the same cases of the study `condition` with the adhesion bank alone, and are warm: each
process has computed cases before the clock starts. Rounds alternate between the ways; a ratio is the median
over rounds of ratios within a round. The last lines follow the memory of the workers over the whole run.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from co_sim.campaign import Journal, run_campaign
from co_sim.campaign.cluster import connect
from co_sim.wheelset.studies.evaluation import evaluate
from co_sim.wheelset.studies.study import load_study

if TYPE_CHECKING:
    from distributed import Client

    from co_sim.campaign import Case

FUNCTION = partial(evaluate, banks=("adhesion",), window=1.0)


def with_dask(client: Client, cases: list[Case]) -> float:
    """Return the seconds that a campaign over the cases takes."""
    with tempfile.TemporaryDirectory() as folder, Journal(Path(folder), "benchmark") as journal:
        return run_campaign(FUNCTION, cases, journal, client).seconds


def with_processes(pool: Any, cases: list[Case]) -> float:
    """Return the seconds that a pool of processes takes for the cases."""
    begin = time.perf_counter()
    for _ in pool.imap_unordered(FUNCTION, cases):
        pass
    return time.perf_counter() - begin


def resident() -> float:
    """Return the memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def main() -> None:
    """Print cases per second, their ratios, and the memory of workers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args()
    study = load_study("condition")
    cases = list(study.cases())
    cases = [cases[i % len(cases)] for i in range(options.cases)]
    cases = [case.model_copy(update={"number": i}) for i, case in enumerate(cases)]
    rates: dict[str, list[float]] = {}
    memory: list[tuple[int, list[float]]] = []
    with ExitStack() as stack:
        ways: dict[str, Any] = {}
        for n in options.workers:
            client = stack.enter_context(connect(workers=n))
            pool = stack.enter_context(multiprocessing.get_context("spawn").Pool(n))
            ways[f"dask, {n} workers"] = partial(with_dask, client)
            ways[f"processes, {n}"] = partial(with_processes, pool)
        for way in ways.values():
            way(cases[: 4 * max(options.workers)])
        for round_ in range(options.rounds):
            for name, way in ways.items():
                rates.setdefault(name, []).append(len(cases) / way(cases))
            memory.append((round_ + 1, sorted(client.run(resident).values())))
    report(rates, options.workers, memory)


def report(rates: dict[str, list[float]], workers: list[int], memory: list[tuple[int, list[float]]]) -> None:
    """Print the tables."""
    print(f"{'way':18} {'cases a second':>15}")
    for name, found in rates.items():
        print(f"{name:18} {median(found):15.2f}")

    def ratio(above: str, below: str) -> float:
        return median(a / b for a, b in zip(rates[above], rates[below], strict=True))

    print()
    for n in workers:
        print(f"dask / processes, {n} workers: {ratio(f'dask, {n} workers', f'processes, {n}'):.3f}")
    for few, many in pairwise(workers):
        gain = ratio(f"dask, {many} workers", f"dask, {few} workers")
        print(f"dask, {many} workers / {few}: {gain:.2f}")
    print()
    for round_, found in memory:
        print(f"round {round_}: workers have {', '.join(f'{mb:.1f}' for mb in found)} MB")


if __name__ == "__main__":
    main()
