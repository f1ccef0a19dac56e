"""A bar that shows on a terminal how far a run is."""

from __future__ import annotations

import time as clocks
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from rich.console import Console
    from rich.progress import Progress as Bar

    from co_sim.component import Vector
    from co_sim.system import Signal

__all__ = ["Progress"]

#: The bar is written anew at this interval, s; more often than one can read costs the run time.
_INTERVAL = 0.1


class Progress:
    """Shows simulated time, real-time factor and remaining time; silent where there is no terminal.

    Parameters
    ----------
    title : text in front of the bar.
    console : where to draw; standard error by default, so that printed results stay clean.
    clock : returns a time that never runs backwards, s.
    """

    def __init__(
        self,
        title: str = "Co-simulation",
        console: Console | None = None,
        *,
        clock: Callable[[], float] = clocks.monotonic,
    ) -> None:
        self._title = title
        self._console = console
        self._clock = clock
        self._bar: Bar | None = None
        self._t0 = self._stop = self._step = 0.0
        self._origin = self._shown = 0.0
        self._done = 0

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Draw the empty bar."""
        from rich import console, progress

        terminal = self._console or console.Console(stderr=True)
        if not terminal.is_terminal:
            return
        self._t0, self._step, self._stop, self._done = t0, h, t0 + n_steps * h, 0
        self._origin = self._shown = self._clock()
        self._bar = progress.Progress(
            progress.TextColumn("{task.description}"),
            progress.BarColumn(),
            progress.TaskProgressColumn(),
            progress.TextColumn("{task.fields[text]}"),
            progress.TimeRemainingColumn(),
            console=terminal,
            auto_refresh=False,
        )
        self._bar.add_task(self._title, total=n_steps, text=self._text())
        self._bar.start()

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """Move on, if the last time is long enough ago."""
        if self._bar is None:
            return
        self._done = k + np.size(time) - 1
        now = self._clock()
        if k == 0:
            # The time that components take to start says nothing about the speed of the run.
            self._origin = now
        if now - self._shown >= _INTERVAL:
            self._shown = now
            self._draw(self._bar)

    def end(self, error: BaseException | None) -> None:
        """Leave the bar where the run has come to."""
        bar, self._bar = self._bar, None
        if bar is not None:
            self._draw(bar)
            bar.stop()

    def _draw(self, bar: Bar) -> None:
        bar.update(bar.task_ids[0], completed=self._done, text=self._text(), refresh=True)

    def _text(self) -> str:
        simulated, elapsed = self._done * self._step, self._clock() - self._origin
        factor = f"{simulated / elapsed:.3g}" if elapsed > 0.0 else "-"
        return f"t = {self._t0 + simulated:.6g} of {self._stop:.6g} s, {factor} x real time"
