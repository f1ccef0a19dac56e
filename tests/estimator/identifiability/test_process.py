from __future__ import annotations

import math
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy import integrate

from estimator import ERRI_B176, CreepCurve, OperatingPoint, wheelset_model
from estimator.identifiability import (
    SENSORS,
    Family,
    Process,
    Sensor,
    creep_amplitude,
    differentiate,
    driven_by_track,
    observe,
    slope_family,
    spectrum,
    stack,
    steady_covariance,
    wheelset_process,
)
from estimator.identifiability.spectra import frequency_grid, spectrum_with_slopes
from estimator.linear_models import full_model, point_at

if TYPE_CHECKING:
    from fmu_wheelset.parameters import WheelsetParameters

TRACK = ERRI_B176["erri_low"]
SLOW = tuple(Sensor(s.output, s.noise / 5**0.5) for group in SENSORS.values() for s in group)
BOTH = ("yaw_rate", "lateral_acceleration")


def lag(a: float = 3.0, gain: float = 2.0) -> control.StateSpace:
    return control.ss([[-a]], [[gain]], [[1.0]], [[0.0]], outputs=["z"])


def test_spectrum_is_that_of_the_track_through_the_wheelset(
    dry_points: tuple[OperatingPoint, ...], wheelset: WheelsetParameters
) -> None:
    # The definition: the density of the track over the path, at the path frequency w/v, and python-control's
    # response of the model. The one-sided S(W) dW is the two-sided density pi S(w/v)/v over dw/(2 pi).
    point, omega = dry_points[1], np.geomspace(0.5, 200.0, 9)
    process = wheelset_process(point, TRACK, prescribed=True)
    response = wheelset_model(point, wheelset)(1j * omega)[:, 0, :].T
    density = math.pi * TRACK.density(omega / point.v) / point.v
    expected = response[:, :, None] * np.conj(response[:, None, :]) * density[:, None, None] / process.h
    assert spectrum(process, omega) - process.R == pytest.approx(expected, rel=1e-4)


def test_variance_is_the_integral_of_the_spectrum(family: Family) -> None:
    process = family.process
    omega, weights = frequency_grid(process)
    S = np.diagonal(spectrum(process, omega), axis1=-2, axis2=-1).real
    found = process.h / math.pi * np.sum(S * weights[..., None], axis=-2)
    for i in range(3):
        P = steady_covariance(process[i])
        expected = np.diag(process.H[i] @ P @ process.H[i].T + process.R)
        assert found[i] == pytest.approx(expected, rel=1e-6)


def test_slopes_of_the_spectrum_are_its_differences(
    family: Family, dry_points: tuple[OperatingPoint, ...]
) -> None:
    omega = np.geomspace(0.3, 600.0, 12)
    _, dS = spectrum_with_slopes(family[1], omega)
    point, step = dry_points[1], 1e3
    ahead, behind = (
        OperatingPoint("moved", point.creep, point.force, point.g11 + d, point.g22, point.v)
        for d in (step, -step)
    )
    S = [spectrum(wheelset_process(p, TRACK, sensors=SLOW, h=5e-3), omega) for p in (ahead, behind)]
    difference = (S[0] - S[1]) / (2.0 * step)
    assert np.abs(dS[0] - difference).max(axis=0) == pytest.approx(0.0, abs=1e-5 * np.abs(dS[0]).max())


def test_low_pass_takes_its_share_of_the_spectrum() -> None:
    omega, h = np.geomspace(0.1, 20.0, 7), 1e-3
    plain, filtered = (
        spectrum(observe(lag(), [Sensor("z", 1e-9, bandwidth=b)], h), omega)[:, 0, 0].real
        for b in (None, 2.0)
    )
    assert filtered / plain == pytest.approx(1.0 / (1.0 + (omega / (4.0 * math.pi)) ** 2), rel=1e-3)


def test_white_noise_may_reach_a_sensor_with_low_pass_only() -> None:
    white = control.ss([[-1.0]], [[1.0]], [[1.0]], [[1.0]], outputs=["z"])
    with pytest.raises(ValueError, match=r"^sensor of z: got white noise in what it samples"):
        observe(white, [Sensor("z", 0.1)], 1e-3)
    process = observe(white, [Sensor("z", 0.1, bandwidth=5.0)], 1e-3)
    assert process.F.shape == (2, 2)


def test_creep_amplitude_by_quadrature(
    dry_points: tuple[OperatingPoint, ...], wheelset: WheelsetParameters
) -> None:
    point = dry_points[1]
    model = full_model(point, wheelset)
    rows = [list(model.output_labels).index(n) for n in ("yaw_rate", "lateral_displacement", "omega_L")]
    weights = np.array([wheelset.L_g, wheelset.gamma * point.v / wheelset.r0, wheelset.r0]) / point.v

    def density(w: float) -> float:
        response = weights @ model(1j * w)[rows, 0] - weights[1]  # y - y_t
        return float(abs(response) ** 2 * TRACK.density(w / point.v) / point.v)

    variance, _ = integrate.quad(density, 0.0, 2e3, limit=400, points=[0.4, 16.0, 80.0])
    assert creep_amplitude(point, TRACK) == pytest.approx(math.sqrt(variance), rel=1e-5)


def test_creep_amplitude_on_low_rail_is_as_large_as_the_working_creep(low: CreepCurve) -> None:
    amplitudes = [creep_amplitude(point_at(low, "P", low.creep_at(mu)), TRACK) for mu in (0.024, 0.05)]
    assert amplitudes[0] == pytest.approx(1.5e-4, rel=0.1)  # as measured in trials
    assert amplitudes[1] > 0.5 * low.creep_at(0.05)
    beyond = OperatingPoint("P3", 0.0, 0.0, -1e4, 1e6, 20.0)
    assert creep_amplitude(beyond, TRACK) == math.inf


def test_steady_where_modes_decay(points: dict[str, OperatingPoint]) -> None:
    for name, steady in (("P1", True), ("P2", False), ("P3", False)):
        assert bool(wheelset_process(points[name], TRACK).steady()) is steady


def test_batches_hold_what_single_ones_do(family: Family, dry_points: tuple[OperatingPoint, ...]) -> None:
    for i, point in enumerate(dry_points):
        alone = wheelset_process(point, TRACK, sensors=SLOW, h=5e-3)
        assert np.array_equal(family.process[i].Q, alone.Q)
        assert np.array_equal(family[i].process.F, alone.F)
    assert family.select(BOTH).process.outputs == BOTH
    assert family.select(BOTH).dH.shape == (2, 3, 2, 9)


# Mistakes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, -1.0, math.nan, math.inf])
def test_a_sensor_has_noise(noise: float) -> None:
    with pytest.raises(ValueError, match=r"^sensor of z: got a noise of .*, expected a finite value > 0;"):
        Sensor("z", noise)


def test_a_bandwidth_is_positive() -> None:
    with pytest.raises(ValueError, match="got a bandwidth of 0 Hz"):
        Sensor("z", 1.0, bandwidth=0.0)


def test_unknown_sensors_are_told(family: Family) -> None:
    with pytest.raises(ValueError, match="got x, expected some of z;"):
        observe(lag(), [Sensor("x", 1.0)], 1e-3)
    with pytest.raises(ValueError, match="got none, expected"):
        observe(lag(), [], 1e-3)
    with pytest.raises(ValueError, match="got x, expected some of yaw_rate"):
        family.select(["yaw_rate", "x"])


def test_a_sample_time_is_positive() -> None:
    with pytest.raises(ValueError, match=r"^sample time: got 0 s"):
        observe(lag(), [Sensor("z", 1.0)], 0.0)


def test_a_batch_is_of_one_kind() -> None:
    with pytest.raises(ValueError, match=r"^batch: got processes of other sensors"):
        stack([observe(lag(), [Sensor("z", noise)], 1e-3) for noise in (1.0, 2.0)])


@pytest.mark.parametrize("scale", [(1.0,), (1.0, 0.0), (1.0, math.nan)])
def test_scales_belong_to_parameters(scale: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"^scale: got .*, expected a value > 0 for each of a, gain;"):
        differentiate(lambda d: lag(3.0 + d[0], 2.0 + d[1]), ("a", "gain"), scale, [Sensor("z", 1.0)], 0.1)


def test_a_track_needs_its_input(points: dict[str, OperatingPoint], wheelset: WheelsetParameters) -> None:
    with pytest.raises(ValueError, match="got no input offset, expected one of y_t;"):
        driven_by_track(wheelset_model(points["P1"], wheelset), TRACK, 20.0, input_name="offset")


def test_prescribed_creep_has_no_wheel_speeds(points: dict[str, OperatingPoint]) -> None:
    with pytest.raises(ValueError, match="got omega_L"):
        slope_family([points["P1"]], TRACK, 1e7, sensors=[Sensor("omega_L", 1.0)], prescribed=True)


def test_process_of_white_noise_alone_is_flat() -> None:
    one = np.ones((1, 1))
    process = Process(0.0 * one, 0.0 * one, one, 4.0 * one, 1.0, ("z",))
    assert spectrum(process, np.array([0.1, 3.0]))[:, 0, 0] == pytest.approx([4.0, 4.0])


def test_narrow_resonances_near_the_peak_are_integrated(low: CreepCurve) -> None:
    # At 0.995 of the creep of the peak the yaw mode is hardly damped: its line is far below a rad/s wide.
    fast = CreepCurve(low.condition, v=80.0)
    process = wheelset_process(point_at(fast, "P", 0.995 * fast.peak_creep), TRACK)
    poles = process.poles()
    assert np.min(np.abs(poles.real[poles.imag > 1.0])) < 0.1
    omega, weights = frequency_grid(process)
    S = np.diagonal(spectrum(process, omega), axis1=-2, axis2=-1).real
    P = steady_covariance(process)
    expected = np.diag(process.H @ P @ process.H.T + process.R)
    assert process.h / math.pi * np.sum(S * weights[:, None], axis=0) == pytest.approx(expected, rel=1e-6)
