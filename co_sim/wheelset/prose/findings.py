"""What an experiment says about each stretch of each run, judged and told from its numbers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from co_sim.wheelset.prose.words import listed, number, percent, quantity, span

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from co_sim.wheelset.results import Experiment, Run, Stretch

__all__ = ["CLEAR_LEAD", "Finding", "Outcome", "counted", "find", "place", "valid_windows"]

#: Lead of one mean probability over the next that counts as an answer.
CLEAR_LEAD = 0.1


class Outcome(Enum):
    """What became of a stretch of a run."""

    IDENTIFIED = "identified"
    MISTAKEN = "mistaken"
    UNDECIDED = "undecided"
    UNKNOWN = "no filter holds"
    EMPTY = "no valid window"


@dataclass(frozen=True, slots=True)
class Finding:
    """The judgement on one stretch, over the windows that end within the range of the model.

    Parameters
    ----------
    stretch : what is judged. outcome : the judgement. text : the judgement in a sentence or two.
    ranking : names of the filters by falling mean probability; empty without valid windows.
    """

    stretch: Stretch
    outcome: Outcome
    text: str
    ranking: tuple[str, ...] = ()


def find(experiment: Experiment) -> list[Finding]:
    """Judge every stretch, in order."""
    runs = {run.name: run for run in experiment.runs}
    return [_judge(experiment, runs[stretch.run], stretch) for stretch in experiment.stretches]


def valid_windows(run: Run, stretch: Stretch, window: float) -> NDArray[np.bool_]:
    """Return where (T,) a window of a run ends that lies on the stretch and within the model's range."""
    return run.windows(stretch.since, stretch.until, window) & run.valid


def place(experiment: Experiment, stretch: Stretch) -> str:
    """Return where a stretch is: run, rail, and when there are several, its time."""
    several = sum(s.run == stretch.run for s in experiment.stretches) > 1
    run = "" if stretch.run in {"torque_driven", "free_rolling"} else f"run {stretch.run}, "
    when = f", {span(stretch.since, stretch.until)}" if several else ""
    return f"{run}{stretch.condition} rail{when}"


def _judge(experiment: Experiment, run: Run, stretch: Stretch) -> Finding:
    p, shares = stretch.mean_probability_valid, stretch.share_smallest_valid
    if p is None or shares is None:
        return Finding(stretch, Outcome.EMPTY, _why_empty(experiment, run, stretch))
    residuals, margin = stretch.mean_residual_valid or {}, stretch.margin or 0.0
    # Equal probabilities are ranked by residual: the rules know only a few degrees of small.
    ranking = tuple(sorted(p, key=lambda name: (-round(p[name], 2), residuals[name])))
    outcome = _outcome(stretch, ranking)
    text = _judgement(stretch, outcome, ranking, margin)
    return Finding(stretch, outcome, text, ranking)


def _outcome(stretch: Stretch, ranking: tuple[str, ...]) -> Outcome:
    p = stretch.mean_probability_valid or {}
    if not stretch.expected:
        return Outcome.UNKNOWN
    if p[ranking[0]] - p[ranking[1]] < CLEAR_LEAD:
        return Outcome.UNDECIDED
    return Outcome.IDENTIFIED if ranking[0] in stretch.expected else Outcome.MISTAKEN


def _judgement(stretch: Stretch, outcome: Outcome, ranking: tuple[str, ...], margin: float) -> str:
    p, shares = stretch.mean_probability_valid or {}, stretch.share_smallest_valid or {}
    best, second = ranking[:2]
    if outcome is Outcome.UNKNOWN:
        return (
            f"No filter of the bank is true here, so no answer can be right. The highest mean probability is "
            f"that of {best}, {percent(p[best])}."
        )
    share = percent(sum(shares[name] for name in stretch.expected))
    one = len(stretch.expected) == 1
    truth = (
        f"{listed(stretch.expected)} {'is true and' if one else 'are true and one of them'} has the smallest "
        f"residual in {share} of the {counted(stretch)}."
    )
    if outcome is Outcome.UNDECIDED:
        return (
            f"The mean probabilities of {best} and {second} are {percent(p[best])} and {percent(p[second])}; "
            f"the smallest residual and the next differ by {number(margin, 2)} of the level of equally good "
            f"filters. {truth}"
        )
    return (
        f"{best} has a mean probability of {percent(p[best])}, the next, {second}, {percent(p[second])}. "
        f"{truth}"
    )


def counted(stretch: Stretch) -> str:
    """Return how many windows of a stretch count."""
    if stretch.valid_windows == stretch.windows:
        return f"{stretch.windows} windows"
    return f"{stretch.valid_windows} windows within the range of the model ({stretch.windows} in all)"


def _why_empty(experiment: Experiment, run: Run, stretch: Stretch) -> str:
    window = experiment.scenario.identifier.window
    if stretch.windows == 0:
        return (
            f"The record of this stretch, {span(stretch.since, stretch.until)}, is shorter than one window "
            f"of {quantity(window, 's')}, so there is nothing to judge."
        )
    return (
        f"All {stretch.windows} windows end after the wheelset has left the range of the model at "
        f"{quantity(run.valid_until, 's')}, so none of them counts."
    )
