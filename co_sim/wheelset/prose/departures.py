"""What did not come out as it should, and why, told from the numbers of an experiment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.assembly import MEASURED
from co_sim.wheelset.prose.findings import Finding, Outcome, counted, find, place, valid_windows
from co_sim.wheelset.prose.words import capital, listed, number, percent, quantity

if TYPE_CHECKING:
    from co_sim.wheelset.results import Experiment, FilterDesign, Run, Stretch

__all__ = ["Departure", "departures"]

#: Share of the windows below which misses are not worth a word.
_NEGLIGIBLE_SHARE = 0.005
#: Share of the windows from which the first place counts as steady.
_STEADY_SHARE = 0.95
#: Variation of the tangent over its mean from which a linear model is doubted.
_LARGE_VARIATION = 0.3
#: The one fuzzy output that the paper reports, at P1.
_PAPER_PROBABILITY = 0.9


@dataclass(frozen=True, slots=True)
class Departure:
    """Something that did not come out as it should: a heading, and what is so and why."""

    heading: str
    text: str


def departures(experiment: Experiment) -> list[Departure]:
    """Return everything that did not come out as it should, with its reasons."""
    findings = find(experiment)
    runs = {run.name: run for run in experiment.runs}
    found = [_stopped(run) for run in experiment.runs if run.stopped]
    for finding in findings:
        found += _about(experiment, runs[finding.stretch.run], finding)
    found += [_out_of_range(experiment, run) for run in experiment.runs if _leaves_range(run)]
    found += [d for finding in findings for d in _against_the_paper(experiment, finding)]
    return found


def _about(experiment: Experiment, run: Run, finding: Finding) -> list[Departure]:
    """Tell what is amiss with one finding."""
    where = capital(place(experiment, finding.stretch))
    stretch = finding.stretch
    match finding.outcome:
        case Outcome.IDENTIFIED:
            heading = f"{listed(stretch.expected)} does not have the smallest residual throughout"
            reasons = _misses(experiment, run, stretch)
        case Outcome.UNDECIDED:
            heading = f"no decision between {finding.ranking[0]} and {finding.ranking[1]}"
            reasons = _undecided(experiment, run, finding)
        case Outcome.MISTAKEN:
            heading = f"taken for {finding.ranking[0]}"
            reasons = _mistaken(experiment, run, finding)
        case _:
            heading, reasons = finding.outcome.value, []
    amiss = {heading: reasons, "the wheels slip": _past_maximum(stretch)}
    return [Departure(f"{where}: {what}", " ".join(why)) for what, why in amiss.items() if why]


def _leaves_range(run: Run) -> bool:
    return run.valid_until < float(run.time[-1])


def _stopped(run: Run) -> Departure:
    return Departure(
        f"Run {run.name} stopped early",
        f"The record ends at {quantity(run.time[-1], 's')}: {run.stopped}. All numbers of this run are of "
        f"the record up to there.",
    )


def _misses(experiment: Experiment, run: Run, stretch: Stretch) -> list[str]:
    """Say when a filter that is not true has the smallest residual."""
    shares = stretch.share_smallest_valid or {}
    others = [name for name in shares if name not in stretch.expected]
    missed = sum(shares[name] for name in others)
    if missed < _NEGLIGIBLE_SHARE:
        return []
    rival = max(others, key=lambda name: shares[name])
    text = (
        f"In {percent(missed)} of the {counted(stretch)} another filter has the smallest residual, most "
        f"often {rival}."
    )
    return [text, *(_late_start(experiment, run, stretch) or _varying_slope(experiment, run, stretch))]


def _undecided(experiment: Experiment, run: Run, finding: Finding) -> list[str]:
    stretch, margin = finding.stretch, finding.stretch.margin or 0.0
    faint = _faint_signal(run, stretch)
    share = sum((stretch.share_smallest_valid or {})[name] for name in stretch.expected)
    apart = f"The smallest residual and the next are {number(margin, 2)} of the level apart"
    if faint:
        verdict = f"{apart}; to prefer a filter on this evidence would be to invent a confidence."
    elif share >= _STEADY_SHARE:
        verdict = f"{apart}, little but steadily: the true filter comes first in almost every window."
    else:
        verdict = f"{apart}, and which comes first changes from window to window."
    reasons = faint or _slopes(experiment, *finding.ranking[:2]) + _varying_slope(experiment, run, stretch)
    return [*reasons, verdict]


def _mistaken(experiment: Experiment, run: Run, finding: Finding) -> list[str]:
    expected = finding.stretch.expected
    return [
        f"True {'is' if len(expected) == 1 else 'are'} {listed(expected)}.",
        *_faint_signal(run, finding.stretch),
        *_slopes(experiment, finding.ranking[0], expected[0]),
        *_varying_slope(experiment, run, finding.stretch),
    ]


def _past_maximum(stretch: Stretch) -> list[str]:
    """Say that wheels driven by a torque slipped, where the truth of a filter is not what it seems."""
    if stretch.run != "torque_driven" or stretch.truth is None:
        return []
    slopes = {side: stretch.truth[f"{side}.g11"] for side in ("left", "right")}
    slipping = [side for side, g11 in slopes.items() if g11 < 0.0]
    if not slipping:
        return []
    text = (
        f"On average the tangent g11 is negative at the {listed(slipping)} wheel, past the maximum of the "
        f"creep curve, while only filters on the stable branch count as true here."
    )
    return [text]


def _faint_signal(run: Run, stretch: Stretch) -> list[str]:
    """Say that the sensors see little more than their noise, and why where the slope is known."""
    ratios = stretch.signal_to_noise
    if ratios is None or max(ratios.values()) >= 1.0:
        return []
    reason = (
        f"The sensors see little but their own noise: the signal-to-noise ratio (rms) is {_ratios(ratios)}."
    )
    if run.point is not None and abs(run.point.g11) < 1e-3 * run.point.g22:
        reason += (
            " At the maximum of the creep curve the tangent g11 is zero, so the track irregularity moves the "
            "wheelset only to second order. A smooth track would look the same at any other point."
        )
    return [reason]


def _ratios(ratios: dict[str, float]) -> str:
    return listed([f"{number(ratio, 2)} at the {sensor}" for sensor, ratio in ratios.items()])


def _slopes(experiment: Experiment, one: str, other: str) -> list[str]:
    """Compare the slopes of two hypotheses, which are all that tells the filters apart."""
    designs: dict[str, FilterDesign] = {design.name: design for design in experiment.filters}
    a, b = designs[one].point, designs[other].point
    reason = (
        f"The models of the filters differ in the slopes of the creep curve only: g11 is "
        f"{number(a.g11 / 1e6)} and {quantity(b.g11 / 1e6, 'MN')}, g22 {number(a.g22 / 1e6)} and "
        f"{quantity(b.g22 / 1e6, 'MN')} for {one} and {other}."
    )
    return [reason]


def _varying_slope(experiment: Experiment, run: Run, stretch: Stretch) -> list[str]:
    """Say that the motion goes too far along the creep curve for a linear model."""
    g11 = run.signals["plant.left.g11"][valid_windows(run, stretch, experiment.scenario.identifier.window)]
    mean, variation = float(np.mean(g11)), float(np.std(g11))
    if variation < _LARGE_VARIATION * abs(mean):
        return []
    reason = (
        f"With the motion the tangent g11 at the left wheel varies by {quantity(variation / 1e6, 'MN', 2)} "
        f"(rms) about {quantity(mean / 1e6, 'MN', 2)}; a linear filter takes it for constant."
    )
    return [reason]


def _late_start(experiment: Experiment, run: Run, stretch: Stretch) -> list[str]:
    """Say that the misses lie at the beginning, while the motion is still growing."""
    where = valid_windows(run, stretch, experiment.scenario.identifier.window)
    true = [experiment.filter_names.index(name) for name in stretch.expected]
    missed = np.flatnonzero(~np.isin(run.E[where].argmin(axis=1), true))
    end = float(run.time[where][missed[-1]])
    early = (run.time >= stretch.since) & (run.time <= end)
    ratios = {
        sensor: float(np.sqrt(np.mean(np.square(run.signals[f"plant.{output}"][early]))))
        / getattr(experiment.scenario.sensors, sensor).noise_rms
        for sensor, (output, _) in MEASURED.items()
    }
    overall = stretch.signal_to_noise or {}
    if missed[-1] > np.count_nonzero(where) / 2 or any(ratios[s] > overall[s] / 2.0 for s in ratios):
        return []
    reason = (
        f"All of these windows end by {quantity(end, 's')}, while the motion is still growing: up to there "
        f"the signal-to-noise ratio (rms) is {_ratios(ratios)}, over all valid windows {_ratios(overall)}."
    )
    return [reason]


def _out_of_range(experiment: Experiment, run: Run) -> Departure:
    limit = experiment.scenario.identifier.valid_offset * 1e3
    stretches = [s for s in experiment.stretches if s.run == run.name]
    valid, windows = sum(s.valid_windows for s in stretches), sum(s.windows for s in stretches)
    greatest = float(np.max(np.abs(run.signals["plant.relative_displacement"]))) * 1e3
    reason = (
        f"flange may touch the rail. The filters know no flange. The motion goes on, to "
        f"{quantity(greatest, 'mm', 2)}."
        if experiment.scenario.has_flanges
        else f"flange would touch the rail. The model has no flange, so the motion goes on, to "
        f"{quantity(greatest, 'mm', 2)}, and means nothing."
    )
    return Departure(
        f"Run {run.name} leaves the range of the model",
        f"At {quantity(run.valid_until, 's')} the wheelset is {quantity(limit, 'mm')} off the track, where a "
        f"{reason} {windows - valid} of the {windows} windows end "
        f"after that time and do not count.",
    )


def _against_the_paper(experiment: Experiment, finding: Finding) -> list[Departure]:
    """Compare P1 with the paper's one number."""
    p = finding.stretch.mean_probability_valid
    if finding.stretch.run != "P1" or p is None or len(finding.stretch.expected) != 1:
        return []
    mean = p[finding.stretch.expected[0]]
    if abs(mean - _PAPER_PROBABILITY) < 0.02:
        return []
    text = (
        f"The paper reports one fuzzy output of {percent(_PAPER_PROBABILITY)} near P1, without its "
        f"membership functions, rules or sensor noise. {percent(mean)} is the mean over the "
        f"{counted(finding.stretch)} with the functions and the noise given here. The greatest output that "
        f"these functions allow is {percent(_greatest_output(experiment))}."
    )
    return [Departure(f"Run P1: {percent(mean)} instead of {percent(_PAPER_PROBABILITY)}", text)]


def _greatest_output(experiment: Experiment) -> float:
    """Return the centroid of the highest output term: what a rule that fires fully gives."""
    fuzzy = experiment.fuzzy.compile().tables
    return float(max(np.sum(fuzzy.grid[0] * shape) / np.sum(shape) for shape in fuzzy.shapes[0]))
