"""Do the limits hold on the plant? Decisions by likelihood on runs of the FMU, counted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from co_sim.wheelset.recordings import Journey, Recording, Stretch, record
from co_sim.wheelset.reporting.information import sensors_of
from co_sim.wheelset.reporting.pairs import Pair, processes
from co_sim.wheelset.sensors import SensorSpec
from estimator.identifiability import (
    divergence_rates,
    error_probability,
    window_covariance,
    window_needed,
    window_rates,
)
from fmu_wheelset import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from co_sim.wheelset.reporting.setup import Setup
    from estimator.identifiability import Process

__all__ = ["Confirmation", "confirm"]

Array = NDArray[np.float64]

#: Length of a run, s, and of its start that does not count: the track's slow part builds up.
_DURATION, _SETTLING = 42.0, 2.0
#: Most steps of a run, and the longest step, s: between samples the track must not stand still.
_STEPS, _STEP = 50_000, 2e-3
#: Least and largest window in samples: a decision takes the covariance of all of them. Error in between:
#: where counting takes the fewest decisions to tell whether theory is right.
_SAMPLES, _ERROR = (20, 250), 0.15
#: Confidence of the interval of a counted share.
_CONFIDENCE = 0.95
#: Sensors that a recording of the plant has, by its name for them.
_RECORDED = {"gyro": "yaw_rate", "accelerometer": "lateral_acceleration"}


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Decisions between two rails on runs of the plant, beside what is possible.

    Parameters
    ----------
    pair : of rails. window : s. lower, estimate, upper : least error probability of the linear model.
    errors, decisions : counted on the plant. low, high : interval of the error probability that they tell.
    """

    pair: Pair
    window: float
    lower: float
    estimate: float
    upper: float
    errors: int
    decisions: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """Counted share of errors."""
        return self.errors / self.decisions

    @property
    def holds(self) -> bool:
        """Whether the counted errors are no fewer than the lower bound allows."""
        return self.high >= self.lower


def confirm(
    pairs: Sequence[Pair], setup: Setup, progress: Callable[[float], None]
) -> tuple[Confirmation, ...]:
    """Record the plant on both rails of each pair, decide window by window, and count.

    The decision is the best there is for the linear model: the likelihood of all samples of a window at
    once. Of the main set, those sensors count that a recording has; without any nothing is confirmed.
    """
    names = [name for name in setup.main_sensors if name in _RECORDED]
    if not names:
        return ()
    found = []
    for i, pair in enumerate(pairs):
        found.append(_confirmed(pair, setup, names, seed=1000 * setup.seed + 2 * i))
        progress((i + 1) / len(pairs))
    return tuple(found)


def _confirmed(pair: Pair, setup: Setup, names: Sequence[str], seed: int) -> Confirmation:
    h = 1.0 / setup.sample_rate
    models = processes(pair, setup, sensors_of(setup, names), h=h, prescribed=True)
    needed = float(window_needed(divergence_rates(*models), _ERROR)) / h
    samples = round(min(max(needed, _SAMPLES[0]), _SAMPLES[1]))
    window = samples * h
    possible = error_probability(window_rates(*models, samples, starts=("steady", "steady")), window)
    recordings = [
        record(_journey(setup, condition, point.creep, point.v, seed + k))
        for k, (condition, point) in enumerate(((pair.first, pair.p), (pair.second, pair.q)))
    ]
    windows = [_windows(recording, names, samples, h) for recording in recordings]
    errors, decisions = _count(models, windows, samples)
    low, high = _interval(errors, decisions)
    return Confirmation(
        pair,
        window,
        lower=float(possible.lower),
        estimate=float(possible.estimate),
        upper=float(possible.upper),
        errors=errors,
        decisions=decisions,
        low=low,
        high=high,
    )


def _journey(setup: Setup, condition: str, creep: float, speed: float, seed: int) -> Journey:
    h = 1.0 / setup.sample_rate
    step = h / math.ceil(h / _STEP)
    return Journey(
        duration=min(round(_DURATION / step), _STEPS) * step,
        step=step,
        speed=speed,
        creep=creep,
        rails=(Stretch(0.0, CONDITIONS[condition]),),
        track=setup.spectrum,
        wheelset=setup.wheelset,
        seed=seed,
        gyro=SensorSpec(noise_rms=setup.noise["gyro"]),
        accelerometer=SensorSpec(noise_rms=setup.noise["accelerometer"]),
    )


def _windows(recording: Recording, names: Sequence[str], samples: int, h: float) -> Array:
    """Return the samples (T m, windows), every h seconds, of one run cut into windows, sample by sample."""
    z = np.column_stack([getattr(recording, _RECORDED[name]) for name in names])
    z = z[:: round(h / recording.journey.step)][round(_SETTLING / h) :]
    count = len(z) // samples
    return z[: count * samples].reshape(count, -1).T


def _count(models: Sequence[Process], runs: Sequence[Array], samples: int) -> tuple[int, int]:
    """Return how many windows of both runs are taken for the other rail, and how many there are."""
    roots = [linalg.cholesky(window_covariance(m, samples, start="steady"), lower=True) for m in models]
    errors = decisions = 0
    for true, z in enumerate(runs):
        costs = [
            0.5 * np.sum(linalg.solve_triangular(L, z, lower=True) ** 2, axis=0) + np.sum(np.log(np.diag(L)))
            for L in roots
        ]
        errors += int(np.sum(costs[true] > costs[1 - true]))
        decisions += z.shape[1]
    return errors, decisions


def _interval(errors: int, decisions: int) -> tuple[float, float]:
    """Return the exact interval of a share (Clopper and Pearson 1934)."""
    from scipy.stats import binomtest

    interval = binomtest(errors, decisions).proportion_ci(_CONFIDENCE, "exact")
    return float(interval.low), float(interval.high)
