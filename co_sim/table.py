"""The rows of a run and what the master is about to do with them.

A run that is supervised from another process has both in shared memory (`co_sim.supervisor`); the master
asks a `Table` for room and tells it of its progress without knowing.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from co_sim.kernel import Integers, Matrix

__all__ = ["BLOCK_VALUES", "LONGEST_BLOCK", "PART", "PHASE", "STEP", "Phase", "Table"]

LONGEST_BLOCK = 8192
#: Values in the rows of a block at most: 0.8 MB, which a core keeps in its own cache.
BLOCK_VALUES = 100_000

#: Where the progress has the step that is being made, the part that is making it (counted in the order of
#: steps while the phase is a step, else in the order of the system), the phase, and a count of calls
#: that tells repetitions of a step apart.
STEP, PART, PHASE, CALLS = range(4)


class Phase(IntEnum):
    """What is going on."""

    BETWEEN = 0
    PREPARING = 1
    STARTING = 2
    INITIALISING = 3
    ENTERING = 4
    STEPPING = 5
    CLOSING = 6


class Table:
    """Rows in the memory of this process.

    Parameters
    ----------
    history : rows before the present one that must be kept. width : number of signals.

    Attributes
    ----------
    progress : four integers, see `STEP` and those behind it.
    rows : the values of all signals, row by row. row : which of them is the present one.
    """

    def __init__(self, history: int, width: int) -> None:
        self.history = history
        self.progress: Integers = np.zeros(4, dtype=np.int64)
        self.rows: Matrix = np.zeros((history + 2, width))
        self.row = history
        self._longest = min(LONGEST_BLOCK, BLOCK_VALUES // max(width, 1) + 1)

    def room(self) -> int:
        """Return how many steps may be made at once."""
        return self._longest

    def make_room(self, n: int) -> None:
        """Have `n` rows below the present one, and its history above."""
        if self.row + n < len(self.rows):
            return
        kept = self.rows[self.row - self.history : self.row + 1].copy()
        if self.history + 1 + n > len(self.rows):
            self.rows = np.zeros((self.history + 1 + n, self.rows.shape[1]))
        self.rows[: self.history + 1] = kept
        self.row = self.history

    def tell(self, phase: Phase, step: int, part: int) -> None:
        """Tell what is about to happen."""
        self.progress[:3] = step, part, phase
        self.progress[CALLS] += 1
