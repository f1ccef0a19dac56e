"""How the parts of a system are coupled: which values a part sees during a step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from co_sim.errors import Fault

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Algorithm", "Coupling"]

Algorithm = Literal["jacobi", "gauss-seidel", "iterated"]


@dataclass(frozen=True, slots=True)
class Coupling:
    """How values pass between components.

    Parameters
    ----------
    algorithm : ``"jacobi"``: all components step with what was known when the step began, so that their order
        changes nothing. ``"gauss-seidel"``: one after the other in the order of their dependencies; who
        comes later sees the new values of those before. ``"iterated"``: a step is repeated, from
        saved states, until the values at its end agree with what the components were given.
    order : of the polynomial in time that stands for each continuous input during a step, through past
        values (and the new one where the algorithm knows it): 0, 1 or 2. A component that takes no
        derivatives gets its mean over the step, one without memory its value at the end. Inputs that are
        not continuous are held.
    loops : at the start, ``"solve"`` algebraic loops between outputs and inputs, or ``"refuse"`` them.
    tolerance : of solved loops and of iterated steps, relative to the largest value a signal has had.
    max_iterations : of one step; ``"iterated"`` fails beyond.
    divergence : a run stops when a signal has grown this many times without pause, its largest jump not
        counted, and beyond this value in its own unit; ``inf`` lets it grow.
    """

    algorithm: Algorithm = "jacobi"
    order: int = 0
    loops: Literal["refuse", "solve"] = "refuse"
    tolerance: float = 1e-9
    max_iterations: int = 50
    divergence: float = 1e6

    def faults(self) -> Iterator[Fault]:
        """Find values that are not allowed."""
        choices = {
            "algorithm": get_args(Algorithm),
            "order": (0, 1, 2),
            "loops": ("refuse", "solve"),
        }
        for name, allowed in choices.items():
            value = getattr(self, name)
            if value not in allowed:
                listed = ", ".join(map(repr, allowed))
                yield Fault(f"coupling {name}", repr(value), f"one of {listed}", "choose one of these")
        if not 0.0 < self.tolerance < 1.0:
            yield Fault("coupling tolerance", f"{self.tolerance}", "between 0 and 1", "use 1e-9")
        if self.max_iterations < 1:
            yield Fault("coupling max_iterations", f"{self.max_iterations}", "at least 1", "use 50")
        if math.isnan(self.divergence) or self.divergence <= 1.0:
            yield Fault("coupling divergence", f"{self.divergence}", "more than 1", "use 1e6, or inf")
