"""The machine code of the components of the wheelset scheme; their classes say what it does and why.

Apart from the components, as in `co_sim.steps`, so that who only describes a system need not wait for numba.

numba caches machine code by the date of this file, also what it has compiled in from `estimator`: a change
there must touch this file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import carray, cfunc, types  # type: ignore[attr-defined]

from co_sim.array_functions import compiled
from co_sim.native import STEP, caller, doubles_at, integers_at
from estimator.fuzzy import Tables
from estimator.identifier import Design, Memory, Work, identifier_step

if TYPE_CHECKING:
    from co_sim.component import Vector

__all__ = ["TRACK_ENDED", "identification_step", "sensors_step", "track_exchange", "track_step"]

#: Status of `track_step` where there is no more track, or no distance.
TRACK_ENDED = 1


@compiled
def track_step(t: float, h: float, u: Vector, y: Vector, x: Vector, p: Vector) -> int:
    """Advance by the held speed times `h`, see `TrackInput`.

    x : distance; what the last addition lost; the present piece. p : length of the ramp; end; number n of
    pieces; n left ends; four times n coefficients, those of the third power first.
    """
    # Kahan's sum: the distance is right to rounding of the last addition after any number of steps.
    increment = u[0] * h - x[1]
    s = x[0] + increment
    x[1] = (s - x[0]) - increment
    x[0] = s
    ramp, end, n = p[0], p[1], int(p[2])
    if not s <= end:
        return TRACK_ENDED
    y[0] = 0.0
    y[1] = s
    if s <= 0.0:
        return 0
    i = int(x[2])
    while i + 1 < n and s >= p[3 + i + 1]:
        i += 1
    while s < p[3 + i]:
        i -= 1
    x[2] = i
    c = 3 + n + i
    r = s - p[3 + i]
    offset = ((p[c] * r + p[c + n]) * r + p[c + 2 * n]) * r + p[c + 3 * n]
    if s < ramp:
        z = s / ramp
        offset *= z**3.0 * (10.0 - 15.0 * z + 6.0 * z**2)
    y[0] = offset
    return 0


@compiled
def track_exchange(t: float, u: Vector, y: Vector, x: Vector, p: Vector) -> int:
    """Write the start of the track: no offset yet."""
    y[0] = 0.0
    y[1] = x[0]
    return 0


#: ``double random_standard_normal(bitgen_t *)``, of numpy's C interface.
_standard_normal = caller(types.float64(types.intp))

#: Places in the table of `sensors_step`.
_N, _NORMAL, _NUMBERS, _COUNTS = range(4)
#: Columns of its numbers and of its counts, one row for each channel.
_DECAY, _BIAS, _RMS, _X, _HELD = range(5)
_GENERATOR, _PERIOD, _LEFT = range(3)


@cfunc(STEP, cache=True, error_model="numpy")
def sensors_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Measure, see `Sensors`: low-pass, bias, and noise where a sample is due."""
    table = carray(integers_at(data), 4)
    n = table[_N]
    true, measured = carray(doubles_at(u), n), carray(doubles_at(y), n)
    numbers = carray(doubles_at(table[_NUMBERS]), (n, 5))
    counts = carray(integers_at(table[_COUNTS]), (n, 3))
    for i in range(n):
        numbers[i, _X] = true[i] + numbers[i, _DECAY] * (numbers[i, _X] - true[i])
        counts[i, _LEFT] -= 1
        if counts[i, _LEFT] == 0:
            counts[i, _LEFT] = counts[i, _PERIOD]
            noise = numbers[i, _RMS] * _standard_normal(table[_NORMAL], (counts[i, _GENERATOR],))
            numbers[i, _HELD] = numbers[i, _X] + numbers[i, _BIAS] + noise
        measured[i] = numbers[i, _HELD]
    return 0


@cfunc(STEP, cache=True, error_model="numpy")
def identification_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Take a sample where one is due, and write what was said last; see `IdentifierComponent`.

    The table: n, m, s, window, terms of an input, clauses, rules, terms of an output, points of the grid;
    addresses of the counters (samples taken; steps until the next one; period) and of the last outputs;
    addresses of the arrays of `Design`, `Memory` and `Work`, in their order.
    """
    table = carray(integers_at(data), 30)
    n, m, s, window, n_terms, n_clauses, n_rules, n_shapes, n_points = (
        table[0], table[1], table[2], table[3], table[4], table[5], table[6], table[7], table[8],
    )  # fmt: skip
    counters = carray(integers_at(table[9]), 3)
    n_y = n * (2 + m)
    held = carray(doubles_at(table[10]), n_y)
    if counters[1] == 0:
        counters[1] = counters[2]
        design = Design(
            carray(doubles_at(table[11]), (n, s, s)),
            carray(doubles_at(table[12]), (n, m, s)),
            carray(doubles_at(table[13]), (n, s, m)),
            carray(doubles_at(table[14]), m),
            Tables(
                carray(doubles_at(table[15]), (n, n_terms, 4)),
                carray(doubles_at(table[16]), (n, 2)),
                carray(integers_at(table[17]), (n_clauses, 4)),
                carray(integers_at(table[18]), (n_rules, 2)),
                carray(doubles_at(table[19]), (n, n_shapes, n_points)),
                carray(doubles_at(table[20]), (n, n_points)),
            ),
        )
        memory = Memory(
            carray(doubles_at(table[21]), (n, s)),
            carray(doubles_at(table[22]), (window, n)),
            carray(doubles_at(table[23]), n),
            carray(doubles_at(table[24]), n),
        )
        work = Work(
            carray(doubles_at(table[25]), (n, s)),
            carray(doubles_at(table[26]), n),
            carray(doubles_at(table[27]), n),
            carray(doubles_at(table[28]), n_rules),
            carray(doubles_at(table[29]), (n, n_points)),
        )
        e = held[2 * n :].reshape((n, m))
        identifier_step(
            design, memory, work, counters[0], carray(doubles_at(u), m), e, held[:n], held[n : 2 * n]
        )
        counters[0] += 1
    counters[1] -= 1
    outputs = carray(doubles_at(y), n_y)
    for i in range(n_y):
        outputs[i] = held[i]
    return 0
