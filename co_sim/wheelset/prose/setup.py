"""A scenario in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from co_sim.wheelset.prose.words import listed, quantity
from co_sim.wheelset.scenario import FreeRolling, PrescribedCreep

if TYPE_CHECKING:
    from co_sim.wheelset.results import Experiment
    from co_sim.wheelset.scenario import Rail, Scenario, Sensor

__all__ = ["described"]

_RESIDUALS = {
    "lateral_acceleration": "of the lateral acceleration",
    "yaw_rate": "of the yaw rate",
    "both": "of both measurements, each over its noise,",
}
_SPECTRA = {"erri_low": "ERRI B176, low level", "erri_high": "ERRI B176, high level"}


def described(experiment: Experiment) -> list[tuple[str, str]]:
    """Return what was done as (subject, sentences)."""
    scenario = experiment.scenario
    return [
        ("Plant", _plant(scenario)),
        ("Rail", _rail(scenario)),
        ("Drive", _drive(experiment)),
        ("Track", _track(scenario)),
        ("Sensors", _sensors(scenario)),
        ("Filters", _filters(experiment)),
        ("Identifier", _identifier(experiment)),
    ]


def _plant(scenario: Scenario) -> str:
    simulation, clearance = scenario.simulation, scenario.parameters.flange_clearance
    touch = f"Its flanges touch the rails {quantity(clearance * 1e3, 'mm')} off the track."
    return (
        f"Nonlinear wheelset with Polach's creep law, as an FMU (FMI {scenario.fmu.version}), stepped by the "
        f"co-simulation every {quantity(simulation.step * 1e3, 'ms')}; each run lasts "
        f"{quantity(simulation.duration, 's')}. "
        f"{touch if scenario.has_flanges else 'The model has no flange.'}"
    )


def _rail(scenario: Scenario) -> str:
    if len(scenario.rail) == 1:
        return f"{_sides(scenario.rail[0])} throughout."
    told = [f"{_sides(rail)} from {quantity(rail.since, 's')}" for rail in scenario.rail]
    return f"{'; '.join(told)}."


def _sides(rail: Rail) -> str:
    left, right = rail.sides
    return left if left == right else f"{left} on the left and {right} on the right"


def _drive(experiment: Experiment) -> str:
    drive = experiment.scenario.drive
    speed = f"at {quantity(drive.speed, 'm/s')} ({quantity(3.6 * drive.speed, 'km/h')})"
    if isinstance(drive, PrescribedCreep):
        points = [
            f"{run.name} ({quantity(100.0 * run.point.creep, '%')} creep)"
            for run in experiment.runs
            if run.point
        ]
        runs = "one run at" if len(points) == 1 else "one run at each of"
        return f"A common longitudinal creepage imposed on both wheels {speed}: {runs} {listed(points)}."
    if isinstance(drive, FreeRolling):
        return f"Free rolling {speed}: no creepage but what the wheelset's own motion makes."
    corners = [
        f"{quantity(torque, 'N m')} at {quantity(time, 's')}"
        for time, torque in zip(drive.times, drive.torque, strict=True)
    ]
    return (
        f"A torque on the axle, {listed(corners)}, linear in between and constant after; the speed is held "
        f"{speed}."
    )


def _track(scenario: Scenario) -> str:
    track = scenario.track
    if track.file is not None:
        source = (
            f"Measured lateral alignment from {track.file}; the filters assume {_SPECTRA[track.spectrum]}"
        )
    else:
        source = f"Random lateral alignment of the spectrum {_SPECTRA[track.spectrum]}, the same for all runs"
    return f"{source}; faded in over {quantity(track.ramp, 'm')}."


def _sensors(scenario: Scenario) -> str:
    gyro = _sensor(scenario.sensors.gyro, 1e3, "mrad/s")
    accelerometer = _sensor(scenario.sensors.accelerometer, 1.0, "m/s²")
    return f"Gyro (yaw rate): {gyro}. Accelerometer (lateral): {accelerometer}."


def _sensor(sensor: Sensor, factor: float, unit: str) -> str:
    parts = [f"white noise of {quantity(sensor.noise_rms * factor, unit)} rms in each sample"]
    if sensor.bias != 0.0:
        parts.append(f"bias {quantity(sensor.bias * factor, unit)}")
    if sensor.bandwidth_hz is not None:
        parts.append(f"bandwidth {quantity(sensor.bandwidth_hz, 'Hz')}")
    if sensor.rate_hz is not None:
        parts.append(f"{quantity(sensor.rate_hz, 'samples a second')}")
    return ", ".join(parts)


def _filters(experiment: Experiment) -> str:
    names = experiment.filter_names
    return (
        f"{len(names)} steady-state Kalman filters, {listed(names)}, each for the wheelset linearised at its "
        f"own point of a creep curve and tuned by maximum likelihood on a training run there."
    )


def _identifier(experiment: Experiment) -> str:
    identifier = experiment.scenario.identifier
    return (
        f"Innovations {_RESIDUALS[identifier.residual]} in a moving window of "
        f"{quantity(identifier.window, 's')}, normalised across the filters as in (15) of the paper; "
        f"{len(experiment.fuzzy.rules)} fuzzy rules, three for each filter against its best rival, make "
        f"them probabilities."
    )
