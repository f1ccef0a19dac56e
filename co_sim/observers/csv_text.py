"""Rows of signals as lines of comma-separated values."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError
from co_sim.observers.kinds import dtype_of, texts

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from co_sim.component import Kind, Vector

__all__ = ["EXACT_DIGITS", "CsvRows", "csv_line"]

#: As many digits give every float64 back.
EXACT_DIGITS = 17

#: Digits of the time at least: 1 us in 10 days, and still 0.3 instead of 0.30000000000000004.
_TIME_DIGITS = 12

#: Rows formatted at a time: enough to spread the cost of a call, few enough to stay small in memory.
_CHUNK = 1000


class CsvRows:
    """Formats times and signals of given kinds, line by line.

    Parameters
    ----------
    kinds : of the signals; texts are quoted where needed, whole numbers and booleans written in full.
    digits : significant digits of floating-point signals, 1 to 17; 17 give every value back to the bit.
    leading : text in front of each line.

    Raises
    ------
    InputError
        If `digits` is not from 1 to 17.
    """

    def __init__(self, kinds: Sequence[Kind], digits: int = 9, leading: str = "") -> None:
        check_digits(digits)
        formats = [f"%.{max(digits, _TIME_DIGITS)}g", *(_format(kind, digits) for kind in kinds)]
        self._line = leading.replace("%", "%%") + ",".join(formats) + "\n"
        self._texts = [i for i, kind in enumerate(kinds, start=1) if kind == "string"]

    def lines(self, time: Vector, table: NDArray[np.float64]) -> Iterator[str]:
        """Yield the lines of many rows at a time: several times faster than one by one."""
        for i in range(0, len(time), _CHUNK):
            rows = np.column_stack([time[i : i + _CHUNK], table[i : i + _CHUNK]])
            yield self._line * len(rows) % tuple(self._cells(rows).ravel().tolist())

    def _cells(self, rows: NDArray[np.float64]) -> NDArray[np.float64] | NDArray[np.object_]:
        if not self._texts:
            return rows
        cells = rows.astype(object)
        for i in self._texts:
            cells[:, i] = [csv_line([text])[:-1] for text in texts(rows[:, i])]
        return cells


def csv_line(fields: Sequence[str]) -> str:
    """Return a line of text fields, quoted where a comma or a quote in them asks for it."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(fields)
    return line.getvalue()


def check_digits(digits: int) -> None:
    """Raise an `InputError` unless `digits` is from 1 to 17."""
    if digits not in range(1, EXACT_DIGITS + 1):
        raise InputError(
            "digits", got=f"{digits}", expected="1 to 17", remedy="use 17 to keep every value to the bit"
        )


def _format(kind: Kind, digits: int) -> str:
    if kind == "string":
        return "%s"
    return f"%.{digits}g" if dtype_of(kind).kind == "f" else f"%.{EXACT_DIGITS}g"
