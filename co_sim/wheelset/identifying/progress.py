"""Shows on a terminal how far an identification is."""

from __future__ import annotations

from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from co_sim.wheelset.identifying.pipeline import Stages

__all__ = ["Shown"]

#: What the work of each stage is, as the bar says it.
_TEXTS = {
    "recording": "Recording the example",
    "reading": "Reading the log",
    "sensors": "Looking for faults of the sensors",
    "design": "Designing the filters",
    "filters": "Running the filters (the first time they are compiled)",
    "advice": "Advising",
    "writing": "Writing the rows",
    "figures": "Drawing figures and writing the report",
}


class Shown(Stages):
    """Stages that move a bar on standard error; silent where there is no terminal.

    The bar is complete when the figures are; stages that a run leaves out are passed over.
    """

    def __init__(self) -> None:
        super().__init__()
        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("Starting", total=len(_TEXTS))

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def begin(self, name: str) -> None:
        """Show what is done now."""
        self._bar.update(self._task, description=_TEXTS[name], completed=list(_TEXTS).index(name))
