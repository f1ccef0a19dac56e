"""The adhesion bank on a log."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError
from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS, Answer
from co_sim.wheelset.prose.words import percent, quantity
from estimator import ERRI_B176
from estimator.log import Log

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.results import Settings
    from estimator.adhesion import AdhesionIdentification

__all__ = ["answer_of", "refined", "run_adhesion_bank"]

#: Longest step that the nonlinear filters integrate well, s: at low speed the wheelset is stiff.
_LARGEST_STEP = 1.25e-3
#: Speed below which the wheelset counts as being at rest, m/s.
_SLOWEST = 1.0
#: Of places on a grid, in steps.
_ROUNDING = 1e-6


def run_adhesion_bank(log: Log, settings: Settings) -> Answer:
    """Return what the adhesion bank says about a log.

    Raises
    ------
    InputError
        If the rows are not a multiple of the bank's blocks of 10 ms apart, or the bank refuses the vehicle.
    """
    from estimator import SensorNoise
    from estimator.adhesion.assumptions import BLOCK
    from estimator.adhesion.bank import AdhesionBank

    blocks = round(settings.every / BLOCK)
    if blocks < 1 or abs(settings.every - blocks * BLOCK) > 1e-6:
        raise InputError(
            "--every",
            got=f"{settings.every:g} s",
            expected=f"a multiple of {BLOCK:g} s",
            remedy="the adhesion bank weighs its evidence that often",
        )
    moving = log.speed >= _SLOWEST
    fine = refined(replace(log, usable=np.asarray(log.usable) & moving[:, None]))
    try:
        bank = AdhesionBank(
            wheelset=settings.vehicle.wheelset,
            conditions={name: settings.vehicle.conditions[name] for name in CONDITION_NAMES},
            noise=SensorNoise(*settings.noise),
            track=ERRI_B176[settings.track],
            h=fine.h,
            unknown=settings.vehicle.unknown,
        )
        answer = answer_of(bank.run(fine, every=settings.every), log)
    except ValueError as error:  # such as a creep curve of the user's own that has no maximum
        raise InputError(
            "adhesion bank",
            got=str(error),
            expected="a vehicle, conditions and a log that it can use",
            remedy="change those, or try --bank paper",
        ) from error
    return replace(
        answer,
        identifiable=answer.identifiable & moving[answer.samples],
        fuzzy=answer.fuzzy and answer.fuzzy.only(moving[answer.samples]),
        notes=tuple(_notes(log, moving)),
    )


def answer_of(said: AdhesionIdentification, log: Log) -> Answer:
    """Return what the adhesion bank said about a log, in the form that all banks have in common."""
    regions = [said.regions.index(name) for name in REGIONS]
    return Answer(
        bank="adhesion",
        time=said.time,
        samples=np.floor((said.time - log.time[0]) / log.h + _ROUNDING).astype(np.int64),
        p_region=said.p_region[:, regions],
        p_condition=said.p_condition,
        p_none=said.p_none,
        mu_used=said.mu_used,
        mu_max=said.mu_max,
        mu_max_low=said.mu_max_low,
        mu_max_high=said.mu_max_high,
        identifiable=said.identifiable,
        fuzzy=said.fuzzy._replace(region=said.fuzzy.region[:, regions]),
    )


def refined(log: Log) -> Log:
    """Return the log at a step that the nonlinear filters can integrate, `_LARGEST_STEP` at most.

    Between the samples of a slow logger there is nothing to measure: the filters only predict.
    """
    factor = math.ceil(log.h / _LARGEST_STEP - _ROUNDING)
    if factor <= 1:
        return log
    h = log.h / factor
    time = log.time[0] + h * np.arange((len(log) - 1) * factor + 1)
    usable = np.zeros((len(time), 2), dtype=np.bool_)
    usable[::factor] = log.usable
    return Log(
        time=time,
        yaw_rate=np.repeat(log.yaw_rate, factor)[: len(time)],
        lateral_acceleration=np.repeat(log.lateral_acceleration, factor)[: len(time)],
        speed=np.interp(time, log.time, log.speed),
        traction_torque=None
        if log.traction_torque is None
        else np.interp(time, log.time, log.traction_torque),
        usable=usable,
    )


def _notes(log: Log, moving: NDArray[np.bool_]) -> Iterator[str]:
    if not moving.all():
        yield (
            f"Below {quantity(_SLOWEST, 'm/s')}, {percent(1.0 - float(moving.mean()))} of the time, the "
            f"sensors say nothing about the rail: the filters do not use these samples, and no row is "
            f"identifiable."
        )
    if log.traction_torque is None:
        yield (
            "Without the traction torque the creep follows from nothing but the sensors: the used adhesion "
            "is estimated, and much less is identifiable."
        )
    if refined(log) is not log:
        yield (
            f"At {quantity(1.0 / log.h, 'Hz')} the steps between samples are too long for the nonlinear "
            f"filters, so that they take several from one sample to the next."
        )
