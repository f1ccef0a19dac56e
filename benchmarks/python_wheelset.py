"""The wheelset in plain Python, for PythonFMU3: the equations of docs/model.md, its options off.

A step of co-simulation is `substeps` steps of the classical Runge-Kutta method. The equations are scalar
ones; arrays of eight elements would make them slower.
"""

from __future__ import annotations

from math import atan, exp, pi, sqrt
from typing import Any

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability

from fmu_wheelset import CONDITIONS, WheelsetParameters
from fmu_wheelset.variables import DriveMode

P = WheelsetParameters()
RAIL = CONDITIONS["dry"]
STATES = ("y", "psi", "y_dot", "psi_dot", "omega_L", "omega_R", "theta")


class PythonWheelset(Fmi3Slave):  # type: ignore[misc]
    """Wheelset without forward dynamics on dry rails, at speeds where the creep is not regularised."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.time, self.drive_mode, self.speed, self.substeps = 0.0, 1.0, 20.0, 1.0
        self.prescribed_creepage = self.traction_torque = self.track_lateral_offset = 0.0
        for name in STATES:
            setattr(self, name, 0.0)
        local = {"causality": Fmi3Causality.independent, "variability": Fmi3Variability.continuous}
        self.register_variable(Float64("time", **local))
        fixed = {"causality": Fmi3Causality.parameter, "variability": Fmi3Variability.tunable}
        for name in ("drive_mode", "speed", "substeps", "prescribed_creepage", "traction_torque", *STATES):
            self.register_variable(Float64(name, **fixed))
        self.register_variable(Float64("track_lateral_offset", causality=Fmi3Causality.input))

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance the states by `step_size`."""
        del current_time
        n = int(self.substeps)
        x = [getattr(self, name) for name in STATES]
        for _ in range(n):
            x = self._runge_kutta(x, step_size / n)
        for name, value in zip(STATES, x, strict=True):
            setattr(self, name, value)
        return True

    def _runge_kutta(self, x: list[float], h: float) -> list[float]:
        k1 = self.x_dot(x)
        k2 = self.x_dot([a + h / 2 * b for a, b in zip(x, k1, strict=True)])
        k3 = self.x_dot([a + h / 2 * b for a, b in zip(x, k2, strict=True)])
        k4 = self.x_dot([a + h * b for a, b in zip(x, k3, strict=True)])
        slopes = zip(x, k1, k2, k3, k4, strict=True)
        return [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in slopes]

    def x_dot(self, x: list[float]) -> list[float]:
        """Return the derivatives of the states."""
        y, psi, y_dot, psi_dot, omega_L, omega_R, theta = x
        v, torque_driven = self.speed, self.drive_mode == DriveMode.TORQUE_DRIVEN
        drive_L = (P.r0 * omega_L - v) / v if torque_driven else self.prescribed_creepage
        drive_R = (P.r0 * omega_R - v) / v if torque_driven else self.prescribed_creepage
        guidance = P.L_g * psi_dot / v + P.gamma * (y - self.track_lateral_offset) / P.r0
        lateral = y_dot / v - psi
        f_xL, f_yL = creep_force(drive_L + guidance, lateral, v)
        f_xR, f_yR = creep_force(drive_R - guidance, lateral, v)
        y_ddot = -(f_yL + f_yR) / P.m_w
        psi_ddot = ((f_xR - f_xL) * P.L_g - P.k_w * psi) / P.I_w
        if not torque_driven:
            return [y_dot, psi_dot, y_ddot, psi_ddot, 0.0, 0.0, 0.0]
        T_s = P.k_s * theta + P.c_s * (omega_R - omega_L)
        spin_L = (T_s - P.r0 * f_xL) / P.I_L
        spin_R = (self.traction_torque - T_s - P.r0 * f_xR) / P.I_R
        return [y_dot, psi_dot, y_ddot, psi_ddot, spin_L, spin_R, omega_R - omega_L]


def creep_force(creepage_x: float, creepage_y: float, v: float) -> tuple[float, float]:
    """Return Polach's longitudinal and lateral creep force. Products, as powers raise where they overflow."""
    patch = P.patch
    creep = sqrt(creepage_x * creepage_x + creepage_y * creepage_y)
    if creep == 0.0:
        return 0.0, 0.0
    s_x, s_y = patch.C11 * creepage_x, patch.C22 * creepage_y
    s = sqrt(s_x * s_x + s_y * s_y)
    mu = RAIL.mu_0 * ((1 - RAIL.A) * exp(-RAIL.B * creep * v) + RAIL.A)
    eps = patch.G * pi * patch.a * patch.b * s / (4 * P.N * mu)
    adhesion = RAIL.k_A * eps
    force = 2 * P.N * mu / pi * (adhesion / (1 + adhesion * adhesion) + atan(RAIL.k_S * eps))
    return force * creepage_x / creep, force * creepage_y / creep
