from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov

from estimator.track_spectrum import ERRI_B176, TrackSpectrum

spectra = st.builds(TrackSpectrum, st.floats(1e-8, 1e-5), st.floats(0.3, 3.0), st.floats(0.005, 0.2))


@given(spectra)
def test_variance_is_the_integral_of_the_density(track: TrackSpectrum) -> None:
    # Over the logarithm of the path frequency the integrand is a smooth bump.
    integral, _ = quad(
        lambda log: float(track.density(math.exp(log))) * math.exp(log), -25.0, 15.0, epsabs=0.0, limit=500
    )
    assert track.variance == pytest.approx(integral, rel=1e-7)


@pytest.mark.parametrize("track", ERRI_B176.values(), ids=ERRI_B176.keys())
@pytest.mark.parametrize("v", [5.0, 60.0])
def test_variance_is_that_of_the_shaping_filter_at_any_speed(track: TrackSpectrum, v: float) -> None:
    # sqrt(pi A v^3) Wc / ((s + Wr v)(s + Wc v)) on white noise of unit two-sided intensity
    A = np.array([[-track.Omega_r * v, 1.0], [0.0, -track.Omega_c * v]])
    b = np.array([[0.0], [math.sqrt(math.pi * track.A * v**3) * track.Omega_c]])
    P = solve_continuous_lyapunov(A, -b @ b.T)
    assert P[0, 0] == pytest.approx(track.variance, rel=1e-12)


@pytest.mark.parametrize("v", [10.0, 50.0])
def test_rate_intensity_is_the_plateau_between_the_corners(v: float) -> None:
    wide = TrackSpectrum(A=3e-7, Omega_c=1e4, Omega_r=1e-4)
    Omega = np.geomspace(0.1, 10.0, 5)
    # Two-sided density over omega = Omega v: half of S(Omega)/v each side, times 2 pi; a rate has omega^2.
    rate = (Omega * v) ** 2 * math.pi * wide.density(Omega) / v
    assert rate == pytest.approx(np.full(5, wide.rate_intensity(v)), rel=1.1e-6)


def test_rate_intensity_is_never_below_the_density() -> None:
    track, v = ERRI_B176["erri_low"], 20.0
    Omega = np.geomspace(1e-4, 1e3, 500)
    rate = math.pi * v * Omega**2 * track.density(Omega)
    assert np.all(rate < track.rate_intensity(v))
    assert rate.max() == pytest.approx(
        track.rate_intensity(v) / (1 + track.Omega_r / track.Omega_c) ** 2, rel=1e-4
    )


def test_reference_spectra_differ_in_level_only() -> None:
    low, high = ERRI_B176["erri_low"], ERRI_B176["erri_high"]
    assert high.variance / low.variance == pytest.approx(6.125 / 2.119, rel=1e-14)
    assert 1e-3 < math.sqrt(low.variance) < math.sqrt(high.variance) < 1e-2


@pytest.mark.parametrize("name", ["A", "Omega_c", "Omega_r"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_refuses_what_is_no_spectrum(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: got .* expected a finite value > 0"):
        TrackSpectrum(**{"A": 1e-7, name: value})
