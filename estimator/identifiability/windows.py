"""Finite windows of Gaussian processes, steady or not, by the covariance of all their samples at once.

The same formulas as for spectra, with matrices of (T m, T m) in their place: exact, whatever the dynamics,
for as many samples as a dense matrix can hold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.identifiability.divergence import Rates, rates_of

if TYPE_CHECKING:
    from estimator.identifiability.process import Family, Process

__all__ = ["fisher_window", "steady_covariance", "window_covariance", "window_rates"]

Array = NDArray[np.float64]

#: Where a window begins: at ``"rest"``, in the ``"steady"`` state, or with a covariance (s, s) of the state.
Start: TypeAlias = "Array | Literal['rest', 'steady']"

_LARGEST = 4000
_OUTGROWN = (
    "window: got an unstable process that outgrows its noise by more than numbers can hold, expected a "
    "shorter window; such motion has long left the range of a linear model"
)


def steady_covariance(process: Process) -> Array:
    """Return the covariance (s, s) of the state of a single process in its steady state.

    Raises
    ------
    ValueError
        If it has none.
    """
    if process.batch or not process.steady():
        raise ValueError(
            "steady state: got a batch or a process with modes that do not decay, expected a single one in "
            "which all do; start from rest or from a covariance"
        )
    return _lyapunov(process.F, process.Q)


def _lyapunov(F: Array, Q: Array) -> Array:
    """Solve ``P = F P F' + Q`` by doubling: 2^k steps after k rounds."""
    P = Q
    while True:
        grown = P + F @ P @ F.T
        if np.array_equal(grown, P) or np.linalg.norm(grown - P) <= 1e-15 * np.linalg.norm(P):
            return np.asarray((grown + grown.T) / 2.0)
        P, F = grown, F @ F


def window_covariance(process: Process, samples: int, *, start: Start = "rest") -> Array:
    """Return the covariance (T m, T m) of a window of T samples, sample by sample.

    Raises
    ------
    ValueError
        If the window is empty or too large for a dense matrix, or the process has no steady state to start
        from.
    """
    _check_window(process, samples)
    m = process.H.shape[0]
    F, H, P = process.F, process.H, _start(process, start)
    ahead = _ahead(process, samples)
    covariance = np.empty((samples, m, samples, m))
    for k in range(samples):
        _put(covariance, k, ahead[: samples - k] @ (P @ H.T))
        covariance[k, :, k, :] += process.R
        P = F @ P @ F.T + process.Q
    return covariance.reshape(samples * m, samples * m)


def _check_window(process: Process, samples: int) -> None:
    m = process.H.shape[-2]
    if process.batch or not 1 <= samples * m <= _LARGEST:
        raise ValueError(
            f"window: got {samples} samples of {m} measurements of a batch of shape {process.batch}, "
            f"expected a single process and 1 to {_LARGEST // m} samples; shorten the window or sample more "
            "slowly"
        )


def _start(process: Process, start: Start) -> Array:
    if isinstance(start, str):
        return steady_covariance(process) if start == "steady" else np.zeros_like(process.F)
    return start


def _ahead(process: Process, samples: int) -> Array:
    """Return H F^k (samples, m, s)."""
    ahead = np.empty((samples, *process.H.shape))
    ahead[0] = process.H
    for k in range(1, samples):
        ahead[k] = ahead[k - 1] @ process.F
    return ahead


def _put(covariance: Array, k: int, column: Array) -> None:
    """Write the covariance of samples k, k + 1, ... with sample k, and its mirror image."""
    covariance[k:, :, k, :] = column
    covariance[k, :, k:, :] = column.transpose(2, 0, 1)


def _window_slope(family: Family, i: int, samples: int, start: Start) -> Array:
    """Return the derivative (T m, T m) of `window_covariance` with respect to parameter i."""
    process, dF, dQ, dH = family.process, family.dF[i], family.dQ[i], family.dH[i]
    m = process.H.shape[0]
    F, H, P = process.F, process.H, _start(process, start)
    dP = np.zeros_like(P)
    if isinstance(start, str) and start == "steady":
        dP = _lyapunov(F, _input_slope(process, dF, dQ, P))
    ahead = _ahead(process, samples)
    change = np.empty_like(ahead)
    change[0] = dH
    for k in range(1, samples):
        change[k] = change[k - 1] @ F + ahead[k - 1] @ dF
    slope = np.empty((samples, m, samples, m))
    for k in range(samples):
        n = samples - k
        _put(slope, k, change[:n] @ (P @ H.T) + ahead[:n] @ (dP @ H.T + P @ dH.T))
        dP = F @ dP @ F.T + _input_slope(process, dF, dQ, P)
        P = F @ P @ F.T + process.Q
    return slope.reshape(samples * m, samples * m)


def _input_slope(process: Process, dF: Array, dQ: Array, P: Array) -> Array:
    half = dF @ P @ process.F.T
    return half + half.T + dQ


def fisher_window(family: Family, samples: int, *, start: Start = "rest") -> Array:
    """Return the exact Fisher information (p, p) of a window of T samples, steady or not.

    ``1/2 tr(Sigma^-1 dSigma_i Sigma^-1 dSigma_j)`` with the covariance of all samples. A steady state
    changes with the parameters, a covariance that is given does not.

    Raises
    ------
    ValueError
        As `window_covariance`, or if an unstable process outgrows the accuracy of numbers in the window.
    """
    root = _root(window_covariance(family.process, samples, start=start))
    whitened = []
    for i in range(len(family.names)):
        half = linalg.solve_triangular(root, _window_slope(family, i, samples, start), lower=True)
        whitened.append(linalg.solve_triangular(root, half.T, lower=True))
    return np.array([[0.5 * np.sum(a * b) for b in whitened] for a in whitened])


def _root(covariance: Array) -> Array:
    try:
        return np.asarray(linalg.cholesky(covariance, lower=True))
    except linalg.LinAlgError:
        raise ValueError(_OUTGROWN) from None


def window_rates(
    p: Process, q: Process, samples: int, *, starts: tuple[Start, Start] = ("rest", "rest")
) -> Rates:
    """Return how a window of T samples tells two single processes apart, steady or not.

    Over the length T h, as rates, so that `estimator.identifiability.decision` reads them like those of long
    windows; they hold for this window alone.

    Raises
    ------
    ValueError
        As `fisher_window`.
    """
    a, b = (window_covariance(x, samples, start=start) for x, start in zip((p, q), starts, strict=True))
    root = _root(b)
    half = linalg.solve_triangular(root, a, lower=True)
    whitened = linalg.solve_triangular(root, half.T, lower=True)
    ratio = linalg.eigvalsh((whitened + whitened.T) / 2.0)
    if ratio[0] <= 0.0:
        raise ValueError(_OUTGROWN)
    return rates_of(ratio[:, None], np.full(ratio.size, np.pi / (samples * p.h)))
