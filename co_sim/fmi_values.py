"""Values of an FMU in its own types: groups of variables that one call sets or gets."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim import fmi_table as at
from co_sim.texts import number_of, text_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from co_sim.component import Kind, Port, Vector

__all__ = ["FUNCTIONS", "Group", "UnfitError", "grouped", "misfit", "write"]

#: Functions of both versions for each kind of port, such as "Real" of `fmi2SetReal`.
FUNCTIONS: dict[int, dict[Kind, str]] = {
    2: {
        "float64": "Real",
        "int32": "Integer",
        "boolean": "Boolean",
        "enumeration": "Integer",
        "string": "String",
    },
    3: {
        "float64": "Float64",
        "float32": "Float32",
        "int8": "Int8",
        "uint8": "UInt8",
        "int16": "Int16",
        "uint16": "UInt16",
        "int32": "Int32",
        "uint32": "UInt32",
        "int64": "Int64",
        "uint64": "UInt64",
        "boolean": "Boolean",
        "enumeration": "Int64",
        "string": "String",
    },
}
#: What the functions take: code of the type, and numpy's name of it.
_TYPES: dict[tuple[int, str], tuple[int, str]] = {
    (2, "Real"): (at.FLOAT64, "float64"),
    (2, "Integer"): (at.INT32, "int32"),
    (2, "Boolean"): (at.BOOLEAN32, "int32"),
    (3, "Float64"): (at.FLOAT64, "float64"),
    (3, "Float32"): (at.FLOAT32, "float32"),
    (3, "Int8"): (at.INT8, "int8"),
    (3, "UInt8"): (at.UINT8, "uint8"),
    (3, "Int16"): (at.INT16, "int16"),
    (3, "UInt16"): (at.UINT16, "uint16"),
    (3, "Int32"): (at.INT32, "int32"),
    (3, "UInt32"): (at.UINT32, "uint32"),
    (3, "Int64"): (at.INT64, "int64"),
    (3, "UInt64"): (at.UINT64, "uint64"),
    (3, "Boolean"): (at.BOOLEAN8, "uint8"),
}
_BOOLEANS = at.BOOLEAN8, at.BOOLEAN32
_LARGEST = float(np.finfo(np.float32).max)


class UnfitError(Exception):
    """A value that its type, or a float64, cannot hold: position in `u` or `y`, and the value."""

    def __init__(self, position: int, value: float) -> None:
        super().__init__(position, value)
        self.position = position
        self.value = value


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Variables that one call sets or gets.

    Parameters
    ----------
    function : such as ``"Float64"``.
    references : value references of the variables.
    positions : of each of their elements in `u` or `y`.
    values : the elements as C takes them, a numpy array or, of texts, a ctypes array.
    code : of the type, as in `co_sim.fmi_table`; ``None`` for texts.
    """

    function: str
    references: NDArray[np.uint32]
    positions: NDArray[np.int64]
    values: Any
    code: int | None

    @property
    def address(self) -> int:
        """Address of the values."""
        if self.code is None:
            return ctypes.addressof(self.values)
        address: int = self.values.ctypes.data
        return address

    @property
    def limits(self) -> tuple[int, int]:
        """Smallest and largest whole number that may pass."""
        if self.code in {None, at.FLOAT64, at.FLOAT32}:
            return 0, 0
        if self.code in _BOOLEANS:
            return 0, 1
        info = np.iinfo(self.values.dtype)
        return max(int(info.min), -at.EXACT), min(int(info.max), at.EXACT)

    def fill(self, u: Vector) -> None:
        """Write inputs into `values`.

        Raises
        ------
        UnfitError
            If the type cannot hold one of them.
        """
        x = u[self.positions]
        if self.code is None:
            self.values[:] = [text_of(number).encode() for number in x]
            return
        if self.code == at.FLOAT32:
            _check((np.abs(x) <= _LARGEST) | ~np.isfinite(x), self.positions, x)
        elif self.code != at.FLOAT64:
            low, high = self.limits
            _check((x >= low) & (x <= high) & (x == np.floor(x)), self.positions, x)
        self.values[:] = x

    def empty(self, y: Vector) -> None:
        """Write outputs from `values`.

        Raises
        ------
        UnfitError
            If a float64 might round one of them.
        """
        if self.code is None:
            y[self.positions] = [number_of((text or b"").decode(errors="replace")) for text in self.values]
            return
        if self.code in {at.INT64, at.UINT64}:
            fits = (self.values <= at.EXACT) & (self.values >= -at.EXACT)
            _check(fits, self.positions, self.values)
        y[self.positions] = self.values != 0 if self.code in _BOOLEANS else self.values


def _check(fits: NDArray[np.bool_], positions: NDArray[np.int64], values: NDArray[Any]) -> None:
    if not fits.all():
        i = int(np.argmin(fits))
        raise UnfitError(int(positions[i]), values[i].item())


def grouped(version: int, ports: Sequence[Port], references: Mapping[str, int]) -> list[Group]:
    """Return ports as groups, float64 first; within a group they keep their order."""
    members: dict[str, list[tuple[Port, int]]] = {}
    position = 0
    for port in ports:
        members.setdefault(FUNCTIONS[version][port.kind], []).append((port, position))
        position += port.size
    order = list(FUNCTIONS[version].values())
    return [
        _group(version, function, members[function], references)
        for function in sorted(members, key=order.index)
    ]


def _group(
    version: int, function: str, members: Sequence[tuple[Port, int]], references: Mapping[str, int]
) -> Group:
    positions = [np.arange(first, first + port.size) for port, first in members]
    return Group(
        function,
        np.array([references[port.name] for port, _ in members], dtype=np.uint32),
        np.concatenate(positions).astype(np.int64),
        *_buffer(version, function, sum(map(len, positions))),
    )


def _buffer(version: int, function: str, n: int) -> tuple[Any, int | None]:
    if function == "String":
        return (ctypes.c_char_p * n)(), None
    code, dtype = _TYPES[version, function]
    return np.zeros(n, dtype), code


def write(version: int, kind: Kind, values: Sequence[Any]) -> tuple[str, Any, int]:
    """Return the function for values of a variable, the values as C takes them, and their address."""
    function = FUNCTIONS[version][kind]
    buffer, code = _buffer(version, function, len(values))
    buffer[:] = values
    return function, buffer, ctypes.addressof(buffer) if code is None else buffer.ctypes.data


def misfit(causality: str, name: str, kind: Kind, value: float) -> str:
    """Tell that a value of an input or output does not fit."""
    what = f'{causality} "{name}" is {value!r}'
    if causality == "output":
        return f"{what}, and beyond 2**53 not every {kind} is a float64"
    if kind == "float32":
        return f"{what}, which is beyond the largest float32"
    if kind == "boolean":
        return f"{what}, expected 0 or 1"
    info = np.iinfo("int64" if kind == "enumeration" else kind)
    low, high = max(int(info.min), -at.EXACT), min(int(info.max), at.EXACT)
    return f"{what}, expected a whole number from {low} to {high}"
