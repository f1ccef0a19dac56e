"""What the banks said about a recording, beside what was true: one row for each window, and the alarms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.answer import Answer
    from co_sim.wheelset.recordings import Recording
    from co_sim.wheelset.studies.trial import Trial
    from estimator import CreepCurve

    Array = NDArray[np.float64]

__all__ = ["OFFSET_LIMIT", "Alarms", "alarms_of", "score", "settled_at", "truth_of"]

#: Offset from the track beyond which a wheelset without flanges is no wheelset any more, m.
OFFSET_LIMIT = 8e-3
#: Before this the torque rises and the filters settle, s.
_SETTLED = 1.0
#: Probability of low adhesion, low and very low together, at which an alarm begins, and at which it ends.
_ALARM, _ALL_CLEAR = 0.9, 0.5
#: A probability that neither begins an alarm nor ends one, for answers that are not to be trusted.
_NO_ALARM = (_ALARM + _ALL_CLEAR) / 2.0


@dataclass(frozen=True, slots=True)
class Alarms:
    """When a bank said that adhesion is low.

    Parameters
    ----------
    onsets : times at which alarms began, s. watched : time during which one could have begun, s.
    """

    onsets: tuple[float, ...]
    watched: float


def truth_of(recording: Recording, trial: Trial, ends: Sequence[float], window: float) -> dict[str, Any]:
    """Return the truth over windows of `window` (s) that end at `ends` (s), a list for each column.

    ``region`` is that of the mean creep over the window, on the curve of the plant at that speed.
    """
    time, creep = recording.time, recording.creep
    columns: dict[str, list[float]] = {name: [] for name in _TRUTH}
    for end in ends:
        inside = (time > end - window - 1e-9) & (time <= end + 1e-9)
        condition = trial.before if trial.manoeuvre == "drop" and end <= trial.change else trial.condition
        mean_creep = float(np.mean(np.abs(creep[inside])))
        curve = trial.curve_of(condition)
        row = (
            end,
            CONDITION_NAMES.index(condition),
            _region(mean_creep, curve),
            mean_creep / curve.peak_creep,
            float(np.mean(recording.peak_adhesion[inside])),
            float(np.mean(np.abs(recording.truth["adhesion_used"][inside]))),
            float(np.max(np.abs(recording.truth["relative_displacement"][inside]))),
        )
        for name, value in zip(_TRUTH, row, strict=True):
            columns[name].append(value)
    return columns


_TRUTH = ("time", "condition", "region", "creep", "mu_max", "mu_used", "offset")


def _region(creep: float, curve: CreepCurve) -> int:
    """Return the place in `REGIONS` of a creepage."""
    # The peak itself belongs to the region of the peak, whatever rounding makes of it.
    return int(creep > curve.knee_creep * 0.99) + int(creep > curve.peak_creep * (1.0 + 1e-6))


def score(
    recording: Recording, trial: Trial, answers: Mapping[str, Answer], window: float = 1.0
) -> dict[str, Any]:
    """Return the record of a case: ``windows`` (columns), and for each bank its alarms.

    Windows follow each other without overlap, from when the torque has settled to the end or to where a
    wheelset without flanges leaves the track; none lies across a change of the rail.
    """
    ends = _ends(recording, trial, window)
    columns: dict[str, Any] = truth_of(recording, trial, ends, window)
    record: dict[str, Any] = {"windows": columns, "recorded": float(recording.time[-1])}
    for bank, answer in answers.items():
        rows = np.searchsorted(answer.time, np.array(ends) + 1e-9, side="right") - 1
        columns |= {f"{bank}.{name}": values for name, values in _said(answer, rows).items()}
        if trial.manoeuvre != "prescribed":
            record |= _alarm_record(bank, alarms_of(answer, recording, trial), trial)
    return record


def settled_at(trial: Trial) -> float:
    """Return the time from which on windows count, s: an imposed creep is there from the start."""
    return 0.0 if trial.manoeuvre == "prescribed" else _SETTLED


def _ends(recording: Recording, trial: Trial, window: float) -> list[float]:
    valid = recording.time[recording.within(np.inf if trial.flanges else OFFSET_LIMIT)]
    last = float(valid[-1]) if valid.size else 0.0
    pieces = [(settled_at(trial), last)]
    if trial.manoeuvre == "drop":
        pieces = [(_SETTLED, min(trial.change, last)), (trial.change, last)]
    return [
        float(since + window * (i + 1))
        for since, until in pieces
        for i in range(int((until - since + 1e-9) / window))
    ]


def _said(answer: Answer, rows: NDArray[np.int64]) -> dict[str, list[Any]]:
    """Return the columns of what a bank said at `rows`; a quantity it says nothing about is None."""
    region = answer.region[rows]
    said: dict[str, list[Any]] = {
        "region": region.tolist(),
        "p_region": answer.p_region[rows, region].tolist(),
        "identifiable": answer.identifiable[rows].tolist(),
    }
    if answer.p_condition is not None:
        condition = answer.p_condition[rows].argmax(axis=1)
        said["condition"] = condition.tolist()
        said["p_condition"] = answer.p_condition[rows, condition].tolist()
    for name in ("mu_max", "mu_max_low", "mu_max_high"):
        values = getattr(answer, name)
        if values is not None:
            said[name] = [float(x) if np.isfinite(x) else None for x in values[rows]]
    return said


def alarms_of(answer: Answer, recording: Recording, trial: Trial) -> Alarms:
    """Return when a bank gave the alarm of low adhesion.

    A bank that knows conditions gives it at a probability of .9 for low and very low together where it trusts
    its answer, and takes it back below .5. The bank of the paper knows regions alone: it gives it when it
    trusts in "unstable".
    """
    valid = recording.within(np.inf if trial.flanges else OFFSET_LIMIT)
    until = float(recording.time[valid][-1]) if valid.any() else 0.0
    watched = (answer.time >= _SETTLED) & (answer.time <= until)
    if answer.p_condition is not None:
        p = answer.p_condition[:, [CONDITION_NAMES.index(name) for name in ("low", "very_low")]].sum(axis=1)
        p = np.where(answer.identifiable, p, np.minimum(p, _NO_ALARM))
    else:
        unstable = answer.region == REGIONS.index("unstable")
        p = np.where(unstable & answer.identifiable, 1.0, 0.0)
    onsets, raised = [], False
    for t, value in zip(answer.time[watched], p[watched], strict=True):
        if not raised and value >= _ALARM:
            onsets.append(float(t))
        raised = value >= _ALARM or (raised and value >= _ALL_CLEAR)
    return Alarms(tuple(onsets), max(until - _SETTLED, 0.0))


def _alarm_record(bank: str, alarms: Alarms, trial: Trial) -> dict[str, Any]:
    """Return false alarms and the time they could have come in, and the latency of a drop.

    An alarm is false while the rail carries more than low adhesion. A drop that is never announced has no
    latency; one that was "announced" before it came has false alarms, and the latency of the next alarm.
    """
    dropped = trial.manoeuvre == "drop"
    sound = trial.condition in {"dry", "wet"}
    innocent_until = trial.change if dropped else (np.inf if sound else 0.0)
    watched = min(alarms.watched, max(innocent_until - _SETTLED, 0.0))
    false = [t for t in alarms.onsets if t <= innocent_until] if innocent_until > 0.0 else []
    record: dict[str, Any] = {f"{bank}.false_alarms": len(false), f"{bank}.watched": float(watched)}
    if dropped and not sound:
        later = [t - trial.change for t in alarms.onsets if t > trial.change]
        record[f"{bank}.latency"] = min(later, default=None)
    return record
