"""Observers of a run, and the one that records signals in memory."""

from __future__ import annotations

import csv
import io
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Protocol

import numpy as np

from co_sim.errors import InputError, suggestion
from co_sim.files import whole_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from typing import TextIO

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.system import Signal

__all__ = ["Observer", "Record", "Recorder", "write_runs_csv"]

#: Rows formatted at a time: enough to spread the cost of a call, few enough to stay small in memory.
_CHUNK = 1000


class Observer(Protocol):
    """What the master calls around and between the steps of a run."""

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Prepare for `n_steps` of `h` from `t0` (s); an exception prevents the run."""

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """See the signals of steps `k`, `k` + 1, ...; `values` is read-only and changes after the call."""

    def end(self, error: BaseException | None) -> None:
        """Learn that the run is over, and what stopped it if it is not complete."""


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
    patterns : names of signals with the wildcards ``*``, ``?`` and ``[...]``, such as ``"plant.*"``.
    every : record the start and every so many steps.

    Raises
    ------
    InputError
        If `every` is less than 1; when a run begins, if a pattern matches no signal.
    """

    def __init__(self, patterns: Sequence[str] = ("*",), every: int = 1) -> None:
        if every < 1:
            raise InputError(
                "every", got=f"{every}", expected="an integer >= 1", remedy="use 1 for all steps"
            )
        self._patterns = tuple(patterns)
        self._every = every
        self.names: tuple[str, ...] = ()
        self.units: tuple[str, ...] = ()
        self._columns: NDArray[np.intp] = np.empty(0, dtype=np.intp)
        self._time = np.empty(0)
        self._table = np.empty((0, 0))
        self._rows = 0

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Choose the signals and make room for the whole run."""
        chosen = _matching(self._patterns, [signal.name for signal in signals])
        self.names = tuple(signals[i].name for i in chosen)
        self.units = tuple(signals[i].unit for i in chosen)
        self._columns = np.array(chosen, dtype=np.intp)
        n_rows = n_steps // self._every + 1
        self._time = np.empty(n_rows)
        self._table = np.empty((n_rows, len(chosen)))
        self._rows = 0

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """Record the start and every so many steps."""
        first = -k % self._every
        rows = slice(self._rows, self._rows + len(time[first :: self._every]))
        self._time[rows] = time[first :: self._every]
        self._table[rows] = values[first :: self._every, self._columns]
        self._rows = rows.stop

    def end(self, error: BaseException | None) -> None:
        """Keep what has been recorded, whatever ended the run."""

    @property
    def time(self) -> Vector:
        """Times of the rows, s, shape ``(n_rows,)``; fewer rows if the run stopped early."""
        return self._time[: self._rows]

    @property
    def table(self) -> NDArray[np.float64]:
        """Signals in the order of `names`, shape ``(n_rows, n_signals)``."""
        return self._table[: self._rows]

    def __getitem__(self, name: str) -> Vector:
        """Return one signal, shape ``(n_rows,)``."""
        if name not in self.names:
            raise KeyError(f'signal "{name}" was not recorded; {suggestion(name, self.names)}')
        return self.table[:, self.names.index(name)]

    def write_csv(self, path: Path) -> None:
        """Write time and signals to a file that is whole or not there; units are in its header.

        Raises
        ------
        InputError
            If the folder of `path` does not exist.
        """
        _check_folder(path)
        with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            file.write(_csv_line(["time [s]", *self.titles]))
            _write_rows(file, self)

    @property
    def titles(self) -> list[str]:
        """Name and unit of each signal."""
        return [f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True)]


def write_runs_csv(path: Path, runs: Mapping[str, Record], *, every: int = 1) -> None:
    """Write several records below each other, with the name of the run in a first column ``run``.

    Parameters
    ----------
    path : file to write; it is whole or not there.
    runs : at least one record by name, all of the same signals.
    every : write the first row and every so many.

    Raises
    ------
    InputError
        If the folder of `path` does not exist, there is no run, or the signals of the runs differ.
    """
    _check_folder(path)
    headers = {tuple(record.titles) for record in runs.values()}
    if len(headers) != 1:
        raise InputError(
            "runs",
            got=f"{len(headers)} different sets of signals",
            expected="the same signals in all runs",
            remedy="record each run with the same patterns, or write one file for each",
        )
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(_csv_line(["run", "time [s]", *headers.pop()]))
        for name, record in runs.items():
            _write_rows(file, record, leading=_csv_line([name]).rstrip("\n") + ",", every=every)


def _matching(patterns: Sequence[str], names: Sequence[str]) -> list[int]:
    """Return the indices of the names that match any pattern, in the order of the names."""
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise InputError(
                f'pattern "{pattern}"',
                got="no match",
                expected="at least one signal",
                remedy=suggestion(pattern, names),
            )
    return [i for i, name in enumerate(names) if any(fnmatchcase(name, pattern) for pattern in patterns)]


def _write_rows(file: TextIO, record: Record, leading: str = "", every: int = 1) -> None:
    """Write the rows of a record; formatting many at once is several times faster than one by one."""
    rows = np.column_stack([record.time, record.table])[::every]
    line = leading.replace("%", "%%") + ",".join(["%.9g"] * rows.shape[1]) + "\n"
    for i in range(0, len(rows), _CHUNK):
        chunk = rows[i : i + _CHUNK]
        file.write(line * len(chunk) % tuple(chunk.ravel().tolist()))


def _csv_line(fields: Sequence[str]) -> str:
    """Return a line of text fields, quoted where a comma or a quote in them asks for it."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(fields)
    return line.getvalue()


def _check_folder(path: Path) -> None:
    if not path.parent.is_dir():
        raise InputError(
            f"{path}", got=f"no folder {path.parent}", expected="an existing folder", remedy="create it first"
        )
