"""Writes logs as CSV, in the columns that `wheelset identify` reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.files import whole_file
from co_sim.observers.csv_text import CsvRows

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

__all__ = ["write_log"]


def write_log(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (T,) of a log, ``time`` among them, under their names."""
    names = [name for name in columns if name != "time"]
    rows = CsvRows(["float64"] * len(names))
    table = np.column_stack([columns[name] for name in names])
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(["time", *names]) + "\n")
        file.writelines(rows.lines(columns["time"], table))
