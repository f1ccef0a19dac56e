"""What identification says about a log, row by row."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.adhesion import Verdict
    from estimator.log import Log

    Array = NDArray[np.float64]
    Indices = NDArray[np.int64]
    Mask = NDArray[np.bool_]

__all__ = ["CONDITION_NAMES", "REGIONS", "Answer", "row_places"]

#: Regions of the creep curve and conditions of the rail, in the order of the columns.
REGIONS = ("linear", "peak", "unstable")
CONDITION_NAMES = ("dry", "wet", "low", "very_low")


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """What a bank says at n rows.

    Parameters
    ----------
    bank : name of the bank. time : (n,) s. samples : (n,) places of the rows in the log.
    p_region : (n, 3) probabilities of `REGIONS`.
    p_condition : (n, 4) of `CONDITION_NAMES`; None: the bank says nothing about conditions.
    p_none : (n,) probability that no hypothesis of the bank holds; None: the bank does not know.
    mu_used, mu_max, mu_max_low, mu_max_high : (n,) adhesion used and available with the interval of the
        latter, NaN where unknown; None: the bank says nothing about adhesion.
    identifiable : (n,) whether to trust the row.
    fuzzy : what the fuzzy identifier makes of the same filters, n rows, regions and conditions in the order
        of the probabilities; None: the bank has none beside its probabilities.
    notes : what a reader must know about these answers.
    """

    bank: str
    time: Array
    samples: Indices
    p_region: Array
    identifiable: Mask
    p_condition: Array | None = None
    p_none: Array | None = None
    mu_used: Array | None = None
    mu_max: Array | None = None
    mu_max_low: Array | None = None
    mu_max_high: Array | None = None
    fuzzy: Verdict | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def region(self) -> Indices:
        """The most probable region of each row, by its place in `REGIONS`."""
        return np.asarray(self.p_region.argmax(axis=1))

    @property
    def condition(self) -> Indices | None:
        """The most probable condition of each row, by its place in `CONDITION_NAMES`."""
        return None if self.p_condition is None else np.asarray(self.p_condition.argmax(axis=1))


def row_places(log: Log, every: float) -> Indices:
    """Return the last sample of each full stretch of `every` (s) of a log: the place of its row."""
    step = max(round(every / log.h), 1)
    return np.arange(step - 1, len(log), step)
