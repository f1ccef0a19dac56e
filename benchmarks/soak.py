"""Memory and handles over ten thousand runs in one process, and over one run of ten simulated hours.

    python benchmarks/soak.py [--runs 10000] [--hours 10]

The runs start the wheelset FMU anew each time, make ten steps, save and restore its state, and close it. The
long run couples the wheelset with a mass on a spring and records nothing.

Caches fill in the first half of the work, the second one is judged. A line is fitted to the memory over it.
Flat is what the line grows by less than the memory strays from it (twice the standard deviation), or less
than two arenas of Python's allocator, which come and go; files must not grow at all. The smallest leak that
would have been seen is printed with the verdict.
"""

from __future__ import annotations

import argparse
import gc
import sys
from dataclasses import dataclass, field
from pathlib import Path

import control
import numpy as np

from co_sim import Connection, FmuComponent, LinearComponent, Master, Port, System
from fmu_wheelset import path

#: Two arenas of Python's allocator, bytes.
ARENAS = 2 * 2.0**18
#: Readings in all, rows that are printed, and mappings that may come.
SAMPLES, ROWS, MAPPINGS = 200, 10, 8


@dataclass
class Readings:
    """Memory (bytes), open files and mapped pieces over the work."""

    memory: list[float] = field(default_factory=list)
    files: list[int] = field(default_factory=list)
    pieces: list[int] = field(default_factory=list)

    def take(self) -> None:
        """Read all three."""
        gc.collect()
        self.memory.append(resident())
        self.files.append(handles())
        self.pieces.append(mappings())

    def verdict(self, work: float, unit: str) -> bool:
        """Print what the second half of so much work says; return whether it was flat."""
        half = len(self.memory) // 2
        memory = np.array(self.memory[half:])
        part = np.linspace(0.0, 1.0, len(memory))
        slope, offset = np.polyfit(part, memory, 1)
        noise = max(2.0 * float(np.std(memory - slope * part - offset)), ARENAS)
        files, pieces = (readings[-1] - readings[half] for readings in (self.files, self.pieces))
        flat = slope < noise and files <= 0 and pieces <= MAPPINGS
        word = "less" if slope < noise else "MORE"
        print(
            f"second half: the line grows by {slope / 1e6:+.2f} MB, {word} than the {noise / 1e6:.2f} MB that"
            f" count ({noise / (0.5 * work):.3g} bytes a {unit}); {files:+d} files, {pieces:+d} mappings"
        )
        return flat


def resident() -> int:
    """Return the memory of this process in bytes."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096


def handles() -> int:
    """Return how many files this process has open."""
    return len(list(Path("/proc/self/fd").iterdir()))


def mappings() -> int:
    """Return how many pieces of memory are mapped: a library that is not unloaded shows here."""
    return len(Path("/proc/self/maps").read_text(encoding="utf-8").splitlines())


def wheelset(fmi: int) -> FmuComponent:
    """Return a wheelset that rolls freely, with a suspension."""
    return FmuComponent(
        path(fmi=2 if fmi == 2 else 3),
        inputs=["suspension_lateral_force"],
        outputs=["lateral_displacement", "lateral_velocity"],
        parameters={"drive_mode": "free_rolling", "k_w": 8.0e6},
    )


def coupled(fmi: int = 3) -> System:
    """Return a wheelset under a sprung mass."""
    A = [[0.0, 1.0], [-1000.0, -20.0]]
    frame = LinearComponent(
        control.ss(A, [[0.0], [1e-3]], [[-1e5, -1e3], [1.0, 0.0]], 0),
        [Port("F", "N", start=0.0)],
        [Port("F_w", "N"), Port("z", "m")],
        x0=[1e-4, 0.0],
    )
    parts = {"frame": frame, "wheelset": wheelset(fmi)}
    return System(parts, [Connection("frame.F_w", "wheelset.suspension_lateral_force")], step=1e-3)


def many_runs(count: int) -> bool:
    """Make short runs one after the other; return whether memory and handles stayed flat."""
    print(f"{'runs':>8}  {'memory MB':>9}  {'files':>5}  {'mappings':>8}")
    readings = Readings()
    for i in range(1, count + 1):
        with Master(coupled(2 + i % 2)) as master:
            master.run(n_steps=5)
            state = master.save()
            master.run(n_steps=5)
            master.restore(state)
        if i % max(count // SAMPLES, 1) == 0:
            readings.take()
        if i % max(count // ROWS, 1) == 0:
            print(f"{i:8d}  {resident() / 1e6:9.1f}  {handles():5d}  {mappings():8d}", flush=True)
    return readings.verdict(count, "run")


def long_run(hours: float) -> bool:
    """Make one long run; return whether memory stayed flat and time and values stayed sound."""
    print(f"{'hours':>8}  {'memory MB':>9}  {'files':>5}")
    readings = Readings()
    piece = round(hours * 3600.0 / SAMPLES)
    with Master(coupled()) as master:
        for i in range(1, SAMPLES + 1):
            master.run(float(piece))
            readings.take()
            if i % (SAMPLES // ROWS) == 0:
                print(f"{master.time / 3600.0:8.3g}  {resident() / 1e6:9.1f}  {handles():5d}", flush=True)
        exact = master.time == master.k * 1e-3 and np.isfinite(master.values).all()
    return readings.verdict(hours * 3600.0, "simulated second") and bool(exact)


def main() -> int:
    """Run both; return 0 if everything stayed flat."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--hours", type=float, default=10.0)
    options = parser.parse_args()
    flat = [many_runs(options.runs), long_run(options.hours)]
    print("flat" if all(flat) else "NOT FLAT")
    return 0 if all(flat) else 1


if __name__ == "__main__":
    sys.exit(main())
