"""What the identification of a log found, in sentences from its numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.prose.words import capital, listed, number, percent, quantity
from estimator.advice import NO_STATEMENT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from co_sim.wheelset.identifying.results import Identified
    from co_sim.wheelset.identifying.status import FaultFound

__all__ = ["answer_sentences", "fault_sentences", "log_sentences"]

#: What each fault is, as a sentence goes on.
_MEANINGS = {
    "dropout": "no value",
    "outlier": "values that nothing before or after explains",
    "saturation": "values at the end of its range",
    "stuck": "the same value all the time while the other sensor moved",
    "bias": "a mean that no wheelset on straight track has",
    "jitter": "time stamps off the uniform grid",
    "gap": "no rows",
}
#: Share of the rows from which on an answer is called that of the log.
_MOST = 0.9


def answer_sentences(done: Identified) -> list[str]:
    """Say what the bank found, from the most to the least important."""
    return list(_answers(done))


def _answers(done: Identified) -> Iterator[str]:
    share = done.identifiable_share
    if share == 0.0:
        yield (
            "No row of this log is identifiable: the most probable values in identification.csv are not to "
            "be trusted."
        )
        return
    yield f"{capital(percent(share))} of the rows are identifiable; what follows is about those."
    yield f"On the creep curve the wheelset was {_ran(done.region_shares or {})}."
    if done.condition_shares is not None:
        yield f"The rail was most probably {_most(done.condition_shares)}."
    yield from _adhesion(done)
    yield from _advice(done)
    yield from _fuzzy(done)


def _ran(shares: dict[str, float]) -> str:
    """Return where the wheelset ran, the longest first."""
    places = {"linear": "in the linear region", "peak": "at the peak", "unstable": "in the unstable region"}
    ranked = sorted(((share, places[name]) for name, share in shares.items() if share > 0.0), reverse=True)
    if len(ranked) == 1:
        return f"always {ranked[0][1]}"
    return f"{listed([f'{place} in {percent(share)}' for share, place in ranked])} of them"


def _most(shares: dict[str, float]) -> str:
    """Return the condition that most rows have, or all of them if none is clear."""
    ranked = sorted((share, name.replace("_", " ")) for name, share in shares.items() if share > 0.0)[::-1]
    share, name = ranked[0]
    if share >= _MOST:
        return f"{name} ({percent(share)} of them)"
    return f"{listed([f'{name} in {percent(share)}' for share, name in ranked])} of them"


def _adhesion(done: Identified) -> Iterator[str]:
    answer, where = done.answer, done.answer.identifiable
    if answer.mu_max is None or answer.mu_max_low is None or answer.mu_max_high is None:
        return
    low, middle, high = (
        float(np.nanmedian(x[where])) for x in (answer.mu_max_low, answer.mu_max, answer.mu_max_high)
    )
    yield (
        f"The available adhesion is {number(middle, 2)} in the median, with an interval from "
        f"{number(low, 2)} to {number(high, 2)}."
    )
    if answer.mu_used is not None and np.isfinite(answer.mu_used[where]).any():
        use = np.abs(answer.mu_used[where]) / np.maximum(answer.mu_max[where], 1e-9)
        yield f"In the median {percent(float(np.nanmedian(use)))} of it was used."


def _advice(done: Identified) -> Iterator[str]:
    shares = {name: s for name, s in done.advice.shares.items() if s > 0.0 and name != NO_STATEMENT}
    if shares:
        said = listed([f"{name} in {percent(share)}" for name, share in shares.items()])
        yield f"The advice, over all rows: {said}."


def _fuzzy(done: Identified) -> Iterator[str]:
    if done.answer.fuzzy is None:
        return
    share, same = float(np.mean(done.answer.fuzzy.clear)), done.same_condition
    if same is None:
        yield "The fuzzy identifier, from the residuals of the last second alone, is nowhere clear."
        return
    yield (
        f"The fuzzy identifier, from the residuals of the last second alone, is clear in {percent(share)} of "
        f"all rows, and names the most probable condition in {percent(same)} of those."
    )


def log_sentences(done: Identified) -> list[str]:
    """Say what the log is and what was done to it before the filters saw it."""
    return list(_log(done))


def _log(done: Identified) -> Iterator[str]:
    clock, log = done.clock, done.log
    yield (
        f"{clock.rows} rows over {quantity(clock.end - clock.start, 's')} at "
        f"{quantity(1.0 / clock.h, 'Hz')}, at {_span(log.speed, 'm/s')}."
    )
    if log.traction_torque is None:
        yield (
            "There is no traction torque in the log. Without it the creep is not known, which costs the "
            "adhesion bank most of what it knows about the rail."
        )
    else:
        yield f"The traction torque is {_span(log.traction_torque, 'N m')}."
    if done.ignored:
        yield f"Columns that were not used: {listed(list(done.ignored))}."
    yield from done.notes
    yield from _clock(done)


def _clock(done: Identified) -> Iterator[str]:
    clock = done.clock
    if clock.resampled:
        yield (
            f"The time stamps are {quantity(clock.jitter_rms, 's')} rms off a uniform grid, so the samples "
            f"were interpolated onto it."
        )
    counts = [
        (clock.duplicated, "with a time that another row has were left out"),
        (clock.unordered, "came late and were sorted in"),
        (clock.undated, "without a time were left out"),
    ]
    for count, text in counts:
        if count:
            yield f"{count} {'row' if count == 1 else 'rows'} {text}."
    if clock.gaps:
        longest = max(until - since for since, until in clock.gaps) + clock.h
        yield (
            f"There {'is 1 gap' if len(clock.gaps) == 1 else f'are {len(clock.gaps)} gaps'} without rows, "
            f"{clock.empty} samples in all, the longest of {quantity(longest, 's')}."
        )


def _span(values: np.ndarray[tuple[int], np.dtype[np.float64]], unit: str) -> str:
    low, high = float(values.min()), float(values.max())
    if high - low <= 0.005 * max(abs(high), abs(low)):
        return quantity((low + high) / 2.0, unit)
    return f"{number(low)} to {quantity(high, unit)}"


def fault_sentences(done: Identified) -> list[str]:
    """Say what is wrong with the sensors, the speed, the torque and the clock."""
    found = done.status.found()
    if not found:
        return ["No fault was found in the sensors."]
    return [_fault(fault) for fault in found]


def _moment(time: float) -> str:
    """Return a time (s) to the millisecond, also where it counts from 1970."""
    return f"{time:.3f}".rstrip("0").rstrip(".")


def _fault(fault: FaultFound) -> str:
    one = fault.samples == 1
    where = (
        f"at {_moment(fault.first)}\N{NO-BREAK SPACE}s"
        if one
        else f"between {_moment(fault.first)} and {_moment(fault.last)}\N{NO-BREAK SPACE}s"
    )
    stretches = "" if one else f" in {fault.stretches} {'stretch' if fault.stretches == 1 else 'stretches'}"
    return (
        f"{capital(fault.source)}, {fault.fault}: {_MEANINGS[fault.fault]} in {fault.samples} "
        f"{'sample' if one else 'samples'} ({percent(fault.share)}){stretches}, {where}."
    )
