"""The bank of the paper on a log: three filters on the dry curve at the log's speed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.errors import InputError
from co_sim.wheelset.identifying.answer import REGIONS, Answer, row_places
from co_sim.wheelset.prose.findings import CLEAR_LEAD
from co_sim.wheelset.prose.words import listed, number, quantity
from co_sim.wheelset.scenario import Scenario
from estimator.masked import identify_rows

if TYPE_CHECKING:
    from collections.abc import Iterable

    from co_sim.wheelset.experiment import Laboratory
    from co_sim.wheelset.results import FilterDesign
    from co_sim.wheelset.vehicle_file import Vehicle
    from estimator.log import Log

__all__ = ["PaperBank"]

#: Speed above which a sample counts for the design, m/s.
_MOVING = 1.0
#: Departure from the speed of the design up to which an answer counts, and from which on the page warns.
_SPEED_TOLERANCE = 0.1
#: Share of the window that must be usable.
_USABLE = 0.5
#: Length of the runs that tune the filters, and of the window, s.
_TRAINING, _WINDOW = 10.0, 1.0


class PaperBank:
    """Filters for P1, P2 and P3 of the dry curve at the median speed of a log, tuned as in `wheelset run`.

    Parameters
    ----------
    log : decides speed and sampling time. vehicle : what the filters know.
    noise : rms of gyro (rad/s) and accelerometer (m/s2). track : name of the spectrum.

    Raises
    ------
    InputError
        If the wheelset of the log does not move, or the dry curve has no maximum at this speed.
    """

    def __init__(self, log: Log, vehicle: Vehicle, noise: tuple[float, float], track: str) -> None:
        moving = log.speed[log.speed > _MOVING]
        if moving.size == 0:
            raise InputError(
                "log: speed",
                got=f"at most {log.speed.max():.3g} m/s",
                expected=f"more than {_MOVING:g} m/s somewhere",
                remedy="the bank of the paper needs a wheelset that runs",
            )
        self.speed = float(np.median(moving))
        self._log = log
        self.laboratory = _laboratory(log.h, self.speed, vehicle, noise, track)

    def design(self) -> tuple[FilterDesign, ...]:
        """Tune the filters, each on a run of the plant at its own operating point."""
        return self.laboratory.design()

    def run(self, filters: tuple[FilterDesign, ...], every: float) -> Answer:
        """Return what the filters say, one row every `every` (s)."""
        log = self._log
        identifier = self.laboratory.identifier(filters)
        rows = row_places(log, every)
        said = identify_rows(identifier, log, rows)
        p = said.probabilities
        first, second = np.sort(p, axis=1)[:, :-3:-1].T
        near = np.abs(log.speed[rows] - self.speed) <= _SPEED_TOLERANCE * self.speed
        # Equal probabilities are ranked by residual: the rules know only a few degrees of small.
        ranked = p - 1e-6 * said.E
        return Answer(
            bank="paper",
            time=log.time[rows],
            samples=rows,
            p_region=ranked / ranked.sum(axis=1, keepdims=True),
            identifiable=(first - second >= CLEAR_LEAD) & (said.usable >= _USABLE) & near,
            notes=tuple(self._notes()),
        )

    def _notes(self) -> Iterable[str]:
        yield (
            "The bank of the paper assumes dry rail. It compares P1, P2 and P3 of the dry curve, takes them "
            f"for the regions {listed(REGIONS)}, and can say nothing about the condition of the rail or how "
            "much adhesion there is: those columns are empty, and the advice never asks for more torque. Its "
            "fuzzy probabilities are scaled to sum to one."
        )
        low, high = np.percentile(self._log.speed, [1.0, 99.0])
        if max(high - self.speed, self.speed - low) > _SPEED_TOLERANCE * self.speed:
            yield (
                f"The filters are designed for one speed, the median of {quantity(self.speed, 'm/s')}, but "
                f"the log goes from {number(float(low))} to {quantity(float(high), 'm/s')}. Rows more than "
                f"{_SPEED_TOLERANCE:.0%} off are not identifiable; the adhesion bank follows the speed."
            )


def _laboratory(
    h: float, speed: float, vehicle: Vehicle, noise: tuple[float, float], track: str
) -> Laboratory:
    from co_sim.wheelset.experiment import Laboratory

    tables: dict[str, Any] = {
        "simulation": {"step": h, "duration": round(_TRAINING / h) * h},
        "drive": {"mode": "prescribed_creep", "speed": speed},
        "conditions": {name: asdict(condition) for name, condition in vehicle.conditions.items()},
        "track": {"spectrum": track},
        "sensors": {"gyro": {"noise_rms": noise[0]}, "accelerometer": {"noise_rms": noise[1]}},
        "identifier": {"window": _WINDOW, "training": round(_TRAINING / h) * h},
        "wheelset": asdict(vehicle.wheelset),
    }
    return Laboratory(Scenario.model_validate(tables), "log", Path())
