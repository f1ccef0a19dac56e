"""What was measured on a wheelset, as the estimators read it: a log of samples at a uniform step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["MEASUREMENTS", "Log"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: The measurements of (14), in the order of the filters and of the columns of `Log.usable`.
MEASUREMENTS = ("yaw_rate", "lateral_acceleration")

#: Greatest departure of a sample's time from the uniform grid, in steps: rounding, never clock jitter.
_GRID_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class Log:
    """Samples of the sensors, the speed and the torque at a uniform step.

    Parameters
    ----------
    time : (T,) s, T >= 2, on a uniform grid. Clock jitter must be resolved before, by resampling.
    yaw_rate : (T,) rad/s. lateral_acceleration : (T,) m/s2. Not finite where there is no measurement.
    speed : (T,) forward speed, m/s, finite.
    traction_torque : (T,) total torque on the axle, N m, finite, negative when braking; None if unknown.
    usable : (T, 2) whether an estimator may use the sample of each of `MEASUREMENTS`; what is not finite
        never is. None: all that is finite.

    Attributes
    ----------
    h : the step, s.

    Raises
    ------
    ValueError
        If the arrays are not as described.
    """

    time: Array
    yaw_rate: Array
    lateral_acceleration: Array
    speed: Array
    traction_torque: Array | None = None
    usable: Mask | None = None

    def __post_init__(self) -> None:
        T = np.size(self.time)
        for name in self._columns():
            object.__setattr__(self, name, _column(name, getattr(self, name), T))
        for name in ("time", "speed", "traction_torque"):
            values = getattr(self, name)
            if values is not None and not np.isfinite(values).all():
                row = int(np.argmin(np.isfinite(values)))
                raise ValueError(
                    f"log: got {name} {values[row]} in row {row + 1}, expected finite numbers; "
                    f"interpolate or drop the rows"
                )
        self._check_grid()
        object.__setattr__(self, "usable", self._usable())

    def __len__(self) -> int:
        return int(self.time.size)

    @property
    def h(self) -> float:
        """The step, s."""
        return float(self.time[-1] - self.time[0]) / (self.time.size - 1)

    @property
    def measurements(self) -> Array:
        """The samples (T, 2) in the order of `MEASUREMENTS`; zero where they are not usable."""
        z = np.column_stack([self.yaw_rate, self.lateral_acceleration])
        return np.where(cast("Mask", self.usable), z, 0.0)

    def _columns(self) -> Iterator[str]:
        yield from ("time", *MEASUREMENTS, "speed")
        if self.traction_torque is not None:
            yield "traction_torque"

    def _check_grid(self) -> None:
        if self.time.size < 2:
            raise ValueError(f"log: got {self.time.size} samples, expected at least 2; give a longer record")
        grid = np.linspace(self.time[0], self.time[-1], self.time.size)
        off = np.abs(self.time - grid)
        if not (self.h > 0.0 and off.max() <= _GRID_TOLERANCE * self.h):
            row = int(np.argmax(off))
            raise ValueError(
                f"log: got time {self.time[row]:.9g} s in row {row + 1}, expected rising times at a uniform "
                f"step, {grid[row]:.9g} s there; resample the record"
            )

    def _usable(self) -> Mask:
        finite = np.column_stack([np.isfinite(getattr(self, name)) for name in MEASUREMENTS])
        if self.usable is not None:
            if np.shape(self.usable) != finite.shape:
                raise ValueError(
                    f"log: got usable of shape {np.shape(self.usable)}, expected {finite.shape}; "
                    f"one column goes with each of {', '.join(MEASUREMENTS)}"
                )
            finite &= np.asarray(self.usable, dtype=np.bool_)
        finite.flags.writeable = False
        return finite


def _column(name: str, values: object, T: int) -> Array:
    column = np.array(values, dtype=np.float64)
    if column.shape != (T,):
        raise ValueError(
            f"log: got {name} of shape {column.shape}, expected ({T},); "
            f"every column has a value for each time"
        )
    column.flags.writeable = False
    return column
