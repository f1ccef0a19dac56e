"""The section that asks whether three roads lead to one linear model."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.prose.words import number
from co_sim.wheelset.reporting.roads import BOUND, PAIRS, Difference, LinearisedPlant, differences
from co_sim.wheelset.reporting.section import GRID_AXES, Column, Figure, Quantity, Section, Table

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.grid import Grid, GridPoint
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["roads_section"]

Array = NDArray[np.float64]

_TITLE = "Do three roads lead to one linear model?"
_NAMES = {"analytic": "equations", "derivatives": "derivatives", "differences": "differences"}
_PAIR_NAMES = tuple(f"{_NAMES[first]} – {_NAMES[second]}" for first, second in PAIRS)
_AT_REST = "no linear model at zero creepage"
#: Faults that are told one by one.
_TOLD = 5


def roads_section(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> Section:
    """Compare the linear models at every point of the grid that has a creepage."""
    points = grid.resolve(setup.wheelset)
    moving = [at for at in points if at.point.creep > 0.0]
    found: dict[GridPoint, tuple[Difference, ...]] = {}
    with LinearisedPlant(setup.wheelset) as plant:
        for i, at in enumerate(moving):
            found[at] = differences(plant, at, setup.wheelset)
            progress((i + 1) / len(moving))
    values = np.full((len(PAIRS), *grid.shape), np.nan)
    for at, ones in found.items():
        values[(slice(None), *at.index)] = [one.value for one in ones]
    faults = _faults(found)
    return Section(
        key="three_roads",
        title=_TITLE,
        words=tuple(_words(found, len(points) - len(moving), bool(faults))),
        numbers=_numbers(values, found, grid),
        axes={"pair": _PAIR_NAMES},
        tables=(_table(values, grid),) if found else (),
        figures=(_figure(values, grid),) if found else (),
        summary=tuple(_summary(found, bool(faults))),
        faults=faults,
    )


def _worst(found: Mapping[GridPoint, tuple[Difference, ...]]) -> tuple[GridPoint, Difference]:
    every = [(at, one) for at, ones in found.items() for one in ones]
    return max(every, key=lambda pair: (np.isnan(pair[1].value), pair[1].value))


def _words(found: Mapping[GridPoint, tuple[Difference, ...]], at_rest: int, failed: bool) -> list[str]:
    words = []
    if found:
        at, worst = _worst(found)
        words.append(
            f"{'No' if failed else 'Yes'}. At {len(found)} points of the grid, the largest difference of two "
            f"entries is {number(worst.value, 2)} of the largest entry of its row ({at}; {worst.entry}); "
            f"{number(BOUND, 2)} is allowed."
        )
    if at_rest:
        words.append(
            f"{at_rest} point{'s are' if at_rest > 1 else ' is'} at zero creepage, where nothing is compared "
            f"because the wheelset has no linear model there: with different stiffnesses along and across "
            f"the rail, the slope of the creep law depends on the direction of the creepage however small "
            f"that is. The other sections take the slope along the rail."
        )
    words.append(
        "The roads are equations (12) and (13) in python-control, with the creep law in numpy and its slopes "
        "derived by hand; the directional derivatives that the FMU computes in C; and central differences of "
        "the FMU's right-hand side. All entries of A, B, C and D are compared, each state measured by the "
        "creepage that it causes. Left out is the direct effect of the unmodelled accelerations on the "
        "accelerometer, which the FMU has and (14) has not."
    )
    return words


def _summary(found: Mapping[GridPoint, tuple[Difference, ...]], failed: bool) -> list[str]:
    if not found:
        return []
    _, worst = _worst(found)
    verdict = (
        "The linear models are not those of the FMU"
        if failed
        else "The linear models behind this page are those of the FMU"
    )
    sentence = (
        f"{verdict}: three ways to compute them differ by at most {number(worst.value, 2)} of a row "
        f"(allowed: {number(BOUND, 2)})."
    )
    return [sentence]


def _faults(found: Mapping[GridPoint, tuple[Difference, ...]]) -> tuple[str, ...]:
    told = [
        f"three roads: at {at} the roads {pair} differ by {number(one.value)} of the row in "
        f"{one.entry}, expected at most {number(BOUND)}"
        for at, ones in found.items()
        for pair, one in zip(_PAIR_NAMES, ones, strict=True)
        if not one.is_small
    ]
    rest = len(told) - _TOLD
    return tuple(told[:_TOLD]) + ((f"three roads: {rest} more differences like these",) if rest > 0 else ())


def _numbers(
    values: Array, found: Mapping[GridPoint, tuple[Difference, ...]], grid: Grid
) -> dict[str, Quantity]:
    entries = np.full((len(PAIRS), *grid.shape), _AT_REST, dtype=object)
    for at, ones in found.items():
        entries[(slice(None), *at.index)] = [one.entry for one in ones]
    over = ("pair", *GRID_AXES)
    return {
        "bound": Quantity(BOUND, "1", "largest difference that is allowed"),
        "difference": Quantity(
            values,
            "1",
            "largest difference of two entries over the largest of their row",
            over,
            _missing(found),
        ),
        "entry": Quantity(entries.astype(str), "1", "equation, row and column of that difference", over),
    }


def _missing(found: Mapping[GridPoint, tuple[Difference, ...]]) -> dict[str, str]:
    broken = any(not np.isfinite(one.value) for ones in found.values() for one in ones)
    wrong = "a model has entries that are no finite numbers"
    return {"nan": f"{_AT_REST}, or {wrong}" if broken else _AT_REST, "inf": wrong}


def _table(values: Array, grid: Grid) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for i, condition in enumerate(grid.conditions):
        for k, point in enumerate(grid.point_names):
            if np.isnan(values[:, i, :, k]).all():
                continue
            largest = [float(value) for value in values[:, i, :, k].max(axis=1)]
            rows.append((condition.replace("_", " "), point, *largest))
    columns = (Column("rail"), Column("point"), *map(Column, _PAIR_NAMES))
    return Table("Largest difference over all speeds", columns, tuple(rows))


def _figure(values: Array, grid: Grid) -> Figure:
    return Figure(
        key="three_roads",
        title=_TITLE,
        caption=(
            "Largest difference of two entries of the linear models (12) and (13) over the largest entry of "
            "their row, at each point of the grid. Equations and derivatives differ by rounding, the central "
            "differences by the error of their formula. Models that are equal to the last bit stand at the "
            "bottom; conditions are moved apart a little along the axis."
        ),
        alt=f"Differences of three pairs of roads over speed, all below the bound of {number(BOUND)}."
        if not (values > BOUND).any()
        else "Differences of three pairs of roads over speed, some above the bound.",
        draw=partial(_draw, grid, values),
    )


def _draw(grid: Grid, values: Array) -> Sheet:
    from co_sim.wheelset.drawing.roads import draw_roads

    return draw_roads(grid, _PAIR_NAMES, values, BOUND, _TITLE)
