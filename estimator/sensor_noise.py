"""Noise of the two sensors, as the filters take it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SensorNoise"]


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """White noise of one sample of each sensor.

    Parameters
    ----------
    yaw_rate : rms, rad/s. lateral_acceleration : rms, m/s2.
    """

    yaw_rate: float = 1e-3
    lateral_acceleration: float = 0.05

    def __post_init__(self) -> None:
        for name in ("yaw_rate", "lateral_acceleration"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(
                    f"sensor noise: got {name} = {value!r}, expected a finite rms > 0; "
                    f"take it from the data sheet of the sensor"
                )

    @property
    def R(self) -> NDArray[np.float64]:
        """Covariance of the noise of one sample (2, 2), in the order of the measurements (14)."""
        return np.diag(np.square([self.yaw_rate, self.lateral_acceleration]))
