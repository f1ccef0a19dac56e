"""Shares and rates with confidence intervals that know that the windows of one case are alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["CONFIDENCE", "Rate", "Share", "paired_difference", "rate_of", "share_of"]

#: Of all intervals.
CONFIDENCE = 0.95
_Z = float(stats.norm.ppf(0.5 + CONFIDENCE / 2.0))


@dataclass(frozen=True, slots=True)
class Share:
    """A share with its interval.

    Parameters
    ----------
    value, low, high : shares; nan without windows. windows, cases : how many there were.
    """

    value: float
    low: float
    high: float
    windows: int
    cases: int


@dataclass(frozen=True, slots=True)
class Rate:
    """Events in a time, with the interval of their rate in events per 1000 s."""

    events: int
    seconds: float
    value: float
    low: float
    high: float


def share_of(right: NDArray[np.bool_], case: NDArray[np.int64]) -> Share:
    """Return the share of windows in which `right` (n,) is true; `case` (n,) tells whose they are.

    Wilson's interval, with as many independent windows as give the variance of the share over cases
    (Kish's design effect). Where all cases agree, each case counts as one window: that they agree within a
    case proves nothing.
    """
    n = right.size
    if n == 0:
        return Share(math.nan, math.nan, math.nan, 0, 0)
    _, index, sizes = np.unique(case, return_inverse=True, return_counts=True)
    hits = np.bincount(index, weights=right.astype(np.float64))
    p, k = float(right.mean()), sizes.size
    spread = float(np.sum((hits - p * sizes) ** 2)) * k / max(k - 1, 1) / n**2
    independent = n if spread <= 0.0 else min(p * (1.0 - p) / spread, float(n))
    if p in {0.0, 1.0}:
        independent = k
    return Share(p, *_wilson(p, independent), n, k)


def _wilson(p: float, n: float) -> tuple[float, float]:
    z2 = _Z**2 / n
    centre = (p + z2 / 2.0) / (1.0 + z2)
    half = _Z / (1.0 + z2) * math.sqrt(p * (1.0 - p) / n + z2 / (4.0 * n))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def rate_of(events: int, seconds: float) -> Rate:
    """Return the rate of rare events with the exact interval of Poisson's law (Garwood 1936)."""
    if seconds <= 0.0:
        return Rate(events, seconds, math.nan, math.nan, math.nan)
    tail = (1.0 - CONFIDENCE) / 2.0
    low = float(stats.chi2.ppf(tail, 2 * events)) / 2.0 if events else 0.0
    # Without events the interval is one-sided: the "rule of three".
    high = float(stats.chi2.ppf(1.0 - tail if events else CONFIDENCE, 2 * events + 2)) / 2.0
    scale = 1000.0 / seconds
    return Rate(events, seconds, events * scale, low * scale, high * scale)


def paired_difference(first: Array, second: Array) -> tuple[float, float, float]:
    """Return the mean of `second` - `first` (n,), which are of the same n cases, and its interval."""
    difference = second - first
    n = difference.size
    if n < 2:
        return float(difference.mean()) if n else math.nan, math.nan, math.nan
    mean = float(difference.mean())
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, n - 1) * difference.std(ddof=1) / math.sqrt(n))
    return mean, mean - half, mean + half
