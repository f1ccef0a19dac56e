"""The adhesion bank on a log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError
from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS, Answer
from estimator import ERRI_B176

if TYPE_CHECKING:
    from co_sim.wheelset.identifying.results import Settings
    from estimator.adhesion import AdhesionIdentification
    from estimator.log import Log

__all__ = ["answer_of", "run_adhesion_bank"]

#: How often the bank weighs its evidence, s.
_BLOCK = 0.01


def run_adhesion_bank(log: Log, settings: Settings) -> Answer:
    """Return what the adhesion bank says about a log.

    Raises
    ------
    InputError
        If the rows are not a multiple of the bank's blocks of 10 ms apart.
    """
    from estimator.adhesion.bank import AdhesionBank, SensorNoise

    blocks = round(settings.every / _BLOCK)
    if blocks < 1 or abs(settings.every - blocks * _BLOCK) > 1e-6:
        raise InputError(
            "--every",
            got=f"{settings.every:g} s",
            expected=f"a multiple of {_BLOCK:g} s",
            remedy="the adhesion bank weighs its evidence that often",
        )
    bank = AdhesionBank(
        wheelset=settings.vehicle.wheelset,
        conditions={name: settings.vehicle.conditions[name] for name in CONDITION_NAMES},
        noise=SensorNoise(*settings.noise),
        track=ERRI_B176[settings.track],
        h=log.h,
    )
    return answer_of(bank.run(log, every=settings.every), log)


def answer_of(said: AdhesionIdentification, log: Log) -> Answer:
    """Return what the adhesion bank said about a log, in the form that all banks have in common."""
    return Answer(
        bank="adhesion",
        time=said.time,
        samples=np.rint((said.time - log.time[0]) / log.h).astype(np.int64),
        p_region=said.p_region[:, [said.regions.index(name) for name in REGIONS]],
        p_condition=said.p_condition,
        p_none=said.p_none,
        mu_used=said.mu_used,
        mu_max=said.mu_max,
        mu_max_low=said.mu_max_low,
        mu_max_high=said.mu_max_high,
        identifiable=said.identifiable,
    )
