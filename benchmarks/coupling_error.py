"""Error against step for all algorithms of coupling, on two coupled oscillators with a known solution.

    python benchmarks/coupling_error.py

draws docs/figures/coupling_error.png and prints the errors at the smallest step and the orders observed.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import control
import matplotlib as mpl
import numpy as np
from scipy.linalg import expm

from co_sim import Component, Connection, Coupling, LinearComponent, Master, Port, System

mpl.use("Agg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from co_sim.component import Vector
    from co_sim.kernel import Matrix

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "coupling_error.png"
#: x' = A x of the whole: an oscillator, and a lag that its position drives and that drives it.
A = np.array([[0.0, 1.0, 0.0], [-5.0, -0.4, 2.0], [1.5, 0.0, -1.0]])
X0 = np.array([1.0, 0.0, 0.5])
BEGIN, END = 0.4, 2.0
STEPS = BEGIN / 2.0 ** np.arange(2, 9)
TITLES = {"jacobi": "Jacobi", "gauss-seidel": "Gauss-Seidel", "iterated": "Iterated"}
COLOURS = ("#1b6ca8", "#d1661b", "#3b8a3e")
#: How a line is drawn, and whether it takes derivatives and counts the first steps.
DERIVATIVES, MEANS, WITH_START = ("-o", True, False), ("--s", False, False), (":^", True, True)


class Held(Component):
    """x' = A x + B u, exact for inputs that are held; of an extrapolated one it knows the mean."""

    def __init__(self, A: Matrix, B: Matrix, x0: Vector) -> None:
        super().__init__([Port("u")], [Port(f"x{i}") for i in range(len(A))], {})
        self._A, self._B, self._x0 = A, B, x0

    def start(self, t0: float, h: float) -> None:
        """Solve over one step."""
        n = len(self._A)
        joint = np.zeros((n + 1, n + 1))
        joint[:n] = np.hstack([self._A, self._B])
        self._solution = expm(joint * h)[:n]
        self._x = self._x0

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the state."""
        y[:] = self._x

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance the state."""
        self._x = self._solution @ [*self._x, *u]
        y[:] = self._x

    def save(self) -> object:
        """Return the state, which no step changes in place."""
        return self._x

    def restore(self, state: Vector) -> None:
        """Take a state."""
        self._x = state


def part(rows: slice, column: int, *, derivatives: bool) -> Component:
    """Return some rows of the whole as a component, with the column of the others as its input."""
    own, B, x0 = A[rows, rows], A[rows, [column]].reshape(-1, 1), X0[rows]
    if not derivatives:
        return Held(own, B, x0)
    names = [f"x{i}" for i in range(len(own))]
    return LinearComponent(control.ss(own, B, np.eye(len(own)), 0), ["u"], names, x0)


def error(h: float, coupling: Coupling, *, derivatives: bool, with_start: bool) -> float:
    """Return the error at the end, without what was lost before `BEGIN` unless it is wanted."""
    parts = {
        "a": part(slice(2), 2, derivatives=derivatives),
        "b": part(slice(2, 3), 0, derivatives=derivatives),
    }
    wires = [Connection("a.x0", "b.u"), Connection("b.x0", "a.u")]
    with Master(System(parts, wires, step=h, coupling=coupling)) as master:
        begin, known = 0.0, X0
        if not with_start:
            master.run(BEGIN)
            begin, known = master.time, master.values.copy()
        master.run(n_steps=round((END - begin) / h))
        return float(np.linalg.norm(master.values - expm(A * (END - begin)) @ known))


def draw(axes: Axes, algorithm: str) -> None:
    """Draw the errors of one algorithm."""
    lines: list[tuple[int, tuple[str, bool, bool]]] = [(order, DERIVATIVES) for order in (0, 1, 2)]
    lines += [(2, MEANS), (2, WITH_START)]
    for order, (style, derivatives, with_start) in lines:
        coupling = Coupling(algorithm, order, tolerance=1e-12)  # type: ignore[arg-type]
        errors = [error(h, coupling, derivatives=derivatives, with_start=with_start) for h in STEPS]
        label = f"order {order}"
        if not derivatives:
            label += ", components take the mean"
        if with_start:
            label += ", first steps counted"
        axes.loglog(1e3 * STEPS, errors, style, color=COLOURS[order], ms=4, lw=1.4, label=label)
        observed = np.log2(errors[-2] / errors[-1])
        print(
            f"{algorithm:12}  {label:36}  {errors[-1]:.1e} at {1e3 * STEPS[-1]:.3g} ms, order {observed:.2f}"
        )
    axes.set(title=TITLES[algorithm], xlabel="step in ms")
    axes.set_xticks([2.0, 10.0, 100.0], ["2", "10", "100"])
    axes.grid(which="major", color="#ddd", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Draw the figure, and print what is in it."""
    figure, panels = plt.subplots(1, 3, figsize=(10.5, 4.6), sharex=True, sharey=True, layout="constrained")
    for axes, algorithm in zip(panels, TITLES, strict=True):
        draw(axes, algorithm)
    panels[0].set_ylabel("error of the state at t = 2 s (norm)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(FIGURE, dpi=110)


if __name__ == "__main__":
    main()
