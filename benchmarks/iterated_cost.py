"""What iterated coupling costs: its compiled loop against the same loop in the interpreter.

    python benchmarks/iterated_cost.py

Systems of two or three parts that feed each other. Both loops make the same repetitions and give the same
bits; they run in turns, and the fastest run of each counts.
"""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, cast

import control
import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from co_sim import (
    Connection,
    Coupling,
    ExchangeFmu,
    FmuComponent,
    FunctionComponent,
    LinearComponent,
    Master,
    Port,
    System,
)
from fmu_wheelset import path

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim import Component
    from co_sim.iterated import CompiledIteratedLoop

#: Stiffness and damping between the bogie frame and the wheelset, N/m and N s/m; mass of the frame, kg.
STIFFNESS, DAMPING, FRAME = 4e6, 4e4, 3000.0
STEP = 1e-3


def running_gear(wheelset: Component, spring: Component) -> System:
    """Return a wheelset under a bogie frame, with the suspension as a part of its own."""
    A = [[0.0, 1.0], [-STIFFNESS / FRAME, -DAMPING / FRAME]]
    frame = LinearComponent(
        control.ss(A, [[0.0], [1.0 / FRAME]], np.eye(2), 0),
        [Port("F", "N")],
        [Port("z", "m"), Port("v", "m/s")],
        x0=[1e-3, 0.0],
    )
    wires = [
        Connection("wheelset.lateral_displacement", "spring.z1"),
        Connection("wheelset.lateral_velocity", "spring.v1"),
        Connection("frame.z", "spring.z2"),
        Connection("frame.v", "spring.v2"),
        Connection("spring.F", "wheelset.suspension_lateral_force"),
        Connection("spring.F", "frame.F", gain=-1.0),
    ]
    parts = {"wheelset": wheelset, "spring": spring, "frame": frame}
    return System(parts, wires, step=STEP, coupling=Coupling("iterated", order=1))


SPRING = [-STIFFNESS, -DAMPING, STIFFNESS, DAMPING]
_ENDS = [Port("z1", "m"), Port("v1", "m/s"), Port("z2", "m"), Port("v2", "m/s")]


def linear_spring() -> Component:
    """Return the suspension in machine code."""
    return LinearComponent(control.ss([], [], [], [SPRING]), _ENDS, [Port("F", "N")])


def python_spring() -> Component:
    """Return the suspension in Python."""
    stiffness = np.array(SPRING)
    return FunctionComponent(lambda t, u: [stiffness @ u], inputs=_ENDS, outputs=[Port("F", "N")])


def _wheelset(kind: Callable[..., Component], fmi: int) -> Component:
    return kind(
        path(fmi=fmi),
        inputs=["suspension_lateral_force"],
        outputs=["lateral_displacement", "lateral_velocity"],
        parameters={"drive_mode": "free_rolling", "speed": 20.0},
    )


def two_masses() -> System:
    """Return two masses joined by a spring that belongs to one of them."""
    left = LinearComponent(
        control.ss([[0, 1], [-50, -0.5]], [[0], [1]], np.eye(2), 0),
        [Port("F", "N")],
        [Port("z", "m"), Port("v", "m/s")],
        x0=[0.01, 0.0],
    )
    right = LinearComponent(
        control.ss([[0, 1], [-50, -1]], [[0, 0], [20, 0.5]], [[20, 0.5]], [[-20, -0.5]]),
        [Port("z", "m"), Port("v", "m/s")],
        [Port("F", "N")],
    )
    wires = [
        Connection("left.z", "right.z"),
        Connection("left.v", "right.v"),
        Connection("right.F", "left.F"),
    ]
    return System({"left": left, "right": right}, wires, step=STEP, coupling=Coupling("iterated", order=1))


CASES: dict[str, Callable[[], System]] = {
    "two linear parts": two_masses,
    "wheelset (FMI 2) and two linear parts": lambda: running_gear(
        _wheelset(FmuComponent, 2), linear_spring()
    ),
    "wheelset (FMI 3) and two linear parts": lambda: running_gear(
        _wheelset(FmuComponent, 3), linear_spring()
    ),
    "the same, one linear part in Python": lambda: running_gear(_wheelset(FmuComponent, 3), python_spring()),
    "wheelset (Model Exchange) and two linear parts": lambda: running_gear(
        _wheelset(ExchangeFmu, 2), linear_spring()
    ),
}


def run(system: System, n: int, *, compiled: bool) -> tuple[float, float]:
    """Return the time of a step, s, and the repetitions of the last one."""
    with Master(system, compiled=compiled, quiet=True) as master:
        master.run(n_steps=10)
        begin = time.perf_counter()
        master.run(n_steps=n)
        seconds = time.perf_counter() - begin
        return seconds / n, cast("CompiledIteratedLoop", master._loop).repetitions


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    table = Table(box=box.MARKDOWN)
    table.add_column("system", no_wrap=True)
    for heading in ("repetitions", "us a step, compiled", "us a step, in Python", "ratio"):
        table.add_column(heading, justify="right", no_wrap=True)
    for title, build in CASES.items():
        system = build()
        runs = [
            (run(system, options.steps, compiled=True), run(system, options.steps // 5, compiled=False))
            for _ in range(options.rounds)
        ]
        compiled, python = (min(pair[i][0] for pair in runs) for i in (0, 1))
        repetitions = runs[0][0][1]
        cells = f"{repetitions}", f"{compiled * 1e6:.1f}", f"{python * 1e6:.0f}", f"{python / compiled:.0f}"
        table.add_row(title, *cells)
    Console(width=150, highlight=False).print(table)


if __name__ == "__main__":
    main()
