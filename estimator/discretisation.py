"""Exact discretisation of linear models, and with it the Gramian of a finite horizon."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

__all__ = ["discretise"]

Array = NDArray[np.float64]


def discretise(A: Array, G: Array, W: Array, h: float) -> tuple[Array, Array]:
    """Discretise ``dx = A x dt + G dw`` exactly (Van Loan 1978), with doubling for stiff models.

    The method carries ``exp(-A h)``, which swamps Q where a mode decays within a fraction of `h`. So Q is
    found over ``h / 2^d``, short against the fastest mode, and doubled: ``Q(2h) = Q(h) + F Q(h) F'``.

    Parameters
    ----------
    A : (s, s). G : (s, n). W : (n, n) two-sided intensity of the white noise. h : step, s.

    Returns
    -------
    (F, Q) : transition (s, s) and noise covariance (s, s) of one step. With ``W = I`` Q is also the
    controllability Gramian of ``(A, G)`` over the horizon `h`.
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
