"""The creep law of Polach (2005) in numpy.

Written from the equations in ``docs/model.md`` and independently of the FMU's C sources, so that each
can be held against the other. Without spin; the patch and the friction law are those of the plant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from fmu_wheelset.parameters import ContactPatch, RailCondition

__all__ = ["KNEE_SLOPE", "CreepCurve"]

Array = NDArray[np.float64]

#: The linear region of a curve ends at the knee, where the tangent has fallen to this part of the initial
#: slope.
KNEE_SLOPE = 0.15
# Creep range in which the maximum is looked for: from far inside the linear region to a spinning wheel.
_CREEP_RANGE = (1e-6, 1.0)


@dataclass(frozen=True)
class CreepCurve:
    """Creep force of one wheel against creepage at constant speed, load and rail condition.

    Parameters
    ----------
    condition : friction and stiffness reduction of the rail.
    v : speed, m/s.
    N : normal load, N.
    patch : contact ellipse and Kalker coefficients.
    """

    condition: RailCondition
    v: float
    N: float = 79.7e3
    patch: ContactPatch = field(default_factory=ContactPatch)

    def __post_init__(self) -> None:
        for name, unit in (("v", "m/s"), ("N", "N")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(
                    f"{name}: got {value!r} {unit}, expected a finite value > 0 {unit}; "
                    f"a creep curve needs a rolling, loaded wheel"
                )

    def _friction(self, creep: Array) -> Array:
        c = self.condition
        return np.asarray(c.mu_0 * ((1.0 - c.A) * np.exp(-c.B * creep * self.v) + c.A))

    def _gradient(self, mu: Array, c_jj: ArrayLike) -> Array:
        """Return eps / creep, the gradient of the tangential stress."""
        p = self.patch
        return np.asarray(p.G * math.pi * p.a * p.b * np.asarray(c_jj) / (4.0 * self.N * mu))

    def _force(self, creep: Array, c_jj: ArrayLike) -> Array:
        c = self.condition
        mu = self._friction(creep)
        eps = self._gradient(mu, c_jj) * creep
        adhesion, slip = c.k_A * eps, c.k_S * eps
        return np.asarray(2.0 * self.N * mu / math.pi * (adhesion / (1.0 + adhesion**2) + np.arctan(slip)))

    def force(self, creep: ArrayLike) -> Array:
        """Return F (N) for longitudinal creepages of any shape; odd in the creepage."""
        creep = np.asarray(creep, dtype=np.float64)
        return np.asarray(np.sign(creep) * self._force(np.abs(creep), self.patch.C11))

    def forces(self, creep_x: ArrayLike, creep_y: ArrayLike) -> tuple[Array, Array]:
        """Return (f_x, f_y) in N for combined creepages that broadcast against each other."""
        lx, ly = np.broadcast_arrays(np.asarray(creep_x, np.float64), np.asarray(creep_y, np.float64))
        creep = np.hypot(lx, ly)
        moving = np.where(creep > 0.0, creep, 1.0)
        c_jj = np.hypot(self.patch.C11 * lx / moving, self.patch.C22 * ly / moving)
        F = self._force(creep, c_jj)
        return np.asarray(F * lx / moving), np.asarray(F * ly / moving)

    def tangent(self, creep: ArrayLike) -> Array:
        """Return g11 = dF/dlambda (N) at longitudinal creepages; negative past the peak."""
        creep = np.abs(np.asarray(creep, dtype=np.float64))
        c = self.condition
        mu = self._friction(creep)
        dmu = -c.B * self.v * (mu - c.mu_0 * c.A)
        eps = self._gradient(mu, self.patch.C11) * creep
        deps = self._gradient(mu, self.patch.C11) - eps / mu * dmu
        adhesion, slip = c.k_A * eps, c.k_S * eps
        shape = adhesion / (1.0 + adhesion**2) + np.arctan(slip)
        dshape = c.k_A * (1.0 - adhesion**2) / (1.0 + adhesion**2) ** 2 + c.k_S / (1.0 + slip**2)
        return np.asarray(2.0 * self.N / math.pi * (dmu * shape + mu * dshape * deps))

    def secant(self, creep: ArrayLike) -> Array:
        """Return g22 = F/lambda (N) at longitudinal creepages; the initial slope at zero creep."""
        creep = np.abs(np.asarray(creep, dtype=np.float64))
        safe = np.where(creep > 0.0, creep, 1.0)
        return np.where(creep > 0.0, self._force(safe, self.patch.C11) / safe, self.initial_slope)

    @property
    def initial_slope(self) -> float:
        """Slope at zero creep, N: Kalker's slope times (k_A + k_S)/2."""
        p, c = self.patch, self.condition
        return p.G * p.a * p.b * p.C11 * (c.k_A + c.k_S) / 2.0

    @cached_property
    def peak_creep(self) -> float:
        """Creepage of the greatest force.

        Raises
        ------
        ValueError
            If the force still grows at 100 % creep, as it does at very low speed.
        """
        grid = np.geomspace(*_CREEP_RANGE, 400)
        best = int(np.argmax(self.force(grid)))
        if best in {0, grid.size - 1}:
            raise ValueError(
                f"creep curve: got no maximum below {_CREEP_RANGE[1]:.0%} creep at {self.v:g} m/s, "
                f"expected one inside; friction does not fall with slip speed here, so choose a higher speed"
            )
        return float(brentq(self.tangent, grid[best - 1], grid[best + 1], xtol=1e-15, rtol=1e-14))

    @cached_property
    def knee_creep(self) -> float:
        """Creepage at which the tangent has fallen to `KNEE_SLOPE` of the initial slope."""
        wanted = KNEE_SLOPE * self.initial_slope
        return float(brentq(lambda creep: float(self.tangent(creep)) - wanted, 0.0, self.peak_creep))

    @cached_property
    def peak_adhesion(self) -> float:
        """Greatest force over the normal load."""
        return float(self.force(self.peak_creep)) / self.N

    def creep_at(self, adhesion: float) -> float:
        """Return the creepage below the peak at which F/N is `adhesion`.

        Raises
        ------
        ValueError
            If the curve does not reach that adhesion.
        """
        if not 0.0 < adhesion < self.peak_adhesion:
            raise ValueError(
                f"creep curve: got adhesion {adhesion:g}, expected between 0 and the maximum "
                f"{self.peak_adhesion:.4g} at {self.v:g} m/s; ask for less"
            )
        return float(
            brentq(
                lambda creep: float(self.force(creep)) / self.N - adhesion, 0.0, self.peak_creep, xtol=1e-15
            )
        )
