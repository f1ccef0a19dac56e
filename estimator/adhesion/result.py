"""What the adhesion bank says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from estimator.adhesion.fuzzy import Verdict

__all__ = ["AdhesionIdentification"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class AdhesionIdentification:
    """What the adhesion bank said, one row for each `every` s; n rows.

    Parameters
    ----------
    time : (n,) s.
    p_region : (n, 3) probabilities of `regions`: linear, peak, unstable.
    p_condition : (n, c) of `conditions`. Both are given that one of the hypotheses holds.
    p_hypothesis : (n, n_h) of `hypotheses`, and p_none : (n,) of none of them; together 1.
    mu_used : (n,) longitudinal force over the load of both wheels, negative when braking.
    mu_max : (n,) peak adhesion, median; mu_max_low, mu_max_high : its interval that holds 90 %.
    identifiable : (n,) whether the data can tell the condition and the peak adhesion.
    fuzzy : what the fuzzy identifier says of the residuals, n rows.
    """

    time: Array
    p_region: Array
    p_condition: Array
    p_hypothesis: Array
    p_none: Array
    mu_used: Array
    mu_max: Array
    mu_max_low: Array
    mu_max_high: Array
    identifiable: Flags
    fuzzy: Verdict
    regions: tuple[str, ...]
    conditions: tuple[str, ...]
    hypotheses: tuple[str, ...]
