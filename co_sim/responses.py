"""The linear model of a component that can only be stepped, from its responses to pulses.

Each input is moved up and down for one step h, and the outputs are recorded for a while. With ``A_h`` and
``B_h`` for a step with held inputs, the k-th answer is ``C A_h^(k-1) B_h``, and the first ``C B_h + D``.
These numbers in a block Hankel matrix have the rank n of the model, and its singular vectors give one
(Ho & Kalman 1966; eigensystem realisation: Juang & Pappa 1985). It holds what the inputs reach and the
outputs see, and no more. The continuous model has ``A = log(A_h)/h``.

Where n outputs that the inputs do not act on at once tell the state, they are the states, with their
names and units.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy import linalg

from co_sim.local_model import LocalModel, NotLinearizableError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from co_sim.component import Port, Vector
    from co_sim.kernel import Matrix

__all__ = ["Stepped", "model_from_responses"]

_EPS = float(np.finfo(np.float64).eps)
#: Rows and columns of blocks, and steps from one block to the next.
_BLOCKS, _STRIDE = 20, 10
_LENGTH = 2 * (_BLOCKS - 1) * _STRIDE + 3
#: Relative size of a pulse, as of central differences.
_PULSE = _EPS ** (1.0 / 3.0)
#: Parts of the largest singular value below which the others may be rounding.
_LEVELS = 10.0 ** np.arange(-14.0, -2.0)
#: A model with fewer states is taken if its error is no more than this many times the smallest.
_AS_GOOD = 10.0
#: Largest difference between the responses and those of the model, relative to the largest response.
_MISFIT = 1e-6
#: Entries of matrices below this many times the error, in scaled units, are zero.
_ROUNDING = 100.0
#: A state told by outputs loses no more than half of the digits.
_CONDITION = 1e8


class Stepped(Protocol):
    """What is needed of a component."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance from `t` by `h` with `u` held, and write the outputs there into `y`."""
        ...

    def save(self) -> object:
        """Return the present state."""
        ...

    def restore(self, state: object) -> None:
        """Return to a state."""
        ...


def model_from_responses(component: Stepped, t: float, h: float, u: Vector) -> LocalModel:
    """Return the model of a running component at its present state, to which it returns.

    Inputs and outputs that are not continuous numbers have zeros.

    Parameters
    ----------
    component : it can save its state, and steps beyond its present time `t` (s).
    h : step, s; an oscillation must take more than two.
    u : the inputs, around which the pulses are.

    Raises
    ------
    NotLinearizableError
        If the responses are not those of a linear model, or of one that no continuous model is behind.
    """
    columns, rows = _smooth(component.inputs), _smooth(component.outputs)
    M = _markov(component, t, h, u, columns, rows)
    size_y, size_u = _sizes(M)
    scaled = M / size_y[:, None] * size_u
    step, misfit = _realised(scaled)
    if not misfit <= _MISFIT:
        raise NotLinearizableError(
            f"its responses to pulses differ from those of a linear model by {misfit:.1g} of the largest"
        )
    A, B = _continuous(step, h)
    T, states, units, sizes = _state(step, size_y, rows, component.outputs)
    A, B, C = T @ linalg.solve(T.T, A.T).T, T @ B, linalg.solve(T.T, step.C.T).T
    # What is no more than the error of the responses is zero: it would count as a coupling.
    A, B = (np.where(np.abs(M) > _ROUNDING * misfit / h, M, 0.0) for M in (A, B))
    C, D = (np.where(np.abs(M) > _ROUNDING * misfit, M, 0.0) for M in (C, step.D))
    n_u, n_y = (sum(port.size for port in ports) for ports in (component.inputs, component.outputs))
    whole_B, whole_C, whole_D = np.zeros((len(A), n_u)), np.zeros((n_y, len(A))), np.zeros((n_y, n_u))
    whole_B[:, columns] = sizes[:, None] * B / size_u
    whole_C[rows] = size_y[:, None] * C / sizes
    whole_D[np.ix_(rows, columns)] = size_y[:, None] * D / size_u
    A = sizes[:, None] * A / sizes
    return LocalModel(A, whole_B, whole_C, whole_D, states, units, method="responses", error=misfit)


@dataclass(frozen=True, eq=False)
class _Step:
    """A model for one step: ``x+ = A x + B u, y+ = C x+ + D u`` with `u` held."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def _smooth(ports: Sequence[Port]) -> NDArray[np.int64]:
    """Return the places of the elements that are continuous numbers."""
    smooth = [port.kind == "float64" and port.continuous for port in ports]
    return np.flatnonzero(np.repeat(smooth, [port.size for port in ports]))


def _markov(
    component: Stepped, t: float, h: float, u: Vector, columns: NDArray[np.int64], rows: NDArray[np.int64]
) -> Matrix:
    """Return the answers (step, output, input) to a pulse of one, from pulses up and down."""
    y = np.empty(sum(port.size for port in component.outputs))
    found = np.zeros((_LENGTH, rows.size, columns.size))
    start = component.save()
    try:
        for j, column in enumerate(columns):
            pulse = _PULSE * max(abs(u[column]), 1.0)
            for sign in (1.0, -1.0):
                held = u.copy()
                held[column] += sign * pulse
                for k in range(_LENGTH):
                    component.step(t + k * h, h, held if k == 0 else u, y)
                    found[k, :, j] += sign * y[rows] / (2.0 * pulse)
                component.restore(start)
    finally:
        component.restore(start)
    return found


def _sizes(M: Matrix) -> tuple[Vector, Vector]:
    """Return sizes of outputs and inputs: to an input of its size the answers are at most of theirs."""
    largest = np.abs(M).max(axis=0, initial=0.0)
    rows = np.sqrt(largest.max(axis=1, initial=0.0))
    columns = (largest / np.where(rows > 0.0, rows, 1.0)[:, None]).max(axis=0, initial=0.0)
    size_u = 1.0 / np.where(columns > 0.0, columns, 1.0)
    size_y = (largest * size_u).max(axis=1, initial=0.0)
    return np.where(size_y > 0.0, size_y, 1.0), size_u


def _realised(M: Matrix) -> tuple[_Step, float]:
    """Return the model of fewest states whose answers are `M` as nearly as any, and its largest error.

    The level of rounding in the singular values is not known beforehand, so several are tried.
    """
    place = 1 + _STRIDE * np.add.outer(np.arange(_BLOCKS), np.arange(_BLOCKS))
    now, later = (np.block([[M[k + shift] for k in row] for row in place]) for shift in (0, 1))
    U, s, Vt = np.linalg.svd(now, full_matrices=False)
    orders = {int(np.sum(s > level * s.max(initial=0.0))) for level in _LEVELS}
    tried = []
    for n in sorted(orders - {min(now.shape)} or {0}):
        step = _balanced(M, later, U[:, :n], s[:n], Vt[:n])
        tried.append((step, float(np.abs(_answers(step, len(M)) - M).max(initial=0.0))))
    least = min(misfit for _, misfit in tried)
    return next((step, misfit) for step, misfit in tried if misfit <= max(_AS_GOOD * least, _EPS))


def _balanced(M: Matrix, later: Matrix, U: Matrix, s: Vector, Vt: Matrix) -> _Step:
    """Return the model of the directions `U` and `Vt`; answers from the second on are of the states alone."""
    _, p, m = M.shape
    root = np.sqrt(s)
    A = (U.T @ later @ Vt.T) / root[:, None] / root
    # The first column of blocks holds the answers from the second on: the states after two steps.
    AB, C = root[:, None] * Vt[:, :m], U[:p] * root
    B = np.asarray(np.linalg.lstsq(A, AB, rcond=None)[0]) if s.size else AB
    return _Step(A, B, C, M[0] - C @ B)


def _answers(step: _Step, length: int) -> Matrix:
    x, found = step.B, [step.C @ step.B + step.D]
    for _ in range(length - 1):
        x = step.A @ x
        found.append(step.C @ x)
    return np.array(found)


def _continuous(step: _Step, h: float) -> tuple[Matrix, Matrix]:
    """Return A and B of the continuous model that, with held inputs, makes this step."""
    n, m = step.B.shape
    if n == 0:
        return step.A, step.B
    values = linalg.eigvals(step.A)
    if np.any((np.abs(values.imag) <= 1e-9 * np.abs(values)) & (values.real < 0.0)):
        raise NotLinearizableError("it has a state that changes its sign in each step")
    joined = np.block([[step.A, step.B], [np.zeros((m, n)), np.eye(m)]])
    logarithm = linalg.logm(joined).real / h
    return logarithm[:n, :n], logarithm[:n, n:]


def _state(
    step: _Step, size_y: Vector, rows: NDArray[np.int64], outputs: Sequence[Port]
) -> tuple[Matrix, tuple[str, ...], tuple[str, ...], Vector]:
    """Return the matrix that makes the wanted states of those found, their names, units and sizes."""
    n = len(step.A)
    named = [(element, port.unit) for port in outputs for element in port.elements]
    free = np.flatnonzero(np.abs(step.D).max(axis=1, initial=0.0) <= _MISFIT)
    if n and free.size >= n:
        _, _, order = linalg.qr(step.C[free].T, pivoting=True, mode="economic")
        chosen = np.sort(free[order[:n]])
        T = step.C[chosen]
        if np.linalg.cond(T) < _CONDITION:
            names = [named[rows[i]] for i in chosen]
            return T, tuple(name for name, _ in names), tuple(unit for _, unit in names), size_y[chosen]
    return np.eye(n), tuple(f"x{i + 1}" for i in range(n)), ("1",) * n, np.ones(n)
