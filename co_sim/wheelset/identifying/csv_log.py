"""Logs as text: comma, semicolon or tab between the columns, one heading line.

A million rows are read by pyarrow where it is installed and by numpy otherwise; both give every number to the
bit. Only if neither can read the text, it is gone through line by line to tell where the fault is.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

__all__ = ["CsvText", "open_csv"]

#: What loggers write where there is no value, in lower case.
MISSING = (
    "",
    "nan",
    "na",
    "n/a",
    "#n/a",
    "#na",
    "null",
    "none",
    "nil",
    "-",
    "--",
    "---",
    "?",
    "err",
    "error",
)

_DELIMITERS = (",", ";", "\t")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True)
class CsvText:
    """A text of columns.

    Parameters
    ----------
    file : name for messages. headings : of the columns. delimiter : between them.
    data : the lines below the headings. first_line : number of the first of them, from 1.
    decimal_comma : whether numbers are written as ``0,5``. cut : whether the last line broke off.
    """

    file: str
    headings: tuple[str, ...]
    delimiter: str
    data: bytes
    first_line: int
    decimal_comma: bool
    cut: bool

    def numbers(self, indices: Sequence[int]) -> NDArray[np.float64]:
        """Return the columns at `indices` as (rows, columns), NaN where the text has a mark for no value.

        Raises
        ------
        InputError
            If a line has too few columns or one of these columns something else than a number.
        """
        if not self.data.strip():
            return np.empty((0, len(indices)))
        table = _by_arrow(self, indices)
        if table is None:
            table = _by_numpy(self, indices)
        if table is None:
            table = _by_numpy(replace(self, data=_marked(self)), indices)
        if table is None:
            raise _first_fault(self, indices)
        return table


def open_csv(file: str, raw: bytes) -> CsvText:
    """Read the headings of a text.

    Parameters
    ----------
    file : name for messages. raw : content of the file.

    Raises
    ------
    InputError
        If there is no text, or no heading line.
    """
    if raw[:2] in _UTF16:
        raise InputError(
            file, got="text in UTF-16", expected="text in UTF-8", remedy="save it as UTF-8 or plain text"
        )
    raw = raw.removeprefix(b"\xef\xbb\xbf")
    start, line = _after_comments(raw)
    end = raw.find(b"\n", start)
    head = raw[start : end if end >= 0 else None].decode("utf-8", "replace").rstrip("\r")
    if not head.strip():
        raise InputError(
            file,
            got="an empty file",
            expected="a heading line and rows of numbers",
            remedy="check the export",
        )
    delimiter = max(_DELIMITERS, key=head.count)
    headings = tuple(h.strip() for h in next(csv.reader([head], delimiter=delimiter, skipinitialspace=True)))
    if all(_is_number(heading) for heading in headings):
        raise InputError(
            f"{file} line {line}",
            got="numbers",
            expected="the names of the columns",
            remedy="put a line such as time,yaw_rate,lateral_acceleration,speed,traction_torque above them",
        )
    data = raw[end + 1 :] if end >= 0 else b""
    data, cut = _without_broken_line(data, delimiter, len(headings))
    comma = delimiter != "," and re.search(rb"\d,\d", data[:4096]) is not None
    return CsvText(file, headings, delimiter, data, line + 1, comma, cut)


def _after_comments(raw: bytes) -> tuple[int, int]:
    """Return where the first line is that is neither empty nor a comment, and its number."""
    start, line = 0, 1
    while start < len(raw):
        end = raw.find(b"\n", start)
        end = len(raw) if end < 0 else end
        text = raw[start:end].strip()
        if text and not text.startswith((b"#", b"%")):
            break
        start, line = end + 1, line + 1
    return start, line


def _without_broken_line(data: bytes, delimiter: str, n: int) -> tuple[bytes, bool]:
    """Drop a last line that has too few columns because the logger was switched off."""
    body = data.rstrip(b"\r\n\x00 ")
    last = body[body.rfind(b"\n") + 1 :]
    if last and last.count(delimiter.encode()) < n - 1 and len(body) > len(last):
        return body[: len(body) - len(last)], True
    return (body + b"\n" if body else b""), False


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _by_arrow(text: CsvText, indices: Sequence[int]) -> NDArray[np.float64] | None:
    """Return the columns, or ``None`` if pyarrow is missing or cannot read them."""
    try:
        import pyarrow
        from pyarrow import csv as arrow
    except ImportError:
        return None
    names = [str(i) for i in range(len(text.headings))]
    wanted = [names[i] for i in indices]
    missing = [*MISSING, *(m.upper() for m in MISSING), *(m.capitalize() for m in MISSING), "NaN", "#N/A"]
    try:
        table = arrow.read_csv(
            pyarrow.BufferReader(text.data),
            arrow.ReadOptions(column_names=names, block_size=1 << 23),
            arrow.ParseOptions(delimiter=text.delimiter),
            arrow.ConvertOptions(
                include_columns=wanted,
                column_types=dict.fromkeys(wanted, pyarrow.float64()),
                null_values=sorted(set(missing)),
                decimal_point="," if text.decimal_comma else ".",
            ),
        )
    except pyarrow.ArrowException:
        return None
    return np.column_stack([table[name].to_numpy() for name in wanted])


def _by_numpy(text: CsvText, indices: Sequence[int]) -> NDArray[np.float64] | None:
    """Return the columns, or ``None`` if numpy cannot read them."""
    data = re.sub(rb"(?<=\d),(?=\d)", b".", text.data) if text.decimal_comma else text.data
    try:
        return np.loadtxt(
            io.BytesIO(data),
            delimiter=text.delimiter,
            usecols=list(indices),
            quotechar='"',
            comments=None,
            ndmin=2,
            encoding="utf-8",
        )
    except ValueError:
        return None


def _marked(text: CsvText) -> bytes:
    """Return the text with ``nan`` for every mark of a missing value."""
    words = b"|".join(re.escape(word.encode()) for word in sorted(MISSING, key=len, reverse=True) if word)
    end = re.escape(text.delimiter.encode())
    pattern = rb"(?im)(^|" + end + rb')[ ]*"?(?:' + words + rb')?"?[ ]*(?=' + end + rb"|\r?$)"
    # Lines without anything are no rows.
    data = re.sub(rb"(?m)^[ \t]*\r?\n", b"", text.data) if text.delimiter != "\t" else text.data
    return re.sub(pattern, rb"\1nan", data.rstrip(b"\r\n"))


def _first_fault(text: CsvText, indices: Sequence[int]) -> InputError:
    """Return the error that tells the first line which cannot be read."""
    for number, row in _rows(text):
        if len(row) <= max(indices):
            return InputError(
                f"{text.file} line {number}",
                got=f"{len(row)} columns",
                expected=f"{len(text.headings)} as in the headings",
                remedy="mend or delete this line",
            )
        for i in indices:
            cell = row[i].strip()
            if cell.lower() not in MISSING and not _is_number(cell):
                return InputError(
                    f"{text.file} line {number}, column {text.headings[i]}",
                    got=repr(cell),
                    expected=f"a number, or nothing, {', '.join(MISSING[1:4])} where there is none",
                    remedy="mend this cell, or choose another column with --column",
                )
    return InputError(
        text.file, got="text that cannot be read", expected="rows of numbers", remedy="export it as plain CSV"
    )


def _rows(text: CsvText) -> Iterator[tuple[int, list[str]]]:
    lines = io.StringIO(text.data.decode("utf-8", "replace"), newline="")
    reader = csv.reader(lines, delimiter=text.delimiter)
    for row in reader:
        if row:
            yield text.first_line + reader.line_num - 1, row
