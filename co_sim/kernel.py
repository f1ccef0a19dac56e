"""The compiled loop: all parts of a system, many steps, no interpreter.

The values of a system at successive communication points are rows of one table. Row ``r`` has the
outputs of all components at ``t_k``; each component writes its outputs at ``t_k+1`` straight into row
``r + 1``, so that a table of results costs nothing but its memory.

A *part* is a component as the loop sees it, a row of integers (`PART`). A *link* feeds one element of an
input: where it reads in a row, how often that source is renewed, and the gain and offset to apply. Links
of a part that read what was there when its step began stand before those that read ahead, at the end of
the step (Gauss-Seidel).

Between its samples the source of a link is a polynomial through its newest ones; in terms of
``s = (t - t_newest)/period`` and of the backward differences ``d1`` and ``d2`` ::

    p(s) = y_0 + s d1 + s (s + 1)/2 d2
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from numba import njit

from co_sim.native import STEP, caller, doubles_at, integers_at

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from co_sim.component import Vector

    Integers = NDArray[np.int64]
    Matrix = NDArray[np.float64]

__all__ = ["NOT_FINITE", "PART", "Links", "advance", "gather"]

#: What the columns of the table of parts hold, in this order.
PART = (
    "address",  # of the step function
    "data",  # of the step function
    "u",  # where the part's inputs begin among all inputs
    "n_derived",  # how many inputs have their derivatives behind them; 0: means, -1: values at the end
    "y",  # where the part's outputs begin in a row
    "n_y",
    "period",  # of the part, in steps of the master
    "behind",  # first link that reads when the step of the part begins
    "ahead",  # first link that reads when it ends
    "end",  # the link after the last one
)
_ADDRESS, _DATA, _U, _DERIVED, _Y, _N_Y, _PERIOD, _BEHIND, _AHEAD, _END = range(len(PART))
_N_PART = len(PART)

#: Returned by `advance` in place of a component's status when an output is nan or infinite.
NOT_FINITE = -(2**31)

_call_step = caller(STEP)


class Links(NamedTuple):
    """The links of all parts, each an array over links."""

    source: Integers
    target: Integers
    period: Integers
    order: Integers
    gain: Vector
    offset: Vector


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _polynomial(rows: Matrix, row: int, k: int, source: int, period: int, order: int) -> tuple[float, ...]:
    """Return y_0, d1 and d2 of a source at step `k`, of the order that its history allows."""
    newest = row - k % period
    y_0 = rows[newest, source]
    known = min(order, k // period)
    if known == 0:
        return y_0, 0.0, 0.0
    y_1 = rows[newest - period, source]
    if known == 1:
        return y_0, y_0 - y_1, 0.0
    return y_0, y_0 - y_1, y_0 - 2.0 * y_1 + rows[newest - 2 * period, source]


@njit(cache=True, nogil=True, error_model="numpy")
def _extrapolate(
    rows: Matrix,
    row: int,
    k: int,
    begin: int,
    length: int,
    h: float,
    links: Links,
    j: int,
    derived: int,
    u: Vector,
) -> None:
    """Set the input of the link `j` from the polynomial through its source; see `gather`."""
    target, gain = links.target[j], links.gain[j]
    period = links.period[j]
    y_0, d1, d2 = _polynomial(rows, row, k, links.source[j], period, links.order[j])
    a = (begin - (k - k % period)) / period
    if derived > 0:
        tau = period * h
        u[target] = gain * (y_0 + a * d1 + 0.5 * a * (a + 1.0) * d2) + links.offset[j]
        u[target + derived] = gain * (d1 + (a + 0.5) * d2) / tau
        u[target + 2 * derived] = gain * d2 / (tau * tau)
    else:
        b = a + length / period
        # Of s and of its square: at the end, or their means.
        middle = b if derived < 0 else 0.5 * (a + b)
        square = b * b if derived < 0 else (a * a + a * b + b * b) / 3.0
        u[target] = gain * (y_0 + middle * d1 + 0.5 * (square + middle) * d2) + links.offset[j]


@njit(cache=True, nogil=True, error_model="numpy")
def gather(
    rows: Matrix,
    row: int,
    k: int,
    begin: int,
    length: int,
    h: float,
    links: Links,
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
    for j in range(first, last):
        if links.order[j] == 0:
            u[links.target[j]] = links.gain[j] * rows[row, links.source[j]] + links.offset[j]
        else:
            _extrapolate(rows, row, k, begin, length, h, links, j, derived, u)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(
    rows: Matrix, row: int, k: int, n: int, t0: float, h: float, parts: Integers, links: Links, u: Vector
) -> tuple[int, int, int]:
    """Make `n` steps from step `k`, whose values are in `row`; the table has `n` more rows below.

    Returns
    -------
    Steps made; the status that ended them (0: none, `NOT_FINITE` or a component's own); index of its part.
    """
    # Pointers, not arrays: views of arrays are counted, and indices of arrays may be negative. In this loop
    # both cost more than the arithmetic.
    u_address, rows_address = u.ctypes.data, rows.ctypes.data
    table, values, inputs = integers_at(parts.ctypes.data), doubles_at(rows_address), doubles_at(u_address)
    source, target = integers_at(links.source.ctypes.data), integers_at(links.target.ctypes.data)
    order = integers_at(links.order.ctypes.data)
    gain, offset = doubles_at(links.gain.ctypes.data), doubles_at(links.offset.ctypes.data)
    width = rows.shape[1]
    end_of_parts = len(parts) * _N_PART
    for i in range(n):
        now, following = row + i, row + i + 1
        for part in range(0, end_of_parts, _N_PART):
            period = table[part + _PERIOD]
            first = k + i + 1 - period
            if period == 1 or (k + i) % period == 0:
                for link in range(table[part + _BEHIND], table[part + _AHEAD]):
                    if order[link] == 0:
                        inputs[target[link]] = gain[link] * values[now * width + source[link]] + offset[link]
                    else:
                        derived = table[part + _DERIVED]
                        _extrapolate(rows, now, k + i, k + i, period, h, links, link, derived, u)
            begin = following * width + table[part + _Y]
            end = begin + table[part + _N_Y]
            if period > 1 and (k + i + 1) % period != 0:
                for c in range(begin, end):
                    values[c] = values[c - width]
                continue
            if table[part + _AHEAD] < table[part + _END]:
                ahead, last = table[part + _AHEAD], table[part + _END]
                derived = table[part + _DERIVED]
                gather(rows, following, k + i + 1, first, period, h, links, ahead, last, derived, u)
            status = _call_step(
                table[part + _ADDRESS],
                (
                    t0 + first * h,
                    period * h,
                    u_address + 8 * table[part + _U],
                    rows_address + 8 * begin,
                    table[part + _DATA],
                ),
            )
            if status != 0:
                return i, status, part // _N_PART
            for c in range(begin, end):
                value = values[c]
                if value - value != 0.0:  # nan or infinite; neither minus itself is zero
                    return i, NOT_FINITE, part // _N_PART
    return n, 0, 0
