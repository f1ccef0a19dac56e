"""Operating points on the creep curve and the linear models around them.

The equations are (12) to (14) of Hussain et al. (2012) with the misprints corrected as
``docs/model.md`` explains. All models are `control.StateSpace` objects with named signals in SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import control
    from numpy.typing import NDArray

    from estimator.contact import CreepCurve
    from fmu_wheelset.parameters import WheelsetParameters

__all__ = [
    "OperatingPoint",
    "critical_speed",
    "filter_model",
    "full_model",
    "klingel_wavelength",
    "operating_points",
    "wheelset_model",
]

#: Decay rate of the track offset in the filter model (13), 1/s.
TRACK_DECAY = 1e-3


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """A point (creep, force) of a creep curve and the slopes there.

    Parameters
    ----------
    name : ``"P1"`` (linear region), ``"P2"`` (maximum), ``"P3"`` (unstable region), or the user's own.
    creep : common longitudinal creepage of both wheels.
    force : creep force of one wheel, N.
    g11, g22 : tangent and secant of the curve, N.
    v : speed at which the curve holds, m/s.
    """

    name: str
    creep: float
    force: float
    g11: float
    g22: float
    v: float


def operating_points(
    curve: CreepCurve, *, linear: float = 0.1, unstable: float = 2.0
) -> tuple[OperatingPoint, OperatingPoint, OperatingPoint]:
    """Find the three points of the paper's Fig. 2 on a creep curve.

    Parameters
    ----------
    curve : the curve to look on.
    linear, unstable : creep of P1 and of P3 as a multiple of the creep of the maximum.

    Raises
    ------
    ValueError
        If the curve has no maximum, or a multiple is on the wrong side of it.
    """
    if not 0.0 < linear < 1.0 < unstable:
        raise ValueError(
            f"operating points: got multiples linear = {linear:g} and unstable = {unstable:g}, "
            f"expected 0 < linear < 1 < unstable; both are relative to the creep of the maximum"
        )
    peak = curve.peak_creep
    at_peak = OperatingPoint(
        # The tangent vanishes here by definition; the root finder's rounding would only hide that.
        "P2",
        creep=peak,
        force=float(curve.force(peak)),
        g11=0.0,
        g22=float(curve.secant(peak)),
        v=curve.v,
    )
    return point_at(curve, "P1", linear * peak), at_peak, point_at(curve, "P3", unstable * peak)


def point_at(curve: CreepCurve, name: str, creep: float) -> OperatingPoint:
    """Return the operating point of `curve` at a given `creep`."""
    return OperatingPoint(
        name,
        creep=creep,
        force=float(curve.force(creep)),
        g11=float(curve.tangent(creep)),
        g22=float(curve.secant(creep)),
        v=curve.v,
    )


def wheelset_model(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
    """Return the small-signal model (12) around `point`.

    States ``y, psi, y_dot, psi_dot``; input the track offset ``y_t``; outputs the yaw rate and the
    lateral acceleration that the sensors measure. Suspension and gravitational stiffness are in it;
    flanges are not, nor what only shifts the equilibrium.
    """
    import control

    _, lateral, (track_yaw, track_lateral) = _rows(point, wheelset)
    A = state_matrix(point, wheelset)
    B = np.array([[0.0], [0.0], [track_lateral], [track_yaw]])
    C = np.array([[0.0, 0.0, 0.0, 1.0], lateral])
    return control.ss(
        A,
        B,
        C,
        np.array([[0.0], [track_lateral]]),
        states=["y", "psi", "y_dot", "psi_dot"],
        inputs=["y_t"],
        outputs=["yaw_rate", "lateral_acceleration"],
        name="wheelset",
    )


def state_matrix(point: OperatingPoint, wheelset: WheelsetParameters) -> NDArray[np.float64]:
    """Return the matrix (4, 4) of (12) over ``y, psi, y_dot, psi_dot``."""
    yaw, lateral, _ = _rows(point, wheelset)
    return np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], lateral, yaw])


def full_model(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
    """Return the small-signal model of the torque-driven wheelset around `point`, at constant speed.

    States ``y, psi, y_dot, psi_dot, omega_L, omega_R, theta``: (12) with the wheel speeds and the twist of
    the axle. Inputs the track offset ``y_t`` (m), the traction torque ``T_t`` on the right wheel (N m) and
    the suspension's lateral force ``F_susp`` (N) and yaw moment ``M_susp`` (N m). Outputs the yaw rate, the
    lateral acceleration, both wheel speeds and the lateral displacement.
    """
    import control

    p, v = wheelset, point.v
    yaw, lateral, (track_yaw, track_lateral) = _rows(point, wheelset)
    r_L, r_R = p.r0 + p.delta_r / 2.0, p.r0 - p.delta_r / 2.0
    # Longitudinal creepages over the states (the track offset acts against y): each wheel's own spin, and
    # the steering that has opposite signs at the two wheels.
    steering = np.array([p.gamma / p.r0, 0.0, 0.0, p.L_g / v, 0.0, 0.0, 0.0])
    creep_L, creep_R = steering.copy(), -steering
    creep_L[4], creep_R[5] = r_L / v, r_R / v
    twist = np.array([0.0, 0.0, 0.0, 0.0, -p.c_s, p.c_s, p.k_s])
    spin_yaw = np.array([0.0] * 4 + [-r_L, r_R, 0.0]) * point.g11 * p.L_g / (v * p.I_w)
    A = np.zeros((7, 7))
    A[0, 2] = A[1, 3] = 1.0
    A[2, :4], A[3, :4] = lateral, yaw
    A[3] += spin_yaw
    A[4] = (twist - r_L * point.g11 * creep_L) / p.I_L
    A[5] = (-twist - r_R * point.g11 * creep_R) / p.I_R
    A[6, 4], A[6, 5] = -1.0, 1.0
    B = np.zeros((7, 4))
    B[2:6, 0] = track_lateral, track_yaw, -A[4, 0], -A[5, 0]
    B[5, 1], B[2, 2], B[3, 3] = 1.0 / p.I_R, 1.0 / p.m_w, 1.0 / p.I_w
    C = np.eye(7)[[3, 0, 4, 5, 0]]
    D = np.zeros((5, 4))
    C[1], D[1] = A[2], B[2]
    return control.ss(
        A,
        B,
        C,
        D,
        states=["y", "psi", "y_dot", "psi_dot", "omega_L", "omega_R", "theta"],
        inputs=["y_t", "T_t", "F_susp", "M_susp"],
        outputs=["yaw_rate", "lateral_acceleration", "omega_L", "omega_R", "lateral_displacement"],
        name="torque_driven_wheelset",
    )


def filter_model(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
    """Return the Kalman filter's model (13) with the measurement (14) around `point`.

    States ``psi, y_dot, psi_dot, y_t, y - y_t``; inputs ``w`` (the white noise that drives the track
    offset, m/s) and the unmodelled accelerations ``a_y`` (m/s2) and ``a_psi`` (rad/s2); outputs the
    yaw rate and the lateral acceleration.
    """
    import control

    # Over y = y_t + (y - y_t), a row takes from y_t what the input y_t leaves of its entry for y.
    (k_y, k_psi, d_y, d_psi), (l_rel, l_psi, l_y, _), (t_psi, t_y) = _rows(point, wheelset)
    A = np.array(
        [
            # psi, y_dot, psi_dot, y_t, y - y_t
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [l_psi, l_y, 0.0, l_rel + t_y, l_rel],
            [k_psi, d_y, d_psi, k_y + t_psi, k_y],
            [0.0, 0.0, 0.0, -TRACK_DECAY, 0.0],
            [0.0, 1.0, 0.0, TRACK_DECAY, 0.0],
        ]
    )
    B = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0]], dtype=np.float64)
    C = np.vstack([np.eye(5)[2], A[1]])
    return control.ss(
        A,
        B,
        C,
        np.zeros((2, 3)),
        states=["psi", "y_dot", "psi_dot", "y_t", "y_rel"],
        inputs=["w", "a_y", "a_psi"],
        outputs=["yaw_rate", "lateral_acceleration"],
        name="filter_model",
    )


def _rows(
    point: OperatingPoint, wheelset: WheelsetParameters
) -> tuple[tuple[float, float, float, float], tuple[float, float, float, float], tuple[float, float]]:
    """Return the rows of psi_ddot and y_ddot over (y, psi, y_dot, psi_dot), and both over y_t."""
    p, v = wheelset, point.v
    track = 2.0 * p.L_g * p.gamma * point.g11 / (p.r0 * p.I_w)
    gravity = 2.0 * p.N * p.contact_angle_rate
    yaw_spring = p.k_w - 2.0 * p.N * p.contact_angle * p.L_g
    yaw = (
        -track,
        -yaw_spring / p.I_w,
        0.0,
        -2.0 * p.L_g**2 * point.g11 / (v * p.I_w) - p.c_w / p.I_w,
    )
    lateral = (
        (0.0 - p.k_y - gravity) / p.m_w,
        2.0 * point.g22 / p.m_w,
        -2.0 * point.g22 / (p.m_w * v) - p.c_y / p.m_w,
        0.0,
    )
    return yaw, lateral, (track, gravity / p.m_w)


def critical_speed(g11: float, g22: float, wheelset: WheelsetParameters) -> float:
    """Return the speed (m/s) above which (12) is unstable for fixed slopes ``g11, g22 > 0`` (N).

    The lowest such speed; ``inf`` if it is stable at every speed, 0 if at none, as without springs.
    """
    if not (g11 > 0.0 and g22 > 0.0):
        raise ValueError(
            f"critical speed: got g11 = {g11:g} N and g22 = {g22:g} N, expected both > 0; "
            f"at and past the peak of the creep curve no speed is stable"
        )
    p = wheelset
    # y_ddot + a y_dot + K y = alpha psi and psi_ddot + b psi_dot + k psi = -tau y, with polynomials a and
    # b in 1/v; the greatest root of the last Hurwitz determinant is where stability is lost.
    K = (p.k_y + 2.0 * p.N * p.contact_angle_rate) / p.m_w
    k = (p.k_w - 2.0 * p.N * p.contact_angle * p.L_g) / p.I_w
    alpha = 2.0 * g22 / p.m_w
    beta = 2.0 * p.L_g**2 * g11 / p.I_w
    tau = beta * p.gamma / (p.r0 * p.L_g)
    a = np.polynomial.Polynomial([p.c_y / p.m_w, alpha])
    b = np.polynomial.Polynomial([p.c_w / p.I_w, beta])
    determinant = a * b * ((a + b) * (k * a + K * b) + (K - k) ** 2) - (a + b) ** 2 * (alpha * tau)
    if K * k + alpha * tau <= 0.0 or alpha * k + beta * K <= 0.0:
        return 0.0
    roots = np.roots(determinant.coef[::-1])
    real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
    slowest = float(np.max(real, initial=0.0))
    return 1.0 / slowest if slowest > 0.0 else math.inf


def klingel_wavelength(wheelset: WheelsetParameters) -> float:
    """Return the wavelength (m) of the kinematic motion of a free wheelset (Klingel 1883)."""
    return 2.0 * math.pi * math.sqrt(wheelset.r0 * wheelset.L_g / wheelset.gamma)
