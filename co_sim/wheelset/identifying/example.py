"""A packaged journey to try the identification on: rail that turns slippery, and sensors that fail."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.identifying.log_csv import write_log
from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from fmu_wheelset import CONDITIONS

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["EXAMPLE", "JOURNEY", "write_example"]

#: Name of the example on the command line.
EXAMPLE = "example"

#: 24 s at 30 to 32 m/s with a torque that uses three quarters of what low rail gives.
JOURNEY = Journey(
    duration=24.0,
    speed=Profile((0.0, 24.0), (30.0, 32.0)),
    torque=Profile((0.0, 1.0), (0.0, 3600.0)),
    rails=(
        Stretch(0.0, CONDITIONS["dry"]),
        Stretch(8.0, CONDITIONS["wet"]),
        Stretch(16.0, CONDITIONS["low"]),
    ),
    seed=7,
)
#: When the gyro is stuck, when rows are missing, and when the accelerometer says something wild, s.
STUCK, MISSING, WILD = (5.0, 5.4), (12.0, 12.2), (3.0, 10.0, 20.0)


def write_example(folder: Path) -> Path:
    """Record the journey, let the sensors fail as told above and write log.csv into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    recording = record(JOURNEY)
    t, yaw_rate = recording.time, recording.yaw_rate.copy()
    acceleration = recording.lateral_acceleration.copy()
    stuck = (t >= STUCK[0]) & (t < STUCK[1])
    yaw_rate[stuck] = yaw_rate[np.argmax(stuck)]
    acceleration[np.searchsorted(t, WILD)] = 60.0
    kept = (t < MISSING[0]) | (t >= MISSING[1])
    columns = {
        "time": t,
        "yaw_rate": yaw_rate,
        "lateral_acceleration": acceleration,
        "speed": recording.speed,
        "traction_torque": recording.traction_torque,
    }
    path = folder / "log.csv"
    write_log(path, {name: values[kept] for name, values in columns.items()})
    return path
