"""Faults of the two sensors, found sample by sample from what they say and nothing else.

Every test is causal and looks at one channel, but that of a stuck sensor, which needs the other one to move.
None knows the model of the wheelset: a fault must not be found because a filter does not like the sample, nor
hidden because it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from estimator.log import Log

__all__ = ["FAULTS", "ChannelLimits", "FaultMemory", "SensorMonitor", "fault_names", "sensor_faults_step"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

DROPOUT, OUTLIER, SATURATION, STUCK, BIAS = (1 << i for i in range(5))
#: Names of the faults, by bit: a sample may have several.
FAULTS = {DROPOUT: "dropout", OUTLIER: "outlier", SATURATION: "saturation", STUCK: "stuck", BIAS: "bias"}

#: Columns of the limits of a channel, see `_limits`.
_NOISE, _RANGE, _BIAS_LIMIT, _N_SHORT, _N_LONG, _N_BIAS = range(6)
#: Columns of the memory of a channel.
(
    _COUNT,  # finite samples so far
    _RAW, _RUN, _EQUAL,  # last finite sample, how often in a row, share of repetitions
    _OTHER_LOW, _OTHER_HIGH,  # range of the other channel during the run
    _LAST, _BEFORE, _GAP,  # accepted samples, and how long ago the last one was, in samples
    _LEVEL, _SCALE,  # slow mean of accepted samples, mean departure from the best prediction
    _REJECTED, _FIRST, _SECOND,  # samples rejected in a row, and the last two of them
    _LOW, _HIGH, _RAIL_LOW, _RAIL_HIGH,  # range of accepted samples, and limits learned from flat tops
    _MEAN, _TAKEN,  # moving mean, and of how many samples
) = range(20)  # fmt: skip

#: A departure of so many times the noise, or the mean departure, from every prediction is an outlier.
_NOISES, _SCALES = 10.0, 15.0
#: Samples at the start from which the departures are learned.
_LEARNING = 10.0
#: Length of the mean of the departures, and of the slow mean, in samples.
_MEMORY = 100.0
#: Repetitions are no chance where fewer runs than one in so many would be as long.
_CHANCE = math.log(1e-9)
#: Speed (m/s) above which a wheelset moves: at rest a sensor may well say the same again and again.
_MOVING = 0.5
#: Times (s) after which a repeated value is a stuck sensor: where it never repeated before, and anyway.
_SHORT, _LONG = 0.02, 0.5
#: Times (s) of the moving mean that shows a bias.
_BIAS_TIME = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelLimits:
    """What is normal for one sensor.

    Parameters
    ----------
    noise : rms of the noise of one sample, in the unit of the channel.
    bias : greatest plausible mean over 2 s. While a wheelset stays on straight track its mean lateral
        acceleration is the change of its lateral velocity over that time, and its mean yaw rate that of its
        yaw angle; curves and cant add to them.
    full_scale : magnitude at which the sensor saturates; infinite: learned from flat tops.
    """

    noise: float
    bias: float
    full_scale: float = math.inf

    def __post_init__(self) -> None:
        for name in ("noise", "bias", "full_scale"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"sensor limits: {name}: got {value:g}, expected more than 0; give it in SI")


#: Limits of a gyro (rad/s) and an accelerometer (m/s2), in the order of `estimator.log.MEASUREMENTS`.
DEFAULT_LIMITS = (
    ChannelLimits(noise=1e-3, bias=0.05),
    ChannelLimits(noise=0.05, bias=1.0),
)


class FaultMemory(NamedTuple):
    """What `sensor_faults_step` keeps from sample to sample: x (2, 20)."""

    x: Array


@njit(cache=True, nogil=True, error_model="numpy")
def sensor_faults_step(  # pragma: no cover - compiled
    limits: Array, memory: FaultMemory, z: Array, speed: float, faults: Indices
) -> None:
    """Judge one sample z (2,) at a speed (m/s); write the bits of `FAULTS` into `faults` (2,)."""
    for c in range(2):
        x, p = memory.x[c], limits[c]
        if not math.isfinite(z[c]):
            faults[c] = DROPOUT
            x[_GAP] += 1.0
            continue
        _count_repetitions(x, z[c], z[1 - c])
        flat = _flat_faults(x, p, z[c], limits[1 - c, _NOISE], speed)
        fault = flat
        if _is_outlier(x, p, z[c]):
            fault |= OUTLIER
        elif flat == 0:
            x[_LOW], x[_HIGH] = min(x[_LOW], z[c]), max(x[_HIGH], z[c])
        if fault & OUTLIER == 0 and _is_biased(x, p, z[c]):
            fault |= BIAS
        faults[c] = fault
        x[_COUNT] += 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _count_repetitions(x: Array, z: float, other: float) -> None:  # pragma: no cover - compiled
    """Count how often in a row a channel has said `z`, and how far the other one moved meanwhile."""
    repeated = x[_COUNT] > 0.0 and z == x[_RAW]
    # What is too long for chance is a fault, which must not teach what is normal.
    if x[_RUN] < _run_by_chance(x):
        x[_EQUAL] += ((1.0 if repeated else 0.0) - x[_EQUAL]) / min(x[_COUNT] + 2.0, 2000.0)
    if not repeated:
        x[_RAW], x[_RUN] = z, 0.0
        x[_OTHER_LOW], x[_OTHER_HIGH] = math.inf, -math.inf
    x[_RUN] += 1.0
    if math.isfinite(other):
        x[_OTHER_LOW], x[_OTHER_HIGH] = min(x[_OTHER_LOW], other), max(x[_OTHER_HIGH], other)


@njit(cache=True, nogil=True, error_model="numpy")
def _run_by_chance(x: Array) -> float:  # pragma: no cover - compiled
    """Return the longest run of repetitions that coarse resolution explains, in samples."""
    return max(4.0, 1.0 + _CHANCE / math.log(min(max(x[_EQUAL], 1e-4), 1.0 - 1e-6)))


@njit(cache=True, nogil=True, error_model="numpy")
def _flat_faults(  # pragma: no cover - compiled
    x: Array, p: Array, z: float, other_noise: float, speed: float
) -> int:
    """Return STUCK or SATURATION where the channel says the same for too long or is at its end."""
    longest = _run_by_chance(x)
    other_moved = x[_OTHER_HIGH] - x[_OTHER_LOW] > 2.0 * other_noise
    stuck = x[_RUN] >= min(max(longest, p[_N_SHORT]), p[_N_LONG]) and other_moved and speed > _MOVING
    at_end = x[_HIGH] - x[_LOW] > _NOISES * p[_NOISE] and (z >= x[_HIGH] or z <= x[_LOW])
    if at_end and x[_RUN] >= longest and x[_RUN] < p[_N_LONG] and speed > _MOVING:
        if z >= x[_HIGH]:
            x[_RAIL_HIGH] = z
        else:
            x[_RAIL_LOW] = z
    # Whoever passes a limit shows that it was none.
    if z > x[_RAIL_HIGH]:
        x[_RAIL_HIGH] = math.inf
    if z < x[_RAIL_LOW]:
        x[_RAIL_LOW] = -math.inf
    railed = z >= x[_RAIL_HIGH] or z <= x[_RAIL_LOW] or abs(z) >= p[_RANGE]
    if railed and x[_RUN] < p[_N_LONG]:
        return SATURATION
    if stuck:
        return STUCK
    return SATURATION if railed else 0


@njit(cache=True, nogil=True, error_model="numpy")
def _is_outlier(x: Array, p: Array, z: float) -> bool:  # pragma: no cover - compiled
    """Tell whether neither the last sample nor the line through the last two nor the slow mean explains `z`.

    A blow of the flange is steep but smooth, so that the line follows it. Three samples in a row that nothing
    explains but that lie on a line themselves are a movement, and taken from the third on.
    """
    if x[_COUNT] == 0.0 or x[_GAP] >= p[_N_SHORT]:
        _accept(x, z)
        return False
    line = x[_LAST] + (x[_LAST] - x[_BEFORE]) * (x[_GAP] + 1.0)
    departure = min(abs(z - x[_LAST]), abs(z - line), abs(z - x[_LEVEL]))
    limit = max(_NOISES * p[_NOISE], _SCALES * x[_SCALE])
    learning = x[_COUNT] < _LEARNING
    # Clipped, so that one wild sample does not open the door for the next, and a rough record still does.
    normal = departure if learning else min(departure, 3.0 * limit / _SCALES)
    x[_SCALE] += (normal - x[_SCALE]) / min(x[_COUNT], _MEMORY)
    if departure <= limit or learning:
        _accept(x, z)
        return False
    on_a_line = abs(z - 2.0 * x[_SECOND] + x[_FIRST]) <= 2.0 * limit
    if x[_REJECTED] >= 2.0 and on_a_line:
        x[_LAST], x[_GAP] = x[_SECOND], 0.0
        _accept(x, z)
        return False
    x[_FIRST], x[_SECOND] = x[_SECOND], z
    x[_REJECTED] += 1.0
    x[_GAP] += 1.0
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _accept(x: Array, z: float) -> None:  # pragma: no cover - compiled
    """Take `z` as a good sample."""
    x[_BEFORE] = x[_LAST] if x[_GAP] == 0.0 and x[_COUNT] > 0.0 else z
    x[_LAST], x[_GAP], x[_REJECTED] = z, 0.0, 0.0
    x[_LEVEL] += (z - x[_LEVEL]) / min(x[_COUNT] + 1.0, _MEMORY)


@njit(cache=True, nogil=True, error_model="numpy")
def _is_biased(x: Array, p: Array, z: float) -> bool:  # pragma: no cover - compiled
    """Tell whether the moving mean is beyond what is plausible, once there is half of it."""
    x[_TAKEN] += 1.0
    x[_MEAN] += (z - x[_MEAN]) / min(x[_TAKEN], p[_N_BIAS])
    return bool(x[_TAKEN] >= p[_N_BIAS] / 2.0 and abs(x[_MEAN]) > p[_BIAS_LIMIT])


@njit(cache=True, nogil=True, error_model="numpy")
def _faults_of_log(  # pragma: no cover - compiled
    limits: Array, memory: FaultMemory, z: Array, speed: Array, faults: Indices
) -> None:
    """Run `sensor_faults_step` over the samples z (T, 2) and speeds (T,) into `faults` (T, 2)."""
    for t in range(z.shape[0]):
        sensor_faults_step(limits, memory, z[t], speed[t], faults[t])


class SensorMonitor:
    """Watches a gyro and an accelerometer for faults.

    Found are drop-outs (not finite), outliers, saturation, a stuck sensor and a gross bias. What a fault
    looks like is told at the limits and tests above; what counts as noise adapts to rough records.

    Parameters
    ----------
    h : sampling time, s.
    limits : of the gyro and the accelerometer.
    """

    def __init__(self, h: float, limits: tuple[ChannelLimits, ChannelLimits] = DEFAULT_LIMITS) -> None:
        if not (math.isfinite(h) and h > 0.0):
            raise ValueError(f"sensor monitor: got a step of {h:g} s, expected more than 0; give it in s")
        self.h = h
        self.limits = limits
        self._limits = np.array([_limits(channel, h) for channel in limits])
        self.reset()

    @property
    def design(self) -> Array:
        """The limits (2, 6) that `sensor_faults_step` reads."""
        return self._limits

    @staticmethod
    def new_memory() -> FaultMemory:
        """Return the memory of a monitor that has seen no sample."""
        x = np.zeros((2, 20))
        x[:, _EQUAL] = 0.5
        x[:, [_LOW, _RAIL_HIGH, _OTHER_LOW]] = math.inf
        x[:, [_HIGH, _RAIL_LOW, _OTHER_HIGH]] = -math.inf
        return FaultMemory(x)

    def reset(self) -> None:
        """Forget all samples."""
        self._memory = self.new_memory()

    def step(self, z: Array, speed: float, faults: Indices) -> None:
        """Judge one sample z (2,) at a speed (m/s); write the bits of `FAULTS` into `faults` (2,)."""
        sensor_faults_step(self._limits, self._memory, z, speed, faults)

    def run(self, log: Log) -> Indices:
        """Reset, then return the faults (T, 2) of the samples of a log, as bits of `FAULTS`."""
        self.reset()
        z = np.column_stack([log.yaw_rate, log.lateral_acceleration])
        faults = np.empty(z.shape, dtype=np.int64)
        _faults_of_log(self._limits, self._memory, z, log.speed, faults)
        return faults

    def watched(self, log: Log) -> Log:
        """Return the log with samples that have a fault marked as not usable."""
        return replace(log, usable=log.usable & (self.run(log) == 0))


def fault_names(bits: int) -> tuple[str, ...]:
    """Return the names of the faults in `bits`."""
    return tuple(name for bit, name in FAULTS.items() if bits & bit)


def _limits(channel: ChannelLimits, h: float) -> tuple[float, ...]:
    samples = [max(time / h, least) for time, least in ((_SHORT, 5.0), (_LONG, 10.0), (_BIAS_TIME, 20.0))]
    return (channel.noise, 0.999 * channel.full_scale, channel.bias, *samples)
