"""Rodas5P: its order, its stability, its linear algebra, and how it gives up."""

from __future__ import annotations

import ctypes
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    Rhs = Callable[[np.ndarray], Any]
    Sizes = tuple[float, float]

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS = range(3)
GAMMA = 0.21193756319429014
STAGES = 8


class Problem:
    """An autonomous system for the integrator in C; `calls` counts evaluations."""

    def __init__(
        self,
        core: SimpleNamespace,
        f: Rhs,
        J: Rhs,
        n: int,
        moving: list[int] | None = None,
        tolerance: float = 1e-8,
    ) -> None:
        self.core, self.n, self.calls = core, n, 0

        def evaluate(_: Any, x: Any, x_dot: Any, jacobian: Any) -> None:
            self.calls += 1
            state = np.array(x[:n])
            matrix = np.atleast_2d(J(state)) if jacobian else None
            for i, rate in enumerate(f(state)):
                x_dot[i] = rate
                if matrix is not None:
                    for j in range(n):
                        jacobian[8 * i + j] = matrix[i, j]

        self._callback = core.Evaluate(evaluate)
        moving = list(range(n)) if moving is None else moving
        self.system = core.System(
            evaluate=self._callback,
            n_states=n,
            n_moving=len(moving),
            moving=(ctypes.c_int * 8)(*moving),
            tolerance=tolerance,
            nominal=core.vector(*[1.0] * 8),
        )

    def step(self, x: Any, h: float) -> tuple[np.ndarray, np.ndarray]:
        after, error = self.core.vector(*[0.0] * 8), self.core.vector(*[0.0] * 8)
        call = self.core.library.integrator_step
        assert call(ctypes.byref(self.system), self.core.vector(*x), ctypes.c_double(h), after, error) == 1
        return np.array(after[: self.n]), np.array(error[: self.n])

    def advance(self, x: Any, duration: float, sizes: Sizes = (0.0, 0.0)) -> tuple[int, np.ndarray, Sizes]:
        """Advance with the proposed next step and first step behind a jump; 0 means unknown."""
        state, carried = self.core.vector(*x), (ctypes.c_double * 2)(*sizes)
        call = self.core.library.integrator_advance
        result = call(ctypes.byref(self.system), state, ctypes.c_double(duration), carried)
        return result, np.array(state[: self.n]), (carried[0], carried[1])


@pytest.fixture
def van_der_pol(core: SimpleNamespace) -> Problem:
    return Problem(
        core,
        lambda x: [x[1], (1 - x[0] ** 2) * x[1] - x[0]],
        lambda x: [[0, 1], [-2 * x[0] * x[1] - 1, 1 - x[0] ** 2]],
        2,
    )


def error_after(problem: Problem, x0: list[float], steps: int, exact: np.ndarray) -> float:
    x = np.array(x0)
    for _ in range(steps):
        x, _ = problem.step(x, 1.0 / steps)
    return float(np.abs(x - exact).max())


def test_converges_with_order_five(van_der_pol: Problem) -> None:
    x = np.array([0.2, -1.0])
    exact = x.copy()
    for _ in range(512):
        exact, _ = van_der_pol.step(exact, 1.0 / 512)
    errors = [error_after(van_der_pol, [0.2, -1.0], steps, exact) for steps in (16, 32, 64)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders == pytest.approx([5.0, 5.0], abs=0.2)


def test_error_estimate_has_order_five_a_step(van_der_pol: Problem) -> None:
    # The embedded solution has order 4, so its local error is of order h^5.
    estimates = [np.abs(van_der_pol.step([2.0, 0.5], h)[1]).max() for h in (0.02, 0.01, 0.005)]
    orders = np.log2(np.divide(estimates[:-1], estimates[1:]))
    assert orders == pytest.approx([5.0, 5.0], abs=0.2)


def stability(core: SimpleNamespace, z: complex) -> complex:
    """Rodas5P on x_dot = z x with h = 1, as a real system of two states."""
    J = np.array([[z.real, -z.imag], [z.imag, z.real]])
    x, _ = Problem(core, lambda x: J @ x, lambda x: J, 2).step([1.0, 0.0], 1.0)
    return complex(*x)


@pytest.mark.parametrize("z", [0.1j, -0.2, -0.1 + 0.2j])
def test_stability_function_is_exponential_to_fifth_order(core: SimpleNamespace, z: complex) -> None:
    assert abs(stability(core, z) - np.exp(z)) < 0.02 * abs(z) ** 6


def test_is_l_stable(core: SimpleNamespace) -> None:
    for y in np.geomspace(1e-2, 1e4, 40):
        assert abs(stability(core, 1j * y)) <= 1.0 + 1e-12
    for angle in np.linspace(math.pi / 2, math.pi, 7):
        assert abs(stability(core, 1e7 * np.exp(1j * angle))) < 1e-4


def test_solves_systems_that_need_pivoting(core: SimpleNamespace) -> None:
    rng, h = np.random.default_rng(0), 0.1
    for _ in range(20):
        J = 30 * rng.normal(size=(6, 6))
        J[np.diag_indices(4)] = 1 / (GAMMA * h)  # zeros on the diagonal of I/(gamma h) - J
        x0 = rng.normal(size=6)
        problem = Problem(core, lambda x, J=J: J @ x, lambda x, J=J: J, 6)
        # On linear systems Rodas5P is its stability function R(hJ): compare with the scalar one.
        values, vectors = np.linalg.eig(J)
        R = np.array([stability(core, complex(h * value)) for value in values])
        expected = (vectors @ (R * np.linalg.solve(vectors, x0.astype(complex)))).real
        assert problem.step(x0, h)[0] == pytest.approx(expected, rel=1e-6, abs=1e-8 * np.abs(expected).max())


def test_states_that_do_not_move_are_constants(core: SimpleNamespace) -> None:
    problem = Problem(
        core, lambda x: [7.0, x[0] * x[2], 9.0], lambda x: [[0, 0, 0], [x[2], 0, x[0]], [0, 0, 0]], 3, [1]
    )
    result, x, _ = problem.advance([2.0, 1.0, 3.0], 0.5)
    assert result == DONE
    assert x == pytest.approx([2.0, 1.0 + 0.5 * 6.0, 3.0], rel=1e-12)
    assert (x[0], x[2]) == (2.0, 3.0)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_error_follows_the_tolerance(core: SimpleNamespace, tolerance: float) -> None:
    oscillator = Problem(core, lambda x: [x[1], -x[0]], lambda x: [[0, 1], [-1, 0]], 2, tolerance=tolerance)
    result, x, _ = oscillator.advance([1.0, 0.0], 10.0)
    assert result == DONE
    error = np.abs(x - [math.cos(10.0), -math.sin(10.0)]).max()
    assert 0.01 * tolerance < error < 20 * tolerance


def test_step_size_is_remembered(van_der_pol: Problem) -> None:
    _, x, sizes = van_der_pol.advance([2.0, 0.0], 1.0)
    first = van_der_pol.calls
    van_der_pol.advance(x, 1e-3, sizes)
    assert sizes[0] > 1e-3
    assert van_der_pol.calls - first == STAGES  # one step: its linearisation and the stages behind the first


def test_first_step_behind_a_jump_is_that_of_the_last_jump(core: SimpleNamespace) -> None:
    """A fast transient after each jump: only the first one has to find its step size by trial."""
    rate = 1e4
    problem = Problem(core, lambda x: [1.0 - rate * x[0]], lambda x: [[-rate]], 1)
    _, x, sizes = problem.advance([1.0], 1e-2)
    by_trial = problem.calls
    assert 0.0 < sizes[1] < 1e-3 < sizes[0]
    problem.advance(x + 1.0, 1e-2, (0.0, sizes[1]))
    remembered = problem.calls - by_trial
    problem.advance(x + 1.0, 1e-2, sizes)
    misled = problem.calls - by_trial - remembered
    # An accepted step is a linearisation and the other stages, a rejected one lacks the linearisation.
    assert remembered % STAGES == 0
    assert by_trial % STAGES != 0
    assert remembered < min(by_trial, misled)


def test_splitting_a_duration_is_deterministic(van_der_pol: Problem) -> None:
    runs = []
    for _ in range(2):
        x, sizes = np.array([2.0, 0.0]), (0.0, 0.0)
        for _ in range(50):
            _, x, sizes = van_der_pol.advance(x, 0.01, sizes)
        runs.append((x.tobytes(), sizes))
    assert runs[0] == runs[1]


def test_gives_up_at_a_singularity_and_keeps_the_states(core: SimpleNamespace) -> None:
    problem = Problem(core, lambda x: x * x, lambda x: np.diag(2 * x), 1)  # x = 1/(1 - t)
    result, x, sizes = problem.advance([1.0], 2.0, (0.125, 0.25))
    assert (result, list(x), sizes) == (STEP_TOO_SMALL, [1.0], (0.125, 0.25))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_gives_up_on_values_that_are_not_finite(core: SimpleNamespace, value: float) -> None:
    problem = Problem(core, lambda x: [value], lambda x: [[0.0]], 1)
    result, x, _ = problem.advance([1.0], 1.0)
    assert (result, list(x)) == (STEP_TOO_SMALL, [1.0])
    assert problem.calls < 200


def test_gives_up_on_a_jacobian_that_is_not_finite(core: SimpleNamespace) -> None:
    problem = Problem(core, lambda x: [0.0], lambda x: [[math.nan]], 1)
    assert problem.advance([1.0], 1.0)[0] == STEP_TOO_SMALL


def test_gives_up_after_too_many_steps(core: SimpleNamespace) -> None:
    # The slope of a step function jumps: accuracy 1e-13 would need steps far below the duration.
    problem = Problem(core, lambda x: [math.cos(1e5 * x[0]) + 1.5], lambda x: [[0.0]], 1, tolerance=1e-13)
    assert problem.advance([0.0], 10.0, (1e-7, 0.0))[0] == TOO_MANY_STEPS
