"""Values by their kind: the bus carries every value as a float64."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.texts import text_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from co_sim.component import Kind, Scalar, Vector

__all__ = ["converter", "dtype_of", "texts", "typed"]

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
        raise ValueError(f"{column[differing[0]]!r} is no value of kind {kind}")
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
