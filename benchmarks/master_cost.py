"""What a master adds to its FMUs: this package's and its peers against a loop written by hand in C.

    python -m pip install '.[benchmark]'
    python benchmarks/master_cost.py

All masters run the same FMUs with the same communication step for the same number of steps, in rounds one
after the other, each in a process of its own. A ratio is a time over that of the bare loop in the same round;
tables show the median of the rounds and, in brackets, the smallest and largest. Loading and initialising are
not timed where a master lets them be told apart. A peer that is not installed is told so.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from masters.cases import masses, vehicle
from masters.extras import first_run, python_component
from masters.workers import FailedError, Worker

if TYPE_CHECKING:
    from collections.abc import Callable

    from masters.cases import Case
    from masters.contender import Trajectory

CASES: tuple[Callable[[Path], Case], ...] = (
    lambda folder: masses(folder, substeps=1),
    lambda folder: masses(folder, substeps=20),
    vehicle,
)
#: Steps after which trajectories are compared.
CHECKED = 2000
#: A fast master is timed again and again for so long in each round, s.
TURN = 0.1


@dataclass
class Entry:
    """A master in the table.

    Parameters
    ----------
    place : its module and class. modes : without recording, recording. remark : what it does differently.
    """

    title: str
    place: str
    modes: tuple[bool, ...] = (False, True)
    remark: str = ""
    times: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    failure: str = ""
    deviation: float = float("nan")
    worker: Worker | None = None


def entries() -> list[Entry]:
    """Return all masters, the floor first."""
    return [
        Entry("bare C loop (the floor)", "masters.floor:BareLoop"),
        Entry("wheelset-cosim, compiled", "masters.ours:Compiled"),
        Entry("wheelset-cosim, Python path", "masters.ours:Interpreted"),
        Entry(
            "FMU Manipulation Toolbox container, one doStep for all steps",
            "masters.containers:ToolboxContainerAtOnce",
            modes=(False,),
            remark="nothing between start and end can be seen",
        ),
        Entry("FMU Manipulation Toolbox container, in fmpy", "masters.containers:ToolboxContainer"),
        Entry("fmpy container, in fmpy", "masters.containers:FmpyContainer"),
        Entry("ecospy", "masters.ecos:Ecos", remark="records to CSV with 6 decimals"),
        Entry("fmpy, loop by hand", "masters.fmpy_masters:FmpyLoop"),
        Entry("libcosimpy", "masters.cosim:Libcosim", remark="steps FMUs in threads"),
        Entry("fmpy, simulate_ssp", "masters.fmpy_masters:FmpySsp", modes=(True,), remark="always records"),
        Entry("pathsim-fmi", "masters.pathsim:PathSim", remark="FMUs one after the other: Gauss-Seidel"),
    ]


def run_case(case: Case, steps: int, rounds: int, console: Console) -> list[Entry]:
    """Time all masters on a case."""
    contenders = entries()
    try:
        reference = _open(contenders[0], case)
        for entry in contenders[1:]:
            _compare(entry, case, reference)
        for _ in track(range(rounds), case.title, console=console, transient=True):
            for entry in contenders:
                _time(entry, steps)
    finally:
        for entry in contenders:
            if entry.worker:
                entry.worker.close()
    return contenders


def _open(floor: Entry, case: Case) -> Trajectory:
    floor.worker = Worker(floor.place, case)
    floor.deviation = 0.0
    return floor.worker.trajectory(CHECKED, record=True)


def _compare(entry: Entry, case: Case, reference: Trajectory) -> None:
    """Start a master and compare what it computes, relative to the largest value of each signal."""
    entry.worker = Worker(entry.place, case)
    try:
        values = entry.worker.trajectory(CHECKED, record=True in entry.modes)
    except FailedError as error:
        entry.failure = str(error)
        return
    scale = np.abs(reference).max(axis=0)
    entry.deviation = float((np.abs(values - reference[-len(values) :]) / scale).max())


def _time(entry: Entry, steps: int) -> None:
    """Add a time of each mode."""
    for mode in entry.modes:
        turn: list[float] = []
        while not entry.failure and sum(turn) < TURN:
            assert entry.worker is not None
            try:
                turn.append(entry.worker.ask("run", steps, record=mode))
            except FailedError as error:
                entry.failure = str(error)
        if not entry.failure:
            entry.times[mode].append(statistics.median(turn))


def table(case: Case, contenders: list[Entry], steps: int) -> Table:
    """Return the table of a case."""
    result = Table(title=f"{case.title}: {steps} steps of {case.step * 1e3:g} ms", title_justify="left")
    result.add_column("master")
    for mode in ("not recording", "recording"):
        result.add_column(f"ns a step, {mode}", justify="right")
        result.add_column("ratio", justify="right")
    result.add_column("deviation", justify="right")
    floor = contenders[0]
    for entry in contenders:
        title = f"{entry.title} [dim]({entry.remark})[/]" if entry.remark else entry.title
        if entry.failure:
            result.add_row(title, f"[red]{entry.failure}[/]")
            continue
        cells = []
        for mode in (False, True):
            cells += _cells(entry.times[mode], floor.times[mode], steps)
        result.add_row(title, *cells, "same bits" if entry.deviation == 0.0 else f"{entry.deviation:.0e}")
    return result


def _cells(times: list[float], floor: list[float], steps: int) -> tuple[str, str]:
    if not times:
        return "not offered", ""
    ratios = [time / least for time, least in zip(times, floor, strict=True)]
    return (
        f"{statistics.median(times) / steps * 1e9:.0f}",
        f"{statistics.median(ratios):.2f} [dim]({min(ratios):.2f} .. {max(ratios):.2f})[/]",
    )


def start_table(processes: list[tuple[str, dict[str, float]]]) -> Table:
    """Return what a new process spends until its first steps are made."""
    result = Table(title="a new process, seconds", title_justify="left")
    result.add_column("machine code")
    for what in processes[0][1]:
        result.add_column(what, justify="right")
    for name, times in processes:
        result.add_row(name, *(f"{seconds:.2f}" for seconds in times.values()))
    return result


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    console = Console(width=200)
    with tempfile.TemporaryDirectory() as folder:
        for i, build in enumerate(CASES):
            place = Path(folder) / str(i)
            place.mkdir()
            case = build(place)
            console.print(table(case, run_case(case, options.steps, options.rounds, console), options.steps))
        costs = python_component(case, options.steps, options.rounds)
        console.print(
            f"a plain Python component adds {statistics.median(costs) * 1e6:.2f} us a step "
            f"[dim]({min(costs) * 1e6:.2f} .. {max(costs) * 1e6:.2f})[/]\n"
        )
        console.print(start_table(first_run(case)))


if __name__ == "__main__":
    main()
