"""The compiled loop: all parts of a system, many steps, no interpreter.

The values of a system at successive communication points are rows of one table. Row ``r`` has the
outputs of all components at ``t_k``; each component writes its outputs at ``t_k+1`` straight into row
``r + 1``, so that a table of results costs nothing but its memory.

A *part* is a component as the loop sees it, a row of integers (`PART`). A *link* feeds one element of an
input, a row of integers too (`LINK`): where it reads in a row, how often that source is renewed, and the gain
and offset to apply. Links of a part that read what was there when its step began stand before those that
read ahead, at the end of the step (Gauss-Seidel).

Between its samples the source of a link is a polynomial through its newest ones; in terms of
``s = (t - t_newest)/period`` and of the backward differences ``d1`` and ``d2`` ::

    p(s) = y_0 + s d1 + s (s + 1)/2 d2

Everything between two calls of components is counted in instructions. A core works ahead of what it waits
for, some 250 instructions far: with few of them between two components, the second begins while the first
one's last results are still under way. Hence pointers instead of arrays, whose views are counted by numba and
whose indices may be negative, and hence the steps of FMUs that stand in the loop itself.

Machine code is cached by the date of its own file: a change of `co_sim.fmi_calls` or of `co_sim.fmi_table`
must touch this file, and a change here `co_sim.iterated_kernel`.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

from numba import intp, njit

from co_sim.fmi_calls import fmi2_step, fmi3_step
from co_sim.native import STEP, Call, caller, doubles_at, integers_at
from co_sim.table import PART as DOING_PART
from co_sim.table import STEP as DOING_STEP

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from co_sim.component import Vector

    Integers = NDArray[np.int64]
    Matrix = NDArray[np.float64]

__all__ = [
    "LINK",
    "NOT_FINITE",
    "PART",
    "Feed",
    "address",
    "advance",
    "gather",
    "gather_links",
    "is_finite",
    "part_at",
    "step_of",
]

#: What the columns of the table of parts hold, in this order.
PART = (
    "index",  # of the part
    "call",  # how the step is called, a `Call`
    "address",  # of the step function
    "data",  # of the step function
    "u",  # address of the part's inputs, or where they begin in a row
    "y",  # where the part's outputs begin in a row
    "n_y",
    "feed",  # how its inputs are set, a `Feed`
    "behind",  # address of the first link that reads when the step of the part begins
    "ahead",  # of the first link that reads when it ends
    "end",  # of the link after the last one
    "period",  # of the part, in steps of the master
    "derived",  # how many inputs have their derivatives behind them; 0: means, -1: values at the end
)
(
    _INDEX,
    _CALL,
    _ADDRESS,
    _DATA,
    _U,
    _Y,
    _N_Y,
    _FEED,
    _BEHIND,
    _AHEAD,
    _END,
    _PERIOD,
    _DERIVED,
) = range(len(PART))
_PART_SIZE = 8 * len(PART)


class Feed(IntEnum):
    """How the inputs of a part are set for a step."""

    ROW = 0  # not at all: they stand in the row, side by side
    HELD = 1  # as they were when the step began, which is every step of the master
    ANY = 2


#: What the columns of the table of links hold, in this order; gain and offset are float64 in the same bits.
LINK = (
    "source",  # column in a row
    "target",  # place among all inputs
    "period",  # of the source, in steps of the master
    "order",  # of the polynomial
    "scaled",  # whether gain and offset are to be applied, which would lose the sign of zero
    "gain",
    "offset",
)
_SOURCE, _TARGET, _SOURCE_PERIOD, _ORDER, _SCALED, _GAIN, _OFFSET = range(len(LINK))
_LINK_SIZE = 8 * len(LINK)

#: Returned by `advance` in place of a component's status when an output is nan or infinite.
NOT_FINITE = -(2**31)
#: The exponent of what is not finite.
_EXPONENT = 0x7FF0_0000_0000_0000

_FMI2, _FMI3 = int(Call.FMI2), int(Call.FMI3)
_ROW, _HELD = int(Feed.ROW), int(Feed.HELD)
_call_step = caller(STEP)


@njit(inline="always")
def address(array: Any) -> Any:
    """Return the address of an array; numba's own is unsigned, and a float64 when something is added."""
    return intp(array.ctypes.data)


@njit(inline="always")
def part_at(parts: Integers, j: int) -> Any:
    """Return a row of the table of parts."""
    return integers_at(address(parts) + _PART_SIZE * j)


@njit(error_model="numpy", inline="always")
def _polynomial(values: Any, row: int, width: int, k: int, source: int, period: int, order: int) -> Any:
    """Return y_0, d1 and d2 of a source at step `k`, of the order that its history allows."""
    newest = (row - k % period) * width + source
    y_0 = values[newest]
    known = min(order, k // period)
    if known == 0:
        return y_0, 0.0, 0.0
    y_1 = values[newest - period * width]
    if known == 1:
        return y_0, y_0 - y_1, 0.0
    return y_0, y_0 - y_1, y_0 - 2.0 * y_1 + values[newest - 2 * period * width]


@njit(error_model="numpy")
def _extrapolate(
    rows: int,
    width: int,
    row: int,
    k: int,
    begin: int,
    length: int,
    h: float,
    link: int,
    derived: int,
    u: int,
) -> None:
    """Set the input of the link at an address from the polynomial through its source; see `gather`."""
    table, numbers, inputs = integers_at(link), doubles_at(link), doubles_at(u)
    target, gain, offset = table[_TARGET], numbers[_GAIN], numbers[_OFFSET]
    period = table[_SOURCE_PERIOD]
    y_0, d1, d2 = _polynomial(doubles_at(rows), row, width, k, table[_SOURCE], period, table[_ORDER])
    a = (begin - (k - k % period)) / period
    if derived > 0:
        tau = period * h
        inputs[target] = gain * (y_0 + a * d1 + 0.5 * a * (a + 1.0) * d2) + offset
        inputs[target + derived] = gain * (d1 + (a + 0.5) * d2) / tau
        inputs[target + 2 * derived] = gain * d2 / (tau * tau)
    else:
        b = a + length / period
        # Of s and of its square: at the end, or their means.
        middle = b if derived < 0 else 0.5 * (a + b)
        square = b * b if derived < 0 else (a * a + a * b + b * b) / 3.0
        inputs[target] = gain * (y_0 + middle * d1 + 0.5 * (square + middle) * d2) + offset


@njit(error_model="numpy", inline="always")
def _scaled(link: Any, numbers: Any, value: float) -> float:
    return numbers[_GAIN] * value + numbers[_OFFSET] if link[_SCALED] else value


@njit(error_model="numpy")
def gather_links(
    rows: int,
    width: int,
    row: int,
    k: int,
    begin: int,
    length: int,
    h: float,
    link: int,
    end: int,
    derived: int,
    u: int,
) -> None:
    """Do what `gather` does, with addresses for arrays and links."""
    values, inputs = doubles_at(rows), doubles_at(u)
    while link < end:
        table, numbers = integers_at(link), doubles_at(link)
        if table[_ORDER] == 0:
            value = values[row * width + table[_SOURCE]]
            inputs[table[_TARGET]] = _scaled(table, numbers, value)
        else:
            _extrapolate(rows, width, row, k, begin, length, h, link, derived, u)
        link += _LINK_SIZE


@njit(cache=True, nogil=True, error_model="numpy")
def gather(
    rows: Matrix,
    row: int,
    k: int,
    begin: int,
    length: int,
    h: float,
    links: Integers,
    first: int,
    last: int,
    derived: int,
    u: Vector,
) -> None:
    """Set the inputs that the links from `first` to `last` feed.

    Parameters
    ----------
    rows, row, k : the table, and its row for the step `k` at which the links read.
    begin, length : of the step that the inputs are for, in steps of the master. `h` : their length, s.
    derived : how many inputs have room for derivatives behind them; 0: the mean over the step is set, -1: the
        value at its end.
    u : all inputs.
    """
    table = address(links)
    link, end = table + _LINK_SIZE * first, table + _LINK_SIZE * last
    gather_links(address(rows), rows.shape[1], row, k, begin, length, h, link, end, derived, address(u))


@njit(error_model="numpy")
def _prepare(rows: int, width: int, row: int, k: int, h: float, part: int, u: int) -> bool:
    """Set the inputs of a part, in any way, for the step after `k`; return whether it makes one.

    If not, its outputs stay as they are.
    """
    table, values = integers_at(part), doubles_at(rows)
    period, derived = table[_PERIOD], table[_DERIVED]
    behind, ahead, end = table[_BEHIND], table[_AHEAD], table[_END]
    if k % period == 0:
        gather_links(rows, width, row, k, k, period, h, behind, ahead, derived, u)
    if (k + 1) % period != 0:
        begin = row * width + table[_Y]
        for c in range(begin, begin + table[_N_Y]):
            values[c + width] = values[c]
        return False
    gather_links(rows, width, row + 1, k + 1, k + 1 - period, period, h, ahead, end, derived, u)
    return True


@njit(error_model="numpy", inline="always")
def step_of(table: Any, t: float, h: float, u: int, y: int) -> Any:
    """Make a step of a part."""
    if table[_CALL] == _FMI2:
        return fmi2_step(t, h, u, y, table[_DATA])
    if table[_CALL] == _FMI3:
        return fmi3_step(t, h, u, y, table[_DATA])
    return _call_step(table[_ADDRESS], (t, h, u, y, table[_DATA]))


@njit(error_model="numpy", inline="always")
def is_finite(y: int, end: int) -> bool:
    """Tell whether all numbers between two addresses are finite."""
    while y < end:
        if integers_at(y)[0] & _EXPONENT == _EXPONENT:
            return False
        y += 8
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def advance(
    rows: Matrix,
    row: int,
    k: int,
    n: int,
    t0: float,
    h: float,
    parts: Integers,
    u: Vector,
    progress: Integers,
) -> tuple[int, int, int]:
    """Make `n` steps from step `k`, whose values are in `row`; the table has `n` more rows below.

    `progress` always has the step and the index of the part that is being made.

    Returns
    -------
    Steps made; the status that ended them (0: none, `NOT_FINITE` or a component's own); index of its part.
    """
    rows_at, width, inputs_at, parts_at = address(rows), rows.shape[1], address(u), address(parts)
    end_of_parts = parts_at + _PART_SIZE * len(parts)
    inputs, doing = doubles_at(inputs_at), integers_at(address(progress))
    now = rows_at + 8 * row * width
    for i in range(n):
        t = t0 + (k + i) * h
        doing[DOING_STEP] = k + i
        values, following = doubles_at(now), now + 8 * width
        part = parts_at
        while part < end_of_parts:
            table = integers_at(part)
            begin, length, inputs_of_part = t, h, table[_U]
            if table[_FEED] == _ROW:
                inputs_of_part += now
            elif table[_FEED] == _HELD:
                link = table[_BEHIND]
                while link < table[_AHEAD]:
                    where, numbers = integers_at(link), doubles_at(link)
                    inputs[where[_TARGET]] = _scaled(where, numbers, values[where[_SOURCE]])
                    link += _LINK_SIZE
            else:
                if not _prepare(rows_at, width, row + i, k + i, h, part, inputs_at):
                    part += _PART_SIZE
                    continue
                period = table[_PERIOD]
                begin, length = t0 + (k + i + 1 - period) * h, period * h
            doing[DOING_PART] = table[_INDEX]
            y = following + 8 * table[_Y]
            status = step_of(table, begin, length, inputs_of_part, y)
            if status != 0:
                return i, status, table[_INDEX]
            if not is_finite(y, y + 8 * table[_N_Y]):
                return i, NOT_FINITE, table[_INDEX]
            part += _PART_SIZE
        now = following
    return n, 0, 0
