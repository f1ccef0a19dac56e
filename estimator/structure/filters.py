"""Is there a steady-state Kalman filter, a stabilising feedback, a stable observer - and if not, why not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.structure.margins import ModeMargin, controllability_margins, observability_margins
from estimator.structure.scaling import Scales, natural_scales
from estimator.structure.subspaces import TOLERANCE
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from estimator.structure.modes import Mode

__all__ = ["SteadyFilter", "Verdict", "detectable", "filter_exists", "stabilisable", "steady_filter"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Verdict:
    """The answer to a yes-or-no question about a model, with its reason.

    Parameters
    ----------
    holds : the answer. reason : in words. obstacles : the modes that stand against it.
    """

    holds: bool
    reason: str
    obstacles: tuple[ModeMargin, ...] = ()

    def __bool__(self) -> bool:
        return self.holds


@dataclass(frozen=True, eq=False)
class SteadyFilter:
    """The steady-state Kalman filter ``x^' = A x^ + K (z - C x^)`` of a model, if there is one.

    Parameters
    ----------
    exists : with its reason.
    gain : (n, p) K, and covariance : (n, n) of the error, in the model's units; for a sampled model those of
        the predicted state. ``None`` where the filter does not exist.
    error_modes : eigenvalues of ``A - K C``, slowest first; empty where the filter does not exist.
    """

    exists: Verdict
    gain: Array | None
    covariance: Array | None
    error_modes: tuple[complex, ...]


def stabilisable(
    model: control.StateSpace | LinearSystem,
    inputs: Sequence[str] | None = None,
    *,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> Verdict:
    """Return whether some inputs (all if ``None``) reach every mode that does not decay."""
    return reach(controllability_margins(model, inputs, scales=scales, tolerance=tolerance))


def detectable(
    model: control.StateSpace | LinearSystem,
    outputs: Sequence[str] | None = None,
    *,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> Verdict:
    """Return whether some outputs (all if ``None``) see every mode that does not decay."""
    return sight(observability_margins(model, outputs, scales=scales, tolerance=tolerance))


def reach(margins: tuple[ModeMargin, ...]) -> Verdict:
    """Return `stabilisable` where the margins are at hand."""
    return _all_met(margins, "reach", "reaches")


def sight(margins: tuple[ModeMargin, ...]) -> Verdict:
    """Return `detectable` where the margins are at hand."""
    return _all_met(margins, "see", "sees")


def steady_filter(
    model: control.StateSpace | LinearSystem,
    W: Array,
    R: Array,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> SteadyFilter:
    """Return the steady-state Kalman filter of a model, or why there is none.

    One exists, with errors that decay, exactly where the outputs see every mode that does not decay and the
    noise excites every undamped one (Kucera 1972); a mode that grows need not be excited.

    Parameters
    ----------
    model : some of its inputs are white noise, some of its outputs are measured; continuous or sampled.
    W : (m, m) intensities of the chosen inputs (for a sampled model covariances of a step).
    R : (p, p) intensity of the noise of the chosen outputs: covariance of a sample times the sampling time
        (for a sampled model the covariance of a sample). inputs, outputs : names; all if ``None``.
    scales : `natural_scales` if ``None``. tolerance : what counts as zero in the scaled model.

    Raises
    ------
    ValueError
        If W or R has another shape, is not positive (semi)definite, or noise reaches an output directly.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    part = system.select(inputs=inputs, outputs=outputs)
    _root("R", R, len(part.outputs), definite=True)
    exists = filter_exists(system, W, inputs=inputs, outputs=outputs, scales=scales, tolerance=tolerance)
    if not exists:
        return SteadyFilter(exists, None, None, ())
    root = _root("W", W, len(part.inputs), definite=False)
    P, K = _riccati(part, root, np.asarray(R, dtype=np.float64), scales)
    errors = linalg.eigvals(part.A - K @ part.C if not part.sampled else part.A - part.A @ K @ part.C)
    slow = -np.abs(errors) if part.sampled else -errors.real
    return SteadyFilter(exists, K, P, tuple(complex(s) for s in errors[np.argsort(slow, kind="stable")]))


def filter_exists(
    model: control.StateSpace | LinearSystem,
    W: Array,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> Verdict:
    """Return whether there is a steady-state Kalman filter, whatever the noise of the outputs.

    As `steady_filter`, without computing it.

    Raises
    ------
    ValueError
        If W has another shape, is not positive semidefinite, or noise reaches an output directly.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    part = system.select(inputs=inputs, outputs=outputs)
    root = _root("W", W, len(part.inputs), definite=False)
    if np.any(part.D @ root):
        raise ValueError(
            "noise: got an input that reaches an output directly, expected D = 0; "
            "put that noise into R, or shape it by states of its own"
        )
    return _existence(system, part, root, scales, tolerance)


def _existence(
    system: LinearSystem, part: LinearSystem, root: Array, scales: Scales, tolerance: float
) -> Verdict:
    seen = detectable(system, part.outputs, scales=scales, tolerance=tolerance)
    if not seen:
        return Verdict(False, f"no steady filter: {seen.reason}", seen.obstacles)
    excited = _excitation(part, root, scales, tolerance)
    silent = tuple(m for m in excited if m.lost and m.mode.behaviour == "undamped")
    if silent:
        reason = (
            f"no steady filter with decaying errors: no noise excites {_listed(silent)}, so the filter "
            f"stops to look at what it believes to know"
        )
        return Verdict(False, reason, silent)
    return Verdict(
        True, "the outputs see every mode that does not decay, and noise excites the undamped ones"
    )


def _excitation(part: LinearSystem, root: Array, scales: Scales, tolerance: float) -> tuple[ModeMargin, ...]:
    """Return how well noise of the covariance ``root root'`` meets each mode, whatever its strength."""
    sizes = np.linalg.norm(root, axis=1)
    active = np.flatnonzero(sizes)
    U, s, _ = np.linalg.svd(root[active] / sizes[active, None], full_matrices=False)
    directions = U[:, s > TOLERANCE * np.max(s, initial=0.0)]
    count = directions.shape[1]
    noises, units = tuple(f"noise {i + 1}" for i in range(count)), ("-",) * count
    B = part.B[:, active] * natural_scales(part).inputs[active] @ directions
    D = np.zeros((len(part.outputs), count))
    excited = replace(part, B=B, D=D, inputs=noises, input_units=units)
    yardstick = Scales(scales.states, np.ones(count), np.ones(len(part.outputs)), scales.time)
    return controllability_margins(excited, scales=yardstick, tolerance=tolerance)


def _all_met(found: tuple[ModeMargin, ...], verb: str, verbs: str) -> Verdict:
    """Return whether every mode that does not decay is met."""
    lost = tuple(m for m in found if m.lost and m.mode.behaviour != "decays")
    signals = found[0].signals if found else ()
    names = " and ".join(filter(None, [", ".join(signals[:-1]), *signals[-1:]])) or "no signal"
    if lost:
        return Verdict(False, f"{names} cannot {verb} {_listed(lost)}", lost)
    return Verdict(True, f"{names} {verb if len(signals) > 1 else verbs} every mode that does not decay")


def _listed(margins: tuple[ModeMargin, ...]) -> str:
    """Return modes in words, an oscillating pair once."""
    shown = [m.mode for m in margins if m.mode.exponent.imag >= 0.0]
    return "; ".join(_described(mode) for mode in shown)


def _described(mode: Mode) -> str:
    what = {"undamped": "undamped", "grows": "growing", "decays": "decaying"}[mode.behaviour]
    if mode.frequency > 0.0:
        return f"the {what} oscillation at {mode.frequency:.4g} Hz ({mode.dominant})"
    if mode.behaviour == "undamped":
        return f"the integrator {mode.dominant}"
    return f"the {what} mode of {mode.dominant} ({mode.exponent.real:.4g} 1/s)"


def _root(name: str, given: Array, order: int, *, definite: bool) -> Array:
    """Return L with ``L L'`` the given covariance."""
    M = np.atleast_2d(np.asarray(given, dtype=np.float64))
    kind = "definite" if definite else "semidefinite"
    if M.shape == (order, order) and np.all(np.isfinite(M)) and np.allclose(M, M.T, rtol=1e-9, atol=0.0):
        d = np.sqrt(np.maximum(np.diag(M), 0.0))
        sizes = np.where(d > 0.0, d, 1.0)
        values, U = np.linalg.eigh(M / np.outer(sizes, sizes))
        smallest = float(np.min(values, initial=np.inf))
        if smallest > 1e-12 if definite else smallest >= -1e-12:
            return np.asarray(sizes[:, None] * U * np.sqrt(np.maximum(values, 0.0)))
    raise ValueError(
        f"{name}: got {np.array2string(M, precision=4)}, expected a symmetric positive {kind} matrix of "
        f"shape {(order, order)}; give one row for each chosen signal"
    )


def _riccati(part: LinearSystem, root: Array, R: Array, scales: Scales) -> tuple[Array, Array]:
    """Return covariance and gain, solved where states, time, noises and outputs are of one size."""
    x, T = scales.states, scales.time
    A, G = part.A / x[:, None] * x, part.B @ root / x[:, None]
    C = linalg.solve_triangular(np.linalg.cholesky(R), part.C * x, lower=True)
    Q, S = G @ G.T, C.T @ C
    # P is of the size of level where noise and measurement balance, or growth and measurement.
    q, a, c = (float(np.linalg.norm(M, 2)) for M in (Q, A, S))
    level = max(math.sqrt(q / c), 1e-4 * a / c) if c > 0.0 else 1.0
    Q, C, one = Q / level, C * np.sqrt(level), np.eye(len(part.outputs))
    if part.sampled:
        P = linalg.solve_discrete_are(A.T, C.T, Q, one) * level
    else:
        P = linalg.solve_continuous_are(T * A.T, C.T, T * Q, one / T) * level
    P = (P + P.T) / 2.0 * np.outer(x, x)
    innovation = part.C @ P @ part.C.T + R if part.sampled else R
    return P, linalg.solve(innovation, part.C @ P, assume_a="pos").T
