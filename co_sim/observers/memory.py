"""Signals of a run in memory."""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from co_sim.errors import InputError, suggestion
from co_sim.files import checked_path, whole_file
from co_sim.observers.csv_text import CsvRows, csv_line
from co_sim.observers.kinds import texts, typed
from co_sim.observers.selection import Selection, Window

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from co_sim.component import Kind, Vector
    from co_sim.system import Signal

__all__ = ["Record", "Recorder", "room", "titles"]


class Record(Protocol):
    """Series of signals over time, as `write_runs_csv` takes them; a `Recorder` is one."""

    @property
    def time(self) -> Vector:
        """Times of the rows, s, shape ``(n_rows,)``."""

    @property
    def table(self) -> NDArray[np.float64]:
        """Signals, shape ``(n_rows, n_signals)``."""

    @property
    def titles(self) -> Sequence[str]:
        """Name and unit of each signal, such as ``"plant.yaw_rate [rad/s]"``."""


class Recorder:
    """Records signals of one run in memory; a new run replaces the record of the last.

    Parameters
    ----------
    patterns : which signals, see `Selection`; such as ``"plant.*"`` or ``["*", "!plant.internal.*"]``.
    every : record the start and every so many steps.

    Raises
    ------
    InputError
        If `every` is less than 1; when a run begins, if a pattern matches no signal or the record of
        the whole run does not fit in memory.
    """

    def __init__(self, patterns: str | Sequence[str] = ("*",), every: int = 1) -> None:
        self._selection = Selection(patterns, every)
        self._window = Window((), slice(0), every)
        self._time = np.empty(0)
        self._table = np.empty((0, 0))
        self._rows = 0

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Choose the signals and make room for the whole run."""
        window = self._selection.window(signals)
        n_rows = window.n_rows(n_steps)
        time, table = room("recorder", (n_rows,)), room("recorder", (n_rows, len(window.signals)))
        self._window, self._time, self._table, self._rows = window, time, table, 0

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """Record the chosen rows."""
        times, rows = self._window.rows(k, time, values)
        i, j = self._rows, self._rows + len(times)
        self._time[i:j] = times
        self._table[i:j] = rows
        self._rows = j

    def end(self, error: BaseException | None) -> None:
        """Keep what has been recorded, whatever ended the run."""

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The recorded signals, in the order of the system."""
        return self._window.signals

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each signal."""
        return tuple(signal.name for signal in self.signals)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each signal."""
        return tuple(signal.unit for signal in self.signals)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Kind of each signal, as `Port.kind`."""
        return tuple(signal.kind for signal in self.signals)

    @property
    def titles(self) -> list[str]:
        """Name and unit of each signal."""
        return titles(self.signals)

    @property
    def time(self) -> Vector:
        """Times of the rows, s, shape ``(n_rows,)``; fewer rows if the run stopped early."""
        return self._time[: self._rows]

    @property
    def table(self) -> NDArray[np.float64]:
        """Signals in the order of `names`, shape ``(n_rows, n_signals)``; texts as their numbers."""
        return self._table[: self._rows]

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one signal, shape ``(n_rows,)``: float64, or `str` objects where it is a text."""
        i = self._index(name)
        column = self.table[:, i]
        return texts(column) if self.kinds[i] == "string" else column

    def typed(self, name: str) -> NDArray[Any]:
        """Return one signal as what it is, shape ``(n_rows,)``: such as int32, bool or `str` objects.

        Raises
        ------
        KeyError
            If the signal was not recorded.
        ValueError
            If a whole number or boolean is to come from a value that is none.
        """
        i = self._index(name)
        return typed(self.table[:, i], self.kinds[i])

    def write_csv(self, path: str | os.PathLike[str], *, digits: int = 9) -> None:
        """Write time and signals to a file that is whole or not there; units are in its header.

        Parameters
        ----------
        path : file to write.
        digits : significant digits, 1 to 17; 17 give every value back to the bit.

        Raises
        ------
        InputError
            If the folder of `path` does not exist or `digits` is out of range.
        """
        path, rows = checked_path(path), CsvRows(self.kinds, digits)
        with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            file.write(csv_line(["time [s]", *self.titles]))
            file.writelines(rows.lines(self.time, self.table))

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise KeyError(f'signal "{name}" was not recorded; {suggestion(name, self.names)}')
        return self.names.index(name)


def titles(signals: Sequence[Signal]) -> list[str]:
    """Return name and unit of each signal, such as ``"plant.yaw_rate [rad/s]"``."""
    return [f"{signal.name} [{signal.unit}]" for signal in signals]


def room(what: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return room for values; raise an `InputError` for `what` if there is none."""
    try:
        return np.empty(shape)
    except (MemoryError, ValueError) as error:
        raise InputError(
            what,
            got=f"{' x '.join(map(str, shape))} values, {8e-9 * prod(shape):.3g} GB",
            expected="a record that fits in memory",
            remedy="record fewer signals or every so many steps, or use CsvWriter or ParquetWriter",
        ) from error
