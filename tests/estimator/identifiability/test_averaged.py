from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator import ERRI_B176, CreepCurve, TrackSpectrum
from estimator.identifiability import averaged_points, averaged_same_force, creep_covariance
from estimator.linear_models import point_at

if TYPE_CHECKING:
    from estimator import OperatingPoint

TRACK = ERRI_B176["erri_low"]


def slopes(point: OperatingPoint) -> tuple[float, float, float]:
    return point.force, point.g11, point.g22


def test_on_a_smooth_track_the_slopes_are_those_of_the_curve(low: CreepCurve) -> None:
    creeps = np.array([0.1, 0.4, 0.8]) * low.peak_creep
    for point, creep in zip(averaged_points(low, creeps, TrackSpectrum(A=1e-14)), creeps, strict=True):
        assert slopes(point) == pytest.approx(slopes(point_at(low, "P", float(creep))), rel=1e-3)


def test_the_motion_is_that_of_the_slopes_found(low: CreepCurve) -> None:
    # Force and slopes again by drawing creepages of the motion that the found slopes make.
    (point,) = averaged_points(low, [0.3 * low.peak_creep], TRACK)
    sigma = np.sqrt(np.diag(creep_covariance(point, TRACK)))
    d = sigma[:, None] * np.random.default_rng(1).standard_normal((2, 400_000))
    f_x, f_y = low.forces(point.creep + d[0], d[1])
    found = (np.mean(f_x), np.mean(f_x * d[0]) / sigma[0] ** 2, np.mean(f_y * d[1]) / sigma[1] ** 2)
    # The wheels turn on their own there and as one here; that moves the amplitude by a few per cent.
    assert slopes(point) == pytest.approx(found, rel=0.06)


def test_no_steady_motion_far_past_the_peak(dry: CreepCurve) -> None:
    near, past = averaged_points(dry, [0.9 * dry.peak_creep, 2.0 * dry.peak_creep], TRACK)
    assert near.g11 > 0.0
    assert np.isnan(slopes(past)).all()


def test_points_of_the_same_mean_force(low: CreepCurve, dry: CreepCurve) -> None:
    found = averaged_same_force([1500.0, 4000.0, 9000.0], {"low": low, "dry": dry}, TRACK)
    assert found["low"][2] is None
    for name, curve in (("low", low), ("dry", dry)):
        for point in found[name][:2]:
            assert point is not None
            (again,) = averaged_points(curve, [point.creep], TRACK)
            assert slopes(point) == pytest.approx(slopes(again), rel=1.5e-2)
