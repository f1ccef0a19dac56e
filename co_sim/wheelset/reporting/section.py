"""A section of a report: a question, its answer in words, the numbers behind it, tables and figures."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from matplotlib.figure import Figure as Drawn

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["GRID_AXES", "Cell", "Column", "Figure", "MakeSection", "Quantity", "Section", "Table"]

#: Axes that every report over a grid has, in the order of its arrays.
GRID_AXES = ("condition", "speed", "point")
_KEY = re.compile(r"[a-z][a-z0-9_]*")

#: A text, a number (shown with three digits), or nothing (a dash).
Cell: TypeAlias = "str | float | None"


@dataclass(frozen=True)
class Quantity:
    """A result for the JSON file: a number or an array, with its unit and what it means.

    Parameters
    ----------
    value : bool, int, float, complex, str, or an array (or nested sequences) of these. Complex numbers are
        written as a last axis of length two, real and imaginary part.
    unit : as in ``"m/s2"``; ``"1"`` for none.
    meaning : what it is, in one line.
    over : names of the axes of an array, such as `GRID_AXES`; `Section.axes` tells the values on those that
        are not of the grid.
    missing : why a number is missing, needed where the value is not finite. A text for all; or a text for
        each of ``"nan"``, ``"inf"`` and ``"-inf"`` that occurs. JSON knows no such numbers: they are
        written as null, with their reason and place.

    Raises
    ------
    ValueError
        If the number of axes is wrong, or a missing number has no reason.
    """

    value: Any
    unit: str
    meaning: str
    over: tuple[str, ...] = ()
    missing: str | Mapping[str, str] = ""

    def __post_init__(self) -> None:
        array = np.asarray(self.value)
        if array.dtype.kind not in "biufcU":
            raise ValueError(
                f'quantity "{self.meaning}": got values of type {array.dtype}, expected numbers, truths or '
                f"texts in a full array; make each row as long as the others"
            )
        if array.ndim != len(self.over):
            raise ValueError(
                f'quantity "{self.meaning}": got {array.ndim} axes and the names {list(self.over)}, expected '
                f"a name for each axis; give them in `over`"
            )
        for kind in self._kinds(array):
            if not self.reason(kind):
                raise ValueError(
                    f'quantity "{self.meaning}": got {kind} without a reason, expected one for each number '
                    f"that is not finite; tell it in `missing`"
                )

    @staticmethod
    def _kinds(array: np.ndarray[Any, Any]) -> list[str]:
        if array.dtype.kind not in "fc":
            return []
        parts = (array.real, array.imag) if array.dtype.kind == "c" else (array,)
        tests: dict[str, Callable[[Any], Any]] = {"nan": np.isnan, "inf": np.isposinf, "-inf": np.isneginf}
        return [kind for kind, test in tests.items() if any(test(part).any() for part in parts)]

    def reason(self, kind: str) -> str:
        """Return why a number of a kind (``"nan"``, ``"inf"`` or ``"-inf"``) is missing."""
        return self.missing if isinstance(self.missing, str) else self.missing.get(kind, "")


@dataclass(frozen=True)
class Figure:
    """A figure that is drawn when it is needed.

    Parameters
    ----------
    key : name of the figure and of its files: small letters, digits and underscores.
    title : the question that it answers; the drawing shows it.
    caption : what it shows, with the finding.
    alt : what it shows, for a reader who cannot see it.
    draw : returns a `co_sim.wheelset.drawing.sheet.Sheet` or a matplotlib ``Figure``; called once, under the
        style of all figures (`drawing.sheet.STYLE`).
    """

    key: str
    title: str
    caption: str
    alt: str
    draw: Callable[[], Sheet | Drawn]

    def __post_init__(self) -> None:
        _check_key("figure", self.key)


@dataclass(frozen=True)
class Column:
    """A column of a table: its heading, and the unit below it."""

    name: str
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """A table of the page; `report.json` has the numbers.

    Parameters
    ----------
    columns : the first one tells what the row is about.
    rows : a cell for each column.
    note : what the columns mean, in sentences.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for i, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(
                    f'table "{self.title}": got {len(row)} cells in row {i}, expected {len(self.columns)}; '
                    f"use None for an empty one"
                )


@dataclass(frozen=True)
class Section:
    """One question and everything that answers it.

    Parameters
    ----------
    key : name in the JSON file and of the anchor: small letters, digits and underscores.
    title : the question.
    words : paragraphs generated from the numbers, the answer first.
    numbers : by name; every number in words, tables and figures.
    axes : values on the axes of `numbers` that are not of the grid: names or numbers.
    tables, figures : in reading order.
    summary : sentences for the page of the summary, most important first.
    brief : columns of the short table (terminal and summary): heading and a text for each condition and
        point, ``[condition][point]``; from all speeds.
    faults : what failed in a check; the report says it on top and the command ends with exit code 1.
    """

    key: str
    title: str
    words: tuple[str, ...]
    numbers: Mapping[str, Quantity] = field(default_factory=dict)
    axes: Mapping[str, Sequence[str | float]] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    summary: tuple[str, ...] = ()
    brief: Mapping[str, Sequence[Sequence[str]]] = field(default_factory=dict)
    faults: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_key("section", self.key)
        for name, quantity in self.numbers.items():
            _check_key("quantity", name)
            lengths = dict(zip(quantity.over, np.shape(quantity.value), strict=True))
            for axis, length in lengths.items():
                if axis in self.axes and len(self.axes[axis]) != length:
                    raise ValueError(
                        f"quantity {name}: got {length} values over {axis}, expected {len(self.axes[axis])}; "
                        f"as many as `axes` tells"
                    )
                if axis not in self.axes and axis not in GRID_AXES:
                    raise ValueError(
                        f"quantity {name}: got the axis {axis}, expected one of {', '.join(GRID_AXES)} or of "
                        f"the section's own; tell its values in `axes`"
                    )


def _check_key(what: str, key: str) -> None:
    if not _KEY.fullmatch(key):
        raise ValueError(
            f'{what} "{key}": expected small letters, digits and underscores, a letter first; rename it'
        )


class MakeSection(Protocol):
    """A section of a report over a grid, as a function that a process of its own can import.

    `progress` takes the share done, from 0 to 1.
    """

    def __call__(
        self, setup: Setup, grid: Grid, progress: Callable[[float], None]
    ) -> Section | tuple[Section, ...]:
        """Compute the section, or several that share their computation."""
        ...
