"""Memory and handles over ten thousand runs in one process, and over one run of ten simulated hours.

    python benchmarks/soak.py [--runs 10000] [--hours 10]

The runs start the wheelset FMU anew each time, make ten steps, save and restore its state, and close it. The
long run couples the wheelset with a mass on a spring and records nothing. Growth is counted from a tenth of
the work on, when caches are filled; with fewer than some thousand runs they are not.
"""

from __future__ import annotations

import argparse
import gc
import sys
from pathlib import Path

import control
import numpy as np

from co_sim import Connection, FmuComponent, LinearComponent, Master, Port, System
from fmu_wheelset import path

#: Growth per run, and of all, that is called flat: pages of the allocator come and go.
BYTES_PER_RUN, BYTES = 200.0, 4e6
SETTLED = 0.1


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
    settled = (0, 0, 0)
    for i in range(1, count + 1):
        with Master(coupled(2 + i % 2)) as master:
            master.run(n_steps=5)
            state = master.save()
            master.run(n_steps=5)
            master.restore(state)
        if i == max(int(SETTLED * count), 1):
            gc.collect()
            settled = resident(), handles(), mappings()
        if i % max(count // 10, 1) == 0:
            print(f"{i:8d}  {resident() / 1e6:9.1f}  {handles():5d}  {mappings():8d}", flush=True)
    gc.collect()
    growth = resident() - settled[0]
    per_run = growth / max((1.0 - SETTLED) * count, 1.0)
    flat = per_run < BYTES_PER_RUN and handles() <= settled[1] and mappings() <= settled[2] + 8
    print(
        f"{per_run:.0f} bytes a run, {handles() - settled[1]:+d} files, {mappings() - settled[2]:+d} mappings"
    )
    return flat


def long_run(hours: float) -> bool:
    """Make one long run; return whether memory stayed flat and time and values stayed sound."""
    print(f"{'hours':>8}  {'memory MB':>9}  {'files':>5}")
    tenth = round(hours * 3600.0 / 10.0)
    with Master(coupled()) as master:
        settled = 0
        for _ in range(10):
            master.run(float(tenth))
            settled = settled or resident()
            print(f"{master.time / 3600.0:8.3g}  {resident() / 1e6:9.1f}  {handles():5d}", flush=True)
        exact = master.time == master.k * 1e-3 and np.isfinite(master.values).all()
        growth = resident() - settled
    print(f"{growth / 1e6:+.1f} MB from the first tenth on")
    return bool(exact) and growth < BYTES


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
