"""Design of steady-state Kalman filters from continuous linear models.

Symbols: ``F`` transition, ``H`` measurement, ``Q`` process and ``R`` measurement noise covariance of one
step, ``P`` covariance of the predicted state, ``S`` of the innovation, ``K`` gain. The filter is

    x^- = F x,   e = z - H x^-,   x = x^- + K e .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.discretisation import discretise
from estimator.structure.subspaces import observable_part

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
