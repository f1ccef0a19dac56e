"""Reads logs from files: CSV, Parquet and MATLAB."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.errors import InputError
from co_sim.wheelset.identifying.csv_log import open_csv
from co_sim.wheelset.identifying.table import COLUMNS, Columns, choose, convert

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from co_sim.wheelset.identifying.table import Array, Found

__all__ = ["SUFFIXES", "read_columns"]


def read_columns(path: Path, *, renamed: Mapping[str, str], speed: bool = True) -> Columns:
    """Read the columns of a log.

    Parameters
    ----------
    path : file, whose ending tells its format, see `SUFFIXES`.
    renamed : heading in the file by name of `COLUMNS`, for those that differ.
    speed : whether to look for the speed.

    Raises
    ------
    InputError
        If the file or a column cannot be read; the first fault in the values, all faults in the headings.
    """
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path}", got=got, expected="a log file", remedy="check the path")
    read = SUFFIXES.get(path.suffix.lower())
    if read is None:
        raise InputError(
            f"{path}",
            got=f'the ending "{path.suffix}"',
            expected=f"one of {', '.join(SUFFIXES)}",
            remedy="rename or export it",
        )
    wanted = [name for name in COLUMNS if speed or name != "speed"]
    try:
        columns = read(path, wanted, renamed)
    except OSError as error:
        raise InputError(
            f"{path}", got=str(error.strerror or error), expected="a log file", remedy="check the file"
        ) from None
    if columns.values["time"].size == 0:
        raise InputError(
            f"{path.name}", got="no rows", expected="a log with samples", remedy="check the export"
        )
    return columns


def _read_csv(path: Path, wanted: list[str], renamed: Mapping[str, str]) -> Columns:
    text = open_csv(path.name, path.read_bytes())
    found = choose(path.name, text.headings, wanted, renamed)
    table = text.numbers([column.index for column in found.values()])
    values = {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(found)}
    notes = ["The last line broke off and was left out."] if text.cut else []
    return _columns(path.name, text.headings, found, values, notes)


def _read_parquet(path: Path, wanted: list[str], renamed: Mapping[str, str]) -> Columns:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError(
            f"{path}",
            got="no pyarrow to read it",
            expected="the package pyarrow",
            remedy="install it with: pip install 'wheelset-cosim[parquet]', or give a CSV file",
        ) from None
    try:
        schema = parquet.read_schema(path)
        units = [((field.metadata or {}).get(b"unit") or b"").decode() or None for field in schema]
        found = choose(path.name, schema.names, wanted, renamed, units)
        table = parquet.read_table(path, columns=[schema.names[c.index] for c in found.values()])
        values = {
            name: _floats(path.name, column.heading, table[schema.names[column.index]])
            for name, column in found.items()
        }
    except pyarrow.ArrowException as error:
        raise _unreadable(path.name, "Parquet", str(error)) from None
    return _columns(path.name, schema.names, found, values)


def _floats(file: str, heading: str, column: Any) -> Array:
    """Return a column of Arrow; NaN where it has null."""
    import pyarrow

    kind = column.type
    if not (
        pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_decimal(kind)
    ):
        raise _no_numbers(file, heading, str(kind))
    return np.array(column.cast(pyarrow.float64()).to_numpy(), dtype=np.float64)


def _read_mat(path: Path, wanted: list[str], renamed: Mapping[str, str]) -> Columns:
    from scipy.io import loadmat, matlab

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False, chars_as_strings=True)
    except NotImplementedError:
        raise InputError(
            path.name,
            got="a MATLAB 7.3 file (HDF5)",
            expected="a file of version 5 to 7",
            remedy="in MATLAB: save(file, '-v7'), or writetable to CSV",
        ) from None
    except (ValueError, TypeError, IndexError, OverflowError, zlib.error, matlab.MatReadError) as error:
        raise _unreadable(path.name, "MATLAB", str(error)) from None
    arrays = dict(_arrays({k: v for k, v in content.items() if not k.startswith("__")}))
    found = choose(path.name, list(arrays), wanted, renamed)
    values = {name: _vector(path.name, c.heading, arrays[c.heading]) for name, c in found.items()}
    lengths = {found[name].heading: column.size for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(
            path.name,
            got=", ".join(f"{size} values in {heading}" for heading, size in lengths.items()),
            expected="variables of one length",
            remedy="save signals of the same samples",
        )
    return _columns(path.name, list(arrays), found, values)


def _arrays(content: Mapping[str, Any], prefix: str = "") -> Any:
    """Yield the variables of a MATLAB file, those within structs as ``struct.field``."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            fields = {field: getattr(value, field) for field in value._fieldnames}
            yield from _arrays(fields, f"{prefix}{name}.")
        elif np.asarray(value).dtype.kind in "fiub":
            yield prefix + name, np.asarray(value)


def _vector(file: str, heading: str, value: Any) -> Array:
    if value.ndim > 1:
        raise _no_numbers(file, heading, f"an array of shape {value.shape}")
    return np.atleast_1d(value).astype(np.float64)


def _columns(
    file: str,
    headings: Any,
    found: Mapping[str, Found],
    values: Mapping[str, Array],
    notes: list[str] | None = None,
) -> Columns:
    used = {column.index for column in found.values()}
    ignored = tuple(heading for i, heading in enumerate(headings) if i not in used)
    converted, units = convert(file, found, values)
    return Columns(converted, ignored, (*(notes or ()), *units))


def _no_numbers(file: str, heading: str, got: str) -> InputError:
    return InputError(
        f"{file}: column {heading}", got=got, expected="numbers, one for each sample", remedy="convert it"
    )


def _unreadable(file: str, kind: str, reason: str) -> InputError:
    return InputError(
        file,
        got=reason.splitlines()[0] if reason else "nothing readable",
        expected=f"a {kind} file",
        remedy="check how it was written",
    )


#: How to read a file, by its ending.
SUFFIXES: dict[str, Callable[[Path, list[str], Mapping[str, str]], Columns]] = {
    ".csv": _read_csv,
    ".tsv": _read_csv,
    ".txt": _read_csv,
    ".parquet": _read_parquet,
    ".mat": _read_mat,
}
