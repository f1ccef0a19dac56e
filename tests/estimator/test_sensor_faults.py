"""Each fault is found where it was injected, and good data have none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator.log import Log
from estimator.sensor_faults import (
    BIAS,
    DROPOUT,
    FAULTS,
    OUTLIER,
    SATURATION,
    STUCK,
    ChannelLimits,
    SensorMonitor,
    fault_names,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NOISE = np.array([1e-3, 0.05])
GYRO, ACCELEROMETER = 0, 1


def motion(T: int = 4000, h: float = 1e-3, amplitude: float = 3.0, seed: int = 1) -> Array:
    """A wheelset that hunts at 2 Hz and trembles at 13 Hz, with the noise of the sensors."""
    rng = np.random.default_rng(seed)
    t = h * np.arange(T)
    wave = np.sin(2 * np.pi * 2.0 * t) + 0.5 * np.sin(2 * np.pi * 13.0 * t + 1.0)
    return NOISE * (amplitude * wave[:, None] + rng.normal(size=(T, 2)))


def faults(z: Array, *, h: float = 1e-3, speed: float = 20.0, **limits: float) -> NDArray[np.int64]:
    log = Log(
        time=h * np.arange(len(z)),
        yaw_rate=z[:, 0],
        lateral_acceleration=z[:, 1],
        speed=np.full(len(z), speed),
    )
    channels = (
        ChannelLimits(noise=NOISE[0], bias=0.05),
        ChannelLimits(**({"noise": NOISE[1], "bias": 1.0} | limits)),
    )
    return SensorMonitor(h, channels).run(log)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("amplitude", [0.0, 3.0, 100.0])
def test_good_data_have_no_fault(h: float, amplitude: float) -> None:
    assert not faults(motion(20_000, h, amplitude), h=h).any()


@pytest.mark.parametrize("speed", [0.0, 20.0])
def test_a_perfect_sensor_at_rest_has_no_fault(speed: float) -> None:
    assert not faults(np.zeros((5000, 2)), speed=speed).any()


def test_standstill_and_departure_have_no_fault() -> None:
    z = np.concatenate([np.zeros((3000, 2)), motion()])
    speed = np.concatenate([np.zeros(3000), np.full(4000, 5.0)])
    log = Log(time=1e-3 * np.arange(7000), yaw_rate=z[:, 0], lateral_acceleration=z[:, 1], speed=speed)
    assert not SensorMonitor(1e-3).run(log).any()


@pytest.mark.parametrize("resolution", [0.05, 0.2])
def test_coarse_resolution_is_no_fault(resolution: float) -> None:
    z = motion(20_000)
    z[:, 1] = resolution * np.round(z[:, 1] / resolution)
    assert not faults(z).any()


@pytest.mark.parametrize(("power", "lost"), [(2, 1), (1, 4)])
def test_blows_of_the_flange_are_no_outliers(power: int, lost: int) -> None:
    """40 ms and 30 m/s2, six hundred times the noise; samples at the kinks of half sines may go."""
    z = motion(20_000)
    blow = 30.0 * np.sin(np.pi * np.arange(40) / 40.0) ** power
    starts = range(1000, 19_000, 777)
    for i, start in enumerate(starts):  # left and right in turn
        z[start : start + 40, 1] += (-1) ** i * blow
    assert np.count_nonzero(faults(z)) <= lost * len(starts)


def test_a_burst_of_wild_samples() -> None:
    z = motion()
    z[2000:2030, 1] += np.random.default_rng(2).normal(scale=20.0, size=30)
    found = faults(z)[:, 1] == OUTLIER
    assert np.mean(found[2000:2030]) > 0.8
    assert not found[:2000].any()
    assert not found[2035:].any()


@pytest.mark.parametrize("channel", [GYRO, ACCELEROMETER])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_drop_outs(channel: int, value: float) -> None:
    z = motion()
    z[2000:2050, channel] = value
    found = faults(z)
    expected = np.zeros_like(found)
    expected[2000:2050, channel] = DROPOUT
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("channel", [GYRO, ACCELEROMETER])
@pytest.mark.parametrize("size", [-1e4, -30.0, 30.0, 1e4])
def test_single_outliers_of_any_size(channel: int, size: float) -> None:
    z = motion()
    places = np.array([500, 1700, 1701, 3000])
    z[places, channel] += size * NOISE[channel]
    found = faults(z)
    expected = np.zeros_like(found)
    expected[places, channel] = OUTLIER
    np.testing.assert_array_equal(found, expected)


def test_a_step_that_stays_is_a_movement() -> None:
    z = motion()
    z[2000:, 1] += 0.8
    found = faults(z)
    np.testing.assert_array_equal(np.flatnonzero(found[:, 1]), [2000, 2001])


def test_noise_greater_than_told_is_learned() -> None:
    z = motion()
    z[:, 1] += np.random.default_rng(5).normal(scale=1.0, size=len(z))
    assert np.mean(faults(z)[500:, 1] == OUTLIER) < 1e-3


@pytest.mark.parametrize("channel", [GYRO, ACCELEROMETER])
@pytest.mark.parametrize("value", [0.0, 1.3])
def test_a_stuck_sensor_from_20_ms_on(channel: int, value: float) -> None:
    z = motion()
    z[2000:3000, channel] = value * NOISE[channel]
    found = faults(z)
    assert (found[2025:3000, channel] == STUCK).all()
    assert not found[:2000].any()
    assert not found[3003:].any()
    assert not found[:, 1 - channel].any()


def test_a_sensor_that_sticks_again_and_again_teaches_nothing() -> None:
    z = motion(20_000)
    for start in range(1000, 20_000, 1000):
        z[start : start + 700, 0] = 1e-3
    found = faults(z)[:, 0]
    for start in range(1000, 20_000, 1000):
        assert (found[start + 25 : start + 700] == STUCK).all()


def test_stuck_from_the_start() -> None:
    z = motion()
    z[:, 0] = 0.0
    found = faults(z)
    assert (found[500:, 0] == STUCK).all()
    assert not found[:, 1].any()


def test_saturation_is_learned_from_flat_tops() -> None:
    z = motion(amplitude=20.0)
    clipped = z.copy()
    clipped[:, 1] = np.clip(z[:, 1], -0.8, 0.8)
    found = faults(clipped)[:, 1]
    flat = np.abs(clipped[:, 1]) >= 0.8
    assert np.mean(found[flat] == SATURATION) > 0.95
    assert not found[~flat].any()


def test_full_scale_that_is_known_needs_no_learning() -> None:
    z = motion(amplitude=20.0)
    z[:, 1] = np.clip(z[:, 1], -0.8, 0.8)
    found = faults(z, full_scale=0.8)[:, 1]
    np.testing.assert_array_equal(found == SATURATION, np.abs(z[:, 1]) >= 0.999 * 0.8)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_gross_bias_after_its_mean_has_moved(sign: float) -> None:
    z = motion(8000)
    z[4000:, 1] += sign * 5.0
    found = faults(z)[:, 1]
    assert (found[5000:] & BIAS != 0).all()
    assert not (found[:4000] & BIAS).any()


def test_a_curve_within_the_limit_is_no_bias() -> None:
    """20 m/s through 800 m: .025 rad/s, .5 m/s2."""
    z = motion(8000)
    z += np.minimum(np.arange(8000) / 3000.0, 1.0)[:, None] * [0.025, 0.5]
    assert not faults(z).any()


def test_step_by_step_is_the_same_as_at_once() -> None:
    z = motion(amplitude=20.0)
    z[:, 1] = np.clip(z[:, 1], -0.8, 0.8)
    z[1000:1500, 0], z[[200, 2500], 0], z[3000:3100, 1] = 2e-3, 0.5, np.nan
    monitor = SensorMonitor(1e-3)
    log = Log(
        time=1e-3 * np.arange(len(z)),
        yaw_rate=z[:, 0],
        lateral_acceleration=z[:, 1],
        speed=np.full(len(z), 20.0),
    )
    at_once = monitor.run(log)
    monitor.reset()
    one_by_one = np.empty_like(at_once)
    for k in range(len(z)):
        monitor.step(z[k], 20.0, one_by_one[k])
    np.testing.assert_array_equal(one_by_one, at_once)
    assert {bit for bit in FAULTS if (at_once & bit).any()} == {DROPOUT, OUTLIER, SATURATION, STUCK}


def test_units_do_not_matter() -> None:
    """Measured in other units, with limits in these, the same samples are at fault."""
    z = motion(amplitude=20.0)
    z[:, 1] = np.clip(z[:, 1], -0.8, 0.8)
    z[2500, 1] = 7.0
    scaled = z * [1.0, 1024.0]
    np.testing.assert_array_equal(faults(scaled, noise=0.05 * 1024.0, bias=1024.0), faults(z))


def test_names() -> None:
    assert fault_names(0) == ()
    assert fault_names(OUTLIER | DROPOUT) == ("dropout", "outlier")


def test_watched_log_is_not_usable_at_faults() -> None:
    z = motion()
    z[100, 1], z[200:210, 0] = 9.0, np.nan
    log = Log(
        time=1e-3 * np.arange(len(z)),
        yaw_rate=z[:, 0],
        lateral_acceleration=z[:, 1],
        speed=np.full(4000, 9.0),
    )
    usable = SensorMonitor(1e-3).watched(log).usable
    assert usable is not None
    assert (~usable).sum(axis=0).tolist() == [10, 1]


@pytest.mark.parametrize("values", [{"noise": 0.0}, {"bias": -1.0}, {"full_scale": np.nan}])
def test_limits_that_are_none_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected more than 0"):
        ChannelLimits(**({"noise": 1.0, "bias": 1.0} | values))


@pytest.mark.parametrize("h", [0.0, -1e-3, np.nan])
def test_steps_that_are_none_are_refused(h: float) -> None:
    with pytest.raises(ValueError, match="expected more than 0"):
        SensorMonitor(h)
