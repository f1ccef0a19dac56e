"""Faults by sample, as words by row and as a list."""

from __future__ import annotations

import numpy as np

from co_sim.wheelset.identifying.status import SensorStatus
from estimator.sensor_faults import DROPOUT, OUTLIER, STUCK

ROWS = np.array([9, 19, 29, 39])


def status(T: int = 45) -> SensorStatus:
    return SensorStatus(
        1e-3 * np.arange(T), np.zeros((T, 2), dtype=np.int64), np.zeros((T, 4), dtype=np.bool_)
    )


def test_a_fault_stands_in_the_first_row_at_or_after_it_and_in_no_other() -> None:
    for sample, row in ((0, 0), (9, 0), (10, 1), (19, 1), (20, 2), (39, 3)):
        one = status()
        one.sensors[sample, 0] = STUCK
        assert one.words(ROWS) == ["gyro:stuck" if i == row else "ok" for i in range(4)]


def test_what_comes_after_the_last_row_stands_in_none() -> None:
    one = status()
    one.sensors[40:] = DROPOUT
    assert one.words(ROWS) == ["ok"] * 4


def test_all_faults_of_a_row_are_told_by_source() -> None:
    one = status()
    one.sensors[11] = OUTLIER, DROPOUT
    one.sensors[12, 0] = STUCK | DROPOUT
    one.others[13] = True
    told = "gyro:dropout|outlier|stuck accelerometer:dropout speed:dropout torque:dropout clock:jitter|gap"
    assert one.words(ROWS) == ["ok", told, "ok", "ok"]


def test_list_of_faults() -> None:
    one = status()
    one.sensors[[3, 4, 10], 1] = OUTLIER
    one.sensors[44, 1] = OUTLIER | STUCK
    found = {(f.source, f.fault): f for f in one.found()}
    assert found.keys() == {("accelerometer", "outlier"), ("accelerometer", "stuck")}
    outlier = found["accelerometer", "outlier"]
    assert (outlier.samples, outlier.stretches, outlier.first, outlier.last) == (4, 3, 0.003, 0.044)
    assert outlier.share == 4 / 45
    assert status().found() == []
