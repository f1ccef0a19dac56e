"""Everything that the identification of a log produced."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.answer import Answer
    from co_sim.wheelset.identifying.grid import Clock
    from co_sim.wheelset.identifying.status import SensorStatus
    from co_sim.wheelset.vehicle_file import Vehicle
    from estimator.advice import Advice
    from estimator.log import Log

__all__ = ["Identified", "Settings", "shares"]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a log is identified.

    Parameters
    ----------
    bank : ``"adhesion"`` or ``"paper"``. every : time between rows, s.
    noise : rms of gyro (rad/s) and accelerometer (m/s2). track : name of the spectrum.
    vehicle : what the filters know. vehicle_file : where it comes from.
    speed : constant speed instead of the column, m/s.
    renamed : headings in the file by name of the column.
    full_scale, bias_limit : of gyro and accelerometer, see `estimator.sensor_faults.ChannelLimits`.
    """

    bank: str
    every: float
    noise: tuple[float, float]
    track: str
    vehicle: Vehicle
    vehicle_file: str | None = None
    speed: float | None = None
    renamed: Mapping[str, str] = field(default_factory=dict)
    full_scale: tuple[float, float]
    bias_limit: tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Identified:
    """A log and what was found out about it.

    Parameters
    ----------
    file : name of the log. settings : as asked.
    log : on a uniform grid, with the samples that can be used. clock, status : what is wrong with it.
    ignored : headings of columns that were not used. notes : of the reading.
    answer, advice : row by row.
    seconds : wall time by stage.
    """

    file: str
    settings: Settings
    log: Log
    clock: Clock
    status: SensorStatus
    ignored: tuple[str, ...]
    notes: tuple[str, ...]
    answer: Answer
    advice: Advice
    seconds: Mapping[str, float]

    @cached_property
    def words(self) -> list[str]:
        """The status of the sensors in each row."""
        return self.status.words(self.answer.samples)

    @property
    def region_shares(self) -> dict[str, float] | None:
        """Share of the identifiable rows by most probable region; None if there are none."""
        return shares(self.answer.region, REGIONS, self.answer.identifiable)

    @property
    def condition_shares(self) -> dict[str, float] | None:
        """Share of the identifiable rows by most probable condition; None if unknown or there are none."""
        condition = self.answer.condition
        return None if condition is None else shares(condition, CONDITION_NAMES, self.answer.identifiable)

    @property
    def fuzzy_advice(self) -> Advice | None:
        """What the fuzzy identifier advises; None if the bank has none."""
        return None if self.answer.fuzzy is None else self.answer.fuzzy.advice

    @property
    def same_condition(self) -> float | None:
        """How often the fuzzy identifier names the most probable condition, where it is clear."""
        said, condition = self.answer.fuzzy, self.answer.condition
        if said is None or condition is None or not said.clear.any():
            return None
        return float(np.mean((said.condition.argmax(axis=1) == condition)[said.clear]))

    @property
    def identifiable_share(self) -> float:
        """Share of the rows whose answer is to be trusted."""
        return float(np.mean(self.answer.identifiable))


def shares(
    which: NDArray[np.int64], names: Sequence[str], where: NDArray[np.bool_]
) -> dict[str, float] | None:
    """Return how often each of `names` is the one, among the rows `where`; None if there are none."""
    if not where.any():
        return None
    counts = np.bincount(which[where], minlength=len(names))
    return dict(zip(names, (counts / counts.sum()).tolist(), strict=True))
