"""What a report assumes: the wheelset, its sensors and their noise, and the track."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError, suggestion
from estimator import ERRI_B176
from fmu_wheelset import WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from estimator import TrackSpectrum

__all__ = ["SENSORS", "Sensor", "Setup", "parse_noise", "parse_sensors", "sensor_set_name"]


@dataclass(frozen=True, slots=True)
class Sensor:
    """A kind of sensor.

    Parameters
    ----------
    measures : outputs of the wheelset, as the FMU calls them.
    unit : of the measurement. rms : of the white noise in each sample, unless a setup tells another.
    """

    measures: tuple[str, ...]
    unit: str
    rms: float


#: The sensors that a report knows, by name.
SENSORS: Mapping[str, Sensor] = MappingProxyType(
    {
        "gyro": Sensor(("yaw_rate",), "rad/s", 1e-3),
        "accelerometer": Sensor(("lateral_acceleration",), "m/s2", 0.05),
        "wheel_speeds": Sensor(("left.wheel_speed", "right.wheel_speed"), "rad/s", 0.01),
        "displacement": Sensor(("lateral_displacement",), "m", 1e-4),
    }
)

#: The sets of sensors that are compared unless others are asked for.
_SETS = (
    ("gyro",),
    ("accelerometer",),
    ("gyro", "accelerometer"),
    ("gyro", "accelerometer", "wheel_speeds"),
    ("gyro", "accelerometer", "displacement"),
)


def _default_noise() -> Mapping[str, float]:
    return MappingProxyType({name: sensor.rms for name, sensor in SENSORS.items()})


@dataclass(frozen=True, slots=True)
class Setup:
    """What a report assumes.

    Parameters
    ----------
    wheelset : parameters of the wheelset and its contact patches.
    sensors : the sets of sensors to compare, each a tuple of names of `SENSORS`.
    noise : rms of the white noise in each sample by name of the sensor, in the sensor's unit; sensors left
        out have that of `SENSORS`.
    sample_rate : of all sensors, Hz.
    window : length of the record from which something is to be told, s.
    track : name of a spectrum of `estimator.ERRI_B176`.
    seed : from which all random numbers follow.

    Raises
    ------
    InputError
        If a name is unknown or a number out of its bounds; all faults are told.
    """

    wheelset: WheelsetParameters = field(default_factory=WheelsetParameters)
    sensors: tuple[tuple[str, ...], ...] = _SETS
    noise: Mapping[str, float] = field(default_factory=_default_noise)
    sample_rate: float = 1000.0
    window: float = 1.0
    track: str = "erri_low"
    seed: int = 1

    def __post_init__(self) -> None:
        faults = list(self._faults())
        if faults:
            raise InputError.from_faults(faults)
        # A plain dict: the processes that compute the sections get a copy, and a proxy cannot be pickled.
        object.__setattr__(self, "noise", dict(_default_noise()) | dict(self.noise))

    def _faults(self) -> Iterator[Fault]:
        if not self.sensors:
            yield Fault("sensors", "none", "at least one set", "as in gyro+accelerometer")
        for names in self.sensors:
            if not names or len(set(names)) < len(names):
                got = f'"{sensor_set_name(names)}"'
                yield Fault("sensors", got, "sets of different sensors", "name each sensor once in a set")
        for name in dict.fromkeys([name for names in self.sensors for name in names] + list(self.noise)):
            if name not in SENSORS:
                yield Fault("sensors", f'"{name}"', "a sensor", suggestion(name, tuple(SENSORS)))
        for name, rms in self.noise.items():
            if name in SENSORS and not (math.isfinite(rms) and rms > 0.0):
                got = f"{rms:g} {SENSORS[name].unit}"
                yield Fault(f"noise.{name}", got, "a finite rms > 0", "no sensor is without noise")
        for what, unit in (("sample_rate", "Hz"), ("window", "s")):
            value = getattr(self, what)
            if not (math.isfinite(value) and value > 0.0):
                yield Fault(what, f"{value:g} {unit}", f"a finite value > 0 {unit}", "change it")
        if self.track not in ERRI_B176:
            yield Fault(
                "track", f'"{self.track}"', "a track spectrum", suggestion(self.track, tuple(ERRI_B176))
            )

    @property
    def spectrum(self) -> TrackSpectrum:
        """Spectrum of the lateral alignment."""
        return ERRI_B176[self.track]

    @property
    def main_sensors(self) -> tuple[str, ...]:
        """The set that the summary is about: gyro and accelerometer if compared, else the first."""
        pair = ("gyro", "accelerometer")
        return next((names for names in self.sensors if set(names) == set(pair)), self.sensors[0])

    def as_json(self) -> dict[str, object]:
        """Return everything for the report's JSON file, SI units."""
        return {
            "wheelset": asdict(self.wheelset),
            "sensors": [list(names) for names in self.sensors],
            "noise_rms": [
                {"sensor": name, "value": rms, "unit": SENSORS[name].unit} for name, rms in self.noise.items()
            ],
            "sample_rate_hz": self.sample_rate,
            "window_s": self.window,
            "track": self.track,
            "seed": self.seed,
        }


def sensor_set_name(names: tuple[str, ...]) -> str:
    """Return the name of a set of sensors, ``"gyro+accelerometer"``."""
    return "+".join(names)


def parse_sensors(text: str) -> tuple[tuple[str, ...], ...]:
    """Return the sets in ``gyro,gyro+accelerometer``; the setup checks the names."""
    sets = (item for item in text.split(",") if item.strip())
    return tuple(tuple(name.strip() for name in item.split("+")) for item in sets)


def parse_noise(text: str) -> dict[str, float]:
    """Return the noise in ``gyro=1e-3,accelerometer=0.05``; the setup checks names and bounds.

    Raises
    ------
    InputError
        If an item is no ``SENSOR=RMS``; all faults are told.
    """
    found: dict[str, float] = {}
    faults: list[Fault] = []
    for item in (part.strip() for part in text.split(",") if part.strip()):
        name, equals, value = item.partition("=")
        try:
            found[name.strip()] = float(value if equals else "no value")
        except ValueError:
            faults.append(
                Fault("--noise", f'"{item}"', "SENSOR=RMS", "as in gyro=1e-3,accelerometer=0.05, SI units")
            )
    if faults:
        raise InputError.from_faults(faults)
    return found
