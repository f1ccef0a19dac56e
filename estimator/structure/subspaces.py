"""Ranks: which part of a model some inputs reach, and which part some outputs see.

The staircase algorithm grows the space reached through B, A B, A^2 B, ... by orthonormal directions and
looks at the size of what each step adds. It works in `natural_scales`: unscaled, entries from 1e-3 to 1e6
would let the units decide the rank.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.structure.scaling import natural_scales, scaled
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from estimator.structure.scaling import Scales

__all__ = ["TOLERANCE", "Rank", "controllability_rank", "observability_rank", "observable_part"]

Array = NDArray[np.float64]

#: What counts as zero against the norm of the scaled model: rounding errors and a little room.
TOLERANCE = 1e-13


@dataclass(frozen=True, eq=False)
class Rank:
    """The part of a model that inputs reach or outputs see.

    Parameters
    ----------
    kind : controllability or observability. signals : the inputs or outputs asked for. states : all states.
    rank : dimension of the reached or seen part.
    singular_values : (n,) what each direction added when it was found, relative to the scaled model, in the
        order found; those from `rank` on were counted as zero. A small one is a weak coupling, not yet a
        short distance to a loss of rank: for that see `distance`.
    tolerance : a singular value up to this counts as zero.
    hidden : (n, n - rank) orthonormal directions in scaled units that are not reached or not seen.
    """

    kind: Literal["controllability", "observability"]
    signals: tuple[str, ...]
    states: tuple[str, ...]
    rank: int
    singular_values: Array
    tolerance: float
    hidden: Array

    @property
    def full(self) -> bool:
        """Whether all of the model is reached or seen."""
        return self.rank == len(self.states)

    @property
    def hidden_states(self) -> tuple[str, ...]:
        """Names of the states with more than half of their direction in the hidden part, most first."""
        shares = np.sum(np.square(self.hidden), axis=1)
        return tuple(self.states[i] for i in np.argsort(-shares, kind="stable") if shares[i] > 0.5)


def controllability_rank(
    model: control.StateSpace | LinearSystem,
    inputs: Sequence[str] | None = None,
    *,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> Rank:
    """Return what some inputs (all if ``None``) reach; scaled with all of the model's signals.

    Raises
    ------
    ValueError
        If the model has no input of that name.
    """
    system = scaled(as_system(model), scales).select(inputs=inputs)
    return _rank("controllability", system, tolerance)


def observability_rank(
    model: control.StateSpace | LinearSystem,
    outputs: Sequence[str] | None = None,
    *,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> Rank:
    """Return what some outputs (all if ``None``) see; scaled with all of the model's signals.

    Raises
    ------
    ValueError
        If the model has no output of that name.
    """
    system = scaled(as_system(model), scales).select(outputs=outputs)
    return _rank("observability", system.dual, tolerance)


def _rank(kind: Literal["controllability", "observability"], system: LinearSystem, tolerance: float) -> Rank:
    reached, added = staircase(system.A, system.B, tolerance)
    values = np.zeros(system.order)
    values[: min(added.size, system.order)] = added[: system.order]
    hidden = linalg.null_space(reached.T) if reached.shape[1] else np.eye(system.order)
    return Rank(kind, system.inputs, system.states, reached.shape[1], values, tolerance, hidden)


def staircase(A: Array, B: Array, tolerance: float) -> tuple[Array, Array]:
    """Return an orthonormal basis (n, rank) of what B reaches through A, and what each direction added.

    Columns of B count as unit vectors and A as of norm one. The first `rank` sizes were above `tolerance`,
    in the order of the basis; the rest were not.
    """
    columns = np.linalg.norm(B, axis=0)
    step = A / max(np.linalg.norm(A, 2), np.finfo(float).tiny)
    reached, new = np.zeros((A.shape[0], 0)), B / np.where(columns > 0.0, columns, 1.0)
    kept: list[float] = []
    dropped: list[float] = []
    while new.shape[1] > 0:
        for _ in range(2):  # twice is enough for orthogonality to rounding
            new = new - reached @ (reached.T @ new)
        U, sizes, _ = np.linalg.svd(new, full_matrices=False)
        large = sizes > tolerance
        kept += sizes[large].tolist()
        dropped += sizes[~large].tolist()
        reached = np.hstack([reached, U[:, large]])
        new = step @ U[:, large]
    return reached, np.array(kept + sorted(dropped, reverse=True))


def observable_part(A: Array, C: Array, *, tolerance: float = TOLERANCE) -> list[int]:
    """Return the states on which the part of ``x' = A x`` that ``C x`` can see rests, in order.

    `tolerance` is relative to the norm of the scaled A.
    """
    n, p = A.shape[0], C.shape[0]
    states, outputs = tuple(map(str, range(n))), tuple(map(str, range(p)))
    system = LinearSystem(
        *(A, np.zeros((n, 0)), C, np.zeros((p, 0))), states, (), outputs, states, (), outputs
    )
    system = scaled(system, natural_scales(system))
    seen, _ = staircase(system.A.T, system.C.T, tolerance)
    _, _, pivots = linalg.qr(seen.T, pivoting=True, mode="economic")
    return sorted(int(i) for i in pivots[: seen.shape[1]])
