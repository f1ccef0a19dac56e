"""What sensors sample of a linear model that white noise drives, and how it changes with parameters.

Symbols: ``x_k+1 = F x_k + w_k, z_k = H x_k + n_k`` with noise covariances ``Q`` and ``R``. Arrays may have
leading axes, a batch of processes that share sensors and sample time: p parameters, s states, m measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.discretisation import discretise

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

__all__ = ["Family", "Process", "Sensor", "differentiate", "observe", "stack"]

Array = NDArray[np.float64]
#: What picks members of a batch.
Index: TypeAlias = "int | slice | tuple[int | slice, ...] | NDArray[np.bool_] | NDArray[np.int64]"

#: Step of the central differences, in units of a parameter's scale.
_STEP = 1e-4
#: Decay of the slowest mode, 1/s, below which a process counts as one without a steady state: rounding of a
#: mode that stands still, and slower than any window.
_DECAY = 1e-6


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor of one output of a model.

    Parameters
    ----------
    output : name of the output.
    noise : rms of the white noise of one sample, in the output's unit.
    bandwidth : corner frequency (-3 dB) of a first-order low-pass before sampling, Hz; ``None`` is unlimited.
    """

    output: str
    noise: float
    bandwidth: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise) and self.noise > 0.0):
            raise ValueError(
                f"sensor of {self.output}: got a noise of {self.noise:g} rms, expected a finite value > 0; "
                "without noise every window, however short, tells all"
            )
        if self.bandwidth is not None and not (math.isfinite(self.bandwidth) and self.bandwidth > 0.0):
            raise ValueError(
                f"sensor of {self.output}: got a bandwidth of {self.bandwidth:g} Hz, expected a finite value "
                "> 0; use None for a sensor without low-pass"
            )


@dataclass(frozen=True, eq=False)
class Process:
    """A sampled Gaussian process of mean zero, or a batch of them.

    Parameters
    ----------
    F, Q : (..., s, s). H : (..., m, s). R : (m, m). h : sample time, s. outputs : names of what is measured.
    """

    F: Array
    Q: Array
    H: Array
    R: Array
    h: float
    outputs: tuple[str, ...]

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch."""
        return self.F.shape[:-2]

    def poles(self) -> NDArray[np.complex128]:
        """Return the poles (..., s) in 1/s, with frequencies up to pi/h."""
        eigenvalues = np.linalg.eigvals(self.F).astype(np.complex128)
        return np.asarray(np.log(np.where(eigenvalues == 0.0, np.finfo(float).tiny, eigenvalues)) / self.h)

    def steady(self) -> NDArray[np.bool_]:
        """Return where (...) all modes decay, so that a steady state exists."""
        return np.asarray(np.max(self.poles().real, axis=-1) < -_DECAY)

    def select(self, outputs: Sequence[str]) -> Process:
        """Return the process that only the sensors of `outputs` see.

        Raises
        ------
        ValueError
            If one of them is not measured.
        """
        rows = _rows(self, outputs)
        return replace(self, H=self.H[..., rows, :], R=self.R[np.ix_(rows, rows)], outputs=tuple(outputs))

    def __getitem__(self, index: Index) -> Process:
        """Return the processes at an index of the batch."""
        F, Q, H = (np.asarray(M)[index] for M in (self.F, self.Q, self.H))
        return replace(self, F=F, Q=Q, H=H)


@dataclass(frozen=True, eq=False)
class Family:
    """A process and its derivatives with respect to parameters.

    Parameters
    ----------
    process : at the point of interest, or a batch of points.
    dF, dQ : (p, ..., s, s). dH : (p, ..., m, s).
    names : of the parameters. scale : (p,) size of a change that would matter.
    """

    process: Process
    dF: Array
    dQ: Array
    dH: Array
    names: tuple[str, ...]
    scale: Array

    def select(self, outputs: Sequence[str]) -> Family:
        """Return the family that only the sensors of `outputs` see."""
        rows = _rows(self.process, outputs)
        return replace(self, process=self.process.select(outputs), dH=self.dH[..., rows, :])

    def __getitem__(self, index: Index) -> Family:
        """Return the families at an index of the batch."""
        at = (slice(None), *(index if isinstance(index, tuple) else (index,)))
        dF, dQ, dH = (np.asarray(M)[at] for M in (self.dF, self.dQ, self.dH))
        return replace(self, process=self.process[index], dF=dF, dQ=dQ, dH=dH)


def _rows(process: Process, outputs: Sequence[str]) -> list[int]:
    missing = sorted(set(outputs) - set(process.outputs))
    if missing or not outputs:
        raise ValueError(
            f"sensors: got {', '.join(missing) or 'none'}, expected some of {', '.join(process.outputs)}; "
            "observe the model with these sensors first"
        )
    return [process.outputs.index(name) for name in outputs]


def observe(model: control.StateSpace, sensors: Sequence[Sensor], h: float) -> Process:
    """Return what `sensors` sample of a model whose inputs are white noises of unit intensity.

    Parameters
    ----------
    model : continuous, with named outputs. sensors : in the order of the measurements. h : sample time, s.

    Raises
    ------
    ValueError
        If an output is unknown, or white noise reaches a sensor that has no low-pass.
    """
    A, G, C = _sensed(model, sensors, h)
    F, Q = discretise(A, G, np.eye(G.shape[1]), h)
    return Process(F, Q, C, _noise(sensors), h, tuple(sensor.output for sensor in sensors))


def differentiate(
    move: Callable[[Array], control.StateSpace],
    names: Sequence[str],
    scale: Sequence[float],
    sensors: Sequence[Sensor],
    h: float,
) -> Family:
    """Return what `sensors` sample of a model, and its derivatives with respect to parameters.

    The sensitivity ``xi = dx`` obeys ``dxi = (A xi + dA x) dt + dG dw``. Sampled together with the state it
    gives dF and dQ without differences of exponentials, so that what vanishes does vanish.

    Parameters
    ----------
    move : returns the model with the parameters changed by an offset (p,); see `observe`.
    names : of the parameters. scale : (p,) size of a change that would matter, all > 0: it sets the step
        of the differences and what counts as knowing nothing.
    sensors, h : as in `observe`.

    Raises
    ------
    ValueError
        As `observe`, or if the scales do not fit.
    """
    sizes = np.asarray(scale, dtype=np.float64)
    if sizes.shape != (len(names),) or not np.all(np.isfinite(sizes) & (sizes > 0.0)):
        raise ValueError(
            f"scale: got {sizes.tolist()}, expected a value > 0 for each of {', '.join(names)}; give the "
            "size of a change that would matter"
        )
    model = move(np.zeros(sizes.size))
    A, G, _C = _sensed(model, sensors, h)
    slopes = []
    for step in np.diag(_STEP * sizes):
        ahead, behind = (_sensed(move(offset), sensors, h) for offset in (step, -step))
        dA, dG, dC = ((x - y) / (2.0 * step.sum()) for x, y in zip(ahead, behind, strict=True))
        slopes.append((*_sampled_slope(A, G, dA, dG, h), dC))
    dF, dQ, dH = (np.stack(M) for M in zip(*slopes, strict=True))
    return Family(observe(model, sensors, h), dF, dQ, dH, tuple(names), sizes)


def _sampled_slope(A: Array, G: Array, dA: Array, dG: Array, h: float) -> tuple[Array, Array]:
    """Return dF and dQ."""
    s = A.shape[0]
    joint = np.block([[A, np.zeros((s, s))], [dA, A]])
    F, Q = discretise(joint, np.vstack([G, dG]), np.eye(G.shape[1]), h)
    return F[s:, :s], Q[s:, :s] + Q[:s, s:]


def _sensed(model: control.StateSpace, sensors: Sequence[Sensor], h: float) -> tuple[Array, Array, Array]:
    """Return A, G, C with the sensors' low-passes."""
    if not (math.isfinite(h) and h > 0.0):
        raise ValueError(f"sample time: got {h:g} s, expected a finite value > 0; give it in seconds")
    labels = list(model.output_labels)
    unknown = sorted({sensor.output for sensor in sensors} - set(labels))
    if unknown or not sensors:
        raise ValueError(
            f"sensors: got {', '.join(unknown) or 'none'}, expected some of {', '.join(labels)}; choose "
            "outputs of the model"
        )
    rows = [labels.index(sensor.output) for sensor in sensors]
    A, G = np.asarray(model.A, dtype=np.float64), np.asarray(model.B, dtype=np.float64)
    C, D = np.asarray(model.C, dtype=np.float64)[rows], np.asarray(model.D, dtype=np.float64)[rows]
    for i, sensor in enumerate(sensors):
        if sensor.bandwidth is not None:
            A, G, C, D = _low_pass(A, G, C, D, i, 2.0 * math.pi * sensor.bandwidth)
        elif np.any(D[i]):
            raise ValueError(
                f"sensor of {sensor.output}: got white noise in what it samples, expected a low-pass in "
                "between; give the sensor a bandwidth"
            )
    return A, G, C


def _low_pass(
    A: Array, G: Array, C: Array, D: Array, i: int, corner: float
) -> tuple[Array, Array, Array, Array]:
    """Put a low-pass with `corner` (rad/s) behind output `i`; its state comes last."""
    s, m = A.shape[0], C.shape[0]
    A = np.block([[A, np.zeros((s, 1))], [corner * C[i : i + 1], np.array([[-corner]])]])
    G = np.vstack([G, corner * D[i : i + 1]])
    C, D = np.hstack([C, np.zeros((m, 1))]), D.copy()
    C[i] = np.eye(s + 1)[s]
    D[i] = 0.0
    return A, G, C, D


def _noise(sensors: Sequence[Sensor]) -> Array:
    return np.diag(np.square([sensor.noise for sensor in sensors]))


_Batch = TypeVar("_Batch", Process, Family)


def stack(items: Sequence[_Batch]) -> _Batch:
    """Return processes, or families, of the same size, sensors and sample time as a batch.

    Raises
    ------
    ValueError
        If the sensors or sample times differ.
    """
    first = items[0]
    if isinstance(first, Family):
        families = items
        dF, dQ, dH = (np.stack([getattr(f, n) for f in families], axis=1) for n in ("dF", "dQ", "dH"))
        return replace(first, process=stack([f.process for f in families]), dF=dF, dQ=dQ, dH=dH)
    processes = items
    for other in processes:
        if other.outputs != first.outputs or other.h != first.h or not np.array_equal(other.R, first.R):
            raise ValueError(
                "batch: got processes of other sensors or sample times, expected the same; observe them alike"
            )
    F, Q, H = (np.stack([getattr(p, name) for p in processes]) for name in ("F", "Q", "H"))
    return replace(first, F=F, Q=Q, H=H)
