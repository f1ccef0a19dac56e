"""The linear model of one component near its present point, and central differences with their error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.component import Vector
    from co_sim.kernel import Matrix

__all__ = ["LocalModel", "NotLinearizableError", "central_differences"]

#: Step of central differences relative to the point: the cube root of the rounding error balances
#: the error of the formula, of order 2, and that of the values.
_RELATIVE_STEP = np.finfo(np.float64).eps ** (1.0 / 3.0)


class NotLinearizableError(Exception):
    """A component has no linear model at the present point; the text says why."""


@dataclass(frozen=True, eq=False)
class LocalModel:
    """``x' = A x + B u, y = C x + D u`` in deviations from a point; ``x(t + dt)`` for ``x'`` where dt > 0.

    Parameters
    ----------
    A, B, C, D : shapes ``(n, n)``, ``(n, n_u)``, ``(n_y, n)`` and ``(n_y, n_u)``.
    states, state_units : names and units of the states.
    dt : sampling time, s; 0 for a continuous model.
    method : how the matrices were found, in words.
    error : estimated largest error of an element, relative to the largest element of its matrix.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    dt: float = 0.0
    method: str = "exact"
    error: float = 0.0


def central_differences(f: Callable[[Vector], Vector], x: Vector) -> tuple[Matrix, float]:
    """Return the Jacobian of `f` at `x`, and its estimated error relative to its largest element.

    Each column is the extrapolation (Richardson) of differences over two steps; how far these two are
    apart is the estimate.
    """
    if not x.size:
        return np.zeros((len(f(x)), 0)), 0.0
    columns, errors = [], []
    for j in range(x.size):
        step = _RELATIVE_STEP * max(abs(x[j]), 1.0)
        wide, narrow = (_difference(f, x, j, s) for s in (2.0 * step, step))
        columns.append((4.0 * narrow - wide) / 3.0)
        errors.append(np.abs(narrow - wide) / 3.0)
    J = np.array(columns).T
    largest = np.abs(J).max(initial=0.0)
    return J, float(np.max(errors, initial=0.0) / largest) if largest > 0.0 else 0.0


def _difference(f: Callable[[Vector], Vector], x: Vector, j: int, step: float) -> Vector:
    ahead, behind = x.copy(), x.copy()
    ahead[j] += step
    behind[j] -= step
    # The step that was made, which rounding may have changed.
    difference: Vector = (f(ahead) - f(behind)) / (ahead[j] - behind[j])
    return difference
