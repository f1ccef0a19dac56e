"""Signals of a run in a MATLAB file."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.errors import InputError
from co_sim.observers.file_writer import FileWriter
from co_sim.observers.kinds import typed
from co_sim.observers.memory import room

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from co_sim.component import Kind, Vector
    from co_sim.observers.selection import Window
    from co_sim.system import Signal

__all__ = ["MatWriter", "matlab_names"]

#: MATLAB reads no larger variable from a version 5 file, and a struct is one variable.
_LIMIT = 2**31 - 1

#: Bytes of the header and name of a field, and of a short text in a cell, amply.
_FIELD, _TEXT = 256, 128

#: MATLAB's `namelengthmax`.
_NAME_LENGTH = 63

#: What is no name of a variable or cannot be written as ``plant.end``.
_RESERVED = re.compile(
    "break|case|catch|classdef|continue|else|elseif|end|for|function|global|if|otherwise|parfor|persistent|"
    "return|spmd|switch|try|while"
)

#: Variables beside the structs of the components.
_TIME, _NAMES, _UNITS, _DESCRIPTIONS, _STOPPED = "time", "names", "units", "descriptions", "stopped"


class MatWriter(FileWriter):
    """Writes signals of one run to a MATLAB file (version 5) when the run is over; they wait in memory.

    The file has a column vector ``time`` (s), a struct for each component with a column vector for each
    signal (``plant.yaw_rate``), and structs of the same fields with the full names, units and descriptions
    (``units.plant.yaw_rate``). What MATLAB does not allow in a name becomes ``_``; names that would then be
    equal are numbered. Whole numbers are integers, booleans logical, texts cells of char. How the file is
    named after a failure: `FileWriter`; it then has the reason in ``stopped``.

    Parameters
    ----------
    path : file to write, in a folder that exists when the run begins.
    patterns : which signals, see `Selection`.
    every : write the start and every so many steps.
    compress : smaller file, slower to write.

    Raises
    ------
    InputError
        If `every` is less than 1; when a run begins, if a pattern matches no signal, the folder of
        `path` does not exist, or the signals of a component would take more than 2 GB, which a version 5
        file cannot hold.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        patterns: str | Sequence[str] = ("*",),
        every: int = 1,
        *,
        compress: bool = False,
    ) -> None:
        super().__init__(path, patterns, every)
        self._compress = compress
        self._time = np.empty(0)
        self._columns = np.empty((0, 0))
        self._rows = 0

    def _open(self, path: Path, window: Window, n_steps: int) -> None:
        n_rows = window.n_rows(n_steps)
        self._check_size(n_rows, window.signals)
        self._time = room(f"{self.path}", (n_rows,))
        self._columns = room(f"{self.path}", (len(window.signals), n_rows))
        self._rows = 0

    def _write(self, time: Vector, table: NDArray[np.float64]) -> None:
        i, j = self._rows, self._rows + len(time)
        self._time[i:j] = time
        self._columns[:, i:j] = table.T
        self._rows = j

    def _close(self, error: BaseException | None) -> None:
        from scipy.io import savemat

        signals, columns = self._window.signals, self._columns[:, : self._rows]
        places = _places(signals)
        variables: dict[str, Any] = {
            _TIME: self._time[: self._rows],
            _NAMES: _nested(places, [signal.name for signal in signals]),
            _UNITS: _nested(places, [signal.unit for signal in signals]),
            _DESCRIPTIONS: _nested(places, [signal.description for signal in signals]),
            **_nested(places, [_matlab_values(c, s.kind) for c, s in zip(columns, signals, strict=True)]),
        }
        if error is not None:
            variables[_STOPPED] = f"{error}"
        self._time, self._columns = np.empty(0), np.empty((0, 0))
        savemat(
            self.partial_path,
            {name: value for name, value in variables.items() if not isinstance(value, dict) or value},
            appendmat=False,
            long_field_names=True,
            do_compression=self._compress,
            oned_as="column",
        )

    def _check_size(self, n_rows: int, signals: Sequence[Signal]) -> None:
        for component in dict.fromkeys(signal.component for signal in signals):
            kinds = [signal.kind for signal in signals if signal.component == component]
            size = sum(_FIELD + n_rows * (_TEXT if kind == "string" else 8) for kind in kinds)
            if size > _LIMIT:
                raise InputError(
                    f"{self.path}",
                    got=f'{size / 1e9:.3g} GB of signals of "{component}"',
                    expected="2 GB at most, as much as a version 5 file holds in a struct",
                    remedy="write fewer signals or every so many steps, or use ParquetWriter",
                )


def matlab_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Return a valid, different MATLAB name for each of `names`, none of them in `taken`."""
    used = set(taken)
    valid = []
    for name in names:
        base = re.sub(r"[^0-9A-Za-z_]+", "_", name.replace("]", ""))
        if not base[:1].isalpha() or _RESERVED.fullmatch(base):
            base = f"x_{base}"
        candidate, number = base[:_NAME_LENGTH], 2
        while candidate in used:
            ending = f"_{number}"
            candidate, number = base[: _NAME_LENGTH - len(ending)] + ending, number + 1
        used.add(candidate)
        valid.append(candidate)
    return valid


def _places(signals: Sequence[Signal]) -> list[tuple[str, str]]:
    """Return the struct and the field of each signal."""
    components = list(dict.fromkeys(signal.component for signal in signals))
    structs = matlab_names(components, taken=(_TIME, _NAMES, _UNITS, _DESCRIPTIONS, _STOPPED))
    places: dict[str, tuple[str, str]] = {}
    for component, struct in zip(components, structs, strict=True):
        names = [signal.name for signal in signals if signal.component == component]
        fields = matlab_names(name.partition(".")[2] for name in names)
        places |= {name: (struct, field) for name, field in zip(names, fields, strict=True)}
    return [places[signal.name] for signal in signals]


def _nested(places: Sequence[tuple[str, str]], values: Iterable[Any]) -> dict[str, dict[str, Any]]:
    """Return the values by struct and field."""
    structs: dict[str, dict[str, Any]] = {}
    for (struct, field), value in zip(places, values, strict=True):
        structs.setdefault(struct, {})[field] = value
    return structs


def _matlab_values(column: Vector, kind: Kind) -> NDArray[Any]:
    try:
        return typed(column, kind)
    except ValueError:
        # A whole number that is none: the doubles show it, an error at the end of the run would lose it.
        return column
