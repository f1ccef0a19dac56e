"""What sensors must be like for a wanted error: noise, bandwidth, sample rate; and which set tells most."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from estimator.identifiability.decision import error_probability

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from estimator.identifiability.divergence import Rates

__all__ = ["limit", "ranking"]

#: Relative accuracy of a limit.
_ACCURACY = 1e-3


def limit(
    rates: Callable[[float], Rates],
    *,
    error: float,
    window: float,
    bounds: tuple[float, float],
    better: Literal["more", "less"],
) -> float:
    """Return how far a property of a sensor may go until the best decision errs with probability `error`.

    Parameters
    ----------
    rates : at which a pair of hypotheses is told apart, as a function of the property, such as noise,
        bandwidth or sample rate.
    error : wanted. window : s.
    bounds : between which the limit is looked for, both > 0.
    better : whether ``"more"`` of the property tells more (bandwidth, sample rate) or ``"less"`` (noise).

    Returns
    -------
    The least value that is enough, or the greatest that is allowed. Where the whole range will do, the bound
    that asks least of the sensor; NaN where no value of the range will.
    """
    easy, hard = bounds if better == "more" else bounds[::-1]
    if not (0.0 < bounds[0] < bounds[1] and 0.0 < error < 0.5 and window > 0.0):
        raise ValueError(
            f"sensor design: got bounds {bounds}, error {error:g} and window {window:g} s, expected rising "
            "bounds > 0, an error between 0 and 0.5 and a window > 0; change them"
        )

    def enough(value: float) -> bool:
        return bool(error_probability(rates(value), window).estimate <= error)

    if enough(easy):
        return easy
    if not enough(hard):
        return math.nan
    while abs(math.log(hard / easy)) > _ACCURACY:
        middle = math.sqrt(easy * hard)
        easy, hard = (easy, middle) if enough(middle) else (middle, hard)
    return hard


def ranking(rates: Mapping[str, Rates]) -> tuple[tuple[str, float], ...]:
    """Return the names of sensor sets with their Chernoff rates (1/s), the set that tells most first."""
    pairs = ((name, float(rate.chernoff)) for name, rate in rates.items())
    return tuple(sorted(pairs, key=lambda pair: -pair[1]))
