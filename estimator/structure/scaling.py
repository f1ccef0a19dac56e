"""Units in which the couplings of a model are of one size, so that ranks and margins mean something.

A model in SI units has entries from 1e-3 to 1e6, and there the choice of units decides what looks small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from estimator.structure.system import LinearSystem

__all__ = ["Scales", "natural_scales", "scaled"]

Array = NDArray[np.float64]

_ROUNDS = 5
#: Even the smallest coupling keeps some say: it may be all that ties one part's units to another's.
_LEAST_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Scales:
    """Sizes that count as one, each in the model's own unit.

    Parameters
    ----------
    states : (n,). inputs : (m,). outputs : (p,). time : s; 1 for sampled models.
    """

    states: Array
    inputs: Array
    outputs: Array
    time: float = 1.0

    def __post_init__(self) -> None:
        for name in ("states", "inputs", "outputs", "time"):
            value = np.asarray(getattr(self, name))
            if not np.all(np.isfinite(value) & (value > 0.0)):
                raise ValueError(
                    f"scales of {name}: got {value}, expected finite numbers > 0; "
                    f"give sizes that are usual for each signal"
                )


def natural_scales(system: LinearSystem) -> Scales:
    """Return the scales that bring all nonzero couplings of a system together.

    Least squares of the logarithms (Curtis & Reid 1972), with the units of states, inputs, outputs and of
    time free. Unlike balancing of A they are the same whatever units the model came in, also where one
    part drives another and is not driven back. An entry that ought to be zero but for rounding counts as
    a coupling like any other: set it to zero first. The A of a sampled model has a small entry wherever
    the continuous one has none; there couplings that come out small get less weight in a next round.
    """
    n, m, p = system.order, len(system.inputs), len(system.outputs)
    blocks = np.block([[system.A, system.B], [system.C, system.D]])
    i, j = np.nonzero(blocks)
    # Unknown logarithms: of states and outputs by row, of states and inputs by column, and of time.
    row = np.where(i < n, i, i + m)
    k = np.arange(i.size)
    equations = np.zeros((i.size, n + m + p + 1))
    equations[k, j] = 1.0
    np.subtract.at(equations, (k, row), 1.0)
    equations[i < n, -1] = 0.0 if system.sampled else 1.0
    couplings = np.log(np.abs(blocks[i, j]))
    logs = _weighted(equations, couplings, np.ones(i.size))
    for _ in range(_ROUNDS if system.sampled else 0):
        found = np.exp(np.minimum(couplings + equations @ logs, 0.0))
        logs = _weighted(equations, couplings, np.maximum(np.sqrt(found), _LEAST_WEIGHT))
    sizes = np.exp(logs)
    return Scales(sizes[:n], sizes[n : n + m], sizes[n + m : -1], float(sizes[-1]))


def _weighted(equations: Array, right: Array, weights: Array) -> Array:
    solution, *_ = np.linalg.lstsq(weights[:, None] * equations, -weights * right, rcond=None)
    return np.asarray(solution)


def scaled(system: LinearSystem, scales: Scales | None = None) -> LinearSystem:
    """Return `system` in the units of `scales` (`natural_scales` if ``None``); the names stay.

    Time too is in its scale, so eigenvalues are times that; units read as multiples of the scales.
    """
    s = natural_scales(system) if scales is None else scales
    x = s.states[:, None]
    return replace(
        system,
        A=s.time * system.A / x * s.states,
        B=s.time * system.B / x * s.inputs,
        C=system.C / s.outputs[:, None] * s.states,
        D=system.D / s.outputs[:, None] * s.inputs,
    )


def size(system: LinearSystem) -> float:
    """Return the spectral norm of the whole model, to which margins and distances are relative."""
    blocks = np.block([[system.A, system.B], [system.C, np.zeros_like(system.D)]])
    return max(float(np.linalg.norm(blocks, 2)), np.finfo(np.float64).tiny) if blocks.size else 1.0
