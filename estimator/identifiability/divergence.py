"""How far apart two Gaussian processes are, from their spectra.

With ``l`` the eigenvalues of ``S_q^-1 S_p`` at a frequency, all distances between two zero-mean processes are
integrals of functions of l: Kullback-Leibler ``(l - 1 - ln l)/2`` and Chernoff ``[ln(1 + s (l - 1)) - s ln
l]/2`` (Kazakos and Papantoni-Kazakos 1980).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.identifiability.spectra import frequency_grid, integral_rate, spectrum

if TYPE_CHECKING:
    from estimator.identifiability.process import Process

__all__ = ["Rates", "divergence_rates", "rates_of"]

Array = NDArray[np.float64]

_BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class Rates:
    """Rates at which samples tell p from q, 1/s; arrays of any one shape.

    Parameters
    ----------
    forward, backward : Kullback-Leibler divergence of p from q and of q from p: what the mean log-likelihood
        ratio grows by when p, or q, is true.
    chernoff : the largest of ``-ln int p^(1-s) q^s`` over s, at `exponent`: at this rate the least achievable
        error probability falls. curvature : its second derivative there, negative of.
    bhattacharyya : the same at s = 1/2.
    """

    forward: Array
    backward: Array
    chernoff: Array
    exponent: Array
    curvature: Array
    bhattacharyya: Array

    def __getitem__(self, index: object) -> Rates:
        """Return the rates at an index of the arrays."""
        return Rates(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})


def divergence_rates(p: Process, q: Process) -> Rates:
    """Return the rates of two processes, or batches of the same shape, NaN where one has no steady state.

    Raises
    ------
    ValueError
        If the processes have other sensors or sample times.
    """
    if p.outputs != q.outputs or p.h != q.h or p.batch != q.batch:
        raise ValueError(
            f"pair of processes: got {p.outputs} every {p.h:g} s and {q.outputs} every {q.h:g} s, expected "
            "the same measurements, sample time and batch; observe both alike"
        )
    omega, weights = frequency_grid(p, q)
    ratio = _eigenvalues(spectrum(p, omega), spectrum(q, omega))
    rates = rates_of(ratio, weights)
    steady = p.steady() & q.steady()
    return Rates(**{name: np.where(steady, value, np.nan) for name, value in vars(rates).items()})


def _eigenvalues(S_p: NDArray[np.complex128], S_q: NDArray[np.complex128]) -> Array:
    """Return the eigenvalues (..., w, m) of S_q^-1 S_p, real and > 0."""
    L = np.linalg.cholesky(S_q)
    half = np.linalg.solve(L, S_p)
    whitened = np.linalg.solve(L, np.conj(np.swapaxes(half, -1, -2)))
    return np.asarray(np.linalg.eigvalsh((whitened + np.conj(np.swapaxes(whitened, -1, -2))) / 2.0))


def rates_of(ratio: Array, weights: Array) -> Rates:
    """Return the rates from eigenvalues (..., w, m) of ``S_q^-1 S_p`` and weights (..., w) of an integral."""
    logs, excess = np.log(ratio), ratio - 1.0

    def rate(density: Array) -> Array:
        return integral_rate(np.sum(density, axis=-1), weights)

    def chernoff(s: Array) -> Array:
        t = s[..., None, None]
        return rate(np.log1p(t * excess) - t * logs)

    lower, upper = np.zeros(ratio.shape[:-2]), np.ones(ratio.shape[:-2])
    for _ in range(_BISECTIONS):
        middle = (lower + upper) / 2.0
        t = middle[..., None, None]
        rising = rate(excess / (1.0 + t * excess) - logs) > 0.0
        lower, upper = np.where(rising, middle, lower), np.where(rising, upper, middle)
    s = (lower + upper) / 2.0
    t = s[..., None, None]
    return Rates(
        forward=rate(excess - logs),
        backward=rate(-excess / ratio + logs),
        chernoff=chernoff(s),
        exponent=s,
        curvature=rate(np.square(excess / (1.0 + t * excess))),
        bhattacharyya=chernoff(np.full_like(s, 0.5)),
    )
