"""Wheelset, operating points and filters that several test modules look at."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import settings

from estimator.contact import CreepCurve
from estimator.kalman import LinearFilter, design_filter
from estimator.linear_models import OperatingPoint, filter_model, operating_points
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Simulate = Callable[[LinearFilter, int, int], NDArray[np.float64]]

# The same examples in every run, and no time limit: the first example pays for compilation.
settings.register_profile("laws", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("laws")


@pytest.fixture(scope="session")
def wheelset() -> WheelsetParameters:
    return WheelsetParameters()


@pytest.fixture(scope="session")
def davis_wheelset() -> WheelsetParameters:
    """Data of a course example (University of California, Davis, EME 134, lab 1).

    Its lateral spring is 2 k1 and its gravitational stiffness 2 N/(R - R').
    """
    m, d, R, R_rail, k1, k2 = 1000.0, 0.72, 0.23, 0.20, 13e3, 13e3
    return WheelsetParameters(
        m_w=m,
        I_w=m * d**2,
        r0=0.46,
        gamma=R * math.radians(1.0) / (R - R_rail),
        L_g=d,
        k_w=2.0 * k2 * (d / 2.0) ** 2,
        k_y=2.0 * k1,
        N=80e3 / 4.0,
        contact_angle_rate=1.0 / (R - R_rail),
    )


@pytest.fixture(scope="session")
def dry() -> CreepCurve:
    return CreepCurve(CONDITIONS["dry"], v=20.0)


@pytest.fixture(scope="session")
def points(dry: CreepCurve) -> dict[str, OperatingPoint]:
    return {point.name: point for point in operating_points(dry)}


@pytest.fixture(scope="session")
def filters(points: dict[str, OperatingPoint], wheelset: WheelsetParameters) -> tuple[LinearFilter, ...]:
    """Filters of P1 (five states), P2 (three) and P3 (five) at 1 kHz."""
    W, R = np.diag([1.3e-5, 1e-4, 1e-4]), np.diag([1e-6, 2.5e-3])
    return tuple(
        design_filter(filter_model(p, wheelset), W, R, 1e-3, name=name) for name, p in points.items()
    )


@pytest.fixture(scope="session")
def simulate() -> Simulate:
    """Samples (T, m) that a filter's own model makes, started from the steady covariance."""

    def run(f: LinearFilter, samples: int, seed: int) -> NDArray[np.float64]:
        rng = np.random.default_rng(seed)
        s, m = f.K.shape
        root = np.linalg.svd(f.Q)
        w = rng.standard_normal((samples, s)) @ (root.U * np.sqrt(root.S)).T
        z = rng.standard_normal((samples, m)) @ np.linalg.cholesky(f.R).T
        x = np.linalg.cholesky(f.P) @ rng.standard_normal(s)
        for k in range(samples):
            z[k] += f.H @ x
            x = f.F @ x + w[k]
        return z

    return run
