import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim.errors import InputError
from co_sim.wheelset.sensors import Channel, Sensors, SensorSpec

H = 1e-3
values = st.floats(-1e6, 1e6)


def one(spec, seed=1):
    return Sensors([Channel("yaw_rate", "rad/s", spec)], seed=seed)


def measure(sensors, u, h=H):
    """Return the measured values at the start and after each step: shape (steps + 1, channels)."""
    u = np.asarray(u, dtype=float).reshape(len(u), len(sensors.channels))
    y = np.full(u.shape[1], np.nan)
    sensors.start(0.0, h)
    sensors.exchange(u[0], y)
    log = [y.copy()]
    for k, row in enumerate(u):
        sensors.step(k * h, h, row, y)
        log.append(y.copy())
    return np.array(log)


def noise(spec, n, seed=1):
    return measure(one(spec, seed), np.zeros(n - 1))[:, 0]


def test_ports():
    sensors = Sensors(
        [Channel("yaw_rate", "rad/s", SensorSpec()), Channel("acceleration", "m/s2", SensorSpec())], seed=1
    )
    for ports, kind in ((sensors.inputs, "true"), (sensors.outputs, "measured")):
        assert [(p.name, p.unit) for p in ports] == [("yaw_rate", "rad/s"), ("acceleration", "m/s2")]
        assert [p.description for p in ports] == [f"{kind} yaw_rate", f"{kind} acceleration"]
        assert [p.start for p in ports] == [None, None]


@given(st.lists(st.tuples(values, values), min_size=1, max_size=50))
@settings(deadline=None)
def test_a_sensor_without_faults_is_the_identity(u):
    sensors = Sensors([Channel(name, "1", SensorSpec()) for name in "ab"], seed=3)
    np.testing.assert_array_equal(measure(sensors, u), [u[0], *u])


def test_no_sensors_measure_nothing():
    assert measure(Sensors([], seed=1), np.empty((3, 0)), H).shape == (4, 0)


@given(st.lists(values, min_size=1, max_size=50), values)
@settings(deadline=None)
def test_bias_is_added(u, bias):
    np.testing.assert_array_equal(
        measure(one(SensorSpec(bias=bias)), u), np.array([u[0], *u])[:, None] + bias
    )


# --- noise

N = 40_000


def test_noise_has_the_rms_and_no_mean():
    e = noise(SensorSpec(noise_rms=0.05), N)
    # Standard errors of the mean and of the rms of N normal values; four of them.
    assert abs(e.mean()) < 4 * 0.05 / math.sqrt(N)
    assert np.std(e) == pytest.approx(0.05, rel=4 / math.sqrt(2 * N))
    assert np.mean(np.abs(e) < 0.05) == pytest.approx(math.erf(math.sqrt(0.5)), abs=4 * math.sqrt(0.22 / N))


@pytest.mark.parametrize("bandwidth_hz", [None, 5.0])
def test_noise_is_white_also_behind_a_low_pass(bandwidth_hz):
    e = noise(SensorSpec(noise_rms=1.0, bandwidth_hz=bandwidth_hz), N)
    # Lags about the block length too, where a repeated block would show.
    for lag in (*range(1, 21), *range(1020, 1029)):
        assert abs(np.mean(e[lag:] * e[:-lag])) < 4.5 / math.sqrt(N)


def test_rms_scales_the_same_noise():
    np.testing.assert_allclose(
        noise(SensorSpec(noise_rms=3e-3), 100), 3e-3 * noise(SensorSpec(noise_rms=1.0), 100), rtol=1e-12
    )


def test_a_start_repeats_the_noise_and_another_seed_does_not():
    sensors = one(SensorSpec(noise_rms=1.0))
    first = measure(sensors, np.zeros(3000))
    np.testing.assert_array_equal(measure(sensors, np.zeros(3000)), first)
    np.testing.assert_array_equal(measure(one(SensorSpec(noise_rms=1.0)), np.zeros(3000)), first)
    other = noise(SensorSpec(noise_rms=1.0), 3001, seed=2)
    assert abs(np.mean(first[:, 0] * other)) < 4 / math.sqrt(3001)


@given(st.permutations(["yaw_rate", "lateral", "longitudinal", "speed"]), st.integers(1, 4))
@settings(deadline=None, max_examples=30)
def test_other_channels_do_not_change_a_channel_s_noise(names, n):
    spec = SensorSpec(noise_rms=1.0)
    sensors = Sensors([Channel(name, "1", spec) for name in names[:n]], seed=7)
    together = measure(sensors, np.zeros((20, n)))
    for i, name in enumerate(names[:n]):
        alone = measure(Sensors([Channel(name, "1", spec)], seed=7), np.zeros(20))
        np.testing.assert_array_equal(together[:, i], alone[:, 0])


def test_channels_have_independent_noise():
    spec = SensorSpec(noise_rms=1.0)
    e = measure(Sensors([Channel(name, "1", spec) for name in "ab"], seed=7), np.zeros((N, 2)))
    assert abs(np.mean(e[:, 0] * e[:, 1])) < 4 / math.sqrt(N)


def test_exchange_may_be_called_any_number_of_times():
    spec = SensorSpec(noise_rms=1.0, bias=0.3, bandwidth_hz=10.0, rate_hz=500.0)
    logs = []
    for calls in (1, 2, 5):
        sensors, y = one(spec), np.empty(1)
        sensors.start(0.0, H)
        # A master that settles the initial values passes provisional ones first.
        for provisional in range(calls - 1, -1, -1):
            sensors.exchange(np.array([float(provisional)]), y)
        log = [y[0]]
        for k in range(6):
            sensors.step(k * H, H, np.array([1.0]), y)
            log.append(y[0])
        logs.append(log)
    assert logs[0] == logs[1] == logs[2]


# --- bandwidth


@given(st.floats(0.1, 1e4), st.floats(1e-4, 1e-2))
@settings(deadline=None)
def test_step_response_of_the_bandwidth_is_exact(bandwidth_hz, h):
    sensors, y = one(SensorSpec(bandwidth_hz=bandwidth_hz)), np.empty(1)
    sensors.start(0.0, h)
    sensors.exchange(np.zeros(1), y)
    assert y[0] == 0.0
    tau = 1.0 / (2.0 * math.pi * bandwidth_hz)
    for k in range(50):
        sensors.step(k * h, h, np.ones(1), y)
        assert y[0] == pytest.approx(-math.expm1(-(k + 1) * h / tau), rel=1e-9, abs=1e-13)


@given(values, st.floats(0.1, 1e4))
@settings(deadline=None)
def test_a_constant_passes_the_bandwidth_unchanged(u, bandwidth_hz):
    np.testing.assert_array_equal(measure(one(SensorSpec(bandwidth_hz=bandwidth_hz)), np.full(20, u)), u)


def test_gain_at_the_corner_is_three_decibels():
    f, h, n = 10.0, 1e-5, 50_000
    y = measure(one(SensorSpec(bandwidth_hz=f)), np.sin(2 * math.pi * f * h * np.arange(n)), h)[1:, 0]
    periods = y[-20_000:]  # two whole periods, five time constants and more after the start
    assert math.sqrt(2.0 * np.mean(periods**2)) == pytest.approx(math.sqrt(0.5), rel=1e-3)


# --- sampling


def test_samples_are_held_from_the_start_on():
    log = measure(one(SensorSpec(bias=0.5, rate_hz=250.0)), np.arange(1.0, 11.0))
    # The step to k h sees the value held from (k - 1) h; samples fall on k = 0, 4 and 8.
    assert log[:, 0].tolist() == [1.5, 1.5, 1.5, 1.5, 4.5, 4.5, 4.5, 4.5, 8.5, 8.5, 8.5]


def test_noise_is_drawn_once_a_sample():
    fast = noise(SensorSpec(noise_rms=1.0), 11)
    slow = noise(SensorSpec(noise_rms=1.0, rate_hz=250.0), 41)
    np.testing.assert_array_equal(slow, np.repeat(fast, 4)[:41])


def test_the_low_pass_runs_between_samples():
    u = np.random.default_rng(0).standard_normal(40)
    every = measure(one(SensorSpec(bandwidth_hz=30.0)), u)
    sampled = measure(one(SensorSpec(bandwidth_hz=30.0, rate_hz=100.0)), u)
    np.testing.assert_array_equal(sampled[::10], every[::10])


@given(st.integers(1, 10_000), st.floats(1e-6, 1e-1))
def test_every_whole_fraction_of_the_step_rate_is_accepted(n, h):
    one(SensorSpec(rate_hz=1.0 / (n * h))).start(0.0, h)


@pytest.mark.parametrize(
    ("rate_hz", "remedy"),
    [(300.0, "333.333 or 250"), (999.0, "1000 or 500"), (1500.0, "1000 or 500"), (1e9, "1000 or 500")],
)
def test_another_rate_is_refused(rate_hz, remedy):
    with pytest.raises(InputError) as caught:
        one(SensorSpec(rate_hz=rate_hz)).start(0.0, H)
    assert str(caught.value) == (
        f"sensor yaw_rate: rate_hz: got {rate_hz:g} Hz, expected the step rate of 1000 Hz divided by a whole"
        f" number; use {remedy} Hz or another step"
    )


# --- faults of the description


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("noise_rms", -1.0, "a finite value >= 0"),
        ("noise_rms", math.nan, "a finite value >= 0"),
        ("bias", math.inf, "a finite value"),
        ("bandwidth_hz", 0.0, "a finite frequency > 0 Hz"),
        ("rate_hz", -100.0, "a finite frequency > 0 Hz"),
        ("rate_hz", math.inf, "a finite frequency > 0 Hz"),
    ],
)
def test_faulty_specifications_are_refused(field, value, expected):
    with pytest.raises(InputError) as caught:
        SensorSpec(**{field: value})
    assert str(caught.value) == (
        f"sensor {field}: got {value:g}, expected {expected}; leave it out for a sensor without this fault"
    )


def test_doubled_channels_are_refused():
    channels = [Channel(name, "1", SensorSpec()) for name in ("b", "a", "b")]
    with pytest.raises(InputError) as caught:
        Sensors(channels, seed=0)
    assert str(caught.value) == (
        "sensor channels: got b more than once, expected one channel of each name;"
        " rename or remove the others"
    )


def test_a_negative_seed_is_refused():
    with pytest.raises(InputError, match=r"^sensor seed: got -1, expected an integer >= 0; use 0$"):
        one(SensorSpec(), seed=-1)
