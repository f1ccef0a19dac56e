"""Sensors as they are: limited bandwidth, bias, sampling and noise.

Each channel passes its true value through the chain::

    first-order low-pass -> + bias -> sampled at rate_hz -> + white noise of each sample -> held
"""

from __future__ import annotations

import ctypes
import json
import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from co_sim.component import Port, StateError
from co_sim.errors import InputError
from co_sim.native import TableComponent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from co_sim.component import Vector

__all__ = ["Channel", "SensorSpec", "Sensors"]

#: Columns of the numbers and of the counts of `co_sim.wheelset.steps.sensors_step` that are used here.
_BIAS, _X, _HELD = 1, 3, 4
_LEFT = 2


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


class _State(NamedTuple):
    """State of all channels: low-pass and held value, steps until the next sample, and the generators'."""

    values: Vector
    left: NDArray[np.int64]
    generators: list[Any]


class Sensors(TableComponent):
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
            feedthrough={c.name: [c.name] for c in channels},
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
        self._generators: list[np.random.Generator] = []
        self._first_noise: Vector = np.empty(0)
        #: Columns as `sensors_step` has them, one row for each channel.
        self._numbers: Vector = np.empty((0, 5))
        self._counts: NDArray[np.int64] = np.empty((0, 3), dtype=np.int64)

    def start(self, t0: float, h: float) -> None:
        """Begin the noise anew.

        Raises
        ------
        InputError
            If a channel's sampling rate does not divide the step rate ``1/h`` evenly.
        """
        from co_sim.wheelset.steps import sensors_step

        self._generators = [_generator(channel.name, self.seed) for channel in self.channels]
        specs = [channel.spec for channel in self.channels]
        self._numbers = np.array(
            [(_decay(spec, h), spec.bias, spec.noise_rms, math.nan, math.nan) for spec in specs]
        ).reshape(-1, 5)
        periods = [_steps_per_sample(channel, h) for channel in self.channels]
        addresses = [generator.bit_generator.ctypes.bit_generator.value for generator in self._generators]
        self._counts = np.array([addresses, periods, periods], dtype=np.int64).T.copy()
        # Drawn here, not in `exchange`, which may be called any number of times.
        self._first_noise = np.array(
            [s.noise_rms * g.standard_normal() for s, g in zip(specs, self._generators, strict=True)]
        )
        arrays = (self._numbers, self._counts)
        self._attach(
            sensors_step,
            [len(specs), _standard_normal(), *(int(array.ctypes.data) for array in arrays)],
        )

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the first samples, with the low-pass settled at the true values."""
        self._numbers[:, _X] = u
        self._numbers[:, _HELD] = u + self._numbers[:, _BIAS] + self._first_noise
        y[:] = self._numbers[:, _HELD]

    def save(self) -> object:
        """Return a copy of the state of all channels and their noise."""
        self.native()
        generators = [generator.bit_generator.state for generator in self._generators]
        return _State(self._numbers[:, _X:].copy(), self._counts[:, _LEFT].copy(), generators)

    def restore(self, state: object) -> None:
        """Return to a state of `save`; the noise goes on from there."""
        self.native()
        values, left, generators = cast("_State", state)
        self._numbers[:, _X:] = values
        self._counts[:, _LEFT] = left
        for generator, bits in zip(self._generators, generators, strict=True):
            generator.bit_generator.state = bits

    def serialize(self, state: object) -> bytes:
        """Return the state as JSON."""
        values, left, generators = cast("_State", state)
        return json.dumps([values.tolist(), left.tolist(), generators]).encode()

    def deserialize(self, data: bytes) -> object:
        """Return the state from the bytes of `serialize`."""
        values, left, generators = json.loads(data)
        if len(left) != len(self.channels):
            raise StateError(f"it has {len(self.channels)} channels, and the state is of {len(left)}")
        return _State(np.array(values), np.array(left, dtype=np.int64), generators)


def _decay(spec: SensorSpec, h: float) -> float:
    """Return the pole of the low-pass over one step; exact for an input held over the step."""
    return 0.0 if spec.bandwidth_hz is None else math.exp(-2.0 * math.pi * spec.bandwidth_hz * h)


def _generator(name: str, seed: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(name.encode())))


@cache
def _standard_normal() -> int:
    """Return the address of the function behind `numpy.random.Generator.standard_normal`.

    It is part of numpy's C interface, exported by this module for those who extend it without a compiler.
    """
    library = ctypes.CDLL(np.random._generator.__file__)
    return ctypes.cast(library.random_standard_normal, ctypes.c_void_p).value or 0


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
