"""The wheelset on an irregular track as a sampled process, with the slopes of the creep curve as parameters.

Small signals: the slopes are those at the operating point. `creep_amplitude` tells how far that holds.

The mean of a measurement counts for nothing here. That of the wheel speeds, less the train's, is the creep;
to tell one per mille of it takes the wheel's radius to half a millimetre and the train's speed to one per
mille.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.identifiability.process import Family, Process, Sensor, differentiate, observe, stack
from estimator.identifiability.windows import steady_covariance
from estimator.linear_models import OperatingPoint, full_model, wheelset_model
from fmu_wheelset.parameters import WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from estimator.track_spectrum import TrackSpectrum

__all__ = [
    "SENSORS",
    "SLOPES",
    "creep_amplitude",
    "creep_covariance",
    "driven_by_track",
    "slope_family",
    "wheelset_process",
]

Array = NDArray[np.float64]

#: Parameters of `slope_family`, N.
SLOPES = ("g11", "g22")
#: What each sensor measures, and its noise at 1 kHz: gyro and accelerometer as in the scenarios, the others
#: assumed.
SENSORS: Mapping[str, tuple[Sensor, ...]] = MappingProxyType(
    {
        "gyro": (Sensor("yaw_rate", 1e-3),),
        "accelerometer": (Sensor("lateral_acceleration", 0.05),),
        "wheel_speeds": (Sensor("omega_L", 0.01), Sensor("omega_R", 0.01)),
        "displacement": (Sensor("lateral_displacement", 1e-4),),
    }
)


def driven_by_track(
    model: control.StateSpace, track: TrackSpectrum, v: float, *, input_name: str = "y_t"
) -> control.StateSpace:
    """Return a model driven by the track at speed `v` (m/s): by white noise of unit intensity, shaped.

    The shaping filter is ``sqrt(pi A v^3) Wc/((s + Wr v)(s + Wc v))``; its states ``y_t`` and ``y_t_fast``
    come last.

    Raises
    ------
    ValueError
        If the model has no such input.
    """
    import control

    labels = list(model.input_labels)
    if input_name not in labels:
        raise ValueError(
            f"track: got no input {input_name}, expected one of {', '.join(labels)}; name the one that is "
            "the offset"
        )
    column = labels.index(input_name)
    slow, fast = track.Omega_r * v, track.Omega_c * v
    s = model.nstates
    A = np.zeros((s + 2, s + 2))
    A[:s, :s], A[:s, s] = model.A, model.B[:, column]
    A[s, s], A[s, s + 1], A[s + 1, s + 1] = -slow, 1.0, -fast
    B = np.zeros((s + 2, 1))
    B[-1] = track.shaping_gain(v)
    outputs, m = list(model.output_labels), model.noutputs
    return control.ss(
        A,
        B,
        np.hstack([model.C, model.D[:, [column]], np.zeros((m, 1))]),
        np.zeros((m, 1)),
        states=[*model.state_labels, "y_t", "y_t_fast"],
        inputs=["track_noise"],
        outputs=outputs,
        name=f"{model.name}_on_track",
    )


def wheelset_process(
    point: OperatingPoint,
    track: TrackSpectrum,
    *,
    wheelset: WheelsetParameters | None = None,
    sensors: Sequence[Sensor] = (*SENSORS["gyro"], *SENSORS["accelerometer"]),
    h: float = 1e-3,
    prescribed: bool = False,
) -> Process:
    """Return what sensors sample of the wheelset at an operating point.

    Parameters
    ----------
    point : with the speed. track : spectrum of its lateral alignment. sensors : of outputs of
        `full_model`.
    h : sample time, s.
    prescribed : with a creepage imposed on both wheels, as the paper has it; there is no wheel speed then,
        and the outputs are those of `estimator.linear_models.wheelset_model`.
    """
    p = wheelset or WheelsetParameters()
    model = (wheelset_model if prescribed else full_model)(point, p)
    return observe(driven_by_track(model, track, point.v), sensors, h)


def slope_family(
    points: Sequence[OperatingPoint],
    track: TrackSpectrum,
    scale: float,
    *,
    wheelset: WheelsetParameters | None = None,
    sensors: Sequence[Sensor] = (*SENSORS["gyro"], *SENSORS["accelerometer"]),
    h: float = 1e-3,
    prescribed: bool = False,
) -> Family:
    """Return the processes at a batch of operating points with the slopes `SLOPES` (N) as parameters.

    `scale` (N) is the change of a slope that would matter, such as the curve's initial slope; the rest is as
    in `wheelset_process`.
    """
    p = wheelset or WheelsetParameters()
    model = wheelset_model if prescribed else full_model

    def family(point: OperatingPoint) -> Family:
        def move(offset: Array) -> control.StateSpace:
            moved = replace(point, g11=point.g11 + offset[0], g22=point.g22 + offset[1])
            return driven_by_track(model(moved, p), track, point.v)

        return differentiate(move, SLOPES, (scale, scale), sensors, h)

    return stack([family(point) for point in points])


def creep_covariance(
    point: OperatingPoint, track: TrackSpectrum, wheelset: WheelsetParameters | None = None
) -> Array:
    """Return the covariance (2, 2) of the longitudinal and lateral creepage that the track adds.

    On the left wheel; ``inf`` without a steady state.
    """
    import control

    p = wheelset or WheelsetParameters()
    model = driven_by_track(full_model(point, p), track, point.v)
    slope, spin = p.gamma / p.r0, (p.r0 + p.delta_r / 2.0) / point.v
    longitudinal = {"psi_dot": p.L_g / point.v, "y": slope, "y_t": -slope, "omega_L": spin}
    lateral = {"y_dot": 1.0 / point.v, "psi": -1.0}
    rows = [[share.get(state, 0.0) for state in model.state_labels] for share in (longitudinal, lateral)]
    seen = control.ss(model.A, model.B, rows, np.zeros((2, 1)), outputs=["x", "y"])
    process = observe(seen, [Sensor("x", 1.0), Sensor("y", 1.0)], 1e-3)
    if not process.steady():
        return np.full((2, 2), np.inf)
    return np.asarray(process.H @ steady_covariance(process) @ process.H.T)


def creep_amplitude(
    point: OperatingPoint, track: TrackSpectrum, wheelset: WheelsetParameters | None = None
) -> float:
    """Return the rms of the longitudinal creepage that the track adds on the left wheel.

    ``inf`` without a steady state. Where it is not small against the creep of the peak, the slopes at the
    point are not those that the wheelset feels, and what is computed of them is a first guess:
    `estimator.identifiability.averaged_points` has better ones.
    """
    return math.sqrt(creep_covariance(point, track, wheelset)[0, 0])
