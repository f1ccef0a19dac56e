r"""Gramians and Hankel singular values: in energies, what inputs reach and what outputs see.

With P the Gramian of controllability and Q that of observability, ``x' P^-1 x`` is the least input energy
``int u'u dt`` that brings the model from rest to x, and ``x' Q x`` the output energy ``int y'y dt`` that x
leaves. Hankel singular values, the roots of the eigenvalues of PQ, join both and do not depend on the units
of the states.

Over an infinite time the integrals exist only where all modes decay. Elsewhere there are two answers: a
finite horizon, and the split in a decaying and a growing part (Zhou, Salomon & Wu 1999), with the growing
one run backwards in time, which is also the integral of the frequency response over the imaginary axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.discretisation import discretise
from estimator.structure.modes import modes
from estimator.structure.scaling import natural_scales
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from estimator.structure.scaling import Scales

__all__ = ["Gramians", "gramians"]

Array = NDArray[np.float64]
Method = Literal["slycot", "scipy"]
Kind = Literal["infinite", "finite", "split"]

#: Hankel singular values below this part of the largest are lost in the rounding of P and Q.
RESOLUTION = 1e-8


@dataclass(frozen=True, eq=False)
class Gramians:
    """Gramians of a model in its own units, and its Hankel singular values.

    Parameters
    ----------
    kind : ``"infinite"`` horizon, where all modes decay; ``"finite"`` horizon; ``"split"`` in a decaying and
        a growing part, infinite each.
    horizon : s; infinite but for a finite horizon.
    inputs, outputs, states : names. state_units : units.
    controllability, observability : (n, n) P and Q.
    hankel : (n,) Hankel singular values, largest first; below `RESOLUTION` of the first they are rounding.
        They add energies of all signals, so give signals of different units one measure first: inputs in
        multiples of what is usual, outputs in multiples of their noise.
    scaled_controllability, scaled_observability : (n,) eigenvalues of P and Q in the scaled units of
        states, largest first: how unlike the directions are.
    """

    kind: Kind
    horizon: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    controllability: Array
    observability: Array
    hankel: Array
    scaled_controllability: Array
    scaled_observability: Array


def gramians(
    model: control.StateSpace | LinearSystem,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    horizon: float | None = None,
    scales: Scales | None = None,
    method: Method | None = None,
) -> Gramians:
    """Return the Gramians of a model for some inputs and outputs (all if ``None``).

    Parameters
    ----------
    model : continuous or sampled.
    horizon : s; ``None`` asks for an infinite one, and for the split where some mode grows.
    scales : of the states, for the eigenvalues in scaled units; `natural_scales` if ``None``. Units of
        inputs and outputs are kept.
    method : who solves the Lyapunov equations; ``None`` takes slycot where it is installed, else scipy.

    Raises
    ------
    ValueError
        If a mode neither decays nor grows and no horizon is given, the horizon is not positive or so long
        that the growth overflows, or the model has no signal of that name.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    part = system.select(inputs=inputs, outputs=outputs)
    x = scales.states
    A, B, C = part.A / x[:, None] * x, part.B / x[:, None], part.C * x
    kind = _kind(system, scales, horizon)
    if kind == "finite":
        assert horizon is not None
        P, Q = (_over_horizon(M, N, horizon, part.dt) for M, N in ((A, B), (A.T, C.T)))
    else:
        P, Q = _over_all_time(A, B, C, part.dt, kind, method)
    hankel, p, q = _hankel(P, Q)
    return Gramians(
        kind,
        np.inf if horizon is None else horizon,
        part.inputs,
        part.outputs,
        part.states,
        part.state_units,
        controllability=P * np.outer(x, x),
        observability=Q / np.outer(x, x),
        hankel=hankel,
        scaled_controllability=p,
        scaled_observability=q,
    )


def _kind(system: LinearSystem, scales: Scales, horizon: float | None) -> Kind:
    if horizon is not None:
        if not (np.isfinite(horizon) and horizon > 0.0):
            raise ValueError(
                f"horizon: got {horizon} s, expected a finite time > 0; leave it out for an infinite one"
            )
        return "finite"
    found = modes(system, scales=scales)
    undamped = [mode for mode in found if mode.behaviour == "undamped"]
    if undamped:
        names = ", ".join(f"{mode.exponent:.4g} 1/s ({mode.dominant})" for mode in undamped)
        raise ValueError(
            f"Gramians: got modes that neither decay nor grow: {names}; expected none over an infinite time; "
            f"give a finite horizon"
        )
    return "split" if any(mode.behaviour == "grows" for mode in found) else "infinite"


def _over_horizon(A: Array, B: Array, horizon: float, dt: float) -> Array:
    """Return ``int e^(A t) B B' e^(A' t) dt``, or ``sum A^k B B' A'^k dt``, over the horizon."""
    if not dt:
        with np.errstate(over="ignore", invalid="ignore"):
            _, P = discretise(A, B, np.eye(B.shape[1]), horizon)
    else:
        P, step = np.zeros_like(A), B
        for _ in range(max(1, round(horizon / dt))):
            P, step = P + step @ step.T, A @ step
    if not np.all(np.isfinite(P)):
        raise ValueError(
            f"horizon: got {horizon:g} s, in which a growing mode overflows; expected a few of its time "
            f"constants; give a shorter horizon"
        )
    return P


def _over_all_time(
    A: Array, B: Array, C: Array, dt: float, kind: Kind, method: Method | None
) -> tuple[Array, Array]:
    if kind == "infinite":
        return _lyapunov(A, B @ B.T, dt, method), _lyapunov(A.T, C.T @ C, dt, method)
    T, decaying = _split(A, dt)
    A, B, C = linalg.solve(T, A @ T), linalg.solve(T, B), C @ T
    P, Q = np.zeros_like(A), np.zeros_like(A)
    for part, backwards in ((decaying, False), (~decaying, True)):
        i = np.ix_(part, part)
        F, G, H = _reversed(A[i], B[part], C[:, part], dt) if backwards else (A[i], B[part], C[:, part])
        P[i], Q[i] = _lyapunov(F, G @ G.T, dt, method), _lyapunov(F.T, H.T @ H, dt, method)
    return T @ P @ T.T, linalg.solve(T.T, linalg.solve(T.T, Q).T)


def _reversed(A: Array, B: Array, C: Array, dt: float) -> tuple[Array, Array, Array]:
    """Return a growing part run backwards in time; for samples ``x- = A^-1 (x - B u)``."""
    if not dt:
        return -A, B, C
    back = linalg.solve(A, np.hstack([np.eye(A.shape[0]), B]))
    F, G = back[:, : A.shape[0]], back[:, A.shape[0] :]
    return F, G, linalg.solve(A.T, C.T).T


def _split(A: Array, dt: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return T whose columns span the decaying and the growing part, and which belong to the first."""
    R, Z, k = linalg.schur(A, output="real", sort="iuc" if dt else "lhp")
    # R11 X - X R22 = -R12 makes the blocks independent.
    X = linalg.solve_sylvester(R[:k, :k], -R[k:, k:], -R[:k, k:])
    T = Z.copy()
    T[:, k:] += Z[:, :k] @ X
    return T, np.arange(A.shape[0]) < k


def _lyapunov(A: Array, Q: Array, dt: float, method: Method | None) -> Array:
    """Solve ``A X + X A' + Q = 0``, or ``A X A' - X + Q = 0``."""
    import control

    if not A.size:
        return np.zeros_like(A)
    solve = control.dlyap if dt else control.lyap
    X = np.asarray(solve(A, (Q + Q.T) / 2.0, method=method), dtype=np.float64)
    return (X + X.T) / 2.0


def _hankel(P: Array, Q: Array) -> tuple[Array, Array, Array]:
    """Return the Hankel singular values through square roots of P and Q, and the eigenvalues of both."""
    (p, U), (q, V) = np.linalg.eigh(P), np.linalg.eigh(Q)
    p, q = np.maximum(p, 0.0), np.maximum(q, 0.0)
    hankel = np.linalg.svd((V * np.sqrt(q)).T @ (U * np.sqrt(p)), compute_uv=False)
    return hankel, p[::-1], q[::-1]
