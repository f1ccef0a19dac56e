"""What an experiment produced, and what it says: shares, probabilities, truth and their limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.assembly import MEASURED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from co_sim.wheelset.scenario import Scenario
    from estimator import CreepCurve, FuzzySystem, OperatingPoint, Tuning

__all__ = ["Experiment", "FilterDesign", "Run", "Stretch", "assess"]

Array = NDArray[np.float64]

#: Outputs of the plant that the summary reports as truth, averaged over the windows.
TRUTH = (
    "adhesion_used",
    "left.adhesion_peak",
    "right.adhesion_peak",
    "left.creepage_x",
    "right.creepage_x",
    "left.g11",
    "right.g11",
    "left.g22",
    "right.g22",
)


@dataclass(frozen=True, slots=True)
class FilterDesign:
    """One filter of the bank: its hypothesis and how it was tuned.

    Parameters
    ----------
    name : as in the results. condition : rail condition, by name.
    point : operating point of the hypothesis. tuning : result of the automatic tuning.
    training : length of the record that tuned it, s; shorter than asked where the model ceased to hold.
    """

    name: str
    condition: str
    point: OperatingPoint
    tuning: Tuning
    training: float


@dataclass(frozen=True)
class Run:
    """The record of one run.

    Parameters
    ----------
    name : ``"P1"``, ``"P2"``, ``"P3"``, ``"free_rolling"`` or ``"torque_driven"``.
    point : operating point, where the creep was prescribed.
    time : (T,) s.
    signals, units : (T,) series and units by name, such as ``"plant.yaw_rate"``.
    E, probabilities : (T, n) normalised residuals and fuzzy probabilities of the n filters.
    valid_until : time at which the wheelset first left the range of the model without flanges, s; the
        end of the run if it never did.
    stopped : why the run ended early, or ``None``.
    interrupted : whether that was the user, so that no other run was made after it.
    """

    name: str
    point: OperatingPoint | None
    time: Array
    signals: Mapping[str, Array]
    units: Mapping[str, str]
    E: Array
    probabilities: Array
    valid_until: float
    stopped: str | None = None
    interrupted: bool = False

    def windows(self, since: float, until: float, window: float) -> NDArray[np.bool_]:
        """Return where (T,) a moving window ends that lies between two times; all in s."""
        half_step = (self.time[1] - self.time[0]) / 2.0 if len(self.time) > 1 else 0.0
        return np.asarray((self.time >= since + window - half_step) & (self.time <= until + half_step))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where (T,) the wheelset has not yet left the range of the model."""
        return np.asarray(self.time <= self.valid_until)

    @property
    def table(self) -> Array:
        """All signals, (T, signals)."""
        return np.column_stack(list(self.signals.values()))

    @property
    def titles(self) -> list[str]:
        """Name and unit of each signal."""
        return [f"{name} [{self.units[name]}]" for name in self.signals]


@dataclass(frozen=True)
class Stretch:
    """What the identifier said over the windows that lie on one rail condition of one run.

    Parameters
    ----------
    run, condition : where. since, until : of the stretch, s.
    expected : names of the filters whose hypothesis is true there.
    windows, valid_windows : number of windows (one ends at each step), and of those that end before the
        wheelset left the range of the model.
    share_smallest, share_smallest_valid : by filter, share of the windows in which its residual was the
        smallest; ``None`` without windows. Names in ``_valid`` are over the valid windows only.
    mean_probability, mean_probability_valid, mean_residual_valid : by filter.
    margin : mean distance from the smallest to the second smallest residual over the level 1/sqrt(n),
        valid windows.
    signal_to_noise : by sensor, rms of the true signal over the rms of the noise, valid windows.
    truth : by output of the plant, mean over the valid windows.
    """

    run: str
    condition: str
    since: float
    until: float
    expected: tuple[str, ...]
    windows: int
    valid_windows: int
    share_smallest: dict[str, float] | None
    share_smallest_valid: dict[str, float] | None
    mean_probability: dict[str, float] | None
    mean_probability_valid: dict[str, float] | None
    mean_residual_valid: dict[str, float] | None
    margin: float | None
    signal_to_noise: dict[str, float] | None
    truth: dict[str, float] | None


@dataclass(frozen=True)
class Experiment:
    """Everything an experiment produced.

    Parameters
    ----------
    scenario : as read. name : of the scenario.
    filters : the bank. fuzzy : the fuzzy system. curves : creep curves by condition.
    runs, stretches : the records and what they say.
    """

    name: str
    scenario: Scenario
    filters: tuple[FilterDesign, ...]
    fuzzy: FuzzySystem
    curves: Mapping[str, CreepCurve]
    runs: tuple[Run, ...]
    stretches: tuple[Stretch, ...]

    @property
    def filter_names(self) -> tuple[str, ...]:
        """Names of the filters, in order."""
        return tuple(f.name for f in self.filters)


def assess(run: Run, scenario: Scenario, filters: tuple[FilterDesign, ...]) -> list[Stretch]:
    """Sum up a run, stretch of rail by stretch.

    Windows count from one window length after the stretch begins, so none reaches into another stretch
    or before the start.
    """
    starts = [rail.since for rail in scenario.rail]
    ends = [*starts[1:], scenario.simulation.duration]
    return [
        _assess_stretch(run, scenario, filters, rail.sides, since, until)
        for rail, since, until in zip(scenario.rail, starts, ends, strict=True)
        if since <= run.time[-1]
    ]


def _assess_stretch(
    run: Run,
    scenario: Scenario,
    filters: tuple[FilterDesign, ...],
    sides: tuple[str, str],
    since: float,
    until: float,
) -> Stretch:
    full = run.windows(since, until, scenario.identifier.window)
    valid = full & run.valid
    names = tuple(f.name for f in filters)

    def by_filter(values: Array, where: NDArray[np.bool_]) -> dict[str, float] | None:
        return dict(zip(names, map(float, values[where].mean(axis=0)), strict=True)) if where.any() else None

    smallest = (run.E.argmin(axis=1)[:, None] == np.arange(len(names))).astype(np.float64)
    best_two = np.sort(run.E, axis=1)[:, :2] * np.sqrt(len(names))
    return Stretch(
        run=run.name,
        condition=sides[0] if sides[0] == sides[1] else "/".join(sides),
        since=since,
        until=min(until, float(run.time[-1])),
        expected=tuple(f.name for f in filters if _is_true(f, run, sides)),
        windows=int(full.sum()),
        valid_windows=int(valid.sum()),
        share_smallest=by_filter(smallest, full),
        share_smallest_valid=by_filter(smallest, valid),
        mean_probability=by_filter(run.probabilities, full),
        mean_probability_valid=by_filter(run.probabilities, valid),
        mean_residual_valid=by_filter(run.E, valid),
        margin=float(np.mean(best_two[valid, 1] - best_two[valid, 0])) if valid.any() else None,
        signal_to_noise=_signal_to_noise(run, scenario, valid),
        truth={name: float(run.signals[f"plant.{name}"][full].mean()) for name in TRUTH}
        if full.any()
        else None,
    )


def _is_true(design: FilterDesign, run: Run, sides: tuple[str, str]) -> bool:
    """Whether a filter's hypothesis holds: its rail, its point where that was prescribed, else its branch.

    With a torque the creep is on the stable branch unless the wheels slip, which `assess` does not know;
    filters on the unstable branch do not count as expected there.
    """
    if {design.condition} != set(sides):
        return False
    return design.point.name == run.point.name if run.point else design.point.g11 > 0.0


def _signal_to_noise(run: Run, scenario: Scenario, where: NDArray[np.bool_]) -> dict[str, float] | None:
    if not where.any():
        return None
    return {
        sensor: float(
            np.sqrt(np.mean(np.square(run.signals[f"plant.{output}"][where])))
            / getattr(scenario.sensors, sensor).noise_rms
        )
        for sensor, (output, _) in MEASURED.items()
    }
