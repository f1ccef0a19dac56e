from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, linalg

from estimator.coloured import UNITS, Disturbances, SensorBias, coloured_filter, coloured_model
from estimator.linear_models import filter_model, wheelset_model
from estimator.sensor_noise import SensorNoise
from estimator.track_spectrum import ERRI_B176, TrackSpectrum

if TYPE_CHECKING:
    from estimator.linear_models import OperatingPoint
    from fmu_wheelset.parameters import WheelsetParameters

LOW = ERRI_B176["erri_low"]
BIAS = SensorBias(2e-3, 0.1, time=50.0)
spectra = st.builds(TrackSpectrum, st.floats(1e-8, 1e-5), st.floats(0.3, 3.0), st.floats(0.005, 0.1))
speeds = st.floats(0.5, 100.0)


# The track -------------------------------------------------------------------------------------------


@given(spectra, speeds, st.floats(1e-3, 10.0))
def test_shaping_filter_has_the_spectrum(track: TrackSpectrum, v: float, wave: float) -> None:
    # Two-sided over the angular frequency W v, with the 2 pi of its inverse transform.
    s = 1j * wave * v
    gain = track.shaping_gain(v) / ((s + track.Omega_r * v) * (s + track.Omega_c * v))
    assert abs(gain) ** 2 == pytest.approx(math.pi / v * track.density(wave), rel=1e-12)


@given(spectra, speeds)
def test_variance_of_the_rate_is_the_integral_of_its_density(track: TrackSpectrum, v: float) -> None:
    top = 1e4 * track.Omega_c
    edges = np.geomspace(1e-4 * track.Omega_r, top, 12)
    total = sum(
        integrate.quad(lambda W: (W * v) ** 2 * float(track.density(W)), a, b)[0] for a, b in pairwise(edges)
    )
    tail = v**2 * track.A * track.Omega_c**2 / top
    assert track.rate_variance(v) == pytest.approx(total + tail, rel=1e-6)


@given(spectra, speeds)
def test_stationary_track_states_have_the_variances_of_the_spectrum(track: TrackSpectrum, v: float) -> None:
    from estimator.linear_models import OperatingPoint as Point
    from fmu_wheelset.parameters import WheelsetParameters as Wheelset

    model = coloured_model(Point("P", 1e-3, 1e4, 1e7, 1e7, v), Wheelset(), track)
    A, B = np.asarray(model.A)[4:, 4:], np.asarray(model.B)[4:, :1]
    X = linalg.solve_continuous_lyapunov(A, -B @ B.T)
    assert X[0, 0] == pytest.approx(track.variance, rel=1e-9)
    assert X[1, 1] == pytest.approx(track.rate_variance(v), rel=1e-9)


# The model -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
@pytest.mark.parametrize("frequency", [0.3, 2.0, 13.0, 60.0])
def test_from_the_noise_to_the_sensors_is_track_after_wheelset(
    name: str, frequency: float, points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    point = points[name]
    s = 2j * math.pi * frequency
    track = LOW.shaping_gain(point.v) / ((s + LOW.Omega_r * point.v) * (s + LOW.Omega_c * point.v))
    expected = wheelset_model(point, wheelset)(s)[:, 0] * track
    found = coloured_model(point, wheelset, LOW)(s)[:, 0]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12 * np.abs(expected).max())


def test_springs_to_the_ground_see_the_offset_itself(
    points: dict[str, OperatingPoint], davis_wheelset: WheelsetParameters
) -> None:
    s = 2j * math.pi * 3.0
    point = points["P1"]
    track = LOW.shaping_gain(point.v) / ((s + LOW.Omega_r * point.v) * (s + LOW.Omega_c * point.v))
    expected = wheelset_model(point, davis_wheelset)(s)[:, 0] * track
    assert coloured_model(point, davis_wheelset, LOW)(s)[:, 0] == pytest.approx(expected, rel=1e-9)


def test_unmodelled_accelerations_enter_as_in_13(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    s = 2j * math.pi * 5.0
    white = filter_model(points["P1"], wheelset)(s)
    assert coloured_model(points["P1"], wheelset, LOW)(s)[:, 1:3] == pytest.approx(white[:, 1:], rel=1e-9)


@pytest.mark.parametrize("bias", [None, BIAS])
def test_signals_are_named_and_have_units(
    bias: SensorBias | None, points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    model = coloured_model(points["P1"], wheelset, LOW, bias=bias)
    names = [*model.state_labels, *model.input_labels, *model.output_labels]
    assert len(set(names)) == len(names) == (11 if bias is None else 15)
    assert set(names) <= set(UNITS)
    assert model.output_labels == ["yaw_rate", "lateral_acceleration"]


def test_each_bias_reaches_its_own_sensor_and_has_its_rms(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    model = coloured_model(points["P1"], wheelset, LOW, bias=BIAS)
    A, B, C = (np.asarray(M) for M in (model.A, model.B, model.C))
    assert np.array_equal(C[:, 6:], np.eye(2))
    X = linalg.solve_continuous_lyapunov(A[6:, 6:], -B[6:] @ B[6:].T)
    assert pytest.approx(np.diag(np.square([2e-3, 0.1])), rel=1e-12) == X
    assert not A[:6, 6:].any()
    assert not A[6:, :6].any()


# The filter ------------------------------------------------------------------------------------------


def test_steady_where_there_is_a_steady_state(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    trusting = {n: coloured_filter(p, wheelset, Disturbances(LOW), 1e-3) for n, p in points.items()}
    assert [f.P is not None for f in trusting.values()] == [True, False, True]
    assert trusting["P2"].states == ("psi", "y_dot", "psi_dot")
    assert trusting["P2"].dropped == ("y_rel", "y_t", "y_t_dot")
    careful = coloured_filter(points["P2"], wheelset, Disturbances(LOW, acceleration=1e-4), 1e-3)
    assert careful.P is not None


@pytest.mark.parametrize("name", ["P1", "P3"])
@pytest.mark.parametrize("bias", [None, BIAS])
def test_steady_covariance_stands_still(
    name: str, bias: SensorBias | None, points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    f = coloured_filter(points[name], wheelset, Disturbances(LOW, bias=bias), 1e-3)
    P = f.P
    assert P is not None
    S = f.H @ P @ f.H.T + f.R
    K = np.linalg.solve(S, f.H @ P).T
    I_KH = np.eye(len(P)) - K @ f.H
    moved = f.F @ (I_KH @ P @ I_KH.T + K @ f.R @ K.T) @ f.F.T + f.Q
    scale = np.sqrt(np.diag(P))
    assert moved / np.outer(scale, scale) == pytest.approx(P / np.outer(scale, scale), abs=1e-7)


def test_start_has_the_variances_of_track_and_biases(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters
) -> None:
    f = coloured_filter(points["P1"], wheelset, Disturbances(LOW, bias=BIAS), 1e-3, name="with bias")
    start = dict(zip(f.states, f.start, strict=True))
    assert f.name == "with bias"
    assert start["y_t"] == pytest.approx(LOW.variance)
    assert start["y_t_dot"] == pytest.approx(LOW.rate_variance(20.0))
    assert start["bias_lateral_acceleration"] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SensorNoise(yaw_rate=0.0), r"^sensor noise: got yaw_rate = 0.0, expected a finite rms > 0"),
        (lambda: SensorNoise(lateral_acceleration=math.nan), r"lateral_acceleration = nan, expected"),
        (lambda: SensorBias(1e-3, -1.0), r"^sensor bias: got lateral_acceleration = -1.0, expected"),
        (lambda: SensorBias(1e-3, 0.1, time=math.inf), r"^sensor bias: got time = inf, expected"),
        (lambda: Disturbances(LOW, acceleration=-1.0), r"^disturbances: got acceleration = -1.0 and"),
        (lambda: Disturbances(LOW, lever=0.0), r"lever = 0.0, expected finite values >= 0 and > 0"),
    ],
)
def test_faulty_disturbances_are_refused(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]
