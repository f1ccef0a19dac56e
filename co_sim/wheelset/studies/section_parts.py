"""What the sections of a study's report have in common: shares in words, in tables and in the JSON file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from co_sim.wheelset.prose.words import percent
from co_sim.wheelset.reporting.section import Figure, Quantity

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.studies.intervals import Share

__all__ = ["draw", "figure", "per_bank", "share_cells", "share_numbers", "share_words"]

_NO_WINDOWS = "no window"


def share_words(share: Share) -> str:
    """Return a share with its interval in words."""
    return f"{percent(share.value)} ({percent(share.low)} to {percent(share.high)})"


def share_cells(share: Share) -> tuple[Cell, ...]:
    """Return a share and its interval as cells of a table."""
    return percent(share.value), f"{percent(share.low)} to {percent(share.high)}"


def share_numbers(
    name: str, meaning: str, over: str, shares: Sequence[Share]
) -> Iterator[tuple[str, Quantity]]:
    """Yield a row of shares and of the ends of their intervals for report.json, by name."""
    for part in ("value", "low", "high"):
        told = meaning if part == "value" else f"{part} end of the interval of 95 % of: {meaning}"
        key = name if part == "value" else f"{name}_{part}"
        yield key, Quantity([getattr(s, part) for s in shares], "1", told, (over,), _NO_WINDOWS)


def per_bank(values: Sequence[float], unit: str, meaning: str, missing: str = _NO_WINDOWS) -> Quantity:
    """Return a number for each bank."""
    return Quantity(values, unit, meaning, ("bank",), missing)


def figure(key: str, title: str, caption: str, draw: Callable[[], Sheet]) -> Figure:
    """Return a figure whose caption says what it shows."""
    return Figure(key=key, title=title, caption=caption, alt=f"{title} {caption}", draw=draw)


def draw(function: str, *arguments: Any) -> Sheet:
    """Call a function of `co_sim.wheelset.drawing.studies`."""
    from co_sim.wheelset.drawing import studies

    drawn: Sheet = getattr(studies, function)(*arguments)
    return drawn
