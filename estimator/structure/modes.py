"""The modes of a model: how fast and how damped, in which states they move and through which they are met."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from estimator.structure.scaling import natural_scales, scaled
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    import control

    from estimator.structure.scaling import Scales

__all__ = ["Mode", "modes"]

Complex = NDArray[np.complex128]
Array = NDArray[np.float64]

_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Mode:
    """One eigenvalue of a model with its motion.

    Parameters
    ----------
    eigenvalue : of the model's A; 1/s, or for one step of a sampled model.
    uncertainty : how far rounding may have moved it.
    states : names. state_units : units.
    shape : (n,) right eigenvector in the model's units: the motion in which the largest state, in scaled
        units, is as large as its scale and real. scaled_shape : (n,) the same in scaled units, of norm one.
    adjoint : (n,) left eigenvector in scaled units, of norm one: how much of each state is in the mode.
    participation : (n,) ``|w_i v_i|`` over ``|w' v|``, the same in all units (Perez-Arriaga 1982); nan
        where eigenvectors meet (a chain of integrators) and none is defined.
    dt : sampling time, s; 0 for a continuous model.
    """

    eigenvalue: complex
    uncertainty: float
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    shape: Complex
    scaled_shape: Complex
    adjoint: Complex
    participation: Array
    dt: float = 0.0

    @property
    def exponent(self) -> complex:
        """The eigenvalue of the continuous motion, 1/s: ``log(eigenvalue)/dt`` for a sampled model."""
        if not self.dt:
            return self.eigenvalue
        return cmath.log(self.eigenvalue) / self.dt if self.eigenvalue else complex(-math.inf)

    @property
    def growth(self) -> float:
        """Growth rate, 1/s: negative where the mode decays; 0 where rounding alone decides the sign."""
        inside = abs(self.eigenvalue) - 1.0 if self.dt else self.eigenvalue.real
        return 0.0 if abs(inside) <= self.uncertainty else self.exponent.real

    @property
    def behaviour(self) -> str:
        """``"decays"``, ``"grows"``, or ``"undamped"`` where rounding alone decides."""
        return "undamped" if self.growth == 0.0 else "grows" if self.growth > 0.0 else "decays"

    @property
    def frequency(self) -> float:
        """Frequency of the damped oscillation, Hz; 0 for a mode that does not oscillate."""
        return abs(self.exponent.imag) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """``-Re/|s|``: 1 or -1 for a real mode, 0 for an undamped one."""
        size = abs(self.exponent)
        return -self.growth / size if self.growth != 0.0 else 0.0

    @property
    def time_constant(self) -> float:
        """Time in which the mode decays, or grows, by the factor e, s; infinite where undamped."""
        return 1.0 / abs(self.growth) if self.growth != 0.0 else math.inf

    @property
    def dominant(self) -> str:
        """Name of the state that participates most; where that is not defined, of the one that moves most."""
        share = np.abs(self.scaled_shape) if np.isnan(self.participation[0]) else self.participation
        return self.states[int(np.argmax(share.round(9)))]  # of equals the first, whatever rounding says


def modes(model: control.StateSpace | LinearSystem, *, scales: Scales | None = None) -> tuple[Mode, ...]:
    """Return the modes of a model, the slowest to decay first, and of a pair the positive frequency first.

    Parameters
    ----------
    model : continuous or sampled. scales : yardstick of mode shapes; `natural_scales` if ``None``.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    if not system.order:
        return ()
    A = scaled(system, scales).A
    A = scaled(system, scales).A
    values, left, right = linalg.eig(A, left=True, right=True)
    blur = _uncertainties(A, values, left, right)
    found = [
        _mode(system, scales, complex(values[i]), float(blur[i]), left[:, i], right[:, i])
        for i in range(system.order)
    ]
    return tuple(sorted(found, key=_slowest_first))


def _uncertainties(A: Array, values: Complex, left: Complex, right: Complex) -> Array:
    """Return how far rounding may have moved each eigenvalue of A.

    First order: rounding of the size of A over the cosine between the two eigenvectors (of norm one). Where
    k eigenvalues meet, that is unbounded, and the k-th root of rounding bounds it.
    """
    n, size = A.shape[0], float(np.linalg.norm(A, 2))
    rounding = n * _EPS
    cosine = np.abs(np.sum(left.conj() * right, axis=0))
    simple = rounding / np.maximum(cosine, np.finfo(np.float64).tiny)
    near = np.abs(np.subtract.outer(values, values)) <= rounding ** (1.0 / n) * size
    company = np.sum(near, axis=1)
    met = np.where(company > 1, rounding ** (1.0 / company), np.inf)
    return np.asarray(size * np.minimum(simple, np.minimum(met, 1.0)))


def _mode(system: LinearSystem, scales: Scales, value: complex, blur: float, w: Complex, v: Complex) -> Mode:
    largest = int(np.argmax(np.abs(v).round(12)))
    scaled_shape = v * (abs(v[largest]) / v[largest])
    product = abs(np.vdot(w, v))
    defective = product <= system.order * _EPS
    return Mode(
        eigenvalue=value / scales.time,
        uncertainty=blur / scales.time,
        states=system.states,
        state_units=system.state_units,
        shape=scaled_shape / abs(v[largest]) * scales.states,
        scaled_shape=scaled_shape,
        adjoint=w,
        participation=np.full(system.order, np.nan) if defective else np.abs(w * v) / product,
        dt=system.dt,
    )


def _slowest_first(mode: Mode) -> tuple[float, float, float]:
    s = mode.exponent
    return (-s.real, abs(s.imag), -s.imag)
