"""What a master adds to its FMUs: this package's and its peers against a loop written by hand in C.

    python -m pip install '.[benchmark]'
    python benchmarks/master_cost.py

All masters run the same FMUs with the same communication step for the same number of steps, each in a
process of its own. In every round each runs in turns with the bare loop, as often as fits into a fraction
of a second, and the fastest run of each of the two counts: the ratio is that of these two. Tables show the
fastest time of all rounds, and the median of their ratios with the smallest and the largest. Loading and
initialising are not timed where a master lets them be told apart. A peer that is not installed, fails or
crashes is told so.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
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
#: The floor and the compiled loop of this package, the first ones of all.
_N_OWN = 2


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
    times: dict[bool, list[tuple[float, float]]] = field(default_factory=lambda: {False: [], True: []})
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
            "fmutool container, one call for all steps",
            "masters.containers:ToolboxContainerAtOnce",
            modes=(False,),
            remark="FMU Manipulation Toolbox; nothing between start and end can be seen",
        ),
        Entry("fmutool container in fmpy", "masters.containers:ToolboxContainer"),
        Entry("fmpy container in fmpy", "masters.containers:FmpyContainer"),
        Entry("ecospy", "masters.ecos:Ecos", remark="records into a CSV file with 6 decimals"),
        Entry("fmpy, loop by hand", "masters.fmpy_masters:FmpyLoop"),
        Entry("libcosimpy", "masters.cosim:Libcosim", remark="steps FMUs in threads of its own"),
        Entry(
            "fmpy, simulate_ssp",
            "masters.fmpy_masters:FmpySsp",
            modes=(True,),
            remark="always records; its time includes unpacking the FMUs",
        ),
        Entry(
            "pathsim-fmi",
            "masters.pathsim:PathSim",
            remark="steps FMUs one after the other, so that the second sees the first one's new values",
        ),
    ]


def run_case(case: Case, contenders: list[Entry], options: argparse.Namespace, console: Console) -> None:
    """Time masters on a case, the floor first."""
    try:
        reference = _open(contenders[0], case)
        for entry in contenders[1:]:
            _compare(entry, case, reference)
        for _ in track(range(options.rounds), case.title, console=console, transient=True):
            for entry in contenders:
                _time(entry, contenders[0], options.steps, options.turn)
    finally:
        for entry in contenders:
            if entry.worker:
                entry.worker.close()


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


def _time(entry: Entry, floor: Entry, steps: int, turn: float) -> None:
    """Add a time of each mode, and one of the floor that ran in turns with it."""
    for mode in entry.modes:
        own: list[float] = []
        least: list[float] = []
        while not entry.failure and sum(own) < turn:
            assert entry.worker is not None
            assert floor.worker is not None
            least.append(floor.worker.ask("run", steps, record=mode))
            try:
                own.append(entry.worker.ask("run", steps, record=mode))
            except FailedError as error:
                entry.failure = str(error)
        if not entry.failure:
            entry.times[mode].append((min(own), min(least)))


def table(case: Case, contenders: list[Entry], steps: int) -> Table:
    """Return the table of a case."""
    result = _markdown(f"{case.title}: {steps} steps of {case.step * 1e3:g} ms")
    result.add_column("master", no_wrap=True)
    for heading in ("ns a step", "ratio", "ns, recording", "ratio, recording", "deviation"):
        result.add_column(heading, justify="right", no_wrap=True)
    for entry in contenders:
        if entry.failure:
            result.add_row(entry.title, "failed: see below")
            continue
        cells = [cell for mode in (False, True) for cell in _cells(entry.times[mode], steps)]
        result.add_row(entry.title, *cells, f"{entry.deviation:.0e}" if entry.deviation else "same bits")
    return result


def _markdown(title: str) -> Table:
    return Table(title=title, title_justify="left", title_style="bold", box=box.MARKDOWN)


def _cells(times: list[tuple[float, float]], steps: int) -> tuple[str, str]:
    if not times:
        return "not offered", ""
    ratios = [own / least for own, least in times]
    return (
        f"{min(own for own, _ in times) / steps * 1e9:.0f}",
        f"{statistics.median(ratios):.2f} ({min(ratios):.2f} .. {max(ratios):.2f})",
    )


def notes(contenders: list[Entry]) -> list[str]:
    """Return what is to be said of masters that failed, or do another thing."""
    return [
        f"{entry.title}: {entry.failure or entry.remark}"
        for entry in contenders
        if entry.failure or entry.remark
    ]


def start_table(processes: list[tuple[str, dict[str, float]]]) -> Table:
    """Return what a new process spends until its first steps are made."""
    result = _markdown("a new process, s")
    result.add_column("machine code")
    for what in processes[0][1]:
        result.add_column(what, justify="right")
    for name, times in processes:
        result.add_row(name, *(f"{seconds:.2f}" for seconds in times.values()))
    return result


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--turn",
        type=float,
        default=0.2,
        help="s in each round for which a fast master runs again and again; more on a shared machine",
    )
    parser.add_argument("--own", action="store_true", help="the floor and the compiled loop only")
    options = parser.parse_args()
    console = Console(width=150, highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        cases = [build(_made(Path(folder) / str(i))) for i, build in enumerate(CASES)]
        for case in cases:
            contenders = entries()[: _N_OWN if options.own else None]
            run_case(case, contenders, options, console)
            console.print(table(case, contenders, options.steps))
            console.print(*notes(contenders), "", sep="\n", soft_wrap=True)
        costs = python_component(cases[0], options.steps, options.rounds)
        low, high = min(costs) * 1e6, max(costs) * 1e6
        console.print(
            f"a plain Python component adds {statistics.median(costs) * 1e6:.2f} us a step "
            f"({low:.2f} .. {high:.2f})\n"
        )
        console.print(start_table(first_run(cases[0])))


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


if __name__ == "__main__":
    main()
