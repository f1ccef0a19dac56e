"""Where on a known creep curve the wheelset runs: linear, near the peak, or past it.

Hypotheses are creepages of the curve. Each is a filter with the track as coloured noise; the region follows
from the likelihood of a window of samples. The filters are scheduled with the speed and with the amplitude of
the yaw oscillation, which the gyro shows: an unstable wheelset soon swings so far that the slopes at its
creepage say nothing any more, and only slopes averaged over the swing tell a limit cycle from the peak.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from estimator.adhesion.curves import REGIONS
from estimator.coloured import Disturbances, coloured_filter
from estimator.finite_amplitude import averaged_point
from estimator.likelihood import LikelihoodBank
from estimator.residuals import moving_mean_square

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.contact import CreepCurve
    from estimator.log import Log
    from estimator.recursive import RecursiveFilter
    from estimator.sensor_noise import SensorNoise
    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import WheelsetParameters

__all__ = ["HYPOTHESES", "REGIONS", "RegionBank", "RegionHypothesis", "RegionIdentification"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Ratio of neighbouring speeds in the schedule.
_SPACING = 1.01
#: Amplitudes of the schedule, over the creepage of the peak. The first is what the track alone moves. It
#: keeps the slope at the peak from being zero, where the filter would have other states than elsewhere.
_AMPLITUDES = np.array([0.015, 0.03, 0.06, 0.1, 0.15, 0.2, 0.27, 0.35, 0.45, 0.6, 0.8, 1.1, 1.5])
#: Time over which the amplitude is found: two periods of the yaw oscillation, s.
_AMPLITUDE_TIME = 0.15
#: Intensity of the unmodelled lateral acceleration, m2/s3: next to none, for the creepage is one of a few.
_UNMODELLED = 1e-8


@dataclass(frozen=True, slots=True)
class RegionHypothesis:
    """A creepage of a curve.

    Parameters
    ----------
    name : for results. region : one of `REGIONS`.
    towards_peak : where between knee (0) and peak (1), on a logarithmic scale.
    multiple : of the creepage there.
    """

    name: str
    region: str
    towards_peak: float
    multiple: float = 1.0

    def __post_init__(self) -> None:
        if self.region not in REGIONS or not (0.0 <= self.towards_peak <= 1.0 and self.multiple > 0.0):
            raise ValueError(
                f"hypothesis {self.name}: got region {self.region!r}, towards_peak = {self.towards_peak:g} "
                f"and multiple = {self.multiple:g}, expected one of {', '.join(REGIONS)}, 0 to 1 and > 0"
            )

    def creep(self, curve: CreepCurve) -> float:
        """Return the creepage on a curve."""
        ratio = curve.peak_creep / curve.knee_creep
        return float(self.multiple * curve.knee_creep * ratio**self.towards_peak)


#: Twofold steps below the knee, threefold to the peak, and the branch beyond up to where the curve is flat.
HYPOTHESES = (
    RegionHypothesis("linear 0.15", "linear", 0.0, 0.15),
    RegionHypothesis("linear 0.3", "linear", 0.0, 0.3),
    RegionHypothesis("linear 0.5", "linear", 0.0, 0.5),
    RegionHypothesis("knee", "peak", 0.0),
    RegionHypothesis("knee to peak 1/3", "peak", 1.0 / 3.0),
    RegionHypothesis("knee to peak 2/3", "peak", 2.0 / 3.0),
    RegionHypothesis("peak", "peak", 1.0),
    RegionHypothesis("unstable 1.15", "unstable", 1.0, 1.15),
    RegionHypothesis("unstable 1.4", "unstable", 1.0, 1.4),
    RegionHypothesis("unstable 1.7", "unstable", 1.0, 1.7),
    RegionHypothesis("unstable 2.2", "unstable", 1.0, 2.2),
)


@dataclass(frozen=True, eq=False)
class RegionIdentification:
    """What a `RegionBank` said, in n rows.

    Parameters
    ----------
    time : (n,) of the last sample in the row's window, s.
    p_region : (n, 3) probabilities of `REGIONS`, taken as equally likely before.
    log_likelihood : (n, hypotheses) of the samples in the window.
    nis : (n,) normalised innovation squared of the best hypothesis for each measurement; about 1 where its
        model holds, nan where nothing was measured.
    hypotheses : in order.
    """

    time: Array
    p_region: Array
    log_likelihood: Array
    nis: Array
    hypotheses: tuple[RegionHypothesis, ...]

    @property
    def region(self) -> Indices:
        """Index of the most probable region (n,)."""
        return np.asarray(np.argmax(self.p_region, axis=1))


class RegionBank:
    """Filters at creepages of a known curve.

    Parameters
    ----------
    curve : rail condition, load and patch; its speed does not matter, the log has that.
    wheelset : parameters. noise : of the sensors. track : spectrum. h : sample time, s.
    window : length of the evidence, s. every : time between rows of the answer, s, a divisor of the window.
    hypotheses : one or more of each region.
    acceleration : intensity of the unmodelled lateral acceleration, m2/s3.

    Raises
    ------
    ValueError
        If the times do not fit each other or a region has no hypothesis.
    """

    def __init__(
        self,
        curve: CreepCurve,
        wheelset: WheelsetParameters,
        noise: SensorNoise,
        track: TrackSpectrum,
        h: float,
        *,
        window: float = 1.0,
        every: float = 0.01,
        hypotheses: Sequence[RegionHypothesis] = HYPOTHESES,
        acceleration: float = _UNMODELLED,
    ) -> None:
        self.curve, self.wheelset, self.noise, self.h = curve, wheelset, noise, h
        self.hypotheses = tuple(hypotheses)
        missing = [region for region in REGIONS if all(x.region != region for x in self.hypotheses)]
        if missing:
            raise ValueError(
                f"region bank: got no hypothesis for {', '.join(missing)}, expected one of each region; "
                f"without it the bank can never name it"
            )
        self._every = _whole(every / h, "every", f"{every:g} s", f"samples of {h:g} s")
        self._window = _whole(window / every, "window", f"{window:g} s", f"rows of {every:g} s")
        self._disturbances = Disturbances(track, noise, acceleration=acceleration, lever=wheelset.L_g)
        self._designed: dict[tuple[int, int], tuple[RecursiveFilter, ...]] = {}

    def run(self, log: Log) -> RegionIdentification:
        """Return the region over a log, the filters knowing nothing at first.

        Raises
        ------
        ValueError
            If the log has another step, or stands still or rolls backwards.
        """
        if abs(log.h - self.h) > 1e-6 * self.h:
            raise ValueError(
                f"region bank: got a log with a step of {log.h:g} s, expected {self.h:g} s; resample "
                f"the log or design the bank for its step"
            )
        if not np.all(log.speed > 0.0):
            raise ValueError(
                f"region bank: got a speed of {log.speed.min():g} m/s, expected more than 0; "
                f"cut out where the wheelset stands"
            )
        # Of each sample its speed and amplitude, as numbers on their scales.
        keys = np.column_stack([self._speed_cells(log.speed), self._amplitude_cells(log)])
        visited, cells = np.unique(keys, axis=0, return_inverse=True)
        with threadpool_limits(1, user_api="blas"):
            bank = LikelihoodBank(*(self._filters(int(s), int(a)) for s, a in visited))
        usable = cast("NDArray[np.bool_]", log.usable)
        said = bank.run(
            log.measurements, usable=usable, cells=cells.ravel(), every=self._every, window=self._window
        )
        best = np.argmax(said.log_likelihood, axis=1)
        measured = np.where(said.measurements > 0, said.measurements, math.nan)
        return RegionIdentification(
            time=log.time[self._every - 1 :: self._every][: len(best)],
            p_region=self._regions(said.log_likelihood),
            log_likelihood=said.log_likelihood,
            nis=said.nis[np.arange(len(best)), best] / measured,
            hypotheses=self.hypotheses,
        )

    def _regions(self, log_likelihood: Array) -> Array:
        """Return the probabilities (n, 3) of the regions; within a region all hypotheses are alike."""
        columns = []
        for region in REGIONS:
            of_region = [i for i, x in enumerate(self.hypotheses) if x.region == region]
            columns.append(logsumexp(log_likelihood[:, of_region], axis=1) - math.log(len(of_region)))
        evidence = np.column_stack(columns)
        return np.asarray(np.exp(evidence - logsumexp(evidence, axis=1, keepdims=True)))

    def _speed_cells(self, speed: Array) -> Indices:
        return np.rint(np.log(speed) / math.log(_SPACING)).astype(np.int64)

    def _speed_of(self, cell: int) -> float:
        return _SPACING**cell

    def _amplitude_cells(self, log: Log) -> Indices:
        """Return which of `_AMPLITUDES` was nearest in the samples before each one."""
        usable = cast("NDArray[np.bool_]", log.usable)[:, 0]
        squares = np.column_stack([np.square(log.measurements[:, 0]), usable])
        window = max(round(_AMPLITUDE_TIME / self.h), 1)
        means = moving_mean_square(squares, window)
        seen = np.maximum(means[:, 1], 1.0 / window)
        yaw_rate = np.sqrt(2.0 * np.maximum(means[:, 0] / seen - self.noise.yaw_rate**2, 0.0))
        cells = self._speed_cells(log.speed)
        peaks = {int(c): self._curve(int(c)).peak_creep for c in np.unique(cells)}
        peak = np.array([peaks[int(c)] for c in cells]) if len(peaks) > 1 else next(iter(peaks.values()))
        relative = self.wheelset.L_g * yaw_rate / log.speed / peak
        nearest = np.searchsorted((_AMPLITUDES[1:] + _AMPLITUDES[:-1]) / 2.0, relative)
        return np.concatenate([[0], nearest[:-1]])

    def _curve(self, speed_cell: int) -> CreepCurve:
        return replace(self.curve, v=self._speed_of(speed_cell))

    def _filters(self, speed_cell: int, amplitude_cell: int) -> tuple[RecursiveFilter, ...]:
        key = speed_cell, amplitude_cell
        if key not in self._designed:
            curve = self._curve(speed_cell)
            amplitude = float(_AMPLITUDES[amplitude_cell]) * curve.peak_creep
            points = [
                averaged_point(curve, x.name, x.creep(curve), amplitude, self.wheelset)
                for x in self.hypotheses
            ]
            self._designed[key] = tuple(
                coloured_filter(point, self.wheelset, self._disturbances, self.h) for point in points
            )
        return self._designed[key]


def _whole(ratio: float, name: str, got: str, unit: str) -> int:
    count = round(ratio)
    if count < 1 or abs(ratio - count) > 1e-6 * ratio:
        raise ValueError(f"{name}: got {got}, expected a whole number of {unit}; round it")
    return count
