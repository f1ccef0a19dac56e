from __future__ import annotations

import math

import numpy as np
import pytest

from estimator.log import Log


def columns(T: int = 5, h: float = 1e-3) -> dict[str, object]:
    return {
        "time": 10.0 + h * np.arange(T),
        "yaw_rate": np.full(T, 0.1),
        "lateral_acceleration": np.full(T, 0.2),
        "speed": np.full(T, 20.0),
    }


def test_holds_columns_step_and_measurements() -> None:
    log = Log(**columns(), traction_torque=np.arange(5))  # type: ignore[arg-type]
    assert len(log) == 5
    assert log.h == pytest.approx(1e-3, rel=1e-9)
    assert log.traction_torque is not None
    assert log.traction_torque.dtype == np.float64
    assert np.array_equal(log.measurements, np.tile([0.1, 0.2], (5, 1)))
    assert log.usable is not None
    assert log.usable.all()


def test_what_is_not_finite_is_not_usable() -> None:
    broken = columns()
    broken["yaw_rate"] = np.array([0.1, math.nan, math.inf, 0.1, 0.1])
    usable = np.ones((5, 2), dtype=bool)
    usable[3, 1] = False
    log = Log(**broken, usable=usable)  # type: ignore[arg-type]
    assert np.array_equal(log.usable, [[1, 1], [0, 1], [0, 1], [1, 0], [1, 1]])
    assert np.array_equal(log.measurements[:, 0], [0.1, 0.0, 0.0, 0.1, 0.1])
    assert usable[1].all()  # the caller's array is not touched


def test_is_read_only_and_a_copy() -> None:
    given = columns()
    log = Log(**given)  # type: ignore[arg-type]
    given["speed"][0] = 99.0  # type: ignore[index]
    assert log.speed[0] == 20.0
    with pytest.raises(ValueError, match="read-only"):
        log.speed[0] = 1.0


def test_a_million_samples_at_a_late_time_are_uniform() -> None:
    T = 1_000_000
    log = Log(**{**columns(T), "time": 36_000.0 + 1e-3 * np.arange(T)})  # type: ignore[arg-type]
    assert log.h == pytest.approx(1e-3, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": np.full(4, 20.0)}, r"got speed of shape \(4,\), expected \(5,\)"),
        ({"speed": np.full(5, math.nan)}, r"got speed nan in row 1, expected finite"),
        ({"traction_torque": np.array([0, 0, math.inf, 0, 0])}, r"traction_torque inf in row 3"),
        ({"time": np.array([0.0, 1.0, 2.0, 3.5, 4.0])}, r"got time 3.5 s in row 4, .* 3 s there"),
        ({"time": -np.arange(5.0)}, r"expected rising times"),
        ({"time": np.zeros(5)}, r"expected rising times"),
        ({"usable": np.ones(5, dtype=bool)}, r"got usable of shape \(5,\), expected \(5, 2\)"),
    ],
)
def test_refuses(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Log(**{**columns(), **change})  # type: ignore[arg-type]


def test_needs_two_samples() -> None:
    with pytest.raises(ValueError, match=r"got 1 samples, expected at least 2"):
        Log(**columns(1))  # type: ignore[arg-type]
