"""The least error with which anyone can decide between hypotheses, and the window that a wanted error needs.

For two equally likely hypotheses with a log-likelihood ratio whose cumulant generating function is
``-D_s(T)``:

* upper bound: ``1/2 exp(-D_s*)`` (Chernoff 1952); lower bound: ``(1 - sqrt(1 - exp(-2 D_1/2)))/2`` (Kailath
  1967);
* estimate: the tail probabilities of the likelihood ratio by saddlepoint (Lugannani and Rice 1980), accurate
  to per cents of itself where the bounds are a factor apart.

All functions take rates of one shape and windows that broadcast against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

if TYPE_CHECKING:
    from estimator.identifiability.divergence import Rates

__all__ = ["ErrorProbability", "error_of_many", "error_probability", "window_needed"]

Array = NDArray[np.float64]

#: Windows that are looked at, s.
_SHORTEST, _LONGEST = 1e-6, 1e9
_BISECTIONS = 60


@dataclass(frozen=True, eq=False)
class ErrorProbability:
    """Least achievable probability of a wrong decision: bounds and the estimate between them."""

    lower: Array
    estimate: Array
    upper: Array


def error_probability(rates: Rates, window: ArrayLike) -> ErrorProbability:
    """Return the least error probability of two equally likely hypotheses after `window` s."""
    T = np.asarray(window, dtype=np.float64)
    D = T * rates.chernoff
    upper = 0.5 * np.exp(-D)
    # expm1: where next to nothing is known, one half less a little.
    lower = 0.5 * (1.0 - np.sqrt(-np.expm1(-2.0 * T * rates.bhattacharyya)))
    return ErrorProbability(
        lower, np.clip(_saddlepoint(D, T * rates.curvature, rates.exponent), lower, upper), upper
    )


def _saddlepoint(D: Array, curvature: Array, s: Array) -> Array:
    """Return the mean of the two tail probabilities of the likelihood ratio."""
    tiny = np.finfo(np.float64).tiny
    w, root = np.sqrt(2.0 * np.maximum(D, tiny)), np.sqrt(np.maximum(curvature, tiny))
    density = np.exp(-D) / math.sqrt(2.0 * math.pi)
    tails = 2.0 * ndtr(-w) + density * (1.0 / (s * root) + 1.0 / ((1.0 - s) * root) - 2.0 / w)
    return np.asarray(tails / 2.0)


def window_needed(rates: Rates, error: ArrayLike) -> Array:
    """Return the window (s) after which the best decision errs with probability `error`, or ``inf``.

    Raises
    ------
    ValueError
        If an error is not between 0 and 1/2, what guessing achieves.
    """
    wanted = np.asarray(error, dtype=np.float64)
    if not np.all((wanted > 0.0) & (wanted < 0.5)):
        raise ValueError(
            f"error probability: got {wanted.tolist()}, expected values between 0 and 0.5; guessing errs in "
            "one of two"
        )
    shape = np.broadcast_shapes(wanted.shape, rates.chernoff.shape)
    lower, upper = np.full(shape, math.log(_SHORTEST)), np.full(shape, math.log(_LONGEST))
    for _ in range(_BISECTIONS):
        middle = (lower + upper) / 2.0
        enough = error_probability(rates, np.exp(middle)).estimate <= wanted
        lower, upper = np.where(enough, lower, middle), np.where(enough, middle, upper)
    window = np.where(upper < math.log(_LONGEST), np.exp(upper), np.inf)
    return np.where(np.isnan(rates.chernoff), np.nan, window)


def error_of_many(pairs: ErrorProbability, hypotheses: int) -> ErrorProbability:
    """Return the least error probability of M equally likely hypotheses from those of their pairs.

    Parameters
    ----------
    pairs : (M (M - 1)/2, ...) of all pairs. hypotheses : M.

    In each pair the two err ``2/M`` as often as if they were alone. The sum over all pairs is the upper
    bound and the estimate, the nearest pair the lower bound.
    """
    count = hypotheses * (hypotheses - 1) // 2
    if hypotheses < 2 or pairs.upper.shape[:1] != (count,):
        raise ValueError(
            f"pairs: got {pairs.upper.shape[:1]} of {hypotheses} hypotheses, expected ({max(count, 1)},); "
            "give every pair once"
        )
    share = 2.0 / hypotheses
    upper = np.minimum(share * np.sum(pairs.upper, axis=0), 1.0 - 1.0 / hypotheses)
    return ErrorProbability(
        share * np.max(pairs.lower, axis=0),
        np.minimum(share * np.sum(pairs.estimate, axis=0), upper),
        upper,
    )
