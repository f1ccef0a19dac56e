"""Faults of a log by sample, as words for each row of the answer and as a list of what was found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.sensor_faults import FAULTS, fault_names

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.grid import Sampled

    Array = NDArray[np.float64]
    Indices = NDArray[np.int64]

__all__ = ["SENSORS", "FaultFound", "SensorStatus"]

#: The sensors, in the order of the measurements.
SENSORS = ("gyro", "accelerometer")
#: What else can be at fault in a log: name, name of the fault.
_OTHERS = (("speed", "dropout"), ("torque", "dropout"), ("clock", "jitter"), ("clock", "gap"))
_BITS = max(FAULTS).bit_length()


@dataclass(frozen=True, slots=True)
class FaultFound:
    """One kind of fault of one source.

    Parameters
    ----------
    source, fault : such as ``"gyro"``, ``"stuck"``. samples : that have it. share : of all samples.
    stretches : number of stretches of consecutive samples. first, last : time of the ends, s.
    """

    source: str
    fault: str
    samples: int
    share: float
    stretches: int
    first: float
    last: float


@dataclass(frozen=True, eq=False)
class SensorStatus:
    """Faults of a log.

    Parameters
    ----------
    time : (T,) s. sensors : (T, 2) bits of `estimator.sensor_faults.FAULTS`.
    others : (T, 4) bool, filled speeds, filled torques, stamps off the grid and places without a row, which
        count for this alone.
    """

    time: Array
    sensors: Indices
    others: NDArray[np.bool_]

    @classmethod
    def of(cls, sampled: Sampled, sensors: Indices) -> SensorStatus:
        """Join what the monitor and the reading of the log found."""
        none = np.zeros(len(sampled.log), dtype=np.bool_)
        there = ~sampled.gap
        filled = [sampled.filled.get(name, none) & there for name in ("speed", "traction_torque")]
        others = np.column_stack([*filled, sampled.jitter, sampled.gap])
        time = sampled.clock.offset + sampled.log.time
        return cls(time, sensors * there[:, None], others)

    def words(self, rows: Indices) -> list[str]:
        """Return the faults since the row before, for each of the samples at `rows`.

        ``"ok"``, or such as ``"accelerometer:outlier|dropout clock:jitter"``.
        """
        packed = self._packed
        # The samples after the row before, up to the row.
        starts = np.concatenate([[0], np.asarray(rows[:-1]) + 1]).astype(np.int64)
        joined = np.bitwise_or.reduceat(packed[: rows[-1] + 1], starts)
        kinds, which = np.unique(joined, return_inverse=True)
        texts = [_words(int(bits)) for bits in kinds]
        return [texts[i] for i in which.tolist()]

    def found(self) -> list[FaultFound]:
        """Return every kind of fault that occurs, sensors first."""
        return list(self._found())

    def where(self, source: str, fault: str) -> NDArray[np.bool_]:
        """Return the samples (T,) that have a fault of a source."""
        if source in SENSORS:
            bit = next(bit for bit, name in FAULTS.items() if name == fault)
            return np.asarray(self.sensors[:, SENSORS.index(source)] & bit != 0)
        return np.asarray(self.others[:, _OTHERS.index((source, fault))])

    @property
    def _packed(self) -> Indices:
        packed = self.sensors[:, 0] | self.sensors[:, 1] << _BITS
        for i in range(len(_OTHERS)):
            packed = packed | self.others[:, i].astype(np.int64) << (2 * _BITS + i)
        return packed

    def _found(self) -> Iterator[FaultFound]:
        kinds = [(sensor, fault) for sensor in SENSORS for fault in FAULTS.values()]
        for source, fault in (*kinds, *_OTHERS):
            yield from self._one(source, fault, self.where(source, fault))

    def _one(self, source: str, fault: str, where: NDArray[np.bool_]) -> Iterator[FaultFound]:
        if not where.any():
            return
        (samples,) = np.nonzero(where)
        yield FaultFound(
            source,
            fault,
            samples=len(samples),
            share=len(samples) / len(where),
            stretches=1 + int(np.count_nonzero(np.diff(samples) > 1)),
            first=float(self.time[samples[0]]),
            last=float(self.time[samples[-1]]),
        )


def _words(bits: int) -> str:
    mask = (1 << _BITS) - 1
    faults: dict[str, list[str]] = {}
    for i, sensor in enumerate(SENSORS):
        faults[sensor] = list(fault_names(bits >> (i * _BITS) & mask))
    for i, (source, fault) in enumerate(_OTHERS):
        faults.setdefault(source, [])
        if bits >> (2 * _BITS + i) & 1:
            faults[source].append(fault)
    return " ".join(f"{source}:{'|'.join(names)}" for source, names in faults.items() if names) or "ok"
