"""What supervision costs: per step, and for starting a run.

    python benchmarks/supervision_cost.py

Each case is run in this process (`Master`) and in a process of its own (`Supervised`), in turn, so that both
see the same weather; a recorder keeps all signals. Steps and starts are timed on their own: a run of one
step, then the long one. The first supervised run starts the server, which imports numba and the rest once.
"""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING

from co_sim import CompiledComponent, Connection, FmuComponent, Master, Port, Recorder, System
from co_sim.compiled_component import compiled
from co_sim.supervisor import Supervised
from fmu_wheelset import path

if TYPE_CHECKING:
    from collections.abc import Callable

ROUNDS = 9


@compiled
def lag(t, h, u, y, x, p):
    """Follow the input; next to no arithmetic, so that the master is what costs."""
    x[0] += h * (u[0] - x[0])
    y[0] = x[0]
    return 0


def chain(n: int) -> System:
    """Return `n` lags in a ring."""
    parts = {
        f"lag{i}": CompiledComponent(
            lag, inputs=[Port("u")], outputs=[Port("y", start=1.0)], state=[float(i)], feedthrough={}
        )
        for i in range(n)
    }
    wires = [Connection(f"lag{i}.y", f"lag{(i + 1) % n}.u") for i in range(n)]
    return System(parts, wires, step=1e-3)


def wheelset() -> System:
    """Return the wheelset FMU alone."""
    return System({"wheelset": FmuComponent(path())}, step=1e-3)


def timed(make: Callable[..., Master | Supervised], system: System, n_steps: int) -> tuple[float, float]:
    """Return the times of starting (with one step) and of so many steps, s."""
    recorder = Recorder()
    begin = time.perf_counter()
    with make(system, observers=[recorder]) as run:
        run.run(n_steps=1)
        started = time.perf_counter()
        run.run(n_steps=n_steps)
        return started - begin, time.perf_counter() - started


def main() -> None:
    """Print a line for each case."""
    begin = time.perf_counter()
    timed(Supervised, chain(1), 1)
    print(f"first run of a process, with its server: {time.perf_counter() - begin:.2f} s")
    print(f"{'case':24} {'in process':>12} {'supervised':>12} {'ratio':>7} {'start':>9} {'supervised':>11}")
    cases = [
        ("1 lag", chain(1), 1_000_000),
        ("20 lags", chain(20), 200_000),
        ("wheelset FMU", wheelset(), 50_000),
    ]
    for name, system, n_steps in cases:
        timed(Master, system, n_steps)
        pairs = [(timed(Master, system, n_steps), timed(Supervised, system, n_steps)) for _ in range(ROUNDS)]
        start, supervised_start = (median(pair[i][0] for pair in pairs) for i in (0, 1))
        step, supervised_step = (1e9 / n_steps * median(pair[i][1] for pair in pairs) for i in (0, 1))
        ratio = median(pair[1][1] / pair[0][1] for pair in pairs)
        print(
            f"{name:24} {step:9.1f} ns {supervised_step:9.1f} ns {ratio:7.3f} "
            f"{1e3 * start:6.1f} ms {1e3 * supervised_start:8.1f} ms"
        )


if __name__ == "__main__":
    main()
