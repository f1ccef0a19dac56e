"""From a log file to everything that is known about it."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from co_sim.errors import InputError
from co_sim.wheelset.identifying.grid import on_grid
from co_sim.wheelset.identifying.log_file import read_columns
from co_sim.wheelset.identifying.results import Identified
from co_sim.wheelset.identifying.status import SensorStatus

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from co_sim.wheelset.identifying.answer import Answer
    from co_sim.wheelset.identifying.results import Settings
    from estimator.log import Log

__all__ = ["Stages", "identify", "write"]


class Stages:
    """Wall time of each stage of the work, and where it is told that one begins."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure a block of work."""
        self.begin(name)
        started = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - started

    def begin(self, name: str) -> None:
        """Take note that a stage begins."""


def identify(path: Path, settings: Settings, stages: Stages) -> Identified:
    """Read a log, find the faults of its sensors and run a bank on what is left.

    Raises
    ------
    InputError
        If the log cannot be read or used.
    RunError
        If the plant that tunes the bank of the paper fails.
    """
    from estimator.advice import advise
    from estimator.sensor_faults import ChannelLimits, SensorMonitor

    with stages.stage("reading"):
        columns = read_columns(path, renamed=settings.renamed, speed=settings.speed is None)
        sampled = on_grid(path.name, columns, settings.speed)
        _check_rows(sampled.log, settings.every)
    with stages.stage("sensors"):
        gyro, accelerometer = (
            ChannelLimits(noise=noise, bias=bias, full_scale=full_scale)
            for noise, bias, full_scale in zip(
                settings.noise, settings.bias_limit, settings.full_scale, strict=True
            )
        )
        faults = SensorMonitor(sampled.log.h, (gyro, accelerometer)).run(sampled.log)
        log = replace(sampled.log, usable=sampled.log.usable & (faults == 0))
    answer = _answer(log, settings, stages)
    with stages.stage("advice"):
        advice = advise(answer.p_region, answer.identifiable, answer.mu_used, answer.mu_max_low)
    return Identified(
        file=path.name,
        settings=settings,
        log=log,
        clock=sampled.clock,
        status=SensorStatus.of(sampled, faults),
        ignored=columns.ignored,
        notes=columns.notes,
        answer=answer,
        advice=advice,
        seconds=stages.seconds,
    )


def _check_rows(log: Log, every: float) -> None:
    if not 0.9 * log.h <= every <= (1.0 + 1e-6) * len(log) * log.h:
        raise InputError(
            "--every",
            got=f"{every:g} s",
            expected=f"from the step of the log, {log.h:.6g} s, to its length of {len(log) * log.h:.6g} s",
            remedy="leave it out for 0.01 s",
        )


def _answer(log: Log, settings: Settings, stages: Stages) -> Answer:
    if settings.bank == "paper":
        from co_sim.wheelset.identifying.paper import PaperBank

        paper = PaperBank(log, settings.vehicle, settings.noise, settings.track)
        with stages.stage("design"):
            filters = paper.design()
        with stages.stage("filters"):
            return paper.run(filters, settings.every)
    from co_sim.wheelset.identifying.adhesion import run_adhesion_bank

    with stages.stage("filters"):
        return run_adhesion_bank(log, settings)


def write(done: Identified, folder: Path, stages: Stages) -> dict[str, Any]:
    """Write everything to `folder` and return the summary."""
    from co_sim.wheelset.identifying.figures import draw
    from co_sim.wheelset.identifying.page import write_page
    from co_sim.wheelset.identifying.writing import (
        summarise,
        write_advice,
        write_fuzzy,
        write_identification,
        write_summary,
    )

    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    with stages.stage("writing"):
        write_identification(done, folder / "identification.csv")
        write_advice(done, folder / "advice.csv")
        write_fuzzy(done, folder / "fuzzy.csv")
    with stages.stage("figures"):
        drawings = draw(done, figures)
    summary = summarise(done)
    write_page(done, drawings, summary, folder / "report.html")
    write_summary(summary, folder / "summary.json")
    return summary
