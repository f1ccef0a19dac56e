"""The section on the places of a known creep curve: what is found at each point, speed and with flanges."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.identifying.answer import REGIONS
from co_sim.wheelset.prose.words import listed, percent
from co_sim.wheelset.reporting.section import Column, Quantity, Section, Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from co_sim.campaign.plan import Value
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.studies.findings import Findings
    from co_sim.wheelset.studies.intervals import Share
    from co_sim.wheelset.studies.study import Study

__all__ = ["place_section"]

_LINEAR, _UNSTABLE = REGIONS.index("linear"), REGIONS.index("unstable")
#: What makes a place, in the order of the arrays: rows of a table, its columns, and a table for each.
_AXES = ("point", "speed", "flanges")
#: A table for plants without flanges and one for plants with them.
_TITLES = {
    False: "Windows right by point and speed",
    True: "Windows right by point and speed, with flange contact",
}
_NOTES = {
    False: "In brackets how many windows there were; they end where the wheelset is 8 mm off the track.",
    True: "In brackets how many windows there were.",
}


def place_section(study: Study, findings: Findings, banks: Sequence[str]) -> Section | None:
    """Return what is found at each place of the curve; ``None`` where its points are not on the grid."""
    if "point" not in study.grid or not findings.cases:
        return None
    values = {name: _values_of(study, name) for name in _AXES}
    shares = {
        (bank, *place): findings.accuracy(bank, "region", _at(findings, place))
        for bank, place in product(banks, product(*values.values()))
    }
    shape = (len(banks), *map(len, values.values()))
    right = np.array([share.value for share in shares.values()]).reshape(shape)
    windows = np.array([share.windows for share in shares.values()]).reshape(shape)[0]
    unstable = findings.column("region") == _UNSTABLE
    mistaken = [int(np.sum(unstable & (findings.column(f"{bank}.region") == _LINEAR))) for bank in banks]
    told = _mistaken_words(banks, mistaken, int(unstable.sum()))
    of_place = "windows at a point, speed (m/s) and with or without flange contact"
    return Section(
        key="places",
        title="Where on the curve, and how fast, is the region right?",
        words=(told,),
        numbers={
            "unstable_windows": Quantity(int(unstable.sum()), "1", "windows of an unstable wheelset"),
            "unstable_called_linear": Quantity(mistaken, "1", "of these, called linear", ("bank",)),
            "right": Quantity(right, "1", f"share right of the {of_place}", ("bank", *_AXES), "no window"),
            "windows": Quantity(windows, "1", of_place, _AXES),
        },
        axes={"bank": list(banks), **values},
        tables=tuple(_tables(values, banks, shares)),
        summary=(told,),
    )


def _values_of(study: Study, name: str) -> list[Value]:
    """Return the values that a quantity of the trials has on the grid, or the one it has in all of them."""
    trial = study.trial(next(study.cases()))
    return list(study.grid.get(name, (getattr(trial, name),)))


def _at(findings: Findings, place: Sequence[Value]) -> Any:
    """Return where (n,) the windows of a place are; a quantity that is not on the grid has one value."""
    on_grid = [(name, value) for name, value in zip(_AXES, place, strict=True) if name in findings.cases[0]]
    return np.logical_and.reduce([findings.of_case(name) == value for name, value in on_grid])


def _mistaken_words(banks: Sequence[str], mistaken: Sequence[int], windows: int) -> str:
    if windows == 0:
        return "No window is of an unstable wheelset."
    counts = listed([f"{count} by the {bank} bank" for bank, count in zip(banks, mistaken, strict=True)])
    return f"Of {windows} windows of an unstable wheelset, these are called linear: {counts}."


def _tables(
    values: dict[str, list[Value]], banks: Sequence[str], shares: dict[tuple[Value, ...], Share]
) -> Iterator[Table]:
    columns = (Column("point"), Column("bank"), *(Column(f"{speed:g} m/s") for speed in values["speed"]))
    for flanges in values["flanges"]:
        rows = [
            (point, bank, *(_cell(shares[bank, point, speed, flanges]) for speed in values["speed"]))
            for point, bank in product(values["point"], banks)
        ]
        yield Table(_TITLES[bool(flanges)], columns, tuple(rows), _NOTES[bool(flanges)])


def _cell(share: Share) -> Cell:
    return f"{percent(share.value)} ({share.windows})" if share.windows else None
