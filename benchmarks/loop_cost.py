"""Where the time of the compiled loop goes: its pieces, and the instructions of a step.

    python benchmarks/loop_cost.py

Two FMUs that do next to nothing (`masters/sources/mass.c`) run in turns in the bare loop in C and in this
package's master, and the run in which the latter was fastest counts. Its pieces are timed where Python calls
them. Instructions are counted on Linux, one by one, which no other program disturbs: the difference between
20 steps and 10.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from signal import SIGUSR1, SIGUSR2, raise_signal
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from co_sim import Master
from co_sim.loops import CompiledLoop
from co_sim.observers import Recorder
from co_sim.watch import Watch
from masters.cases import SOURCES, masses
from masters.floor import BareLoop
from masters.ours import Compiled

if TYPE_CHECKING:
    from masters.cases import Case

STEPS = 50_000
PIECES = ((CompiledLoop, "advance"), (Watch, "see"), (Recorder, "observe"))


def pieces(case: Case, folder: Path, rounds: int, *, record: bool) -> dict[str, float]:
    """Return the times of the fastest run, ns a step: of the floor, of the whole, of the pieces."""
    floor, ours = BareLoop(case, _made(folder / "floor")), Compiled(case, folder)
    spent: dict[str, float] = {}
    originals = [(kind, name, getattr(kind, name)) for kind, name in PIECES]
    for kind, name, original in originals:
        setattr(kind, name, _timed(original, f"{kind.__name__}.{name}", spent))
    found = []
    for _ in range(rounds):
        in_c = floor.run(STEPS, record=record)
        spent.clear()
        found.append({"C": in_c, "whole": ours.run(STEPS, record=record), **spent})
    for kind, name, original in originals:
        setattr(kind, name, original)
    best = min(found, key=lambda run: run["whole"]) | {"C": min(run["C"] for run in found)}
    return {name: seconds / STEPS * 1e9 for name, seconds in best.items()}


def _timed(function: Any, name: str, spent: dict[str, float]) -> Any:
    def timed(*arguments: Any) -> Any:
        begin = time.perf_counter()
        result = function(*arguments)
        spent[name] = spent.get(name, 0.0) + time.perf_counter() - begin
        return result

    return timed


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


def instructions(folder: Path) -> tuple[float, float]:
    """Return the instructions of a step, in C and in the compiled loop, those of the FMUs included."""
    counter = folder / "count_instructions"
    source = SOURCES / "count_instructions.c"
    subprocess.run([sys.executable, "-m", "ziglang", "cc", "-O2", source, "-o", counter], check=True)
    command = [counter, sys.executable, __file__, "--steps-in", folder]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    in_c, ours = np.diff(np.array(done.stdout.split(), dtype=int).reshape(2, 2)).ravel() / 10
    return float(in_c), float(ours)


def make_steps(folder: Path) -> None:
    """Make 10 steps and 20 in each loop, between signals for the counter."""
    case = masses(_made(folder / "counted"), substeps=1)
    floor, ours = BareLoop(case, folder / "counted"), Compiled(case, folder)
    floor.run(10, record=False)
    library = floor.opened()
    for n in (10, 20):
        raise_signal(SIGUSR1)
        library.bare_run(n, case.step)
        raise_signal(SIGUSR2)
    with Master(ours.system) as master:
        master.run(n_steps=10)
        rows = np.zeros((30, len(master.signals)))
        loop: Any = master._loop
        for n in (10, 20):
            raise_signal(SIGUSR1)
            loop.advance(rows, 5, 0, n)
            raise_signal(SIGUSR2)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--steps-in", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.steps_in:
        make_steps(options.steps_in)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        case = masses(folder, substeps=1)
        runs = [pieces(case, folder, options.rounds, record=record) for record in (False, True)]
        table = Table(box=box.MARKDOWN)
        for heading in ("ns a step", "not recording", "recording"):
            table.add_column(heading, justify="left" if heading == "ns a step" else "right")
        rest = [2 * run["whole"] - sum(run.values()) + run["C"] for run in runs]
        for piece, what in (
            ("C", "the loop in C, with its FMUs"),
            ("CompiledLoop.advance", "the compiled loop, with its FMUs"),
            ("Watch.see", "the watch for signals that grow without end"),
            ("Recorder.observe", "the recorder, copying rows and times"),
        ):
            table.add_row(what, *(f"{run.get(piece, 0.0):.1f}" for run in runs))
        table.add_row("Python between blocks, and getting going", *(f"{ns:.1f}" for ns in rest))
        console = Console(width=120, highlight=False)
        console.print(table)
        if sys.platform == "linux":
            in_c, ours = instructions(folder)
            console.print(f"instructions of a step: {in_c:.0f} in C, {ours:.0f} here, with those of the FMUs")


if __name__ == "__main__":
    main()
