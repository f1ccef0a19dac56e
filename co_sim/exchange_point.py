"""States and derivatives of a Model Exchange FMU at its present point, for linearisation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from co_sim.component import Vector
    from co_sim.exchange_binding import ExchangeBinding
    from co_sim.exchange_model import ExchangeModel

__all__ = ["PresentPoint"]


class PresentPoint:
    """The point of time, states and inputs at which an instance stands between two steps.

    States and inputs may be moved, and derivatives and outputs be taken, as often as wanted. States stay
    as they are set and the next step begins with them; inputs are those of the next step again.
    Arrays have an element for each element of the states, the inputs or the outputs. Calls that the FMU
    refuses raise `co_sim.fmi.FmuError`.
    """

    def __init__(self, model: ExchangeModel, binding: ExchangeBinding) -> None:
        self._model = model
        self._binding = binding

    @property
    def time(self) -> float:
        """Time of the point, s."""
        return float(self._binding.table["time"])

    def states(self) -> Vector:
        """Return the states."""
        return np.array(self._binding.arrays["x"])

    def set_states(self, x: ArrayLike) -> None:
        """Set all states."""
        states = self._binding.arrays["x"]
        states[:] = x
        self._model.transfer_array("set_states", states)

    def set_inputs(self, u: ArrayLike) -> None:
        """Set the inputs that may change in continuous-time mode, given all inputs."""
        self._binding.set_smooth(np.asarray(u, dtype=np.float64))

    def derivatives(self) -> Vector:
        """Return the derivatives of the states, in their unit per s."""
        return self._model.transfer_array("get_derivatives", np.zeros(self._binding.arrays["x"].size))

    def nominals(self) -> Vector:
        """Return the typical magnitudes of the states, which may change at events."""
        return self._model.transfer_array("get_nominals", np.zeros(self._binding.arrays["x"].size))

    def outputs(self) -> Vector:
        """Return the outputs."""
        return self._binding.outputs()
