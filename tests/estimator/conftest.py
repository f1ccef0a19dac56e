"""Wheelset, operating points and filters that several test modules look at."""

from __future__ import annotations

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
