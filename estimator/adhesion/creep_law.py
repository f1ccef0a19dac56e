"""The creep law of Polach for combined creepage with its partial derivatives, compiled.

With the creepages a along and b across the rail, the friction scaled by exp(s) and
``kappa = pi G a b/(4 N)`` of the patch,

    lambda = sqrt(a^2 + b^2)          chi = sqrt((C11 a)^2 + (C22 b)^2)
    mu     = mu_0 exp(s) [(1 - A) exp(-B lambda v) + A]           eps = kappa chi/mu
    F      = (2 N mu/pi) [k_A eps/(1 + (k_A eps)^2) + atan(k_S eps)]
    f_x    = F a/lambda               f_y = F b/lambda
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fmu_wheelset.parameters import ContactPatch, RailCondition

__all__ = ["creep_force", "patch_row", "rail_row"]

Array = NDArray[np.float64]
#: What describes the rail under one wheel: a row of `rail_row`, or its numbers.
Rail = Array | tuple[float, float, float, float, float]

#: Columns of a row that describes the rail under one wheel.
_K_A, _K_S, _MU_0, _A, _B = range(5)
#: Columns of the row that describes the patch: kappa, C11^2, C22^2 and the load (N).
_KAPPA, _C11_2, _C22_2, _LOAD = range(4)
#: Square of a creepage along the rail that is added, so that the secant at no creepage is that along it.
_TINY = 1e-24


def rail_row(condition: RailCondition) -> Array:
    """Return what `creep_force` reads of a rail condition, (5,)."""
    c = condition
    return np.array([c.k_A, c.k_S, c.mu_0, c.A, c.B])


def patch_row(patch: ContactPatch, N: float) -> Array:
    """Return what `creep_force` reads of a contact patch under the load `N` (N), (4,)."""
    return np.array([math.pi * patch.G * patch.a * patch.b / (4.0 * N), patch.C11**2, patch.C22**2, N])


@njit(cache=True, nogil=True, error_model="numpy")
def creep_force(  # pragma: no cover - compiled
    rail: Rail, patch: Array, v: float, a: float, b: float, s: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return ``f_x, f_y`` (N) and the partials ``f_x_a, f_x_b, f_y_a, f_y_b, f_x_s, f_y_s``.

    Parameters
    ----------
    rail, patch : rows of `rail_row` and `patch_row`.
    v : speed >= 0, m/s. a, b : creepages. s : logarithm of the friction over that of the condition.
    """
    k_A, k_S, kappa, C11_2, C22_2 = rail[_K_A], rail[_K_S], patch[_KAPPA], patch[_C11_2], patch[_C22_2]
    creep = math.sqrt(a * a + b * b + _TINY)
    chi = math.sqrt(C11_2 * (a * a + _TINY) + C22_2 * b * b)
    level = rail[_MU_0] * math.exp(s)
    falling = level * (1.0 - rail[_A]) * math.exp(-rail[_B] * creep * v)
    mu = falling + level * rail[_A]
    eps = kappa * chi / mu
    alpha, sigma = k_A * eps, k_S * eps
    # One division for both 1/(1 + alpha^2) and 1/(1 + sigma^2).
    alpha_2, sigma_2 = 1.0 + alpha * alpha, 1.0 + sigma * sigma
    both = 1.0 / (alpha_2 * sigma_2)
    stick, slip = sigma_2 * both, alpha_2 * both
    shape = alpha * stick + math.atan(sigma)
    slope = k_A * (1.0 - alpha * alpha) * stick * stick + k_S * slip

    scale = (2.0 / math.pi) * patch[_LOAD]
    F = scale * mu * shape
    F_mu = scale * (shape - eps * slope)
    F_creep = -rail[_B] * v * falling * F_mu
    F_chi = scale * kappa * slope / chi

    over_creep = 1.0 / creep
    x, y = a * over_creep, b * over_creep
    F_a = F_creep * x + F_chi * C11_2 * a
    F_b = F_creep * y + F_chi * C22_2 * b
    F_s = F_mu * mu
    secant = F * over_creep
    return (
        F * x,
        F * y,
        F_a * x + secant * (1.0 - x * x),
        F_b * x - secant * x * y,
        F_a * y - secant * x * y,
        F_b * y + secant * (1.0 - y * y),
        F_s * x,
        F_s * y,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def creep_scale(rail: Rail, patch: Array) -> float:  # pragma: no cover - compiled
    """Return the creepage at which the initial slope would reach the friction: where the law bends."""
    slope = patch[_KAPPA] * math.sqrt(patch[_C11_2]) * (rail[_K_A] + rail[_K_S])
    return float(rail[_MU_0] / slope)
