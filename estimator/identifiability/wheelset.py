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
from estimator.linear_models import OperatingPoint, wheelset_model
from fmu_wheelset.parameters import WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from estimator.track_spectrum import TrackSpectrum

__all__ = [
    "SENSORS",
    "SLOPES",
    "creep_amplitude",
    "driven_by_track",
    "rolling_model",
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
        "wheel_speeds": (Sensor("left_wheel_speed", 0.01), Sensor("right_wheel_speed", 0.01)),
        "displacement": (Sensor("lateral_displacement", 1e-4),),
    }
)


def rolling_model(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
    """Return the small-signal model around `point` with wheels that turn on their own (torque driven).

    States ``y, psi, y_dot, psi_dot, omega_L, omega_R, theta``; input the track offset ``y_t``; outputs
    ``yaw_rate``, ``lateral_acceleration``, ``lateral_displacement``, ``relative_displacement``,
    ``left_wheel_speed`` and ``right_wheel_speed``, all as deviations. With prescribed creep the wheel speeds
    give way to the axle's; `estimator.linear_models.wheelset_model` has that case.
    """
    import control

    p, v = wheelset, point.v
    lateral = wheelset_model(point, wheelset)
    # Longitudinal force of each wheel over the states, and over y_t: g11 times the creepages (1) and (2).
    common = np.array([p.gamma / p.r0, 0.0, 0.0, p.L_g / v, 0.0, 0.0, 0.0])
    turning = np.eye(7) * p.r0 / v
    f_L, f_R = point.g11 * (common + turning[4]), point.g11 * (turning[5] - common)
    track_L, track_R = -point.g11 * p.gamma / p.r0, point.g11 * p.gamma / p.r0
    twist = np.array([0.0, 0.0, 0.0, 0.0, -p.c_s, p.c_s, p.k_s])
    A, B = np.zeros((7, 7)), np.zeros((7, 1))
    A[:4, :4], B[:4] = lateral.A, lateral.B
    A[3, 4:] = (f_R - f_L)[4:] * p.L_g / p.I_w
    A[4], B[4] = (twist - p.r0 * f_L) / p.I_L, -p.r0 * track_L / p.I_L
    A[5], B[5] = (-twist - p.r0 * f_R) / p.I_R, -p.r0 * track_R / p.I_R
    A[6, 4:6] = -1.0, 1.0
    E = np.eye(7)
    C = np.vstack([E[3], A[2], E[0], E[0], E[4], E[5]])
    D = np.array([[0.0], B[2], [0.0], [-1.0], [0.0], [0.0]], dtype=np.float64)
    return control.ss(
        A,
        B,
        C,
        D,
        states=["y", "psi", "y_dot", "psi_dot", "omega_L", "omega_R", "theta"],
        inputs=["y_t"],
        outputs=[
            "yaw_rate",
            "lateral_acceleration",
            "lateral_displacement",
            "relative_displacement",
            "left_wheel_speed",
            "right_wheel_speed",
        ],
        name="rolling_wheelset",
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
            f"the offset"
        )
    column = labels.index(input_name)
    slow, fast = track.Omega_r * v, track.Omega_c * v
    s = model.nstates
    A = np.zeros((s + 2, s + 2))
    A[:s, :s], A[:s, s] = model.A, model.B[:, column]
    A[s, s], A[s, s + 1], A[s + 1, s + 1] = -slow, 1.0, -fast
    B = np.zeros((s + 2, 1))
    B[-1] = math.sqrt(math.pi * track.A * v**3) * track.Omega_c
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
        `rolling_model`.
    h : sample time, s.
    prescribed : with a creepage imposed on both wheels, as the paper has it; there is no wheel speed then,
        and the outputs are those of `estimator.linear_models.wheelset_model`.
    """
    p = wheelset or WheelsetParameters()
    model = (wheelset_model if prescribed else rolling_model)(point, p)
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
    model = wheelset_model if prescribed else rolling_model

    def family(point: OperatingPoint) -> Family:
        def move(offset: Array) -> control.StateSpace:
            moved = replace(point, g11=point.g11 + offset[0], g22=point.g22 + offset[1])
            return driven_by_track(model(moved, p), track, point.v)

        return differentiate(move, SLOPES, (scale, scale), sensors, h)

    return stack([family(point) for point in points])


def creep_amplitude(
    point: OperatingPoint, track: TrackSpectrum, wheelset: WheelsetParameters | None = None
) -> float:
    """Return the rms of the longitudinal creepage that the track adds on each wheel.

    ``inf`` without a steady state. Where it is not small against the creep of the peak, the slopes at the
    point are not those that the wheelset feels, and what is computed of them is a first guess.
    """
    import control

    p = wheelset or WheelsetParameters()
    model = driven_by_track(rolling_model(point, p), track, point.v)
    left = dict(zip(model.output_labels, np.asarray(model.C), strict=True))
    creepage = (
        p.L_g / point.v * left["yaw_rate"]
        + p.gamma / p.r0 * left["relative_displacement"]
        + p.r0 / point.v * left["left_wheel_speed"]
    )
    seen = control.ss(model.A, model.B, creepage[None], 0.0, outputs=["creepage"])
    process = observe(seen, [Sensor("creepage", 1.0)], 1e-3)
    if not process.steady():
        return math.inf
    return math.sqrt(float((process.H @ steady_covariance(process) @ process.H.T)[0, 0]))
