"""A short ride of the wheelset FMU and its log in files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from co_sim.wheelset.cli import main
from co_sim.wheelset.identifying.log_csv import write_log
from co_sim.wheelset.recordings import Journey, Profile, record

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NAMES = ("time", "yaw_rate", "lateral_acceleration", "speed", "traction_torque")


@dataclass(frozen=True)
class Ride:
    """Columns of a log by name, SI."""

    columns: dict[str, Array]

    def changed(self, **columns: Array) -> dict[str, Array]:
        return self.columns | columns


@pytest.fixture(scope="session")
def ride() -> Ride:
    """4 s at 20 m/s on dry rail with 2 kN m."""
    journey = Journey(duration=4.0, speed=20.0, torque=Profile((0.0, 0.5), (0.0, 2000.0)), seed=5)
    recording = record(journey)
    return Ride({name: getattr(recording, name).copy() for name in NAMES})


@pytest.fixture
def log(ride: Ride, tmp_path: Path) -> Path:
    path = tmp_path / "ride.csv"
    write_log(path, ride.columns)
    return path


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return int(caught.value.code or 0)
