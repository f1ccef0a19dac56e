"""Fisher information and Cramer-Rao bounds of the parameters of a Gaussian process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.identifiability.spectra import frequency_grid, integral_rate, spectrum_with_slopes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.identifiability.process import Family

__all__ = ["Bound", "bound_of", "cramer_rao", "fisher_rate"]

Array = NDArray[np.float64]

#: Information of one direction relative to the best one, and per window in units of the scales, below which
#: the direction counts as unknowable: far above rounding, far below what a window of hours would add up.
_RELATIVE, _ABSOLUTE = 1e-12, 1e-12
#: Part of a direction that lies among the unknowable ones, from which on it is unknowable: squared sine.
_LOST = 1e-9


@dataclass(frozen=True, eq=False)
class Bound:
    """What no unbiased estimate can beat.

    Parameters
    ----------
    names : of the parameters. std : (..., p) least standard deviations, infinite where nothing is known.
    covariance : (..., p, p) least covariance within the knowable directions.
    unknown : (..., p, p) orthogonal projector, in units of the scales, onto the directions that cannot be
        known; zero where all can.
    """

    names: tuple[str, ...]
    std: Array
    covariance: Array
    unknown: Array

    @property
    def knowable(self) -> NDArray[np.bool_]:
        """Where (...) every direction of the parameters can be known."""
        return np.asarray(np.all(np.isfinite(self.std), axis=-1))


def fisher_rate(family: Family) -> Array:
    """Return the Fisher information rate (..., p, p) per second of a long window (Whittle 1953).

    ``(1/4 pi)`` times the integral of ``tr(S^-1 dS_i S^-1 dS_j)`` over ``|w| < pi/h``. NaN where the process
    has no steady state: ask `fisher_window` there.
    """
    omega, weights = frequency_grid(family.process)
    S, dS = spectrum_with_slopes(family, omega)
    X = np.linalg.solve(S, dS)
    p = X.shape[0]
    rate = np.empty((*family.process.batch, p, p))
    for i in range(p):
        for j in range(i + 1):
            trace = np.sum(X[i] * np.swapaxes(X[j], -1, -2), axis=(-1, -2)).real
            rate[..., i, j] = rate[..., j, i] = integral_rate(trace, weights)
    rate[~family.process.steady()] = np.nan
    return rate


def cramer_rao(information: Array, names: Sequence[str], scale: Array) -> Bound:
    """Return the Cramer-Rao bound that belongs to Fisher information; NaN where that is.

    Parameters
    ----------
    information : (..., p, p) of the window. names, scale : (p,) or (..., p) as in `Family`; they make the
        directions comparable, so that what counts as knowing nothing does not hang on units.
    """
    unit = np.asarray(scale, dtype=np.float64)
    scaled = information * unit[..., :, None] * unit[..., None, :]
    missing = np.isnan(scaled).any(axis=(-1, -2), keepdims=True)
    values, vectors = np.linalg.eigh(np.where(missing, 0.0, scaled))
    known = values > np.maximum(_RELATIVE * values[..., -1:], _ABSOLUTE)
    inverse = np.where(known, 1.0 / np.where(known, values, 1.0), 0.0)
    covariance = (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    unknown = (vectors * ~known[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    covariance, unknown = (np.where(missing, np.nan, M) for M in (covariance, unknown))
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    lost = np.diagonal(unknown, axis1=-2, axis2=-1) > _LOST
    std = np.where(lost, np.inf, np.sqrt(np.maximum(variance, 0.0)))
    return Bound(tuple(names), std * unit, covariance * unit[..., :, None] * unit[..., None, :], unknown)


def bound_of(information: Array, gradient: Array, scale: Array) -> Array:
    """Return the least standard deviation (...) of a function of the parameters.

    `gradient` (..., p) is that of the function. Infinite where the function changes along a direction that
    cannot be known. `information` and `scale` are as in `cramer_rao`.
    """
    bound = cramer_rao(information, tuple(map(str, range(information.shape[-1]))), scale)
    scaled = gradient * scale
    size = np.linalg.norm(scaled, axis=-1)
    unit = scaled / np.where(size > 0.0, size, 1.0)[..., None]
    lost = np.einsum("...i,...ij,...j->...", unit, bound.unknown, unit) > _LOST
    variance = np.einsum("...i,...ij,...j->...", gradient, bound.covariance, gradient)
    return np.where(lost, np.inf, np.sqrt(np.maximum(variance, 0.0)))
