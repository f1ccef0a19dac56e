"""Values by their kind: the bus carries every value as a float64."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.texts import text_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from co_sim.component import Kind, Scalar, Vector
    from co_sim.system import Signal

__all__ = ["WholeNumbers", "converter", "dtype_of", "texts", "typed"]

#: The kinds that numpy calls otherwise; the numbers of an FMI 3 enumeration are 64 bits wide.
_DTYPES: dict[Kind, Any] = {"boolean": np.bool_, "enumeration": np.int64, "string": object}


def dtype_of(kind: Kind) -> np.dtype[Any]:
    """Return the type of numpy that holds the values of a kind; texts are objects."""
    dtype: np.dtype[Any] = np.dtype(_DTYPES.get(kind, kind))
    return dtype


def typed(column: Vector, kind: Kind) -> NDArray[Any]:
    """Return carried values as what they are, shape as `column`.

    Raises
    ------
    ValueError
        If a whole number or boolean is to come from a value that is none; rounding would hide it.
    """
    if kind == "string":
        return texts(column)
    dtype = dtype_of(kind)
    if dtype.kind == "f":
        return column.astype(dtype)
    with np.errstate(invalid="ignore"):
        values = column.astype(dtype)
    differing = np.flatnonzero(values != column)
    if differing.size:
        raise ValueError(f"{float(column[differing[0]])!r} is no value of kind {kind}")
    return values


def texts(column: Vector) -> NDArray[np.object_]:
    """Return the texts that numbers stand for, as an array of `str` objects."""
    numbers, where = np.unique(column, return_inverse=True)
    found = np.empty(len(numbers), dtype=object)
    found[:] = [text_of(number) for number in numbers]
    return found[where]


def converter(kind: Kind) -> Callable[[float], Scalar]:
    """Return the function that makes a carried value the Python object that it stands for."""
    if kind == "string":
        return text_of
    return {"f": float, "b": bool}.get(dtype_of(kind).kind, int)


class WholeNumbers:
    """Holds whole numbers and booleans among carried values against what their kinds can hold."""

    def __init__(self, signals: Sequence[Signal]) -> None:
        self._columns = [i for i, signal in enumerate(signals) if dtype_of(signal.kind).kind in "iub"]
        self._signals = [signals[i] for i in self._columns]
        ranges = [_range(dtype_of(signal.kind)) for signal in self._signals]
        self._low, self._high = np.array(ranges, dtype=np.float64).reshape(-1, 2).T

    def check(self, table: NDArray[np.float64]) -> None:
        """Raise a `ValueError` if one of `table`, shape ``(n_rows, n_signals)``, is none of its kind."""
        if not self._columns:
            return
        values = table[:, self._columns]
        fits = (values == np.rint(values)) & (self._low <= values) & (values <= self._high)
        if not fits.all():
            i, j = np.argwhere(~fits)[0]
            signal = self._signals[j]
            raise ValueError(f"{signal.name} = {float(values[i, j])!r} is no value of kind {signal.kind}")


def _range(dtype: np.dtype[Any]) -> tuple[int, int]:
    if dtype.kind == "b":
        return 0, 1
    limits = np.iinfo(dtype)
    return limits.min, limits.max
