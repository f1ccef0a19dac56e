"""What the sections on information say in words, from their numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.prose.words import listed, number, percent, quantity
from co_sim.wheelset.reporting.information import ERROR

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.wheelset.reporting.confirmation import Confirmation
    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.information import Limits
    from co_sim.wheelset.reporting.pairs import Design, Pair
    from co_sim.wheelset.reporting.setup import Setup
    from co_sim.wheelset.reporting.slope_bounds import SlopeBounds

__all__ = ["brief_of", "information_summary", "information_words", "sensor_summary", "sensor_words"]

Array = NDArray[np.float64]

_HOUR = 3600.0


def information_words(
    found: Limits, bounds: SlopeBounds, confirmations: Sequence[Confirmation], grid: Grid
) -> list[str]:
    """Return the paragraphs of the section on what can be known, the answer first."""
    words = [_decided(found), _peak(found), _nothing(bounds, grid), _linear(found)]
    if confirmations:
        words.append(_confirmed(confirmations))
    words.append(
        "This follows from the statistics of what the sensors measure of a wheelset on an irregular track, "
        "with track, noise and vehicle known; a method that knows less does worse. It holds for every "
        "method as far as the wheelset moves like the linear model with averaged slopes. Where the motion "
        "is large, its departure from that model could tell more. Only fluctuations count: to take the "
        "creep from the mean of the wheel speeds would need the wheel's radius and the train's speed to a "
        "fraction of the creep."
    )
    return [text for text in words if text]


def _decided(found: Limits) -> str:
    undecided = found.window > found.T
    known = np.isfinite(found.window) | undecided
    if not undecided.any():
        return (
            f"Every rail looked at can be told from all others within {quantity(found.T, 's')} with less "
            f"than {percent(ERROR)} errors."
        )
    share = float(np.mean(undecided[known]))
    i, j, k = np.unravel_index(int(np.nanargmax(np.where(known, found.window, np.nan))), found.window.shape)
    rails = [name for i, name in enumerate(found.conditions) if undecided[i].any()]
    return (
        f"No method can tell the rail from its nearest rival with less than {percent(ERROR)} errors within "
        f"{quantity(found.T, 's')} at {percent(share)} of the points of the map, on {_plain(listed(rails))} "
        f"rail. The longest record, {_length(float(found.window[i, j, k]))}, is needed between "
        f"{_plain(found.conditions[i])} and {_plain(str(found.rival[i, j, k]))} rail at "
        f"{quantity(found.speeds[j], 'm/s')} and {percent(found.shares[k])} of the creep of the peak: at the "
        "same force both have nearly the same slopes, and what differs hides in the noise."
    )


def _length(window: float) -> str:
    return quantity(window, "s", 2) if window < _HOUR else "more than an hour"


def _peak(found: Limits) -> str:
    known = np.isfinite(found.adhesion) & np.isfinite(found.utilisation)
    good = known & (found.adhesion < 0.1)
    if not good.any():
        return "Nowhere on the map can the peak adhesion be known to a tenth of itself."
    low = [found.utilisation[i][good[i]].min() for i in range(len(found.conditions)) if good[i].any()]
    share = float(np.sum(good) / np.sum(known))
    return (
        f"The peak adhesion can be known to a tenth of itself at {percent(share)} of the points; the least "
        f"used part of the adhesion where that is possible is {percent(float(min(low)))}. Below, the curve "
        "is nearly straight, and its slope says little of where it ends."
    )


def _nothing(bounds: SlopeBounds, grid: Grid) -> str:
    blind = [grid.point_names[k] for k in range(len(grid.points)) if np.isinf(bounds.g11[:, :, k]).all()]
    if not blind:
        return ""
    return (
        f"For small signals nothing at all can be known at {listed(blind)}: with the tangent zero the track "
        "does not move the wheelset, and the information about both slopes is exactly zero, however long "
        "the record. On the irregular track of a real line the creep swings around the peak, so that the "
        "averaged slope is not zero; the maps take that into account."
    )


def _linear(found: Limits) -> str:
    texts = []
    for i, condition in enumerate(found.conditions):
        known = np.isfinite(found.amplitude[i])
        share = float(np.mean(found.small[i][known])) if known.any() else 0.0
        texts.append(f"{percent(share)} on {_plain(condition)} rail")
    return (
        "Small-signal theory, with the slopes at a point of the curve, holds where the track moves the "
        f"creep by less than half the way to zero or to the peak: at {listed(texts)}. The maps and decisions "
        "therefore use slopes averaged over that motion; the bounds at the points of the grid are for small "
        "signals."
    )


def _confirmed(confirmations: Sequence[Confirmation]) -> str:
    total = sum(one.decisions for one in confirmations)
    below = [one.pair.name for one in confirmations if not one.holds]
    above = [one.pair.name for one in confirmations if one.low > one.upper]
    text = f"{total} decisions on runs of the nonlinear plant were counted. "
    text += (
        f"For {listed(below)} they err less than the lower bound allows: the plant tells more than the "
        "linear model knows."
        if below
        else "Nowhere did they err less than the lower bound allows."
    )
    if above:
        text += (
            f" For {listed(above)} they err more than the upper bound: there the motion is not that of any "
            "linear model, and a method that knows the creep curve can do better."
        )
    return text


def information_summary(found: Limits, confirmations: Sequence[Confirmation]) -> list[str]:
    """Return the sentences for the page of the summary."""
    sentences = [_decided(found)]
    inside = sum(one.low <= one.upper and one.holds for one in confirmations)
    if confirmations:
        sentences.append(
            f"The limits were held against decisions on runs of the plant: for {inside} of "
            f"{len(confirmations)} pairs of rails the counted errors lie between the bounds."
        )
    return sentences


def brief_of(bounds: SlopeBounds) -> list[list[str]]:
    """Return how well g11 is known, a text for each condition and point, from all speeds."""
    return [[_range(bounds.g11[i, :, k]) for k in range(bounds.g11.shape[2])] for i in range(len(bounds.g11))]


def _range(values: Array) -> str:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "not at all"
    low, high = (_part(float(x)) for x in (finite.min(), finite.max()))
    return low if low == high else f"{low} – {high}"


def _part(value: float) -> str:
    if value > 1.0:
        return "over 100 %"
    return f"{number(100.0 * value, 1)} %" if value >= 1e-3 else "under 0.1 %"


def sensor_words(
    pairs: Sequence[Pair], sets: Sequence[str], rates: Array, designs: Mapping[str, Design], setup: Setup
) -> list[str]:
    """Return the paragraphs of the section on sensors, the answer first."""
    if not pairs:
        alone = "No two rails carry the same force where half the adhesion of one is in use: the force tells."
        return [alone]
    words = [*sensor_summary(pairs, sets, rates)]
    words += [_noise(pairs, designs["noise"], setup), _speed(designs)]
    words.append(
        "Bandwidth is that of a low-pass before the noise; a filter behind the noise loses nothing that the "
        "likelihood could not undo. When the sample rate changes, each sample keeps its noise: a sensor "
        "that averages between samples loses less."
    )
    return words


def sensor_summary(pairs: Sequence[Pair], sets: Sequence[str], rates: Array) -> list[str]:
    """Return the sentences on the ranking of sensor sets."""
    if not pairs:
        return []
    mean = np.exp(np.mean(np.log(rates), axis=1))
    order = np.argsort(-mean)
    best, *rest = (sets[k] for k in order)
    if not rest:
        return []
    parts = [f"{_set(sets[k])} {percent(float(mean[k] / mean[order[0]]))}" for k in order[1:]]
    sentence = (
        f"Of the sets of sensors, {_set(best)} tells most; of its information the others have, as a "
        f"geometric mean over the pairs of rails: {listed(parts)}."
    )
    return [sentence]


def _noise(pairs: Sequence[Pair], design: Design, setup: Setup) -> str:
    hopeless = [p.name for p, value in zip(pairs, design.limit, strict=True) if np.isnan(value)]
    easy = [float(value) for value in design.limit if not np.isnan(value)]
    parts = []
    if easy:
        factor = number(min(easy), 2)
        parts.append(f"the hardest pair that can be decided allows {factor} times the noise assumed")
    if hopeless:
        least = number(float(design.values[0]), 1)
        parts.append(f"even {least} times that noise is too much for {listed(hopeless)}")
    return f"For {percent(ERROR)} errors within {quantity(setup.window, 's')}, {'; '.join(parts)}."


def _speed(designs: Mapping[str, Design]) -> str:
    bandwidth, rate = (designs[name].limit for name in ("bandwidth", "sample_rate"))
    if np.isnan(bandwidth).all() or np.isnan(rate).all():
        return "No bandwidth and no sample rate makes up for that."
    least = quantity(float(np.nanmax(bandwidth)), "Hz", 2), quantity(float(np.nanmax(rate)), "Hz", 2)
    return (
        f"For the pairs that can be decided, a bandwidth of {least[0]} is enough, and a sample rate of "
        f"{least[1]} with the noise of each sample as it is: the wheelset moves slowly, and faster samples "
        "only average noise."
    )


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _set(name: str) -> str:
    return _plain(name).replace("+", " + ")
