"""Spectra of sampled processes, and the integrals over frequency of which all rates of information are made.

The spectrum of one sample is ``S(w) = Y Q Y^* + R`` with ``Y = H (exp(i w h) - F)^-1``, so that the
covariance of a sample is ``(h/2 pi)`` times its integral over ``|w| < pi/h``. What sampling folds back is in
it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from estimator.identifiability.process import Family, Process

__all__ = ["frequency_grid", "integral_rate", "spectrum", "spectrum_with_slopes"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Points of the Gauss-Legendre rule in each panel; panels in the geometric part of the grid, from this part
#: of the highest frequency on.
_ORDER, _PANELS, _LOWEST = 6, 24, 1e-5
#: Edges of panels around a pole: the first in its half-widths, the last in its frequency, and those between.
_FIRST, _REACH = 0.7, 0.5
_STEPS = np.linspace(0.0, 1.0, 7)
#: Frequency of a pole over its half-width from which on it has edges of its own, and the least half-width.
_SHARP, _NARROWEST = 0.5, 1e-9


def frequency_grid(*processes: Process) -> tuple[Array, Array]:
    """Return frequencies (..., w) in rad/s over 0 to pi/h and weights (..., w) of a quadrature rule.

    Panels of a Gauss-Legendre rule, geometric over the whole range and around each oscillating pole of the
    processes as narrow as its damping asks.
    """
    top = math.pi / processes[0].h
    poles = _ringing(np.concatenate([p.poles() for p in processes], axis=-1))
    centre, width = poles.imag[..., None], np.maximum(np.abs(poles.real[..., None]), _NARROWEST * top)
    # From the half-width of each pole out to where it is no longer seen, in steps of one ratio.
    reach = _FIRST * width * np.maximum(_REACH * centre / (_FIRST * width), 1.0) ** _STEPS
    rings = np.concatenate([centre - reach, centre, centre + reach], axis=-1).reshape(*poles.shape[:-1], -1)
    base = np.concatenate([[0.0], np.geomspace(_LOWEST * top, top, _PANELS)])
    edges = np.concatenate([np.broadcast_to(base, (*rings.shape[:-1], base.size)), rings], axis=-1)
    edges = np.sort(np.clip(edges, 0.0, top), axis=-1)
    nodes, weights = np.polynomial.legendre.leggauss(_ORDER)
    half = np.diff(edges, axis=-1)[..., None] / 2.0
    middle = (edges[..., :-1] + edges[..., 1:])[..., None] / 2.0
    shape = (*edges.shape[:-1], -1)
    return (middle + half * nodes).reshape(shape), (half * weights + 0.0 * middle).reshape(shape)


def _ringing(poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the poles (..., n) that ring, one of each pair; others where members of a batch have fewer."""
    sharpness = np.where(poles.imag > 0.0, poles.imag / np.maximum(np.abs(poles.real), 1e-300), 0.0)
    count = int(np.max(np.sum(sharpness > _SHARP, axis=-1)))
    order = np.argsort(-sharpness, axis=-1)[..., :count]
    return np.take_along_axis(poles, order, axis=-1)


def integral_rate(values: Array, weights: Array) -> Array:
    """Return ``(1/4 pi)`` times the integral over ``|w| < pi/h`` of `values` (..., w), even in w.

    This is the rate per second of ``1/2 sum f(w_j)`` over the Fourier frequencies of a long window.
    """
    return np.asarray(np.sum(values * weights, axis=-1) / (2.0 * math.pi))


def spectrum(process: Process, omega: Array) -> Complex:
    """Return S (..., w, m, m) at frequencies `omega` (..., w) in rad/s."""
    Y = _transfer(process, omega)
    return np.asarray(Y @ process.Q[..., None, :, :] @ _adjoint(Y) + process.R)


def spectrum_with_slopes(family: Family, omega: Array) -> tuple[Complex, Complex]:
    """Return S (..., w, m, m) and its derivatives (p, ..., w, m, m) with respect to the parameters."""
    process = family.process
    Y = _transfer(process, omega)
    right = process.Q[..., None, :, :] @ _adjoint(Y)
    # (exp(i w h) - F)^-1 Q Y^*, from which dF and dH take their share.
    seen = np.linalg.solve(_pencil(process, omega), right)
    dF, dQ, dH = (d[..., None, :, :] for d in (family.dF, family.dQ, family.dH))
    half = dH @ seen + Y @ (dF @ seen)
    return Y @ right + process.R, half + _adjoint(half) + Y @ dQ @ _adjoint(Y)


def _pencil(process: Process, omega: Array) -> Complex:
    """Return exp(i w h) - F (..., w, s, s); NaN where there is no steady state and so no spectrum."""
    z = np.exp(1j * omega * process.h)[..., None, None]
    F = np.where(process.steady()[..., None, None], process.F, np.nan)
    return np.asarray(z * np.eye(F.shape[-1]) - F[..., None, :, :])


def _transfer(process: Process, omega: Array) -> Complex:
    """Return Y (..., w, m, s)."""
    transposed = np.swapaxes(_pencil(process, omega), -1, -2)
    right = np.swapaxes(process.H, -1, -2)[..., None, :, :].astype(np.complex128)
    right = np.broadcast_to(right, (*transposed.shape[:-1], right.shape[-1]))
    return np.asarray(np.swapaxes(np.linalg.solve(transposed, right), -1, -2))


def _adjoint(M: Complex) -> Complex:
    return np.conj(np.swapaxes(M, -1, -2))
