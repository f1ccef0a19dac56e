"""The linear model of a filter with the track's spectrum as coloured noise.

Model (13) takes the track's rate as white noise. Here the track passes a shaping filter on white noise of
unit intensity, so that the offset has its spectrum (`estimator.track_spectrum`) at speed v::

    y_t = sqrt(pi A v^3) Wc / ((s + Wr v)(s + Wc v)) w

with two states, the offset and its rate. Sensors may have a bias that wanders (a Gauss-Markov process), with
one more state for each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.linear_models import filter_model
from estimator.recursive import RecursiveFilter, design_recursive
from estimator.sensor_noise import SensorNoise

if TYPE_CHECKING:
    from collections.abc import Mapping

    import control

    from estimator.linear_models import OperatingPoint
    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import WheelsetParameters

__all__ = ["UNITS", "Disturbances", "SensorBias", "coloured_filter", "coloured_model"]

Array = NDArray[np.float64]

#: Units of the signals of `coloured_model`; white noises count per root of their bandwidth, two-sided.
UNITS: Mapping[str, str] = MappingProxyType(
    {
        "psi": "rad",
        "y_dot": "m/s",
        "psi_dot": "rad/s",
        "y_rel": "m",
        "y_t": "m",
        "y_t_dot": "m/s",
        "bias_yaw_rate": "rad/s",
        "bias_lateral_acceleration": "m/s2",
        "w": "Hz^-0.5",
        "a_y": "m/s2 Hz^-0.5",
        "a_psi": "rad/s2 Hz^-0.5",
        "w_yaw_rate": "Hz^-0.5",
        "w_lateral_acceleration": "Hz^-0.5",
        "yaw_rate": "rad/s",
        "lateral_acceleration": "m/s2",
    }
)

#: Standard deviations of what a filter does not know at its start: wide against any motion on the rails.
_START = MappingProxyType({"psi": 5e-3, "y_dot": 0.1, "psi_dot": 0.1, "y_rel": 5e-3})


@dataclass(frozen=True, slots=True)
class SensorBias:
    """Biases of gyro and accelerometer that wander slowly: Gauss-Markov processes.

    Parameters
    ----------
    yaw_rate, lateral_acceleration : rms of each bias, rad/s and m/s2.
    time : in which a bias forgets, s.
    """

    yaw_rate: float
    lateral_acceleration: float
    time: float = 300.0

    def __post_init__(self) -> None:
        for name in ("yaw_rate", "lateral_acceleration", "time"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(
                    f"sensor bias: got {name} = {value!r}, expected a finite value > 0; "
                    f"leave the biases out if the sensors have none"
                )

    @property
    def rms(self) -> tuple[float, float]:
        """The rms of both, in the order of the measurements."""
        return self.yaw_rate, self.lateral_acceleration


@dataclass(frozen=True, slots=True)
class Disturbances:
    """What moves the wheelset and disturbs its sensors, as a filter takes it.

    Parameters
    ----------
    track : spectrum of the alignment.
    noise : of the sensors.
    acceleration : two-sided intensity of the unmodelled lateral acceleration, m2/s3. It stands for what the
        linear model leaves out; 0 trusts the model entirely.
    lever : length that turns it into an unmodelled yaw acceleration, m.
    bias : of the sensors, None for none.
    """

    track: TrackSpectrum
    noise: SensorNoise = field(default_factory=SensorNoise)
    acceleration: float = 0.0
    lever: float = 0.75
    bias: SensorBias | None = None

    def __post_init__(self) -> None:
        if not (0.0 <= self.acceleration < math.inf and 0.0 < self.lever < math.inf):
            raise ValueError(
                f"disturbances: got acceleration = {self.acceleration!r} and lever = {self.lever!r}, "
                f"expected finite values >= 0 and > 0; half the gauge is a lever of the right size"
            )

    @property
    def W(self) -> Array:
        """Intensities of the inputs of `coloured_model`."""
        biases = [] if self.bias is None else [1.0, 1.0]
        return np.diag([1.0, self.acceleration, self.acceleration / self.lever**2, *biases])


def coloured_model(
    point: OperatingPoint,
    wheelset: WheelsetParameters,
    track: TrackSpectrum,
    *,
    bias: SensorBias | None = None,
) -> control.StateSpace:
    """Return the filter's model around `point` on a track with that spectrum.

    States ``psi, y_dot, psi_dot, y_rel`` (the offset from the track), ``y_t, y_t_dot`` and, with `bias`,
    ``bias_yaw_rate, bias_lateral_acceleration``. Inputs are white noises: ``w`` of unit intensity, which
    drives the track, the unmodelled accelerations ``a_y`` and ``a_psi`` and, with `bias`, one of unit
    intensity for each. Outputs: the measurements (14). `UNITS` has the unit of each.
    """
    import control

    white = filter_model(point, wheelset)
    states = ["psi", "y_dot", "psi_dot", "y_rel", "y_t", "y_t_dot"]
    # psi, y_dot, psi_dot, y_rel and y_t as they stand in (13); y_rel follows the rate of the offset.
    order = [white.state_labels.index(name) for name in states[:5]]
    fast, slow = track.Omega_c * point.v, track.Omega_r * point.v
    A = np.zeros((6, 6))
    A[:3, :5] = np.asarray(white.A)[np.ix_(order[:3], order)]
    A[3, 1], A[3, 5] = 1.0, -1.0
    A[4, 5] = 1.0
    A[5, 4:] = -fast * slow, -(fast + slow)
    B = np.zeros((6, 3))
    B[5, 0] = track.shaping_gain(point.v)
    B[1, 1] = B[2, 2] = 1.0
    C = np.vstack([np.eye(6)[2], A[1]])
    inputs, outputs = ["w", "a_y", "a_psi"], list(white.output_labels)
    if bias is not None:
        A, B, C = _with_bias(A, B, C, bias)
        states += [f"bias_{name}" for name in outputs]
        inputs += [f"w_{name}" for name in outputs]
    return control.ss(
        A,
        B,
        C,
        np.zeros((len(C), B.shape[1])),
        states=states,
        inputs=inputs,
        outputs=outputs,
        name="coloured_model",
    )


def _with_bias(A: Array, B: Array, C: Array, bias: SensorBias) -> tuple[Array, Array, Array]:
    """Join a bias to each of the outputs: ``b' = -b/T + sqrt(2/T) rms w``."""
    m = len(C)
    zero = np.zeros((m, len(A)))
    gains = np.diag(math.sqrt(2.0 / bias.time) * np.array(bias.rms))
    return (
        np.block([[A, zero.T], [zero, -np.eye(m) / bias.time]]),
        np.block([[B, np.zeros((len(B), m))], [np.zeros((m, B.shape[1])), gains]]),
        np.hstack([C, np.eye(m)]),
    )


def coloured_filter(
    point: OperatingPoint,
    wheelset: WheelsetParameters,
    disturbances: Disturbances,
    h: float,
    *,
    name: str | None = None,
) -> RecursiveFilter:
    """Design the Kalman filter of `coloured_model` for samples at a step of `h` (s).

    Its gain is the steady one where there is one; elsewhere, as at the peak of the creep curve without
    unmodelled acceleration, its covariance goes on moving. `name` is the point's if left out.
    """
    d = disturbances
    model = coloured_model(point, wheelset, d.track, bias=d.bias)
    start = np.array([_start(label, point.v, d) for label in model.state_labels])
    return design_recursive(model, d.W, d.noise.R, h, start=np.square(start), name=name or point.name)


def _start(state: str, v: float, disturbances: Disturbances) -> float:
    """Return the standard deviation of a state before the first sample."""
    track, bias = disturbances.track, disturbances.bias
    known = {**_START, "y_t": math.sqrt(track.variance), "y_t_dot": math.sqrt(track.rate_variance(v))}
    if bias is not None:
        known |= {"bias_yaw_rate": bias.yaw_rate, "bias_lateral_acceleration": bias.lateral_acceleration}
    return known[state]
