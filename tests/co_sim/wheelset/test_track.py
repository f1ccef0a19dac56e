import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.signal import welch

from co_sim.errors import InputError
from co_sim.wheelset.track import SHORTEST_WAVELENGTH, TrackInput, TrackProfile, read_track_csv, synthesise
from estimator.track_spectrum import ERRI_B176

SPECTRUM = ERRI_B176["erri_low"]
H = 1e-3

TWO_COLUMNS = (
    "expected two columns, distance and lateral offset in m;"
    " separate the columns by one comma and write decimals with a point"
)
NUMBER = "expected a finite number; write decimals with a point and remove points without a measurement"
INCREASING = "expected strictly increasing distances; sort the points and remove doubled ones"
POINTS = (
    "expected one offset for each distance and at least 4 points; give two columns of the same length, in m"
)
FINITE = "expected finite distances and offsets in m; remove the points without a measurement"


def covariance(d):
    """Return the cosine transform of the spectrum in closed form."""
    A, Wc, Wr = SPECTRUM.A, SPECTRUM.Omega_c, SPECTRUM.Omega_r
    return A * Wc**2 * math.pi / (2 * (Wc**2 - Wr**2)) * (math.exp(-Wr * d) / Wr - math.exp(-Wc * d) / Wc)


def straight(length, *, slope=0.0, level=0.0, first=0.0):
    distance = np.linspace(first, first + length, 4)
    return TrackProfile(distance, level + slope * (distance - first))


def drive(track, speeds, h=H):
    """Return lateral offset and distance after each step."""
    y = np.empty(2)
    log = []
    track.start(0.0, h)
    track.exchange(np.array(speeds[:1]), y)
    for k, speed in enumerate(speeds):
        track.step(k * h, h, np.array([speed]), y)
        log.append(y.copy())
    return np.array(log).T


@st.composite
def profiles(draw, shape=None):
    """Draw points in whole millimetres along the track and micrometres across it."""
    shape = shape or draw(st.sampled_from(["spline", "monotone"]))
    # A spline through very uneven points swings by metres, and its rounding errors with it.
    gap = st.integers(1_000, 5_000) if shape == "spline" else st.integers(10, 50_000)
    gaps = draw(st.lists(gap, min_size=3, max_size=30))
    n = len(gaps) + 1
    offset = draw(st.lists(st.integers(-50_000, 50_000), min_size=n, max_size=n))
    first = draw(st.integers(-1_000_000, 1_000_000))
    return TrackProfile(1e-3 * (first + np.cumsum([0, *gaps])), 1e-6 * np.array(offset), shape=shape)


# --- synthesised track


def test_spectrum_of_a_long_track_is_the_wanted_one_in_every_octave():
    track = synthesise(SPECTRUM, 100e3, np.random.default_rng(20))
    dx = track.distance[1]
    n = round(2048.0 / dx)
    frequency, density = welch(track.offset, fs=1.0 / dx, nperseg=n, detrend=False)
    W, S = 2 * math.pi * frequency, density / (2 * math.pi)
    segments = 2 * (track.distance.size // n) - 1
    edges = [0.01 * 2**i for i in range(11)]  # 0.01 to 10.24 rad/m
    for low, high in pairwise(edges):
        band = (low <= W) & (high > W)
        # Relative standard error of the mean: Hann windows correlate half-overlapping segments (1.06)
        # and neighbouring bins (1.94). Five of them, and 1 % for the window's blur of a curved spectrum.
        bound = 5 * math.sqrt(1.06 * 1.94 / (segments * band.sum())) + 0.01
        assert np.mean(S[band] / SPECTRUM.density(W[band])) == pytest.approx(1.0, abs=bound)


def test_nothing_is_shorter_than_the_shortest_wavelength():
    track = synthesise(SPECTRUM, 20e3, np.random.default_rng(21))
    dx = track.distance[1]
    # A Blackman window keeps the long waves, ten orders above, out of the empty band.
    frequency, density = welch(track.offset, fs=1.0 / dx, nperseg=4096, window="blackman")
    last, empty = (frequency < 1.0 / SHORTEST_WAVELENGTH), (frequency > 1.01 / SHORTEST_WAVELENGTH)
    assert density[empty].max() < 1e-3 * density[last].min()


class Impulse:
    """A generator whose normal values are all zero but the one at `index`, which is one."""

    index = 0
    size = 1

    def standard_normal(self, shape):
        normal = np.zeros(shape)
        self.size = normal.size
        normal.flat[self.index] = 1.0
        return normal


def test_covariance_is_that_of_the_spectrum():
    # The track is linear in its independent normal values, so its covariance is the sum of the products
    # of the answers to each: exact, where an average over drawn tracks would scatter by per cents.
    distances = np.array([0.0, 5.0, 50.0, 120.0, 200.0])
    products = np.zeros((5, 5))
    rng = Impulse()
    while rng.index < rng.size:
        offset = synthesise(SPECTRUM, 200.0, rng).offset[np.round(distances / 0.125).astype(int)]
        products += np.outer(offset, offset)
        rng.index += 1
    expected = [[covariance(abs(a - b)) for a in distances] for b in distances]
    # What the finite period may cost: exp(-10).
    np.testing.assert_allclose(products, expected, rtol=0, atol=math.exp(-10) * SPECTRUM.variance)


def test_covariance_at_zero_is_the_variance_of_the_spectrum():
    assert covariance(0.0) == pytest.approx(SPECTRUM.variance, rel=1e-12)


def test_level_scales_the_track():
    low, high = (synthesise(ERRI_B176[n], 100.0, np.random.default_rng(3)) for n in ("erri_low", "erri_high"))
    ratio = math.sqrt(ERRI_B176["erri_high"].A / ERRI_B176["erri_low"].A)
    np.testing.assert_allclose(high.offset, ratio * low.offset, rtol=1e-12)


def test_a_seed_sets_the_track():
    a, b, c = (synthesise(SPECTRUM, 100.0, np.random.default_rng(seed)).offset for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.isclose(a, c).any()


@given(st.floats(1e-3, 500.0))
@settings(max_examples=30, deadline=None)
def test_track_covers_the_length_on_a_grid_of_a_quarter_of_the_shortest_wave(length):
    track = synthesise(SPECTRUM, length, np.random.default_rng(0))
    track.require(length)
    assert track.distance[0] == 0.0
    assert set(np.diff(track.distance)) == {SHORTEST_WAVELENGTH / 4}


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_a_length_that_is_none_is_refused(length):
    with pytest.raises(InputError, match=r"^track length: got .* m, expected a finite length > 0; use speed"):
        synthesise(SPECTRUM, length, np.random.default_rng(0))


# --- profile


@given(profiles())
@settings(deadline=None)
def test_profile_passes_through_its_points(profile):
    np.testing.assert_allclose(profile.offset_at(profile.distance), profile.offset, rtol=0, atol=1e-12)


@given(profiles(shape="monotone"), st.floats(0.0, 1.0))
@settings(deadline=None)
def test_monotone_profile_stays_between_neighbouring_points(profile, fraction):
    between = profile.distance[:-1] + fraction * np.diff(profile.distance)
    offset = profile.offset_at(between)
    assert (offset >= np.minimum(profile.offset[:-1], profile.offset[1:]) - 1e-12).all()
    assert (offset <= np.maximum(profile.offset[:-1], profile.offset[1:]) + 1e-12).all()


def test_a_spline_would_overshoot_a_measured_kink():
    distance, offset = np.arange(8.0), np.repeat([0.0, 0.01], 4)
    fine = np.linspace(0.0, 7.0, 141)
    assert TrackProfile(distance, offset).offset_at(fine).max() > 0.0105
    assert TrackProfile(distance, offset, shape="monotone").offset_at(fine).max() == pytest.approx(0.01)


def test_spline_error_falls_with_the_fourth_power_of_the_spacing():
    errors = []
    for n in (40, 80, 160):
        x = np.linspace(0.0, 10.0, n + 1)
        profile = TrackProfile(x, np.sin(x))
        fine = np.linspace(2.0, 8.0, 1001)
        errors.append(np.abs(profile.offset_at(fine) - np.sin(fine)).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 4.0, atol=0.1)


def test_profile_keeps_its_own_arrays_and_does_not_let_them_change():
    distance, offset = np.arange(4.0), np.zeros(4)
    profile = TrackProfile(distance, offset)
    offset[0] = 1.0
    assert profile.offset[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        profile.offset[0] = 1.0


@pytest.mark.parametrize(
    ("distance", "offset", "message"),
    [
        ([0, 1, 2], [0, 0, 0], f"track: got 3 distances and 3 offsets, {POINTS}"),
        ([0, 1, 2, 3], [0, 0, 0, 0, 0], f"track: got 4 distances and 5 offsets, {POINTS}"),
        ([0, 1, 2, 3], [0, 0, math.nan, 0], f"track: got a value that is not finite, {FINITE}"),
        ([0, 1, math.inf, 3], [0, 0, 0, 0], f"track: got a value that is not finite, {FINITE}"),
        ([0, 1, 1, 2], [0, 0, 0, 0], f"track, point 3: got a distance of 1 m after 1 m, {INCREASING}"),
    ],
)
def test_faulty_points_are_refused(distance, offset, message):
    with pytest.raises(InputError) as caught:
        TrackProfile(np.array(distance), np.array(offset))
    assert str(caught.value) == message


@pytest.mark.parametrize("x", [9.999, 40.001, math.nan])
def test_offset_off_the_track_is_refused(x):
    with pytest.raises(InputError) as caught:
        straight(30.0, first=10.0).offset_at([20.0, x])
    assert str(caught.value) == f"track: got a distance of {x:g} m, expected 10 to 40 m; stay on the track"


def test_require_tells_before_a_run_whether_the_track_is_long_enough():
    profile = straight(30.0, first=10.0)
    assert profile.length == 30.0
    profile.require(math.nextafter(30.0, 31.0))
    with pytest.raises(InputError) as caught:
        profile.require(30.001)
    assert str(caught.value) == (
        "track: got 30 m of track, expected at least the 30.001 m of the run;"
        " shorten the run, lower the speed or give a longer track"
    )


# --- measured track

ROWS = "0,0.001\n2.5,-0.002\n5,0.003\n10,0\n"


@pytest.mark.parametrize(
    "text",
    [
        ROWS,
        "distance,offset\n" + ROWS,
        "\ufeff" + ROWS,
        ROWS.replace("\n", "\r\n"),
        "\n" + ROWS.replace(",", " , ").replace("\n", "\n\n"),
    ],
    ids=["plain", "header", "byte-order mark", "windows", "blank lines"],
)
def test_measured_track_is_read(tmp_path, text):
    file = tmp_path / "line 7.csv"
    file.write_bytes(text.encode())
    profile = read_track_csv(file)
    np.testing.assert_array_equal(profile.distance, [0.0, 2.5, 5.0, 10.0])
    np.testing.assert_array_equal(profile.offset, [0.001, -0.002, 0.003, 0.0])
    assert profile.shape == "monotone"
    assert profile.name == "line 7.csv"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n0;0\n1;0\n", f", line 2: got one column, {TWO_COLUMNS}"),
        ("0,0\n\n1,0,5\n", f", line 3: got 3 columns, {TWO_COLUMNS}"),
        ("x,y\n0,0\n1,o\n", f", line 3: got 'o', {NUMBER}"),
        ("0,0\nx,y\n", f", line 2: got 'x', {NUMBER}"),
        ("0,zero\n1,0\n", f", line 1: got 'zero', {NUMBER}"),
        ("0,0\n1,nan\n", f", line 2: got 'nan', {NUMBER}"),
        ("0,0\n1,\n", f", line 2: got '', {NUMBER}"),
        ("0,0\n5,0\n4.5,0\n", f", line 3: got a distance of 4.5 m after 5 m, {INCREASING}"),
        ("0,0\n5,0\n5,0.1\n", f", line 3: got a distance of 5 m after 5 m, {INCREASING}"),
        ("0,0\n1,0\n2,0\n", f": got 3 distances and 3 offsets, {POINTS}"),
        ("x,y\n", f": got 0 distances and 0 offsets, {POINTS}"),
        ("", f": got 0 distances and 0 offsets, {POINTS}"),
    ],
)
def test_faulty_track_files_are_refused(tmp_path, text, message):
    file = tmp_path / "track.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_track_csv(file)
    assert str(caught.value) == "track.csv" + message


def test_missing_and_unreadable_track_files_are_refused(tmp_path):
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"0,0\n\xff\xfe,\n")
    remedy = "expected a readable CSV file in UTF-8; check the path and the format of the file"
    for file, got in [
        (tmp_path / "none.csv", "No such file or directory"),
        (binary, "bytes that are not text"),
    ]:
        with pytest.raises(InputError) as caught:
            read_track_csv(file)
        assert str(caught.value) == f"{file.name}: got {got}, {remedy}"


def test_too_short_a_measured_track_is_named(tmp_path):
    (tmp_path / "short.csv").write_text(ROWS, encoding="utf-8")
    with pytest.raises(InputError, match=r"^short\.csv: got 10 m of track, expected at least the 20 m"):
        read_track_csv(tmp_path / "short.csv").require(20.0)


# --- component


def test_ports():
    track = TrackInput(straight(1.0), speed=20.0)
    assert [(p.name, p.unit, p.start) for p in track.inputs] == [("speed", "m/s", 20.0)]
    assert [(p.name, p.unit) for p in track.outputs] == [("lateral_offset", "m"), ("distance", "m")]
    assert TrackInput(straight(1.0)).inputs[0].start is None


def test_distance_does_not_drift_at_constant_speed():
    v, n = 27.3, 1_000_000
    track, u, y = TrackInput(straight(30e3)), np.array([v]), np.empty(2)
    track.start(0.0, H)
    naive = 0.0
    for k in range(n):
        track.step(k * H, H, u, y)
        naive += v * H
    exact = float(Fraction(v) * Fraction(H) * n)
    # The product v h is rounded once, the sum once more; a plain sum is four hundred times worse.
    assert abs(y[1] - exact) <= 2 * math.ulp(exact)
    assert abs(naive - exact) > 100 * math.ulp(exact)


@given(st.lists(st.floats(-50.0, 100.0), min_size=1, max_size=200))
@settings(deadline=None)
def test_distance_is_the_sum_of_the_held_speeds(speeds):
    _, distance = drive(TrackInput(straight(1e3)), speeds)
    steps = [v * H for v in speeds]
    assert distance[-1] == pytest.approx(math.fsum(steps), rel=0, abs=4e-16 * math.fsum(map(abs, steps)))


@given(profiles(), st.lists(st.floats(-1.0, 1.5), min_size=1, max_size=30))
@settings(deadline=None)
def test_offset_is_the_profile_counted_from_its_first_point(profile, moves):
    # Moves of up to two tenths of the track, also backward, pass many points in one step.
    speeds = 0.1 * profile.length * np.array(moves)
    assume(np.cumsum(speeds).max() < profile.length)
    offset, distance = drive(TrackInput(profile, ramp=0.0), speeds, h=1.0)
    x = profile.distance[0] + np.maximum(distance, 0.0)
    np.testing.assert_allclose(offset, profile.offset_at(x) - profile.offset[0], rtol=0, atol=1e-11)


def test_offset_is_faded_in_without_a_jump():
    m, ramp = 1e-3, 4.0
    track = TrackInput(straight(30.0, slope=m, level=0.02), ramp=ramp)
    offset, distance = drive(track, np.ones(200), h=0.125)
    weight = offset / (m * distance)
    inside = distance < ramp
    np.testing.assert_allclose(weight[~inside], 1.0, rtol=1e-12)
    np.testing.assert_allclose(weight[inside] + weight[inside][::-1], 1.0, rtol=1e-12)
    assert (np.diff(weight[inside]) > 0.0).all()
    # It starts with the third power of the distance, so the offset with the fourth.
    offset, _ = drive(track, np.ones(2), h=1e-4)
    assert offset[1] / offset[0] == pytest.approx(16.0, rel=1e-3)


@given(st.floats(-10.0, 10.0))
@settings(deadline=None, max_examples=20)
def test_a_constant_offset_is_no_offset(level):
    offset, _ = drive(TrackInput(straight(10.0, level=level)), np.full(50, 10.0), 1e-2)
    np.testing.assert_allclose(offset, 0.0, rtol=0, atol=1e-14)


def test_track_behind_the_start_is_straight():
    track = TrackInput(straight(10.0, slope=1e-2), ramp=0.0)
    offset, distance = drive(track, [-1.0, -1.0, 1.0, 1.0, 1.0], h=1.0)
    np.testing.assert_array_equal(distance, [-1.0, -2.0, -1.0, 0.0, 1.0])
    np.testing.assert_allclose(offset, [0.0, 0.0, 0.0, 0.0, 0.01])


@given(st.floats(0.0, 20.0), st.floats(0.0, 20.0))
def test_a_wheelset_behind_meets_the_track_of_the_one_in_front_later(behind, ramp):
    track = TrackProfile(np.arange(0.0, 60.0), 1e-3 * np.random.default_rng(5).standard_normal(60))
    speeds = np.full(250, 20.0)
    offset, distance = drive(TrackInput(track, ramp=ramp, behind=behind), speeds, h=0.01)
    s = 0.2 * np.arange(1, 251) - behind
    np.testing.assert_allclose(distance, s, rtol=0, atol=1e-13)
    met = np.maximum(s, 0.0)
    z = np.minimum(met / max(ramp, 1e-300), 1.0)
    fade = z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
    expected = np.where(s > 0.0, fade * (track.offset_at(met) - track.offset[0]), 0.0)
    np.testing.assert_allclose(offset, expected, rtol=0, atol=1e-14)


def test_a_wheelset_behind_starts_there():
    y = np.empty(2)
    track = TrackInput(straight(10.0, slope=1.0), behind=2.5)
    track.start(0.0, H)
    track.exchange(np.array([20.0]), y)
    np.testing.assert_array_equal(y, [0.0, -2.5])


@pytest.mark.parametrize("behind", [-1.0, math.nan, math.inf])
def test_a_faulty_distance_behind_is_refused(behind):
    with pytest.raises(InputError, match="track behind"):
        TrackInput(straight(10.0), behind=behind)


def test_start_and_exchange_return_to_the_first_point():
    profile = synthesise(SPECTRUM, 100.0, np.random.default_rng(5))
    track = TrackInput(profile)
    first = drive(track, np.full(200, 20.0), 1e-2)
    y = np.full(2, np.nan)
    track.start(0.0, 1e-2)
    for _ in range(3):
        track.exchange(np.array([20.0]), y)
        np.testing.assert_array_equal(y, 0.0)
    np.testing.assert_array_equal(drive(track, np.full(200, 20.0), 1e-2), first)


def test_a_run_may_end_on_the_last_point_and_not_behind_it():
    # Three steps of 0.1 m make 0.30000000000000004 m.
    track = TrackInput(straight(0.3, slope=1e-3), ramp=0.0)
    offset, _ = drive(track, np.full(3, 0.1), h=1.0)
    assert offset[-1] == pytest.approx(3e-4)
    with pytest.raises(ValueError, match="track") as caught:
        drive(track, np.full(4, 0.1), h=1.0)
    assert str(caught.value) == (
        "track: got a distance of 0.4 m, expected at most 0.3 m;"
        " shorten the run, lower the speed or give a longer track"
    )


def test_a_speed_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="got a distance of nan m"):
        drive(TrackInput(straight(3.0)), [math.nan])


@pytest.mark.parametrize("ramp", [-1.0, math.nan, math.inf])
def test_a_faulty_ramp_is_refused(ramp):
    with pytest.raises(InputError, match=r"^track ramp: got .* m, expected a finite length >= 0; 5 m suits"):
        TrackInput(straight(3.0), ramp=ramp)
