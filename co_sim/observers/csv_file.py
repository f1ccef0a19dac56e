"""Signals of a run in a CSV file that grows while the run goes on; several records in one file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from co_sim.errors import InputError
from co_sim.files import checked_path, whole_file
from co_sim.observers.csv_text import CsvRows, check_digits, csv_line
from co_sim.observers.file_writer import FileWriter
from co_sim.observers.memory import titles
from co_sim.observers.selection import Window, check_every

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from typing import TextIO

    import numpy as np
    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.observers.memory import Record

__all__ = ["CsvWriter", "write_runs_csv"]


class CsvWriter(FileWriter):
    """Writes signals of one run to a CSV file while it goes on, in little memory however long it is.

    The first line has names and units: ``time [s],plant.yaw_rate [rad/s],...``. How the file is named
    while the run goes on and after a failure: `FileWriter`.

    Parameters
    ----------
    path : file to write, in a folder that exists when the run begins.
    patterns : which signals, see `Selection`.
    every : write the start and every so many steps.
    digits : significant digits, 1 to 17; 17 give every value back to the bit. The time has at least 12.

    Raises
    ------
    InputError
        If `every` or `digits` is out of range; when a run begins, if a pattern matches no signal or the
        folder of `path` does not exist.
    """

    _file: TextIO

    def __init__(
        self,
        path: str | os.PathLike[str],
        patterns: str | Sequence[str] = ("*",),
        every: int = 1,
        *,
        digits: int = 9,
    ) -> None:
        super().__init__(path, patterns, every)
        check_digits(digits)
        self._digits = digits
        self._rows = CsvRows((), digits)

    def _open(self, path: Path, window: Window, n_steps: int) -> None:
        self._rows = CsvRows([signal.kind for signal in window.signals], self._digits)
        self._file = path.open("w", encoding="utf-8", newline="")
        self._file.write(csv_line(["time [s]", *titles(window.signals)]))

    def _write(self, time: Vector, table: NDArray[np.float64]) -> None:
        self._file.writelines(self._rows.lines(time, table))

    def _close(self, error: BaseException | None) -> None:
        self._file.close()


def write_runs_csv(
    path: str | os.PathLike[str], runs: Mapping[str, Record], *, every: int = 1, digits: int = 9
) -> None:
    """Write several records below each other, with the name of the run in a first column ``run``.

    Parameters
    ----------
    path : file to write; it is whole or not there.
    runs : at least one record by name, all of the same signals.
    every : write the first row and every so many.
    digits : significant digits, 1 to 17; 17 give every value back to the bit.

    Raises
    ------
    InputError
        If the folder of `path` does not exist, there is no run, the signals of the runs differ, or a
        number is out of range.
    """
    path = checked_path(path)
    check_every(every)
    check_digits(digits)
    headers = {tuple(record.titles) for record in runs.values()}
    if len(headers) != 1:
        raise InputError(
            "runs",
            got=f"{len(headers)} different sets of signals",
            expected="the same signals in all runs",
            remedy="record each run with the same patterns, or write one file for each",
        )
    (header,) = headers
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(csv_line(["run", "time [s]", *header]))
        for name, record in runs.items():
            # Records of other makers than ours hold floating-point signals.
            kinds = getattr(record, "kinds", ["float64"] * len(header))
            rows = CsvRows(kinds, digits, leading=csv_line([name])[:-1] + ",")
            file.writelines(rows.lines(record.time[::every], record.table[::every]))
