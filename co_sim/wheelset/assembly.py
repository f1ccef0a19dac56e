"""Builds the co-simulation of one run.

Its components know each other only by their ports::

drive ----> plant <---- track
rail -----> plant ----> sensors ----> identifier
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

import numpy as np

from co_sim.component import Port
from co_sim.errors import InputError
from co_sim.fmu import FmuComponent
from co_sim.signals import TimeTable
from co_sim.system import Connection, System
from co_sim.wheelset.identification import MEASUREMENTS, IdentifierComponent
from co_sim.wheelset.scenario import TorqueDriven
from co_sim.wheelset.sensors import Channel, Sensors, SensorSpec
from co_sim.wheelset.track import TrackInput
from fmu_wheelset import RailCondition, path

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from co_sim.component import Component
    from co_sim.wheelset.scenario import Rail, Scenario
    from co_sim.wheelset.track import TrackProfile
    from estimator import Identifier
    from fmu_wheelset import WheelsetParameters

__all__ = [
    "MEASURED",
    "Case",
    "assemble",
    "plant_fmu",
    "plant_parameters",
    "rail_table",
    "sampling_period",
    "wires_of_plant",
]

#: What each sensor measures: output of the plant and its unit, in the order of (14).
MEASURED = dict(zip(("gyro", "accelerometer"), MEASUREMENTS, strict=True))

#: Outputs of the plant that a run records.
_OUTPUTS = (
    "lateral_displacement",
    "yaw_angle",
    "lateral_velocity",
    "yaw_rate",
    "lateral_acceleration",
    "relative_displacement",
    "forward_speed",
    "axle_twist",
    "axle_torque",
    "adhesion_used",
    *(
        f"{side}.{name}"
        for side in ("left", "right")
        for name in (
            "wheel_speed",
            "creepage_x",
            "creepage_y",
            "creep_force_x",
            "creep_force_y",
            "adhesion_used",
            "adhesion_peak",
            "creep_peak",
            "g11",
            "g22",
        )
    ),
)
_SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class Case:
    """One co-simulation of a scenario.

    Parameters
    ----------
    name : for results. mode : drive mode of the plant.
    creep : prescribed creepage; 0 in the other modes.
    rail : stretches of rail. track : under the wheelset. duration : s.
    seed : of the sensors' noise.
    """

    name: str
    mode: str
    creep: float
    rail: tuple[Rail, ...]
    track: TrackProfile
    duration: float
    seed: int


def assemble(scenario: Scenario, case: Case, identifier: Identifier | None) -> System:
    """Return the components of a run and their connections; without identifier for training."""
    components: dict[str, Component] = {
        "drive": _drive(scenario, case),
        "rail": _rail(scenario, case),
        "track": TrackInput(case.track, ramp=scenario.track.ramp),
        "plant": plant_fmu(scenario.parameters, case.mode, case.creep, scenario.fmu.version),
        "sensors": _sensors(scenario, case),
    }
    wires = list(wires_of_plant(components["rail"]))
    if identifier is not None:
        components["identifier"] = IdentifierComponent(identifier, period=sampling_period(scenario))
        wires += [Connection(f"sensors.{name}", f"identifier.{name}") for name, _ in MEASURED.values()]
    return System(components, wires)


def wires_of_plant(rail: Component) -> Iterator[Connection]:
    """Yield the connections that every run has: of drive, rail, track, plant and sensors."""
    for name in ("speed", "prescribed_creepage", "traction_torque"):
        yield Connection(f"drive.{name}", f"plant.{name}")
    yield Connection("drive.speed", "track.speed")
    yield Connection("track.lateral_offset", "plant.track_lateral_offset")
    for port in rail.outputs:
        yield Connection(f"rail.{port.name}", f"plant.{port.name}")
    for name, _ in MEASURED.values():
        yield Connection(f"plant.{name}", f"sensors.{name}")


def plant_fmu(wheelset: WheelsetParameters, mode: str, creep: float, fmi: Literal[2, 3] = 3) -> FmuComponent:
    """Return the wheelset FMU.

    Parameters
    ----------
    wheelset : its parameters. mode : drive mode. fmi : version of the standard.
    creep : longitudinal creepage at the start, torque driven.
    """
    parameters: dict[str, float | int | bool | str] = {
        "drive_mode": mode,
        "initial_creepage": creep,
        **plant_parameters(wheelset),
    }
    return FmuComponent(path(fmi=fmi), outputs=_OUTPUTS, parameters=parameters)


def plant_parameters(wheelset: WheelsetParameters) -> dict[str, float]:
    """Return the parameters of the FMU by its names.

    The normal load is an input of the FMU, so that a vehicle could supply it.
    """
    return {
        prefix + declared.name: getattr(owner, declared.name)
        for owner, prefix in ((wheelset, ""), (wheelset.patch, "patch."))
        for declared in fields(owner)
        if "unit" in declared.metadata and declared.name != "N"
    }


def _drive(scenario: Scenario, case: Case) -> TimeTable:
    drive = scenario.drive
    times: tuple[float, ...] = (0.0,)
    torque: tuple[float, ...] = (0.0,)
    if isinstance(drive, TorqueDriven) and case.mode == drive.mode:
        times, torque = drive.times, drive.torque
    values = np.column_stack([np.full(len(times), drive.speed), np.full(len(times), case.creep), torque])
    ports = [Port("speed", "m/s"), Port("prescribed_creepage"), Port("traction_torque", "N.m")]
    return TimeTable(times, values, ports, interpolation="linear")


def _rail(scenario: Scenario, case: Case) -> TimeTable:
    times = [stretch.since for stretch in case.rail]
    conditions = [[scenario.condition(name) for name in stretch.sides] for stretch in case.rail]
    return rail_table(times, conditions, scenario.parameters.N)


def rail_table(times: Sequence[float], conditions: Sequence[Sequence[RailCondition]], N: float) -> TimeTable:
    """Return the rail conditions and normal loads over time, under both wheels.

    Parameters
    ----------
    times : from which each stretch of rail lies under the wheelset, s.
    conditions : under the left and the right wheel, for each stretch.
    N : normal load of each wheel, N.
    """
    parameters = fields(RailCondition)
    ports, columns = [], []
    for index, side in enumerate(_SIDES):
        for declared in parameters:
            ports.append(Port(f"rail_{side}.{declared.name}", declared.metadata["unit"]))
            columns.append([getattr(pair[index], declared.name) for pair in conditions])
        ports.append(Port(f"normal_load_{side}", "N"))
        columns.append([N] * len(conditions))
    return TimeTable(times, np.array(columns).T, ports, interpolation="hold")


def _sensors(scenario: Scenario, case: Case) -> Sensors:
    channels = [
        Channel(name, unit, SensorSpec(**getattr(scenario.sensors, sensor).model_dump()))
        for sensor, (name, unit) in MEASURED.items()
    ]
    return Sensors(channels, seed=case.seed)


def sampling_period(scenario: Scenario) -> int:
    """Return the steps between two samples of the sensors.

    Raises
    ------
    InputError
        If the sensors differ in their rate: the filters take both measurements at once.
    """
    h = scenario.simulation.step
    rates = [getattr(scenario.sensors, sensor).rate_hz or 1.0 / h for sensor in MEASURED]
    if abs(rates[0] - rates[1]) > 1e-9 * rates[0]:
        raise InputError(
            "sensors",
            got=f"rates of {rates[0]:g} Hz and {rates[1]:g} Hz",
            expected="one rate",
            remedy="set the same rate_hz for both",
        )
    return max(round(1.0 / (rates[0] * h)), 1)
