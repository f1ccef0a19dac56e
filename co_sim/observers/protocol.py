"""What the master calls around and during a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.system import Signal

__all__ = ["Observer"]


class Observer(Protocol):
    """Sees the signals of a run in blocks of consecutive rows, one row for each communication point.

    How a run is cut into blocks says nothing about it: an observer must not depend on it. One that has to
    see the values soon after they are computed has an attribute ``max_block: int | None``, the most rows
    that a block may have for it; the smallest of all observers counts.
    """

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Prepare for `n_steps` of `h` from `t0` (s); an exception prevents the run."""

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """See rows `k`, ``k + 1``, ... of the run, the first block begins with row 0, the initial values.

        Parameters
        ----------
        k : number of the first row.
        time : s, shape ``(n,)``.
        values : shape ``(n, n_signals)``, read-only; both arrays change after the call.
        """

    def end(self, error: BaseException | None) -> None:
        """Learn that the run is over, and what stopped it if it is not complete."""
