"""The identifier as a component of the co-simulation: measurements in, residuals and probabilities out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.component import Component, Port
from estimator.residuals import duels, equal_level

if TYPE_CHECKING:
    from co_sim.component import Vector
    from estimator import Identifier

__all__ = ["MEASUREMENTS", "IdentifierComponent"]

#: The measurements of (14), in the order of the filters, with their units.
MEASUREMENTS = (("yaw_rate", "rad/s"), ("lateral_acceleration", "m/s2"))


class IdentifierComponent(Component):
    """Runs an `Identifier` on every `period`-th step and holds its outputs in between.

    Inputs are the two measurements. Outputs, for each filter of the bank: ``E.NAME`` (normalised
    residual (15)), ``p.NAME`` (fuzzy probability) and the innovations ``e_yaw_rate.NAME`` and
    ``e_lateral_acceleration.NAME``.

    Parameters
    ----------
    identifier : designed for the sampling period of the sensors.
    period : that period, in steps of the master.
    """

    def __init__(self, identifier: Identifier, *, period: int = 1) -> None:
        names = identifier.bank.names
        super().__init__(
            inputs=[Port(name, unit, description=f"measured {name}") for name, unit in MEASUREMENTS],
            outputs=[
                *(Port(f"E.{name}", description=f"normalised residual of {name}") for name in names),
                *(Port(f"p.{name}", description=f"probability of {name}") for name in names),
                *(
                    Port(f"e_{measured}.{name}", unit, description=f"innovation of {name}")
                    for name in names
                    for measured, unit in MEASUREMENTS
                ),
            ],
        )
        self._identifier = identifier
        self._period = period
        n = len(names)
        self._E, self._p, self._e = np.empty(n), np.empty(n), np.empty((n, len(MEASUREMENTS)))
        self._countdown = 0

    def start(self, t0: float, h: float) -> None:
        """Forget all samples."""
        self._identifier.reset()
        self._countdown = 0
        self._E[:] = equal_level(len(self._E))
        self._p[:] = self._identifier.fuzzy(duels(self._E))
        self._e[:] = 0.0

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write what can be said before the first sample: all filters are equally good."""
        self._write(y)

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Take the sample `u` (2,) if one is due."""
        if self._countdown == 0:
            self._identifier.step(u, self._e, self._E, self._p)
            self._countdown = self._period
        self._countdown -= 1
        self._write(y)

    def _write(self, y: Vector) -> None:
        n = len(self._E)
        y[:n] = self._E
        y[n : 2 * n] = self._p
        y[2 * n :] = self._e.ravel()
