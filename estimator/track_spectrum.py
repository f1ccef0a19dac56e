"""The lateral alignment of a track as a power spectral density over the path.

ERRI B176 describes the alignment by ``S(W) = A Wc^2 / ((W^2 + Wr^2)(W^2 + Wc^2))``, one-sided in the
path frequency ``W`` (rad/m), so that the variance of the offset is the integral of S over W > 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

__all__ = ["ERRI_B176", "TrackSpectrum"]


@dataclass(frozen=True, slots=True)
class TrackSpectrum:
    """Spectrum of the lateral alignment.

    Parameters
    ----------
    A : level, rad m.
    Omega_c, Omega_r : upper and lower corner path frequency, rad/m.
    """

    A: float
    Omega_c: float = 0.8246
    Omega_r: float = 0.0206

    def __post_init__(self) -> None:
        for name in ("A", "Omega_c", "Omega_r"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: got {value!r}, expected a finite value > 0; see ERRI_B176")

    def density(self, Omega: ArrayLike) -> NDArray[np.float64]:
        """Return the one-sided density S (m^3/rad) at the path frequencies `Omega` (rad/m)."""
        W2 = np.square(np.asarray(Omega, dtype=np.float64))
        return np.asarray(self.A * self.Omega_c**2 / ((W2 + self.Omega_r**2) * (W2 + self.Omega_c**2)))

    @property
    def variance(self) -> float:
        """Variance of the offset, m^2: the integral of `density` over all path frequencies."""
        Wc, Wr = self.Omega_c, self.Omega_r
        return self.A * Wc * math.pi / (2.0 * Wr * (Wr + Wc))

    def rate_intensity(self, v: float) -> float:
        """Return the white-noise intensity (m^2/s) that stands for the offset's rate at speed `v` (m/s).

        Between the corners ``Wr v`` and ``Wc v``, where the wheelset responds, the two-sided density of
        the rate is flat at ``pi A v``.
        """
        return math.pi * self.A * v

    def shaping_gain(self, v: float) -> float:
        """Return the gain (m/s^1.5) of the shaping filter at speed `v` (m/s).

        White noise of unit two-sided intensity times ``gain/((s + Wr v)(s + Wc v))`` has this spectrum.
        """
        return math.sqrt(math.pi * self.A * v**3) * self.Omega_c

    def rate_variance(self, v: float) -> float:
        """Return the variance (m^2/s^2) of the offset's rate at speed `v` (m/s)."""
        return math.pi * self.A * (v * self.Omega_c) ** 2 / (2.0 * (self.Omega_c + self.Omega_r))


#: Reference spectra of ERRI B176 by class.
ERRI_B176: Mapping[str, TrackSpectrum] = MappingProxyType(
    {"erri_low": TrackSpectrum(A=2.119e-7), "erri_high": TrackSpectrum(A=6.125e-7)}
)
