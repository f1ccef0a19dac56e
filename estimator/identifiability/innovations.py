"""Divergences from the innovations of Kalman filters: another way to the numbers of spectra and windows.

The log-likelihood of a window is a sum over the innovations of a filter, ``-1/2 sum ln det S_k + e_k' S_k^-1
e_k``. What it is worth on average, when the samples come from this or from another model, needs covariances
only:

* divergence: the filter of q runs on samples of p, and the covariance of its innovations follows from a
  Lyapunov recursion of both states;
* Chernoff distance: ``-ln int p^(1-s) q^s`` holds the determinant of ``(1-s) Sigma_q + s Sigma_p``, which is
  the covariance of ``sqrt(1-s) z_q + sqrt(s) z_p`` with independent z_q and z_p, again a state-space model.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.identifiability.windows import steady_covariance

if TYPE_CHECKING:
    from estimator.identifiability.process import Process

__all__ = ["Divergences", "innovation_rates", "innovation_sums"]

Array = NDArray[np.float64]
Starts = tuple["Array | None", "Array | None"]


class Divergences(NamedTuple):
    """Kullback-Leibler divergence of p from q and of q from p, and ``-ln int p^(1-s) q^s``."""

    forward: Array
    backward: Array
    chernoff: Array


def innovation_sums(
    p: Process, q: Process, samples: int, *, s: float = 0.5, starts: Starts = (None, None)
) -> Divergences:
    """Return the divergences (samples,) of windows of 1, 2, ... samples, steady or not.

    Time-varying filters; `starts` are the covariances of the states at the first sample, rest where left out.
    """
    _check_pair(p, q)
    P_p, P_q = (
        np.zeros_like(x.F) if start is None else start for x, start in zip((p, q), starts, strict=True)
    )
    logs_p, own_p = _log_likelihood(p, P_p, p, P_p, samples)
    logs_q, own_q = _log_likelihood(q, P_q, q, P_q, samples)
    mixture = _mixture(p, q, s)
    start = linalg.block_diag(P_p, P_q)
    mixed, _ = _log_likelihood(mixture, start, mixture, start, samples)
    return Divergences(
        own_p - _log_likelihood(p, P_p, q, P_q, samples)[1],
        own_q - _log_likelihood(q, P_q, p, P_p, samples)[1],
        0.5 * (mixed - (1.0 - s) * logs_q - s * logs_p),
    )


def innovation_rates(p: Process, q: Process, *, s: float = 0.5) -> Divergences:
    """Return the rates of the divergences, 1/s, of two single processes from steady-state filters.

    The Riccati equation of each process, and the Lyapunov equation of its filter on samples of the other.

    Raises
    ------
    ValueError
        If a process has no steady state.
    """
    _check_pair(p, q)
    if not (p.steady() and q.steady()):
        raise ValueError(
            "innovation rates: got a process with modes that do not decay, expected a steady state; use "
            "innovation_sums for a window"
        )
    S_p, S_q, S_mix = (_steady_filter(x)[0] for x in (p, q, _mixture(p, q, s)))
    logs_p, logs_q, logs_mix = (float(np.linalg.slogdet(S)[1]) for S in (S_p, S_q, S_mix))
    m = len(p.outputs)
    forward = 0.5 * (_steady_mismatch(p, q) + logs_q - logs_p - m)
    backward = 0.5 * (_steady_mismatch(q, p) + logs_p - logs_q - m)
    chernoff = 0.5 * (logs_mix - (1.0 - s) * logs_q - s * logs_p)
    return Divergences(*(np.asarray(value / p.h) for value in (forward, backward, chernoff)))


def _check_pair(p: Process, q: Process) -> None:
    if p.outputs != q.outputs or p.h != q.h or p.batch or q.batch:
        raise ValueError(
            f"pair of processes: got {p.outputs} every {p.h:g} s and {q.outputs} every {q.h:g} s, expected "
            "two single processes with the same measurements and sample time; observe both alike"
        )


def _mixture(p: Process, q: Process, s: float) -> Process:
    """Return the process ``sqrt(1-s) z_q + sqrt(s) z_p`` with p and q independent."""
    H = np.hstack([math.sqrt(s) * p.H, math.sqrt(1.0 - s) * q.H])
    F, Q = linalg.block_diag(p.F, q.F), linalg.block_diag(p.Q, q.Q)
    return replace(p, F=F, Q=Q, H=H, R=s * p.R + (1.0 - s) * q.R)


def _steady_filter(x: Process) -> tuple[Array, Array]:
    """Return the covariance (m, m) of the innovations and the gain (s, m) of the steady-state filter."""
    P = linalg.solve_discrete_are(x.F.T, x.H.T, x.Q, x.R)
    S = x.H @ P @ x.H.T + x.R
    return S, linalg.solve(S, x.H @ P, assume_a="pos").T


def _steady_mismatch(truth: Process, model: Process) -> float:
    """Return ``tr(S^-1 E[e e'])`` of the steady-state filter of `model` on samples of `truth`."""
    S, K = _steady_filter(model)
    joint = _joint(truth, model, K)
    e = joint.H @ steady_covariance(joint) @ joint.H.T + truth.R
    return float(np.trace(linalg.solve(S, e, assume_a="pos")))


def _joint(truth: Process, model: Process, K: Array) -> Process:
    """Return the innovations of a filter with gain K on samples of `truth`: its state beside the filter's."""
    s, r = truth.F.shape[0], model.F.shape[0]
    FK = model.F @ K
    F = np.block([[truth.F, np.zeros((s, r))], [FK @ truth.H, model.F - FK @ model.H]])
    Q = linalg.block_diag(truth.Q, FK @ truth.R @ FK.T)
    return replace(truth, F=F, Q=Q, H=np.hstack([truth.H, -model.H]))


def _log_likelihood(
    truth: Process, truth_start: Array, model: Process, model_start: Array, samples: int
) -> tuple[Array, Array]:
    """Return the sums of ``ln det S_k`` and of the mean log-likelihood, less 2 pi, on samples of `truth`."""
    logs, terms = np.empty(samples), np.empty(samples)
    P, _s = model_start, truth.F.shape[0]
    covariance = linalg.block_diag(truth_start, np.zeros_like(model_start))
    for k in range(samples):
        S = model.H @ P @ model.H.T + model.R
        K = np.asarray(np.linalg.solve(S, model.H @ P).T, dtype=np.float64)
        joint = _joint(truth, model, K)
        e = joint.H @ covariance @ joint.H.T + truth.R
        logs[k] = np.linalg.slogdet(S)[1]
        terms[k] = -0.5 * (logs[k] + np.trace(np.linalg.solve(S, e)))
        covariance = joint.F @ covariance @ joint.F.T + joint.Q
        keep = np.eye(model.F.shape[0]) - K @ model.H
        P = model.F @ (keep @ P @ keep.T + K @ model.R @ K.T) @ model.F.T + model.Q
    return np.cumsum(logs), np.cumsum(terms)
