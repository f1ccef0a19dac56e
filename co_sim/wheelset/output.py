"""Writes what an experiment produced: results.csv, logs, summary.json, figures and report.html."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from co_sim.errors import InputError
from co_sim.files import whole_file
from co_sim.observers import write_runs_csv
from co_sim.wheelset.assembly import MEASURED, sampling_period
from co_sim.wheelset.identifying.log_csv import write_log

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim.wheelset.results import Experiment, FilterDesign, Run

__all__ = ["check_folder", "summarise", "write"]

_PACKAGES = ("wheelset-cosim", "fmpy", "numpy", "scipy", "control", "numba", "matplotlib")


def check_folder(folder: Path) -> None:
    """Raise `InputError` unless results can be written to `folder`, existing or not; writes nothing."""
    existing = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        fault = "write-protected" if existing.is_dir() else "a file"
        raise InputError(
            f"--out {folder}",
            got=f"{existing}, which is {fault}",
            expected="a folder that can be written to, or a place for a new one",
            remedy="choose another place",
        )


def write(experiment: Experiment, folder: Path) -> dict[str, Any]:
    """Write all results to `folder` and return the summary.

    Every file appears under its name when it is complete; files of an earlier run are replaced one by one.
    """
    from co_sim.wheelset.figures import draw
    from co_sim.wheelset.report import write_report

    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    summary = summarise(experiment)
    write_runs_csv(
        folder / "results.csv",
        {run.name: run for run in experiment.runs},
        every=experiment.scenario.output.every,
    )
    _write_logs(experiment, folder / "logs")
    with whole_file(folder / "summary.json") as path:
        path.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    drawings = draw(experiment, figures)
    write_report(experiment, drawings, summary, folder / "report.html")
    return summary


def _write_logs(experiment: Experiment, folder: Path) -> None:
    """Write what the sensors said in each run, as `wheelset identify` reads it.

    The torque is part of it only where one drives the wheels.
    """
    sources = {name: f"sensors.{name}" for name, _ in MEASURED.values()}
    sources["speed"] = "plant.forward_speed"
    if experiment.scenario.drive.mode == "torque_driven":
        sources["traction_torque"] = "drive.traction_torque"
    folder.mkdir(exist_ok=True)
    period = sampling_period(experiment.scenario)
    for run in experiment.runs:
        columns = {"time": run.time} | {name: run.signals[source] for name, source in sources.items()}
        write_log(folder / f"{run.name}.csv", {name: values[::period] for name, values in columns.items()})


def summarise(experiment: Experiment) -> dict[str, Any]:
    """Return the content of summary.json: the scenario, the bank, and what each stretch of each run says."""
    return {
        "name": experiment.name,
        "scenario": experiment.scenario.model_dump(mode="json"),
        "seed": experiment.scenario.seed,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}},
        "filters": [_filter(design) for design in experiment.filters],
        "runs": [_run(run) for run in experiment.runs],
        "stretches": [asdict(stretch) for stretch in experiment.stretches],
    }


def _filter(design: FilterDesign) -> dict[str, Any]:
    tuning = design.tuning
    return {
        "name": design.name,
        "condition": design.condition,
        "point": asdict(design.point),
        "states": list(tuning.filter.states),
        "dropped": list(tuning.filter.dropped),
        "noise": asdict(tuning.noise),
        "cost": tuning.cost,
        "evaluations": tuning.evaluations,
        "training_s": design.training,
    }


def _run(run: Run) -> dict[str, Any]:
    return {
        "name": run.name,
        "point": asdict(run.point) if run.point else None,
        "end_s": float(run.time[-1]),
        "valid_until_s": run.valid_until,
        "stopped": run.stopped,
    }
