from __future__ import annotations

import math

import numpy as np
import pytest

from estimator.contact import CreepCurve
from estimator.linear_models import critical_speed, point_at
from estimator.stability import growth_rate, stable_speeds
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters


def test_it_is_the_critical_speed_of_the_slopes_found_there(wheelset: WheelsetParameters) -> None:
    v = stable_speeds(CONDITIONS["dry"], 1e-3, wheelset).critical
    point = point_at(CreepCurve(CONDITIONS["dry"], v), "", 1e-3)
    assert critical_speed(point.g11, point.g22, wheelset) == pytest.approx(v, rel=1e-9)


def test_small_creep_is_that_of_the_initial_slopes(wheelset: WheelsetParameters) -> None:
    curve = CreepCurve(CONDITIONS["dry"], 20.0)
    expected = critical_speed(curve.initial_slope, curve.initial_slope, wheelset)
    assert stable_speeds(CONDITIONS["dry"], 1e-7, wheelset).critical == pytest.approx(expected, rel=1e-3)


def test_stability_ends_where_the_curve_peaks(wheelset: WheelsetParameters) -> None:
    # At 3 % creep friction falls with the slip speed: the peak passes by as the speed grows.
    found = stable_speeds(CONDITIONS["dry"], 0.03, wheelset)
    assert CreepCurve(CONDITIONS["dry"], found.critical).peak_creep == pytest.approx(0.03, rel=1e-6)


@pytest.mark.parametrize("multiple", [1.0, 1.2, 2.0])
def test_at_and_past_the_peak_no_speed_is_stable(multiple: float, wheelset: WheelsetParameters) -> None:
    found = stable_speeds(
        CONDITIONS["low"],
        lambda curve: multiple * curve.peak_creep,
        wheelset,
        speeds=(5.0, 60.0),
        resolution=5.0,
    )
    assert (found.ranges, found.critical) == ((), 0.0)


def test_slack_grip_is_stable_throughout(wheelset: WheelsetParameters) -> None:
    found = stable_speeds(CONDITIONS["wet"], 1e-3, wheelset, speeds=(5.0, 100.0))
    assert found.ranges == ((5.0, 100.0),)
    assert found.critical == math.inf


def test_edges_separate_decay_from_growth(wheelset: WheelsetParameters) -> None:
    found = stable_speeds(CONDITIONS["very_low"], 1e-4, wheelset, resolution=3.0)
    for v in np.linspace(2.0, 118.0, 30):
        stable = any(a < v < b for a, b in found.ranges)
        assert (growth_rate(CONDITIONS["very_low"], 1e-4, wheelset, v) < 0.0) == stable


@pytest.mark.parametrize(("speeds", "step"), [((0.0, 10.0), 1.0), ((20.0, 10.0), 1.0), ((5.0, 10.0), 0.0)])
def test_a_range_that_is_none_is_refused(
    speeds: tuple[float, float], step: float, wheelset: WheelsetParameters
) -> None:
    with pytest.raises(ValueError, match="expected 0 < from < to and a step > 0"):
        stable_speeds(CONDITIONS["dry"], 1e-3, wheelset, speeds=speeds, resolution=step)
