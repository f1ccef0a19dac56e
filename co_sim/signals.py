"""Sources: constants, and tables over time."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Literal

import numpy as np

from co_sim.component import Component, Port
from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from co_sim.component import Vector

__all__ = ["Constant", "TimeTable"]

#: A breakpoint counts as reached this fraction of a step early: ``t0 + k*h`` is rounded.
EARLY = 1e-6


class Constant(Component):
    """Outputs that never change.

    Parameters
    ----------
    values : one finite number for each port.
    ports : the outputs.
    """

    def __init__(self, values: Sequence[float], ports: Sequence[Port]) -> None:
        super().__init__((), ports)
        self._values = _finite("values", values)
        if self._values.shape != (len(self.outputs),):
            raise InputError(
                "values",
                got=f"shape {self._values.shape}",
                expected=f"one value for each of {len(self.outputs)} ports",
                remedy="give as many values as ports",
            )

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the values."""
        y[:] = self._values

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Write the values."""
        y[:] = self._values


class TimeTable(Component):
    """Outputs given at breakpoints in time.

    Parameters
    ----------
    times : breakpoints, s, strictly increasing; shape ``(n,)``.
    values : shape ``(n, len(ports))``, or ``(n,)`` for a single port.
    ports : the outputs.
    interpolation : ``"hold"`` keeps each value until the next breakpoint, ``"linear"`` joins them by
        straight lines. Before the first and after the last breakpoint the nearest value holds.
    """

    def __init__(
        self,
        times: Sequence[float],
        values: ArrayLike,
        ports: Sequence[Port],
        interpolation: Literal["hold", "linear"] = "hold",
    ) -> None:
        super().__init__((), ports)
        knots = _checked_times(times)
        table = _finite("values", values)
        self._values = table[:, np.newaxis] if table.ndim == 1 else table
        if self._values.shape != (len(knots), len(self.outputs)):
            raise InputError(
                "values",
                got=f"shape {table.shape}",
                expected=f"{len(knots)} times by {len(self.outputs)} ports",
                remedy="give one row for each time and one column for each port",
            )
        self._times: list[float] = knots.tolist()
        self._slopes = _slopes(knots, self._values, interpolation)
        self._early = 0.0
        self._t0 = 0.0

    def start(self, t0: float, h: float) -> None:
        """Remember the start time and the step."""
        self._t0 = t0
        self._early = EARLY * h

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the values at the start time."""
        self._write(self._t0, y)

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Write the values at the end of the step."""
        self._write(t + h, y)

    def _write(self, t: float, y: Vector) -> None:
        i = max(bisect_right(self._times, t + self._early) - 1, 0)
        np.multiply(self._slopes[i], max(t - self._times[i], 0.0), out=y)
        y += self._values[i]


def _finite(what: str, values: ArrayLike) -> Vector:
    array = np.array(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise InputError(what, got="nan or inf", expected="finite numbers", remedy="remove those entries")
    return array


def _checked_times(times: Sequence[float]) -> Vector:
    knots = _finite("times", times)
    if knots.ndim != 1 or knots.size == 0:
        raise InputError(
            "times",
            got=f"shape {knots.shape}",
            expected="a list of times",
            remedy="give at least one breakpoint",
        )
    backwards = np.flatnonzero(np.diff(knots) <= 0.0)
    if backwards.size:
        i = int(backwards[0])
        raise InputError(
            "times",
            got=f"{knots[i]:g} s before {knots[i + 1]:g} s",
            expected="strictly increasing breakpoints",
            remedy="sort them, and keep one of equal times",
        )
    return knots


def _slopes(knots: Vector, values: Vector, interpolation: str) -> Vector:
    """Return the rate of change after each breakpoint; after the last one nothing changes."""
    slopes = np.zeros_like(values)
    if interpolation == "linear":
        slopes[:-1] = np.diff(values, axis=0) / np.diff(knots)[:, np.newaxis]
    elif interpolation != "hold":
        raise InputError(
            "interpolation",
            got=f'"{interpolation}"',
            expected='"hold" or "linear"',
            remedy="choose one of the two",
        )
    return slopes
