"""The compiled loop of iterated coupling, see `co_sim.iterated`.

It has lines of `co_sim.kernel`, `co_sim.fmi_calls` and `co_sim.quasi_newton` within itself and is cached by
its own date: a change there must touch this file too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import njit

from co_sim.kernel import NOT_FINITE, address, gather_links, is_finite, part_at, step_of
from co_sim.kernel import PART as COLUMNS
from co_sim.native import STATE, caller
from co_sim.quasi_newton import agrees, next_guess
from co_sim.table import CALLS, PART, STEP

if TYPE_CHECKING:
    from co_sim.component import Vector
    from co_sim.kernel import Integers, Matrix
    from co_sim.quasi_newton import Iteration

__all__ = ["NOT_CONVERGED", "STATES", "begin", "iterate"]

#: Returned by `iterate` in place of a component's status when the repetitions of a step do not agree.
NOT_CONVERGED = -(2**31) + 1

#: What the columns of the table of states hold: `co_sim.native.NativeState`.
STATES = ("keep", "go_back", "data")
_KEEP, _GO_BACK, _DATA = range(len(STATES))
_U, _Y, _N_Y = COLUMNS.index("u"), COLUMNS.index("y"), COLUMNS.index("n_y")
_AHEAD, _END, _DERIVED = COLUMNS.index("ahead"), COLUMNS.index("end"), COLUMNS.index("derived")

_call_state = caller(STATE)


@njit(cache=True, nogil=True, error_model="numpy")
def begin(rows: Matrix, row: int, k: int, fed: Integers, largest: Vector, iteration: Iteration) -> None:
    """Begin the step after `k`: guess that the signals go on along straight lines."""
    for j in range(len(fed)):
        now = rows[row, fed[j]]
        largest[j] = max(largest[j], abs(now))
        iteration.guess[j] = now if k == 0 else 2.0 * now - rows[row - 1, fed[j]]


@njit(error_model="numpy")
def _all_states(states: Integers, which: int, progress: Integers) -> tuple[int, int]:
    """Keep the states of all parts, or go back; return the status that ended this, and its part."""
    for j in range(len(states)):
        progress[PART] = j
        progress[CALLS] += 1
        status = _call_state(states[j, which], (states[j, _DATA],))
        if status != 0:
            return status, j
    return 0, 0


@njit(error_model="numpy")
def _all_steps(
    rows: Matrix, row: int, k: int, t: float, h: float, parts: Integers, u: Vector, progress: Integers
) -> tuple[int, int]:
    """Make the step after `k` with what is in the next row; return a status that is not 0, and its part."""
    rows_at, width, u_at = address(rows), rows.shape[1], address(u)
    # All parts read the guess, none a result of this repetition: their order changes nothing.
    for j in range(len(parts)):
        part = part_at(parts, j)
        link, end = part[_AHEAD], part[_END]
        gather_links(rows_at, width, row + 1, k + 1, k, 1, h, link, end, part[_DERIVED], u_at)
    for j in range(len(parts)):
        part = part_at(parts, j)
        y = rows_at + 8 * ((row + 1) * width + part[_Y])
        progress[PART] = j
        progress[CALLS] += 1
        status = step_of(part, t, h, part[_U], y)
        if status != 0:
            return status, j
        if not is_finite(y, y + 8 * part[_N_Y]):
            return NOT_FINITE, j
    return 0, 0


@njit(cache=True, nogil=True, error_model="numpy")
def iterate(
    rows: Matrix,
    row: int,
    k: int,
    n: int,
    t0: float,
    h: float,
    parts: Integers,
    states: Integers,
    u: Vector,
    fed: Integers,
    largest: Vector,
    tolerance: float,
    iteration: Iteration,
    progress: Integers,
) -> tuple[int, int, int, int]:
    """Make `n` steps from step `k`, whose values are in `row`; the table has `n` more rows below.

    Returns
    -------
    Steps made; the status that ended them (0: none, `NOT_FINITE`, `NOT_CONVERGED` or a component's own);
    index of its part; repetitions of the last step.
    """
    repetitions = 0
    for i in range(n):
        following = rows[row + i + 1]
        progress[STEP] = k + i
        status, j = _all_states(states, _KEEP, progress)
        if status != 0:
            return i, status, j, repetitions
        begin(rows, row + i, k + i, fed, largest, iteration)
        repetitions = 0
        while True:
            for c in range(len(fed)):
                following[fed[c]] = iteration.guess[c]
            status, j = _all_steps(rows, row + i, k + i, t0 + (k + i) * h, h, parts, u, progress)
            if status != 0:
                return i, status, j, repetitions
            repetitions += 1
            if agrees(following, fed, repetitions - 1, largest, tolerance, iteration):
                break
            if repetitions == len(iteration.results):
                return i, NOT_CONVERGED, 0, repetitions
            next_guess(repetitions - 1, iteration)
            status, j = _all_states(states, _GO_BACK, progress)
            if status != 0:
                return i, status, j, repetitions
    return n, 0, 0, repetitions
