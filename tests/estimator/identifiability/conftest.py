"""Processes that several test modules look at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator import ERRI_B176, CreepCurve
from estimator.identifiability import SENSORS, Family, Process, Sensor, slope_family
from estimator.linear_models import OperatingPoint, point_at
from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

TRACK = ERRI_B176["erri_low"]
#: Sensors at 200 Hz with the noise density of those at 1 kHz.
SLOW = tuple(Sensor(s.output, s.noise / 5**0.5) for group in SENSORS.values() for s in group)
BOTH = ("yaw_rate", "lateral_acceleration")


@pytest.fixture(scope="session")
def autoregression() -> Callable[[float, float], Process]:
    """AR(1) without measurement noise: ``z_k+1 = phi z_k + w_k`` with variance q of w."""

    def make(phi: float, q: float) -> Process:
        one = np.ones((1, 1))
        return Process(phi * one, q * one, one, 0.0 * one, 1.0, ("z",))

    return make


@pytest.fixture(scope="session")
def dry_points(dry: CreepCurve) -> tuple[OperatingPoint, ...]:
    return tuple(point_at(dry, f"{share:g}", share * dry.peak_creep) for share in (0.1, 0.3, 0.6))


@pytest.fixture(scope="session")
def family(dry_points: tuple[OperatingPoint, ...], dry: CreepCurve) -> Family:
    """All sensors at 200 Hz on dry rail at 20 m/s, three creeps, slopes as parameters."""
    return slope_family(dry_points, TRACK, dry.initial_slope, sensors=SLOW, h=5e-3)


@pytest.fixture(scope="session")
def pair(family: Family) -> tuple[Process, Process]:
    """Gyro and accelerometer at two creeps."""
    seen = family.select(BOTH).process
    return seen[0], seen[1]


@pytest.fixture(scope="session")
def low() -> CreepCurve:
    return CreepCurve(CONDITIONS["low"], v=20.0)
