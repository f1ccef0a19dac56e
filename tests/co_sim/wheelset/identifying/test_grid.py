"""Time stamps as they come, onto a uniform grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim.errors import InputError
from co_sim.wheelset.identifying.grid import on_grid
from co_sim.wheelset.identifying.status import SensorStatus
from co_sim.wheelset.identifying.table import Columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.grid import Sampled

    Array = NDArray[np.float64]


def smooth(t: Array) -> Array:
    return np.sin(2.0 * t)


def sampled(time: Array, speed: float | None = None, **columns: Array) -> Sampled:
    values = {
        "time": time,
        "yaw_rate": 1e-2 * smooth(time),
        "lateral_acceleration": smooth(time),
        "speed": np.full(len(time), 20.0),
        "traction_torque": 1e3 * smooth(time),
    }
    return on_grid("log", Columns(values | columns), speed)


def words(of: Sampled) -> set[str]:
    status = SensorStatus.of(of, np.zeros((len(of.log), 2), dtype=np.int64))
    return set(status.words(np.arange(len(of.log))))


@pytest.mark.parametrize("rate", [100.0, 1000.0, 1024.0, 2500.0, 10e3])
@pytest.mark.parametrize("start", [0.0, -3.0, 1.7e9])
def test_a_uniform_log_stays_as_it_is(rate: float, start: float) -> None:
    time = start + np.arange(5000) / rate
    done = sampled(time)
    assert done.log.h == pytest.approx(1.0 / rate, rel=1e-6)
    assert len(done.log) == 5000
    np.testing.assert_allclose(done.clock.offset + done.log.time, time, atol=1e-2 / rate)
    np.testing.assert_array_equal(done.log.lateral_acceleration, smooth(time))
    assert done.clock.gaps == ()
    assert (done.clock.resampled, done.clock.duplicated, done.clock.unordered) == (False, 0, 0)
    assert words(done) == {"ok"}


def test_times_with_few_digits_give_round_times() -> None:
    done = sampled(np.round(0.001 * np.arange(2000), 3))
    assert done.log.time[1234] == pytest.approx(1.234, abs=1e-12)
    assert done.clock.h == 0.001


def test_a_gap_is_not_usable_and_told() -> None:
    time = 1e-3 * np.arange(3000)
    done = sampled(np.delete(time, slice(1000, 1200)))
    assert len(done.log) == 3000
    usable = np.asarray(done.log.usable)
    assert not usable[1000:1200].any()
    assert usable[:1000].all()
    assert usable[1200:].all()
    assert done.clock.gaps == (pytest.approx((1.0, 1.199)),)
    assert done.clock.empty == 200
    np.testing.assert_allclose(done.log.speed, 20.0)
    assert words(done) == {"ok", "clock:gap"}


def test_a_long_pause_keeps_the_time() -> None:
    time = 1e-3 * np.arange(3000)
    time[1500:] += 7.0004
    done = sampled(time)
    assert done.log.time[-1] == pytest.approx(time[-1], abs=1e-3)
    assert np.asarray(done.log.usable).sum() == 6000


@pytest.mark.parametrize("drift", [-3e-4, 3e-4])
def test_a_clock_that_goes_wrong_evenly_is_followed(drift: float) -> None:
    done = sampled(1e-3 * (1.0 + drift) * np.arange(20_000))
    assert done.clock.h == pytest.approx(1e-3 * (1.0 + drift), rel=1e-9)
    assert not done.clock.resampled


def test_small_jitter_is_tolerated_and_large_resampled() -> None:
    rng = np.random.default_rng(1)
    even = 1e-3 * np.arange(5000)
    little = sampled(even + 2e-5 * rng.normal(size=5000))
    assert not little.clock.resampled
    assert little.clock.jitter_rms == pytest.approx(2e-5, rel=0.1)
    much = sampled(even + 1.5e-4 * rng.normal(size=5000))
    assert much.clock.resampled
    assert much.clock.h == pytest.approx(1e-3, rel=1e-4)
    inner = smooth(much.log.time[1:-1])
    np.testing.assert_allclose(much.log.lateral_acceleration[1:-1], inner, atol=1e-5)
    assert np.asarray(much.log.usable)[1:-1].all()
    assert "clock:jitter" in words(much)


def test_gaps_stay_gaps_when_resampled() -> None:
    rng = np.random.default_rng(1)
    time = 1e-3 * np.arange(5000) + 1.5e-4 * rng.normal(size=5000)
    done = sampled(np.delete(np.sort(time), slice(2000, 2100)))
    assert done.clock.resampled
    assert np.asarray(~done.log.usable).sum(axis=0) == pytest.approx([100, 100], abs=3)


def test_duplicated_and_unordered_and_undated_rows() -> None:
    time = 1e-3 * np.arange(2000)
    order = np.arange(2000)
    order[[500, 501]] = order[[501, 500]]
    stamps = np.insert(time[order], [100, 100], time[99])
    stamps[1000] = np.nan
    done = sampled(stamps)
    clock = done.clock
    assert (clock.rows, clock.duplicated, clock.unordered, clock.undated) == (2002, 2, 1, 1)
    assert len(done.log) == 2000
    assert clock.empty == 1
    np.testing.assert_allclose(done.log.lateral_acceleration[:990], smooth(done.log.time[:990]), atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.3), st.floats(0.0, 0.3))
def test_no_sample_ends_far_from_its_time(seed: int, jitter: float, lost: float) -> None:
    rng = np.random.default_rng(seed)
    time = 5.0 + 1e-3 * (np.arange(2000) + jitter * rng.uniform(-1.0, 1.0, 2000))
    time = time[rng.random(2000) >= lost]
    done = sampled(time)
    good = np.asarray(done.log.usable)[:, 1]
    error = np.abs(done.log.lateral_acceleration - smooth(done.log.time))[good]
    assert error.max() <= 2.0 * 1e-3  # the slope of the sine times a step
    # With a third of a step of jitter and a quarter of the rows gone, the rate itself is a guess.
    assert done.clock.h == pytest.approx(1e-3, rel=1e-2)


def test_speed_and_torque_with_holes_are_interpolated_and_told() -> None:
    time = 1e-3 * np.arange(1000)
    speed, torque = 20.0 + time, 1e3 + time
    holed_speed, holed_torque = speed.copy(), torque.copy()
    holed_speed[100:200], holed_torque[-50:] = np.nan, np.nan
    values = {"time": time, "yaw_rate": time, "lateral_acceleration": time}
    holed = {"speed": holed_speed, "traction_torque": holed_torque}
    done = on_grid("log", Columns(values | holed))
    assert np.isfinite(np.asarray(done.log.traction_torque)).all()
    np.testing.assert_allclose(done.log.speed, speed)
    assert words(done) == {"ok", "speed:dropout", "torque:dropout"}


def test_constant_speed_and_no_torque() -> None:
    time = 1e-3 * np.arange(1000)
    values = {"time": time, "yaw_rate": time, "lateral_acceleration": time}
    log = on_grid("log", Columns(values), 30.0).log
    assert (log.speed == 30.0).all()
    assert log.traction_torque is None


TIME = 1e-3 * np.arange(1000)


@pytest.mark.parametrize(
    ("time", "columns", "said"),
    [
        (TIME[:50], {}, "got 50 samples, expected at least 100"),
        (np.full(1000, np.nan), {}, "got 0 samples"),
        (1e3 * TIME, {}, "got a rate of 1 Hz.*give the time in s"),
        (1e-3 * TIME, {}, "got a rate of 1e.06 Hz.*thin"),
        (np.concatenate([TIME + 5.0, TIME]), {}, "row 1001: time: got 0 s after 5.999 s"),
        (np.round(TIME, 2), {}, "899 of 1000 rows with the time of the row before"),
        (np.where(TIME < 0.5, TIME, TIME + 1000.0), {}, "cut the log where it pauses"),
        (TIME, {"speed": np.full(1000, np.nan)}, "column speed: got no number"),
        (TIME, {"speed": np.full(1000, -20.0)}, "speed: got -20 m/s.*magnitude"),
        (TIME, {"speed": np.full(1000, 300.0)}, r"speed: got 300 m/s.*speed \[km/h\]"),
    ],
)
def test_logs_that_cannot_be_used(time: Array, columns: dict[str, Array], said: str) -> None:
    with pytest.raises(InputError, match=said):
        sampled(time, **columns)


def test_a_speed_that_trembles_around_rest_is_rest() -> None:
    speed = 0.05 * np.random.default_rng(1).normal(size=1000)
    values = {"time": TIME, "yaw_rate": TIME, "lateral_acceleration": TIME, "speed": speed}
    assert on_grid("log", Columns(values)).log.speed.min() == 0.0
