"""The machine code of this package's own components.

Apart from the components, because numba takes half a second to get ready for the first compiled function of a
process, also where that is cached: who only imports the package need not wait for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import carray, cfunc, njit, uintp  # type: ignore[attr-defined]

from co_sim.array_functions import RAISED, call_array_step, compiled
from co_sim.native import STEP, doubles_at, integers_at

if TYPE_CHECKING:
    from co_sim.component import Vector

__all__ = ["array_step", "constant_step", "linear_exchange", "linear_step", "table_step"]

#: Places in the table of `array_step`.
_FUNCTION, _U, _Y, _X, _N_X, _P, _N_P, _EXCEPTION = range(8)


@cfunc(STEP, cache=True)
def array_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Call a function over arrays, see `CompiledComponent`."""
    table = carray(integers_at(data), 8)
    arrays = (
        carray(doubles_at(u), table[_U]),
        carray(doubles_at(y), table[_Y]),
        carray(doubles_at(table[_X]), table[_N_X]),
        carray(doubles_at(table[_P]), table[_N_P]),
    )
    status: int
    status, exception = call_array_step(table[_FUNCTION], (t, h, *arrays))
    if status == RAISED:
        table[_EXCEPTION] = exception
    return status


#: Places in the table of `table_step`; that of `constant_step` has the first two.
_N_Y, _VALUES, _N_TIMES, _TIMES, _SLOPES, _EARLY = range(6)


@cfunc(STEP, cache=True)
def constant_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Write the same values again."""
    table = carray(integers_at(data), 2)
    values = carray(doubles_at(table[_VALUES]), table[_N_Y])
    outputs = carray(doubles_at(y), table[_N_Y])
    for i in range(outputs.size):
        outputs[i] = values[i]
    return 0


@cfunc(STEP, cache=True, error_model="numpy")
def table_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Look up the values at the end of the step, see `TimeTable`."""
    table = carray(integers_at(data), 6)
    n_y, n_times = table[_N_Y], table[_N_TIMES]
    times = carray(doubles_at(table[_TIMES]), n_times)
    values = carray(doubles_at(table[_VALUES]), (n_times, n_y))
    slopes = carray(doubles_at(table[_SLOPES]), (n_times, n_y))
    outputs = carray(doubles_at(y), n_y)
    now = t + h
    reached = now + carray(doubles_at(table[_EARLY]), 1)[0]
    # The last breakpoint that is reached, by bisection; the first one where none is.
    low, high = 0, n_times
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= reached:
            low = middle
        else:
            high = middle
    since = max(now - times[low], 0.0)
    for i in range(n_y):
        outputs[i] = slopes[low, i] * since + values[low, i]
    return 0


@njit(error_model="numpy")
def _dot(p: Vector, start: Any, vector: Vector, size: Any) -> float:
    # Sizes are unsigned: numba would ask of each index whether it counts from the end.
    total = 0.0
    for j in range(uintp(size)):
        total += p[start + j] * vector[j]
    return total


@njit(error_model="numpy")
def _used(u: Vector) -> int:
    """Return how many of the inputs count: a third where all derivatives are zero, else all."""
    values = u.size // 3
    for j in range(values, u.size):
        if u[j] != 0.0:
            return u.size
    return values


@compiled
def linear_step(t: float, h: float, u: Vector, y: Vector, x: Vector, p: Vector) -> int:
    """``x := Phi x + Gamma u``, ``y := C x + E u``; p holds the four row by row, then room for x."""
    n, m, n_y, used = uintp(x.size), uintp(u.size), uintp(y.size), _used(u)
    gamma = n * n
    c = gamma + n * m
    e = c + n_y * n
    room = e + n_y * m
    for i in range(n):
        p[room + i] = _dot(p, i * n, x, n) + _dot(p, gamma + i * m, u, used)
    for i in range(n):
        x[i] = p[room + i]
    for i in range(n_y):
        y[i] = _dot(p, c + i * n, x, n) + _dot(p, e + i * m, u, used)
    return 0


@compiled
def linear_exchange(t: float, u: Vector, y: Vector, x: Vector, p: Vector) -> int:
    """``y := C x + D u``; D is the first third of each row of E."""
    n, m, n_y = uintp(x.size), uintp(3 * u.size), uintp(y.size)
    c = n * n + n * m
    e = c + n_y * n
    for i in range(n_y):
        y[i] = _dot(p, c + i * n, x, n) + _dot(p, e + i * m, u, u.size)
    return 0
