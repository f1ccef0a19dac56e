"""What the benchmark asks of a master."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from masters.cases import Case

    Trajectory = NDArray[np.float64]

__all__ = ["Contender"]


class Contender(ABC):
    """One master, made ready for a case.

    Parameters
    ----------
    case : the coupled system.
    folder : its own, to write into.

    Raises
    ------
    Exception
        Of any type, if the master cannot run the case; its text goes into the table.
    """

    def __init__(self, case: Case, folder: Path) -> None:
        self.case = case
        self.folder = folder

    @abstractmethod
    def run(self, n: int, *, record: bool) -> float:
        """Make `n` steps from time 0 with fresh FMUs; return the wall time of the steps alone, s."""

    @abstractmethod
    def trajectory(self) -> Trajectory:
        """Return the signals at the end of each step of the last run that was recorded.

        A master that keeps nothing on the way returns one row, the end of its last run.
        """
