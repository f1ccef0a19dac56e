"""Which signals and which rows of a run an observer takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError
from co_sim.patterns import matching

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.system import Signal

    Table = NDArray[np.float64]

__all__ = ["Selection", "Window"]


class Selection:
    """Signals by pattern, and every so many rows.

    Parameters
    ----------
    patterns : names of signals, such as ``"plant.*"``, see `co_sim.patterns.matching`; one string or several.
    every : take row 0 and every so many.

    Raises
    ------
    InputError
        If `every` is not a whole number >= 1.
    """

    def __init__(self, patterns: str | Sequence[str] = ("*",), every: int = 1) -> None:
        check_every(every)
        self.patterns = (patterns,) if isinstance(patterns, str) else tuple(patterns)
        self.every = every

    def window(self, signals: Sequence[Signal]) -> Window:
        """Return what is chosen of `signals`, in their order.

        Raises
        ------
        InputError
            If a pattern matches no signal; all such patterns are told.
        """
        chosen = matching(self.patterns, [signal.name for signal in signals])
        return Window(tuple(signals[i] for i in chosen), _columns(chosen), self.every)


@dataclass(frozen=True, slots=True)
class Window:
    """What a `Selection` chooses of the signals of one run.

    Parameters
    ----------
    signals : the chosen ones.
    columns : where they lie in the rows of the run; a slice where they lie side by side, as that needs
        no copy.
    every : row 0 is taken and every so many.
    """

    signals: tuple[Signal, ...]
    columns: slice | NDArray[np.intp]
    every: int

    def n_rows(self, n_steps: int) -> int:
        """Return how many rows are taken of a run of `n_steps`."""
        return n_steps // self.every + 1

    def rows(self, k: int, time: Vector, values: Table) -> tuple[Vector, Table]:
        """Return what is taken of a block that begins with row `k`: times (s) and values.

        Both may be views of the block, and may be empty.
        """
        first = -k % self.every
        times, rows = np.atleast_1d(time)[first :: self.every], np.atleast_2d(values)[first :: self.every]
        return times, rows[:, self.columns]


def check_every(every: int) -> None:
    """Raise an `InputError` unless `every` is a whole number >= 1."""
    if not isinstance(every, int | np.integer) or every < 1:
        raise InputError(
            "every", got=f"{every}", expected="an integer >= 1", remedy="use 1 for all communication points"
        )


def _columns(chosen: Sequence[int]) -> slice | NDArray[np.intp]:
    if chosen and chosen[-1] - chosen[0] + 1 == len(chosen):
        return slice(chosen[0], chosen[-1] + 1)
    return np.array(chosen, dtype=np.intp)
