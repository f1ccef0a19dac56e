"""Values of a run for a Python function, while it goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from co_sim.observers.kinds import converter
from co_sim.observers.selection import Selection, Window

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from co_sim.component import Scalar, Vector
    from co_sim.system import Signal

__all__ = ["Live"]


class Live:
    """Calls a function with values while the run goes on, for a dashboard or a test that stops the run.

    Parameters
    ----------
    function : called with the time (s) and the values by name: float, int, bool or str as their kind
        says. What it raises stops the run.
    patterns : which signals, see `Selection`.
    every : call at the start and after every so many steps; calls of Python cost time.

    Raises
    ------
    InputError
        If `every` is less than 1; when a run begins, if a pattern matches no signal.
    """

    def __init__(
        self,
        function: Callable[[float, Mapping[str, Scalar]], object],
        patterns: str | Sequence[str] = ("*",),
        every: int = 1,
    ) -> None:
        self._function = function
        self._selection = Selection(patterns, every)
        self._window = Window((), slice(0), every)
        self._convert: list[tuple[str, Callable[[float], Scalar]]] = []
        #: The function is called at most so many steps after its values were computed.
        self.max_block: int | None = every

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Choose the signals."""
        self._window = self._selection.window(signals)
        self._convert = [(signal.name, converter(signal.kind)) for signal in self._window.signals]

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """Call the function for each chosen row."""
        times, rows = self._window.rows(k, time, values)
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            named = {name: convert(value) for (name, convert), value in zip(self._convert, row, strict=True)}
            self._function(t, named)

    def end(self, error: BaseException | None) -> None:
        """Forget the run."""
