"""Design of steady-state Kalman filters from continuous linear models.

Symbols: ``F`` transition, ``H`` measurement, ``Q`` process and ``R`` measurement noise covariance of one
step, ``P`` covariance of the predicted state, ``S`` of the innovation, ``K`` gain. The filter is

    x^- = F x,   e = z - H x^-,   x = x^- + K e .
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

if TYPE_CHECKING:
    import control

__all__ = [
    "LinearFilter",
    "NoSteadyStateError",
    "design_filter",
    "discretise",
    "observable_part",
    "steady_covariance",
    "visible_model",
]

Array = NDArray[np.float64]

#: Least decay of a steady filter's errors in one step. Below it stands rounding, not damping.
_DECAY = 1e-10


class NoSteadyStateError(ValueError):
    """A model has no steady-state filter with decaying errors."""


@dataclass(frozen=True, eq=False)
class LinearFilter:
    """A steady-state Kalman filter for samples at a fixed step.

    Parameters
    ----------
    name : the hypothesis that the filter stands for.
    F : (s, s), H : (m, s), K : (s, m), S : (m, m), P : (s, s), Q : (s, s), R : (m, m).
    states : names of the filter's states.
    dropped : names of the model's states that the measurements cannot see and the filter leaves out.
    """

    name: str
    F: Array
    H: Array
    K: Array
    S: Array
    P: Array
    Q: Array
    R: Array
    states: tuple[str, ...]
    dropped: tuple[str, ...] = ()


def discretise(A: Array, G: Array, W: Array, h: float) -> tuple[Array, Array]:
    """Discretise ``dx = A x dt + G dw`` exactly (Van Loan 1978), with doubling for stiff models.

    The method carries ``exp(-A h)``, which swamps Q where a mode decays within a fraction of `h`. So Q is
    found over ``h / 2^d``, short against the fastest mode, and doubled: ``Q(2h) = Q(h) + F Q(h) F'``.

    Parameters
    ----------
    A : (s, s). G : (s, n). W : (n, n) two-sided intensity of the white noise. h : step, s.

    Returns
    -------
    (F, Q) : transition (s, s) and noise covariance (s, s) of one step.
    """
    s = A.shape[0]
    fastest = float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
    doublings = max(0, math.frexp(fastest * h)[1])
    block = np.zeros((2 * s, 2 * s))
    block[:s, :s] = -A
    block[:s, s:] = G @ W @ G.T
    block[s:, s:] = A.T
    E = linalg.expm(block * (h / 2**doublings))
    F = E[s:, s:].T
    Q = F @ E[:s, s:]
    for _ in range(doublings):
        F, Q = F @ F, Q + F @ Q @ F.T
    return F, (Q + Q.T) / 2.0


def natural_units(A: Array, C: Array) -> Array:
    """Return units (s,) of the states that bring all nonzero couplings of ``x' = A x, z = C x`` together.

    Least squares of the logarithms (Curtis & Reid 1972), with the units of the measurements and of time
    free as well. Unlike balancing of A it is the same whatever units the model came in, also where one
    part drives another and is not driven back.
    """
    s, m = A.shape[0], C.shape[0]
    couplings = np.vstack([A - np.diag(np.diag(A)), C])
    i, j = np.nonzero(couplings)
    k = np.arange(i.size)
    rows = np.zeros((i.size, s + m + 1))
    rows[k, j] = 1.0
    rows[k, i] = -1.0
    rows[i < s, -1] = -1.0
    logs, *_ = np.linalg.lstsq(rows, -np.log(np.abs(couplings[i, j])), rcond=None)
    return np.asarray(np.exp(logs[:s]))


def observable_part(A: Array, C: Array, *, tolerance: float = 1e-13) -> list[int]:
    """Return the states on which the part of ``x' = A x`` that ``C x`` can see rests, in order.

    The staircase algorithm grows the space seen through C, C A, C A^2, ... by orthonormal directions.
    It works in `natural_units` with each output scaled to one: unscaled, entries from 1e-3 to 1e6 would
    let the units decide the rank. `tolerance` is relative to the norm of the scaled A.
    """
    units = natural_units(A, C)
    scaled, outputs = A / units[:, None] * units, C * units
    norms = np.linalg.norm(outputs, axis=1, keepdims=True)
    seen = linalg.orth((outputs / np.where(norms > 0.0, norms, 1.0)).T)
    step = scaled.T / max(np.linalg.norm(scaled, 2), np.finfo(float).tiny)
    new = seen
    while new.shape[1] > 0:
        grown = step @ new
        for _ in range(2):  # twice is enough for orthogonality to rounding
            grown = grown - seen @ (seen.T @ grown)
        U, singular, _ = np.linalg.svd(grown, full_matrices=False)
        new = U[:, singular > tolerance]
        seen = np.hstack([seen, new])
    _, _, pivots = linalg.qr(seen.T, pivoting=True, mode="economic")
    return sorted(int(i) for i in pivots[: seen.shape[1]])


def design_filter(model: control.StateSpace, W: Array, R: Array, h: float, *, name: str) -> LinearFilter:
    """Design the steady-state filter of a continuous model on its observable part.

    Parameters
    ----------
    model : inputs are white noises, outputs the measurements; no feedthrough.
    W : (n, n) two-sided intensities of the inputs. R : (m, m) noise covariance of one sample.
    h : sample time, s. name : of the hypothesis that the filter stands for.

    Raises
    ------
    ValueError
        If the model has feedthrough, states cannot be left out one by one, or no steady-state filter with
        decaying errors exists.
    """
    A, G, C, kept, hidden = visible_model(model, name)
    F, Q = discretise(A, G, W, h)
    P = steady_covariance(F, C, Q, R, name)
    S = C @ P @ C.T + R
    K = linalg.solve(S, C @ P, assume_a="pos").T
    return LinearFilter(name, F, C, K, S, P, Q, R, kept, hidden)


def visible_model(
    model: control.StateSpace, name: str
) -> tuple[Array, Array, Array, tuple[str, ...], tuple[str, ...]]:
    """Return A, B and C on the states that the measurements can see, their names, and those of the others.

    Raises
    ------
    ValueError
        If the model has feedthrough or states cannot be left out one by one.
    """
    A, G, C = (np.asarray(M, dtype=np.float64) for M in (model.A, model.B, model.C))
    if np.any(model.D):
        raise ValueError(
            f"{name}: got a model with feedthrough, expected D = 0; "
            f"put noise that enters a measurement directly into R"
        )
    kept = observable_part(A, C)
    hidden = [i for i in range(A.shape[0]) if i not in kept]
    if np.any(A[np.ix_(kept, hidden)]) or np.any(C[:, hidden]):
        raise ValueError(
            f"{name}: got an unobservable part that is a mixture of states, expected single states; "
            f"transform the model to its Kalman decomposition first"
        )
    seen, unseen = (tuple(model.state_labels[i] for i in states) for states in (kept, hidden))
    return A[np.ix_(kept, kept)], G[kept], C[:, kept], seen, unseen


def steady_covariance(F: Array, H: Array, Q: Array, R: Array, name: str) -> Array:
    """Solve the Riccati equation for the predicted covariance (s, s).

    Raises
    ------
    NoSteadyStateError
        If there is no solution whose errors decay.
    """
    try:
        P = linalg.solve_discrete_are(F.T, H.T, Q, R)
    except (linalg.LinAlgError, ValueError) as error:
        raise NoSteadyStateError(_no_filter(name, str(error))) from error
    K = linalg.solve(H @ P @ H.T + R, H @ P, assume_a="pos").T
    radius = float(np.max(np.abs(np.linalg.eigvals(F - F @ K @ H))))
    if radius >= 1.0 - _DECAY:
        reason = f"its errors would not decay (spectral radius {radius:.9f})"
        raise NoSteadyStateError(_no_filter(name, reason))
    return np.asarray((P + P.T) / 2.0)


def _no_filter(name: str, reason: str) -> str:
    return (
        f"{name}: got no steady-state Kalman filter ({reason}), expected a detectable model whose undamped "
        f"modes are excited; give every such mode some process noise"
    )
