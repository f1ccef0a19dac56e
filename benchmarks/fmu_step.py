"""What one communication step of 1 ms costs, against the least that it could and against other tools.

    python -m pip install ".[benchmark]"
    python benchmarks/fmu_step.py

All that is compared takes the same steps of the same motion, in turn in one process, and that is repeated; a
ratio is that of neighbours in time. Our steps, CVode "in C" and PythonFMU3 are driven by one loop in C
(fmu_step.c), so that no call from Python counts; where the track waves, a step includes setting its offset.

Errors are the largest difference of any state, in units of its largest or its nominal value, from a run of
DOP853 that starts anew in each step. CVode and PythonFMU3 get the cheapest setting whose error is at most
twice ours or 5e-8, a twentieth of the error that our FMU may have, whichever is larger.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from scipy.integrate import solve_ivp
from step_plants import NOMINALS, CVodeC, CVodeFmpy, H, Plant, PythonFmu, Scenario, WheelsetFmu, compile_loops

from fmu_wheelset.variables import DriveMode

if TYPE_CHECKING:
    import ctypes
    from collections.abc import Callable, Iterable, Sequence

P = TypeVar("P", bound=Plant)

SCENARIOS = (
    Scenario("20 m/s, prescribed creep", DriveMode.PRESCRIBED_CREEP, 20.0),
    Scenario("20 m/s, torque driven", DriveMode.TORQUE_DRIVEN, 20.0),
    Scenario("20 m/s, torque, straight track", DriveMode.TORQUE_DRIVEN, 20.0, waves=False),
    Scenario("1 m/s, torque driven (stiff)", DriveMode.TORQUE_DRIVEN, 1.0),
    Scenario("100 m/s, torque driven", DriveMode.TORQUE_DRIVEN, 100.0),
)
STEPS = 200
ROUNDS = 9
EVALUATIONS = 100  # at each state
ENOUGH = 0.02  # s, for one round of steps
TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(8, 27))
SUBSTEPS = tuple(2**k for k in range(9))
GOOD_ENOUGH = 5e-8


@dataclass(frozen=True)
class Measured:
    """Times in s per step or evaluation, by round; evaluations per step, without and with Jacobian."""

    scenario: Scenario
    times: dict[str, np.ndarray]
    errors: dict[str, float]
    counts: np.ndarray
    cvode_evaluations: float
    tolerance: float
    substeps: int

    def microseconds(self, name: str) -> float:
        """Return the median time."""
        return float(np.median(self.times[name])) * 1e6

    def ratio(self, name: str) -> str:
        """Return the time over ours."""
        return spread(self.times[name] / self.times["ours"])

    def overhead(self) -> str:
        """Return the share of our step that is not in the evaluations it takes."""
        evaluations = self.counts[0] * self.times["f"] + self.counts[1] * self.times["f and J"]
        return spread(1 - evaluations / self.times["ours"], ".2f")


def spread(values: np.ndarray, form: str = ".1f") -> str:
    """Write the median and the range of the rounds."""
    return f"{np.median(values):{form}} ({values.min():{form}}..{values.max():{form}})"


def reference(scenario: Scenario, loops: ctypes.CDLL) -> np.ndarray:
    """Return the states after each step. Below 1e-11 rounding would shrink the steps of the stiff motion."""
    plant = WheelsetFmu(scenario, loops)
    plant.start()
    x, rows = plant.states(), []
    for offset in scenario.offsets(STEPS):
        plant.set_offset(float(offset))
        run = solve_ivp(
            lambda _, x: plant.evaluate(x[None]),
            (0.0, H),
            x,
            method="DOP853",
            rtol=1e-11,
            atol=1e-11 * NOMINALS,
        )
        x = run.y[:, -1]
        rows.append(x)
    return np.array(rows)


def cheapest(plants: Iterable[P], error: Callable[[Plant], float], allowed: float) -> P:
    """Return the first plant whose error is allowed.

    Raises
    ------
    RuntimeError
        None is that accurate.
    """
    for plant in plants:
        if error(plant) <= allowed:
            return plant
    raise RuntimeError(f"settings: got none with an error of at most {allowed:.1e}")


def timed(plant: Plant) -> float:
    """Return the wall time of a step, s."""
    total, passes = 0.0, 0
    while total < ENOUGH:
        plant.start()
        begin = time.perf_counter()
        plant.advance(STEPS)
        total += time.perf_counter() - begin
        passes += 1
    return total / (passes * STEPS)


def timed_evaluation(plant: WheelsetFmu, x: np.ndarray, jacobian: bool) -> float:
    """Return the wall time of one evaluation, averaged over the states, s."""
    begin = time.perf_counter()
    plant.evaluate(x, EVALUATIONS, jacobian)
    return (time.perf_counter() - begin) / (EVALUATIONS * len(x))


def measure(scenario: Scenario, loops: ctypes.CDLL) -> Measured:
    """Find settings of equal accuracy, then time all in turn."""
    exact = reference(scenario, loops)
    size = np.maximum(np.abs(exact).max(axis=0), NOMINALS)

    def error(plant: Plant) -> float:
        found = float((np.abs(plant.trajectory(STEPS) - exact) / size).max())
        return found if np.isfinite(found) else np.inf

    ours = WheelsetFmu(scenario, loops)
    allowed = max(2 * error(ours), GOOD_ENOUGH)
    in_c = cheapest((CVodeC(scenario, loops, tolerance) for tolerance in TOLERANCES), error, allowed)
    cvode_evaluations = in_c.evaluations / STEPS
    in_fmpy = CVodeFmpy(scenario, loops, in_c.tolerance)
    python = cheapest((PythonFmu(scenario, loops, n) for n in SUBSTEPS), error, allowed)
    plants: dict[str, Plant] = {"ours": ours, "CVode in C": in_c, "CVode of fmpy": in_fmpy}
    plants["PythonFMU3"] = python
    errors = {name: error(plant) for name, plant in plants.items()}
    times: dict[str, list[float]] = {name: [] for name in (*plants, "f", "f and J")}
    for _ in range(ROUNDS):
        times["f"].append(timed_evaluation(ours, exact, jacobian=False))
        times["f and J"].append(timed_evaluation(ours, exact, jacobian=True))
        for name, plant in plants.items():
            times[name].append(timed(plant))
    arrays = {name: np.array(values) for name, values in times.items()}
    counts = ours.count(STEPS) / STEPS
    return Measured(scenario, arrays, errors, counts, cvode_evaluations, in_c.tolerance, python.substeps)


def print_table(title: str, columns: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """Print a table with columns as wide as they must be."""
    table = [("", *columns), *rows]
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    print(f"\n{title}\n")
    for row in table:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def print_overhead(found: list[Measured]) -> None:
    """Print our step against the evaluations in it."""
    rows = [
        (
            m.scenario.name,
            f"{m.microseconds('ours'):.2f}",
            f"{m.microseconds('f'):.3f}",
            f"{m.microseconds('f and J'):.3f}",
            f"{m.counts[0]:.1f}",
            f"{m.counts[1]:.1f}",
            m.overhead(),
        )
        for m in found
    ]
    print_table(
        "(a) Against the evaluations of the right-hand side f and its Jacobian J that the method needs",
        ("step, us", "f, us", "f and J, us", "f", "f and J", "overhead, share of the step"),
        rows,
    )


def print_cvode(found: list[Measured]) -> None:
    """Print CVode against our step."""
    rows = [
        (
            m.scenario.name,
            f"{m.tolerance:.1e}",
            f"{m.errors['CVode of fmpy']:.1e}",
            f"{m.errors['ours']:.1e}",
            f"{m.cvode_evaluations:.0f}",
            m.ratio("CVode of fmpy"),
            m.ratio("CVode in C"),
        )
        for m in found
    ]
    print_table(
        "(b) Against CVode on our own FMU for model exchange, as fmpy calls it and called from C",
        ("tolerance", "its error", "ours", "f", "fmpy / ours", "in C / ours"),
        rows,
    )


def print_python(found: list[Measured]) -> None:
    """Print the FMU of PythonFMU3 against our step."""
    rows = [
        (
            m.scenario.name,
            str(m.substeps),
            f"{m.errors['PythonFMU3']:.1e}",
            f"{m.errors['ours']:.1e}",
            m.ratio("PythonFMU3"),
        )
        for m in found
    ]
    print_table(
        "(c) Against the same equations in Python (python_wheelset.py), exported by PythonFMU3",
        ("Runge-Kutta substeps", "its error", "ours", "PythonFMU3 / ours"),
        rows,
    )


def main() -> None:
    """Print one table for each comparison."""
    missing = [name for name in ("ziglang", "pythonfmu3") if importlib.util.find_spec(name) is None]
    if missing:
        sys.exit(f'packages: got no {" and no ".join(missing)}; run `python -m pip install ".[benchmark]"`')
    print(f"A step of {1e3 * H:g} ms; {STEPS} steps, {ROUNDS} rounds, median (minimum..maximum)")
    with tempfile.TemporaryDirectory() as folder:
        loops = compile_loops(Path(folder))
        found = [measure(scenario, loops) for scenario in SCENARIOS]
    print_overhead(found)
    print_cvode(found)
    print_python(found)


if __name__ == "__main__":
    main()
