"""Sensors as they are: limited bandwidth, bias, sampling and noise.

Each channel passes its true value through the chain::

    first-order low-pass -> + bias -> sampled at rate_hz -> + white noise of each sample -> held
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.component import Component, Port
from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from co_sim.component import Vector

__all__ = ["Channel", "SensorSpec", "Sensors"]

_NOISE_BLOCK = 1024


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """What a sensor does to the true value; the default is a perfect sensor.

    Parameters
    ----------
    noise_rms : rms of the white noise of each sample, in the unit of the channel.
    bias : constant error, in the unit of the channel.
    bandwidth_hz : corner frequency (-3 dB) of a first-order low-pass, Hz; ``None`` is unlimited.
    rate_hz : sampling rate, Hz; the value is held in between. It must divide the master's step rate
        evenly. ``None`` samples at every step.

    Raises
    ------
    InputError
        If a value is not finite, the rms is negative, or a frequency is not positive.
    """

    noise_rms: float = 0.0
    bias: float = 0.0
    bandwidth_hz: float | None = None
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        self._check("noise_rms", self.noise_rms, self.noise_rms >= 0.0, "a finite value >= 0")
        self._check("bias", self.bias, True, "a finite value")
        for name in ("bandwidth_hz", "rate_hz"):
            value = getattr(self, name)
            if value is not None:
                self._check(name, value, value > 0.0, "a finite frequency > 0 Hz")

    @staticmethod
    def _check(name: str, value: float, in_range: bool, expected: str) -> None:
        if not (math.isfinite(value) and in_range):
            raise InputError(
                f"sensor {name}",
                got=f"{value:g}",
                expected=expected,
                remedy="leave it out for a sensor without this fault",
            )


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity.

    Parameters
    ----------
    name : name of the input (true value) and of the output (measured value).
    unit : FMI unit name of both.
    spec : the faults of the sensor.
    """

    name: str
    unit: str
    spec: SensorSpec


class Sensors(Component):
    """Any number of sensors; inputs are the true values, outputs the measured ones.

    Each channel has its own stream of noise, set by `seed` and the channel's name: adding, removing or
    reordering channels leaves the noise of the others as it was, and each start repeats it.

    Parameters
    ----------
    channels : the sensors, in the order of the ports; the names must differ.
    seed : any integer >= 0. Give two components in one system different seeds.

    Raises
    ------
    InputError
        If a name is doubled or the seed is negative.
    """

    def __init__(self, channels: Sequence[Channel], *, seed: int) -> None:
        super().__init__(
            inputs=[Port(c.name, c.unit, description=f"true {c.name}") for c in channels],
            outputs=[Port(c.name, c.unit, description=f"measured {c.name}") for c in channels],
        )
        names = [channel.name for channel in channels]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise InputError(
                "sensor channels",
                got=f"{', '.join(doubled)} more than once",
                expected="one channel of each name",
                remedy="rename or remove the others",
            )
        if seed < 0:
            raise InputError("sensor seed", got=f"{seed}", expected="an integer >= 0", remedy="use 0")
        self.channels = tuple(channels)
        self.seed = seed
        self._sensors: list[_Sensor] = []

    def start(self, t0: float, h: float) -> None:
        """Begin the noise anew.

        Raises
        ------
        InputError
            If a channel's sampling rate does not divide the step rate ``1/h`` evenly.
        """
        self._sensors = [_Sensor(channel, self.seed, h) for channel in self.channels]

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the first samples, with the low-pass settled at the true values."""
        for i, sensor in enumerate(self._sensors):
            y[i] = sensor.settle(float(u[i]))

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Write the measured values at ``t + h`` for true values held from `t`."""
        for i, sensor in enumerate(self._sensors):
            y[i] = sensor.advance(float(u[i]))


class _Sensor:
    """The state of one channel during a run."""

    def __init__(self, channel: Channel, seed: int, h: float) -> None:
        spec = channel.spec
        # The pole of the low-pass over one step; exact for an input held over the step.
        self._decay = 0.0 if spec.bandwidth_hz is None else math.exp(-2.0 * math.pi * spec.bandwidth_hz * h)
        self._period = _steps_per_sample(channel, h)
        self._bias = spec.bias
        self._noise = _noise(channel.name, seed, spec.noise_rms)
        # Drawn here, not in `settle`, which may be called any number of times.
        self._first_noise = next(self._noise)
        self._k = 0
        self._x = math.nan
        self._held = math.nan

    def settle(self, u: float) -> float:
        """Return the sample at the start, for a true value that has been `u` for ever."""
        self._x = u
        self._held = u + self._bias + self._first_noise
        return self._held

    def advance(self, u: float) -> float:
        """Return the measured value after one step with `u` held."""
        self._x = u + self._decay * (self._x - u)
        self._k += 1
        if self._k % self._period == 0:
            self._held = self._x + self._bias + next(self._noise)
        return self._held


def _noise(name: str, seed: int, rms: float) -> Iterator[float]:
    """Yield white noise for ever, drawn in blocks because single draws cost ten times more."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(name.encode())))
    while True:
        yield from (rms * rng.standard_normal(_NOISE_BLOCK)).tolist()


def _steps_per_sample(channel: Channel, h: float) -> int:
    """Return the whole number of steps `h` (s) between two samples."""
    rate = channel.spec.rate_hz
    if rate is None:
        return 1
    ratio = 1.0 / (rate * h)
    steps = round(ratio)
    if steps < 1 or abs(ratio - steps) > 1e-9 * ratio:
        below = max(math.floor(ratio), 1)
        rates = " or ".join(f"{1.0 / (n * h):g}" for n in (below, below + 1))
        raise InputError(
            f"sensor {channel.name}: rate_hz",
            got=f"{rate:g} Hz",
            expected=f"the step rate of {1.0 / h:g} Hz divided by a whole number",
            remedy=f"use {rates} Hz or another step",
        )
    return steps
