"""Noise covariances of the filters: from the track and the sensors, then tuned by likelihood.

The paper tunes "by trial and error until the estimation error is lowest" at a filter's own operating
point. Here the same is done by an optimiser, on the negative log-likelihood of the innovations over a
training record of that point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from threadpoolctl import threadpool_limits

from estimator.bank import FilterBank
from estimator.kalman import LinearFilter, design_filter

if TYPE_CHECKING:
    from collections.abc import Callable

    import control

__all__ = ["NoiseModel", "Tuning", "negative_log_likelihood", "tune"]

Array = NDArray[np.float64]

# Scale of the track's white noise and intensity of the unmodelled accelerations, both as powers of ten.
# The floor keeps every mode excited, so that a filter exists at the peak of the creep curve, where an
# undamped yaw mode is left; it moves the wheelset by less than the sensors resolve.
_BOUNDS = ((-3.0, 3.0), (-9.0, 2.0))
_NO_FILTER = 1e9  # cost where no filter exists: finite, so that the search turns back
_SIMPLEX = np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 2.0]])  # around the prior, powers of ten


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """What drives the filter model and what disturbs its measurements.

    Parameters
    ----------
    track_rate : intensity of the white noise that stands for the track offset's rate, m^2/s.
    acceleration : intensity of the unmodelled lateral acceleration, m^2/s^3.
    lever : length that turns it into an unmodelled yaw acceleration, m.
    sensors : rms noise of one sample of each measurement, in its unit.
    """

    track_rate: float
    acceleration: float
    lever: float
    sensors: tuple[float, ...]

    @property
    def W(self) -> Array:
        """Intensities of the inputs ``w, a_y, a_psi`` of `estimator.linear_models.filter_model`."""
        return np.diag([self.track_rate, self.acceleration, self.acceleration / self.lever**2])

    @property
    def R(self) -> Array:
        """Covariance of the noise of one sample."""
        return np.diag(np.square(self.sensors))


@dataclass(frozen=True, slots=True)
class Tuning:
    """A tuned filter and how it came about.

    Parameters
    ----------
    filter : the filter with the lowest cost.
    noise : the noise model it was designed with.
    cost : negative log-likelihood for each sample of the training record.
    evaluations : filters designed on the way.
    """

    filter: LinearFilter
    noise: NoiseModel
    cost: float
    evaluations: int


def negative_log_likelihood(design: LinearFilter, z: Array, *, skip: int = 0) -> float:
    """Return the mean of ``(e' S^-1 e + ln det 2 pi S) / 2`` over the samples z (T, m) after `skip`."""
    e = FilterBank([design]).innovations(z)[skip:, 0, :]
    L = np.linalg.cholesky(design.S)
    whitened = np.linalg.solve(L, e.T)
    m = design.S.shape[0]
    return float(
        0.5 * np.mean(np.sum(whitened**2, axis=0))
        + np.sum(np.log(np.diag(L)))
        + 0.5 * m * math.log(2.0 * math.pi)
    )


def tune(
    model: control.StateSpace,
    prior: NoiseModel,
    z: Array,
    h: float,
    *,
    name: str,
    skip: int = 0,
    evaluations: int = 120,
) -> Tuning:
    """Find the process noise that makes a training record most likely.

    Parameters
    ----------
    model : filter model of the operating point.
    prior : noise model from the track spectrum and the sensors, where the search begins.
    z : (T, m) measurements recorded at that operating point. h : sample time, s.
    name : of the hypothesis that the filter stands for.
    skip : samples at the start that do not count. evaluations : greatest number of filters tried.

    Raises
    ------
    ValueError
        If the record is too short, not finite or of other sensors than the model's, or if no filter can
        be designed.
    """
    if len(z) - skip < 100:
        raise ValueError(
            f"{name}: got a training record of {len(z)} samples, expected at least {skip + 100}; "
            f"make the training run longer"
        )
    if not np.all(np.isfinite(z)):
        raise ValueError(
            f"{name}: got a training record with NaN or infinity, expected finite samples; "
            f"cut the record where the sensors or the plant failed"
        )

    def design(powers: Array) -> tuple[NoiseModel, LinearFilter]:
        noise = NoiseModel(
            prior.track_rate * 10.0 ** powers[0], 10.0 ** powers[1], prior.lever, prior.sensors
        )
        return noise, design_filter(model, noise.W, noise.R, h, name=name)

    def cost(powers: Array) -> float:
        try:
            candidate = design(powers)[1]
        except ValueError:
            return _NO_FILTER
        return negative_log_likelihood(candidate, z, skip=skip)

    # Threads of BLAS that wait for each other over 5 by 5 matrices cost several times the search itself.
    with threadpool_limits(1, user_api="blas"):
        return _search(cost, design, prior, evaluations)


def _search(
    cost: Callable[[Array], float],
    design: Callable[[Array], tuple[NoiseModel, LinearFilter]],
    prior: NoiseModel,
    evaluations: int,
) -> Tuning:
    simplex = _SIMPLEX + np.array([0.0, math.log10(prior.acceleration)])
    design(simplex[0])  # where even this fails, its reason is better than the search's
    found = optimize.minimize(
        cost,
        simplex[0],
        method="Nelder-Mead",
        bounds=_BOUNDS,
        options={"initial_simplex": simplex, "maxfev": evaluations, "xatol": 1e-2, "fatol": 1e-6},
    )
    noise, best = design(found.x)
    return Tuning(best, noise, float(found.fun), int(found.nfev))
