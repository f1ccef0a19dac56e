"""A report: its sections with their images, computed over a grid or about one model."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from co_sim.wheelset.reporting.about import described
from co_sim.wheelset.reporting.images import drawn_once, render
from co_sim.wheelset.reporting.json_text import FORMAT, section_json
from co_sim.wheelset.reporting.section import Column, Section, Table
from co_sim.wheelset.reporting.workers import run_tasks

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.images import Image
    from co_sim.wheelset.reporting.section import Cell, MakeSection
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["Report", "over_grid", "with_images"]

_PACKAGES = ("wheelset-cosim", "control", "numpy", "scipy", "matplotlib")


@dataclass(frozen=True)
class Report:
    """Everything of a report.

    Parameters
    ----------
    title : of the page. about : what was assumed, as (subject, sentences).
    setup, grid : the same for report.json; values by axis for the grid, none for a report on one model.
    sections : in reading order. images : by key of the figure.
    """

    title: str
    about: tuple[tuple[str, str], ...]
    setup: Mapping[str, Any]
    grid: Mapping[str, Sequence[str] | Sequence[float]]
    sections: tuple[Section, ...]
    images: Mapping[str, Image]

    def __post_init__(self) -> None:
        for what, keys in (
            ("section", [section.key for section in self.sections]),
            ("figure", [figure.key for section in self.sections for figure in section.figures]),
        ):
            twice = sorted({key for key in keys if keys.count(key) > 1})
            if twice:
                raise ValueError(
                    f"report: got {what} {', '.join(twice)} twice, expected unique keys; rename one"
                )

    @property
    def summary(self) -> tuple[str, ...]:
        """Sentences of all sections."""
        return tuple(text for section in self.sections for text in section.summary)

    @property
    def faults(self) -> tuple[str, ...]:
        """Checks that failed."""
        return tuple(text for section in self.sections for text in section.faults)

    @property
    def brief(self) -> Table | None:
        """The short table: a row for each condition and point; ``None`` if no section has a column for it."""
        columns = {name: cells for section in self.sections for name, cells in section.brief.items()}
        if not columns:
            return None
        rows: list[tuple[Cell, ...]] = [
            (str(condition).replace("_", " "), str(point), *(cells[i][k] for cells in columns.values()))
            for i, condition in enumerate(self.grid["condition"])
            for k, point in enumerate(self.grid["point"])
        ]
        headings = [Column(name) for name in ("rail", "point", *columns)]
        points = dict(self.about).get("Points", "")
        note = f"Two numbers are the least and the largest over the speeds of the grid. {points}".strip()
        return Table("At a glance", tuple(headings), tuple(rows), note)

    def as_json(self) -> dict[str, Any]:
        """Return the content of report.json."""
        return {
            "format": FORMAT,
            "title": self.title,
            "versions": versions(),
            "setup": dict(self.setup),
            "grid": {axis: list(values) for axis, values in self.grid.items()},
            "summary": list(self.summary),
            "faults": list(self.faults),
            "sections": [section_json(section) for section in self.sections],
        }


def versions() -> dict[str, str]:
    """Return the versions of what computed the report, by package."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


def over_grid(
    setup: Setup,
    grid: Grid,
    makers: Sequence[MakeSection],
    *,
    progress: Callable[[int, float], None] = lambda index, share: None,
    processes: int | None = None,
) -> Report:
    """Compute the sections of a report over a grid.

    Parameters
    ----------
    makers : functions of modules, in reading order.
    progress : takes the index of a maker and its share done.
    processes : how many makers run at once, each in a process of its own; ``None`` for as many as this
        machine has cores. 1 runs all here.

    Raises
    ------
    InputError
        If a point of the grid does not exist, or a section cannot be made of what was given.
    """
    grid.resolve(setup.wheelset)
    tasks = [partial(_computed, make, setup, grid) for make in makers]
    done = run_tasks(tasks, progress, processes or min(len(tasks), os.cpu_count() or 1))
    return Report(
        title="What can be seen, steered and identified?",
        about=described(setup, grid),
        setup=setup.as_json(),
        grid=grid.as_json(),
        sections=tuple(section for sections, _ in done for section in sections),
        images={key: image for _, images in done for key, image in images.items()},
    )


def _computed(
    make: MakeSection, setup: Setup, grid: Grid, progress: Callable[[float], None]
) -> tuple[tuple[Section, ...], dict[str, Image]]:
    """Make sections, with nine tenths of the progress, and draw their figures."""
    made = make(setup, grid, lambda share: progress(0.9 * share))
    sections = (made,) if isinstance(made, Section) else tuple(made)
    drawn = with_images(sections)
    progress(1.0)
    return drawn


def with_images(sections: Sequence[Section]) -> tuple[tuple[Section, ...], dict[str, Image]]:
    """Return the sections with their figures drawn, and the images by key."""
    images = {figure.key: render(figure) for section in sections for figure in section.figures}
    return tuple(map(drawn_once, sections)), images
