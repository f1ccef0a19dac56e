"""Signals of a run in a Parquet file that grows while the run goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.errors import InputError, suggestion
from co_sim.observers.file_writer import FileWriter
from co_sim.observers.kinds import WholeNumbers, typed

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.observers.selection import Window
    from co_sim.system import Signal

__all__ = ["ParquetWriter"]

#: Values in a row group: 8 MB, large enough for a reader to be fast, small enough to wait in memory.
_GROUP_VALUES = 2**20

_COMPRESSIONS = ("brotli", "gzip", "lz4", "none", "snappy", "zstd")

#: The kinds that Arrow calls otherwise.
_ARROW_TYPES = {"float64": "double", "float32": "float", "boolean": "bool", "enumeration": "int64"}


class ParquetWriter(FileWriter):
    """Writes signals of one run to a Parquet file while it goes on; needs the extra ``parquet``.

    The columns are ``time`` and the signals under their full names, each of its own type; the metadata of
    a field have ``unit``, ``description`` and ``kind``. At most 8 MB wait in memory. How the file is named
    while the run goes on and after a failure: `FileWriter`; after a failure the metadata of the file have
    the reason in ``stopped``.

    Parameters
    ----------
    path : file to write, in a folder that exists when the run begins.
    patterns : which signals, see `Selection`.
    every : write the start and every so many steps.
    compression : ``"zstd"``, ``"snappy"``, ``"gzip"``, ``"lz4"``, ``"brotli"`` or ``"none"``.

    Raises
    ------
    InputError
        If pyarrow is not installed, `compression` is unknown or `every` is less than 1; when a run begins,
        if a pattern matches no signal or the folder of `path` does not exist.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        patterns: str | Sequence[str] = ("*",),
        every: int = 1,
        *,
        compression: str = "zstd",
    ) -> None:
        super().__init__(path, patterns, every)
        self._pyarrow = _pyarrow()
        if compression not in _COMPRESSIONS:
            raise InputError(
                "compression",
                got=f'"{compression}"',
                expected="a compression of Parquet files",
                remedy=suggestion(compression, _COMPRESSIONS),
            )
        self._compression = compression
        self._writer: Any = None
        self._schema: Any = None
        self._whole = WholeNumbers(())
        self._group = np.empty((0, 0))
        self._rows = 0

    def _open(self, path: Path, window: Window, n_steps: int) -> None:
        from pyarrow.parquet import ParquetWriter as Writer

        self._schema = self._schema_of(window.signals)
        self._whole = WholeNumbers(window.signals)
        n_columns = len(window.signals) + 1
        # Column by column, as Arrow takes them.
        n_rows = min(max(_GROUP_VALUES // n_columns, 1), window.n_rows(n_steps))
        self._group = np.empty((n_columns, n_rows))
        self._rows = 0
        self._writer = Writer(path, self._schema, compression=self._compression)

    def _write(self, time: Vector, table: NDArray[np.float64]) -> None:
        # Here, not when a group is full: an error then would lose the good rows before it.
        self._whole.check(table)
        room = self._group.shape[1]
        done = 0
        while done < len(time):
            count = min(room - self._rows, len(time) - done)
            target = self._group[:, self._rows : self._rows + count]
            target[0] = time[done : done + count]
            target[1:] = table[done : done + count].T
            self._rows, done = self._rows + count, done + count
            if self._rows == room:
                self._flush()

    def _flush(self) -> None:
        columns, self._rows = self._group[:, : self._rows], 0
        kinds = [signal.kind for signal in self._window.signals]
        arrays = [
            self._pyarrow.array(typed(column, kind), type=field.type)
            for column, kind, field in zip(columns, ["float64", *kinds], self._schema, strict=True)
        ]
        self._writer.write_table(self._pyarrow.Table.from_arrays(arrays, schema=self._schema))

    def _close(self, error: BaseException | None) -> None:
        with self._writer:
            if self._rows:
                self._flush()
            if error is not None:
                self._writer.add_key_value_metadata({"stopped": f"{error}"})
        self._group = np.empty((0, 0))

    def _schema_of(self, signals: Sequence[Signal]) -> Any:
        field = self._pyarrow.field
        time = field("time", "double", nullable=False, metadata={"unit": "s", "description": "time"})
        return self._pyarrow.schema(
            [
                time,
                *(
                    field(
                        signal.name,
                        _ARROW_TYPES.get(signal.kind, signal.kind),
                        nullable=False,
                        metadata={
                            "unit": signal.unit,
                            "description": signal.description,
                            "kind": signal.kind,
                        },
                    )
                    for signal in signals
                ),
            ]
        )


def _pyarrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise InputError(
            "ParquetWriter",
            got="no pyarrow",
            expected="the package pyarrow",
            remedy="install it with: pip install 'wheelset-cosim[parquet]', or use CsvWriter",
        ) from error
    return pyarrow
