"""Observers that write a file, which is never taken for whole when it is not."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim.files import checked_path
from co_sim.observers.selection import Selection, Window

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.system import Signal

    Table = NDArray[np.float64]

__all__ = ["FileWriter"]


class FileWriter(ABC):
    """Writes the chosen signals of one run to a file; a new run replaces it.

    While the run goes on the file is ``NAME.partial.csv``, for example; it becomes ``NAME.csv`` when the
    run is complete. A run that fails leaves what it has computed under the partial name, tells so in a
    note to its error, and leaves the file of an earlier run as it was.

    A subclass writes: `_open`, then `_write` any number of times, then `_close`.

    Parameters
    ----------
    path : file to write, in a folder that exists when the run begins.
    patterns : which signals, see `Selection`.
    every : write the start and every so many steps.

    Raises
    ------
    InputError
        If `every` is less than 1; when a run begins, if a pattern matches no signal or the folder of
        `path` does not exist.
    """

    def __init__(
        self, path: str | os.PathLike[str], patterns: str | Sequence[str] = ("*",), every: int = 1
    ) -> None:
        self.path = Path(path)
        self._selection = Selection(patterns, every)
        self._window = Window((), slice(0), every)
        self._until: float | None = None

    @property
    def partial_path(self) -> Path:
        """The file while the run goes on, and after a run that failed."""
        return self.path.with_name(f"{self.path.stem}.partial{self.path.suffix}")

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Choose the signals and open the file."""
        self._window = self._selection.window(signals)
        self._until = None
        checked_path(self.path)
        try:
            self._open(self.partial_path, self._window, n_steps)
        except BaseException:
            self.partial_path.unlink(missing_ok=True)
            raise

    def observe(self, k: int, time: Vector, values: Table) -> None:
        """Write the chosen rows."""
        times, rows = self._window.rows(k, time, values)
        if len(times):
            self._write(times, rows)
            self._until = float(times[-1])

    def end(self, error: BaseException | None) -> None:
        """Close the file and give it the name that it has earned."""
        try:
            self._close(error)
        except Exception as second:
            if error is None:
                raise
            # The error that stopped the run must not hide behind one that follows from it: a full disk.
            error.add_note(f"while closing {self.partial_path}: {second}")
        if error is None:
            self.partial_path.replace(self.path)
        elif self._until is None:
            self.partial_path.unlink(missing_ok=True)
        else:
            error.add_note(f"{self.partial_path} holds the values up to t = {self._until:.12g} s")

    @abstractmethod
    def _open(self, path: Path, window: Window, n_steps: int) -> None:
        """Prepare to write what `window` chooses of `n_steps` to `path`."""

    @abstractmethod
    def _write(self, time: Vector, table: Table) -> None:
        """Take rows, at least one; the arrays change after the call."""

    @abstractmethod
    def _close(self, error: BaseException | None) -> None:
        """Write what is left and close the file; `error` is what stopped the run."""
