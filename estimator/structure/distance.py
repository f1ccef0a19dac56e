r"""Distance to the nearest model in which an input reaches, or an output sees, less than everything.

A model loses controllability by the smallest change (in the spectral norm, complex changes of A and B
allowed) ``min over s of sigma_min([A - s I, B])``, s anywhere in the complex plane (Eising 1984). The
function has many local minima, so a search from the eigenvalues alone may miss the nearest loss. Here the
global minimum is enclosed by branch and bound: sigma_min moves no faster than s (Weyl), so a square of half
diagonal r with the value f at its centre holds nothing below ``f - r``, and singular vectors often tell
more. Squares that may hold something smaller than the best value found are cut in four. The search may
stay within the box around the field of values of A widened by the best value, because
``sigma_min([A - s I, B])`` is at least the distance of s from that field. The answer is a value that is
attained and a lower bound that nothing undercuts.

Trisection (Gu 2000; Burke, Lewis & Overton 2004) answers the same through eigenvalues of matrices of size
``2 n^2``; bounds through singular values of size n are cheaper here and certify as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from estimator.structure.scaling import natural_scales, scaled, size
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from estimator.structure.scaling import Scales

__all__ = ["Distance", "distance_to_uncontrollable", "distance_to_unobservable"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Region = Literal["everywhere", "not decaying"]

_EPS = float(np.finfo(np.float64).eps)
#: Squares looked at before the bounds are given as they are.
_MOST_SQUARES = 400_000


@dataclass(frozen=True)
class Distance:
    """The smallest relative change of a scaled model that loses a mode.

    Parameters
    ----------
    value : attained, relative to the norm of the whole scaled model. lower : nothing is below this.
    at : eigenvalue of the lost mode, 1/s, or for one step of a sampled model. signals : asked for.
    region : where the lost mode may be: everywhere, or where it does not decay.
    """

    value: float
    lower: float
    at: complex
    signals: tuple[str, ...]
    region: Region


def distance_to_uncontrollable(
    model: control.StateSpace | LinearSystem,
    inputs: Sequence[str] | None = None,
    *,
    region: Region = "everywhere",
    scales: Scales | None = None,
    within: float = 0.05,
) -> Distance:
    """Return how near a model is to one that some inputs (all if ``None``) do not reach wholly.

    Parameters
    ----------
    model : continuous or sampled. inputs : names. scales : `natural_scales` if ``None``.
    region : ``"not decaying"`` asks for the nearest model that cannot be stabilised.
    within : wanted ``(value - lower)/value``; smaller takes longer.

    Raises
    ------
    ValueError
        If the model has no input of that name.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    inner = scaled(system, scales)
    return _distance(inner, inner.select(inputs=inputs), scales.time, region, within)


def distance_to_unobservable(
    model: control.StateSpace | LinearSystem,
    outputs: Sequence[str] | None = None,
    *,
    region: Region = "everywhere",
    scales: Scales | None = None,
    within: float = 0.05,
) -> Distance:
    """Return how near a model is to one that some outputs (all if ``None``) do not see wholly.

    As `distance_to_uncontrollable`, of outputs; ``region="not decaying"`` asks for the nearest model that
    is not detectable.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    inner = scaled(system, scales)
    return _distance(inner, inner.select(outputs=outputs).dual, scales.time, region, within)


def _distance(
    whole: LinearSystem, part: LinearSystem, time: float, region: Region, within: float
) -> Distance:
    value, lower, s = nearest_loss(part.A, part.B, region=region, sampled=part.sampled, within=within)
    scale = size(whole)
    return Distance(value / scale, lower / scale, s / time, part.inputs, region)


def smallest(A: Array, B: Array, s: Complex) -> Array:
    """Return the smallest singular value of ``[A - s I, B]`` at each s (k,)."""
    return np.asarray(np.linalg.svd(_pencils(A, B, s), compute_uv=False)[..., -1])


def smallest_at(A: Array, B: Array, s: complex) -> float:
    """Return the smallest singular value of ``[A - s I, B]``."""
    return float(smallest(A, B, np.array([s]))[0])


def local_minimum(
    A: Array,
    B: Array,
    starts: Complex,
    keep: Callable[[Complex], Complex] = lambda s: s,
    *,
    steps: int = 100,
    precision: float = 1e-4,
) -> tuple[float, complex]:
    """Return the least local minimum ``(value, s)`` of ``sigma_min([A - s I, B])`` below some starts.

    The value is the least norm of ``u' [A - s I, B]`` over s and unit vectors u. Each step takes the best u
    for s, a singular vector, and then the best s for u, ``u' A u``: the value never grows.

    Parameters
    ----------
    starts : (k,). keep : returns the nearest point of the region to search. steps : at most so many.
    precision : relative gain of a step below which the search ends.
    """
    s, values = keep(starts), np.full(starts.size, np.inf)
    zero = _EPS * float(np.linalg.norm(A, 2))
    for _ in range(steps):
        _, sizes, Vh = np.linalg.svd(_pencils(A, B, s), full_matrices=False)
        u, before, values = Vh[:, -1], values, sizes[:, -1]
        if np.min(values) <= zero or np.all(before - values <= precision * values):
            break
        s = keep(np.einsum("ki,ij,kj->k", u.conj(), A, u))
    best = int(np.argmin(smallest(A, B, s)))
    return smallest_at(A, B, s[best]), complex(s[best])


def nearest_loss(
    A: Array, B: Array, *, region: Region = "everywhere", sampled: bool = False, within: float = 0.05
) -> tuple[float, float, complex]:
    """Return ``(value, lower bound, s)`` of the least ``sigma_min([A - s I, B])`` over a region."""
    keep = _projection(region, sampled)
    best, s = local_minimum(A, B, np.linalg.eigvals(A).astype(np.complex128), keep)
    zero = 10.0 * A.shape[0] * _EPS * float(np.linalg.norm(np.hstack([A, B]), 2))
    if best <= zero:
        return best, 0.0, s
    centres, half = _cover(A, best)
    seen = 0
    while centres.size:
        radius = half * np.sqrt(2.0)
        centres = centres[np.abs(keep(centres) - centres) <= radius]
        values = smallest(A, B, centres)
        seen += centres.size
        if values.size and np.min(values) < best:
            best, s = local_minimum(A, B, centres[[np.argmin(values)]], keep, steps=30)
        centres = centres[values - radius < (1.0 - within) * best]
        floors = _floors(A, B, centres, radius)
        if seen > _MOST_SQUARES:
            return best, max(0.0, float(np.min(floors, initial=(1.0 - within) * best))), s
        half /= 2.0
        corners = half * np.array([1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j])
        centres = (centres[floors < (1.0 - within) * best, None] + corners).ravel()
        if best <= zero:
            return best, 0.0, s
    lower = (1.0 - within) * best
    best, s = local_minimum(A, B, np.array([s]), keep, precision=1e-8)
    return best, lower, s


def _cover(A: Array, best: float) -> tuple[Complex, float]:
    """Return centres and half width of squares over the field of values of A, widened; upper half plane.

    A and B are real, so the value is the same at s and its conjugate.
    """
    real = np.linalg.eigvalsh((A + A.T) / 2.0)
    top = float(np.max(np.linalg.eigvalsh(1j * (A - A.T) / 2.0))) + best
    left, right = real[0] - best, real[-1] + best
    half = max(min(top, right - left), (top + right - left) / 64.0) / 8.0
    x = np.arange(left + half, right + half, 2.0 * half)
    y = np.arange(half, top + half, 2.0 * half)
    return np.asarray((x[:, None] + 1j * y).ravel()), half


def _projection(region: Region, sampled: bool) -> Callable[[Complex], Complex]:
    if region == "everywhere":
        return lambda s: s
    if sampled:
        return lambda s: s / np.where(s == 0.0, 1.0, np.minimum(np.abs(s), 1.0)) + (s == 0.0)
    return lambda s: np.maximum(s.real, 0.0) + 1j * s.imag


def _floors(A: Array, B: Array, s: Complex, radius: float) -> Array:
    """Return what ``sigma_min([A - z I, B])`` is at least, where z is within `radius` of each s (k,).

    The change ``-(z - s) [I, 0]``, seen in the singular vectors of the pencil at s, moves the smallest
    singular value by no more than ``slope radius`` on the diagonal, and through its coupling to the others,
    over the gap that is left, by no more than Li & Li (2005) allow. Where two modes nearly meet this is far
    above Weyl's ``f - radius``.
    """
    n = A.shape[0]
    V, sizes, Uh = np.linalg.svd(_pencils(A, B, s), full_matrices=False)
    slope = np.abs(np.sum(Uh[:, -1].conj() * V[:, :n, -1].conj(), axis=1))
    gap = np.full(s.size, np.inf) if n == 1 else sizes[:, -2] - sizes[:, -1] - (1.0 + slope) * radius
    gap = np.maximum(gap, 0.0)
    coupling = np.where(gap > 0.0, 2.0 * radius**2 / (gap + np.hypot(gap, 2.0 * radius)), radius)
    return np.asarray(sizes[:, -1] - np.minimum(radius, slope * radius + coupling))


def _pencils(A: Array, B: Array, s: Complex) -> Complex:
    """Return the transposes of ``[A - s I, B]`` for each s (k,)."""
    n = A.shape[0]
    pencils = np.empty((s.size, n + B.shape[1], n), dtype=np.complex128)
    pencils[:, :n] = A.T
    pencils[:, n:] = B.T
    pencils[:, range(n), range(n)] -= s[:, None]
    return pencils
