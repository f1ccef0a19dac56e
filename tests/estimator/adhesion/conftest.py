"""Motions of a torque-driven wheelset, integrated by scipy from the plant's equations; filters to compare."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.adhesion import AdhesionBank, Unknowns
from estimator.adhesion.block import new_memory, take_sample
from estimator.contact import CreepCurve
from estimator.log import Log
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from estimator.adhesion.block import Design, Memory

    Array = NDArray[np.float64]


V, TORQUE, H = 30.0, 3000.0, 1e-3
#: With everything that the default leaves out.
WHEELSET = replace(
    WheelsetParameters(), delta_r=1e-4, k_y=1e5, c_y=1e4, c_w=1e4, c_s=50.0, contact_angle=0.1,
    contact_angle_rate=1.0,
)  # fmt: skip
BOTH = np.ones(2, dtype=np.bool_)


def bank(**unknown: float) -> AdhesionBank:
    return AdhesionBank(WHEELSET, unknown=Unknowns(bias=(1e-3, 1e-2), **unknown))  # type: ignore[arg-type]


def compiled(design: Design, z: Array, usable: NDArray[np.bool_] | None = None, v_dot: float = 0.0) -> Memory:
    memory = new_memory(len(design.held))
    usable = np.ones(z.shape, dtype=np.bool_) if usable is None else usable
    work = np.zeros((5, 4, 12))
    for k in range(len(z)):
        for i in range(len(design.held)):
            take_sample(design, memory, i, k == 0, V, v_dot, TORQUE, z[k], usable[k], work)
    return memory


@pytest.fixture(scope="module")
def z() -> Array:
    rng = np.random.default_rng(5)
    return rng.standard_normal((150, 2)) * [1e-3, 0.06]


def _track(distance: float, seed: int) -> Callable[[float], float]:
    """Return a lateral offset over the distance: harmonics with the amplitudes of the spectrum."""
    rng = np.random.default_rng(seed)
    W = np.arange(0.01, 8.0, 0.01)
    amplitude = np.sqrt(2.0 * ERRI_B176["erri_low"].density(W) * 0.01)
    phase = rng.uniform(0.0, 2.0 * math.pi, W.size)
    fade = 5.0
    x = np.linspace(0.0, distance, int(distance / 0.05) + 2)
    offset = np.cos(np.outer(x, W) + phase) @ amplitude * np.minimum(x / fade, 1.0)
    return lambda at: float(np.interp(at, x, offset))


@pytest.fixture(scope="session")
def drive() -> Callable[[str, float, float, int], Log]:
    """Return a function that drives over a rail at a speed with a torque: (condition, v, torque, samples)."""

    def run(condition: str, v: float, torque: float, samples: int) -> Log:
        w, h = WheelsetParameters(), 1e-3
        curve = CreepCurve(CONDITIONS[condition], v)
        offset = _track(v * h * samples, 11)
        creep = curve.creep_at(torque / (2.0 * w.r0 * w.N))

        def rates(t: float, x: Array) -> list[float]:
            y, psi, u, r, l_L, l_R, theta = x
            g, b = w.L_g * r / v + w.gamma * (y - offset(v * t)) / w.r0, u / v - psi
            f_x, f_y = curve.forces([l_L + g, l_R - g], b)
            T_s = w.k_s * theta
            return [
                u,
                r,
                -(f_y[0] + f_y[1]) / w.m_w,
                ((f_x[1] - f_x[0]) * w.L_g - w.k_w * psi) / w.I_w,
                w.r0 / v * (T_s - w.r0 * f_x[0]) / w.I_L,
                w.r0 / v * (torque - T_s - w.r0 * f_x[1]) / w.I_R,
                v / w.r0 * (l_R - l_L),
            ]

        time = h * np.arange(samples)
        x0 = [0.0, 0.0, 0.0, 0.0, creep, creep, 0.5 * torque / w.k_s]
        motion = solve_ivp(rates, (0.0, time[-1]), x0, "LSODA", time, rtol=1e-5, atol=1e-8).y
        rng = np.random.default_rng(12)
        acceleration = [rates(t, x)[2] for t, x in zip(time, motion.T, strict=True)]
        return Log(
            time=time,
            yaw_rate=motion[3] + 1e-3 * rng.standard_normal(samples),
            lateral_acceleration=acceleration + 0.05 * rng.standard_normal(samples),
            speed=np.full(samples, v),
            traction_torque=np.full(samples, torque),
        )

    return run
