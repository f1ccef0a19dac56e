"""Kalman filters whose covariance moves until it stands still.

Where a steady-state filter exists, its gain is reached after the start, and again after samples that were
missing; where none does, as for an undamped mode that nothing excites, the covariance moves for ever.
`estimator.likelihood` runs both kinds side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.kalman import NoSteadyStateError, discretise, steady_covariance, visible_model

if TYPE_CHECKING:
    import control

__all__ = ["RecursiveFilter", "design_recursive"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RecursiveFilter:
    """A Kalman filter by its model.

    Parameters
    ----------
    name : the hypothesis that the filter stands for.
    F : (s, s) transition. H : (m, s) measurement. Q : (s, s), R : (m, m) noise covariances of one step.
    start : (s,) variances of the states before the first sample.
    P : (s, s) steady covariance of the predicted state, None where there is none.
    states : names of the filter's states.
    dropped : names of the model's states that the measurements cannot see and the filter leaves out.
    """

    name: str
    F: Array
    H: Array
    Q: Array
    R: Array
    start: Array
    P: Array | None
    states: tuple[str, ...]
    dropped: tuple[str, ...] = ()


def design_recursive(
    model: control.StateSpace, W: Array, R: Array, h: float, *, start: Array, name: str
) -> RecursiveFilter:
    """Design the filter of a continuous model on its observable part.

    Parameters
    ----------
    model : inputs are white noises, outputs the measurements; no feedthrough.
    W : (n, n) two-sided intensities of the inputs. R : (m, m) noise covariance of one sample.
    h : sample time, s. start : variances of all the model's states before the first sample.
    name : of the hypothesis that the filter stands for.

    Raises
    ------
    ValueError
        If the model has feedthrough or states cannot be left out one by one.
    """
    A, G, C, kept, hidden = visible_model(model, name)
    F, Q = discretise(A, G, W, h)
    P: Array | None
    try:
        P = steady_covariance(F, C, Q, R, name)
    except NoSteadyStateError:
        P = None
    labels = list(model.state_labels)
    known = np.asarray(start, dtype=np.float64)[[labels.index(state) for state in kept]]
    return RecursiveFilter(name, F, C, Q, R, known, P, kept, hidden)
