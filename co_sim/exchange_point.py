"""A Model Exchange FMU at its present point: states that can be moved, derivatives, and the linear model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.local_model import central_differences

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from co_sim.component import Vector
    from co_sim.exchange_binding import ExchangeBinding
    from co_sim.exchange_model import ExchangeModel
    from co_sim.kernel import Matrix

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

    @property
    def moving_inputs(self) -> Vector:
        """Which inputs may change in continuous-time mode, as booleans."""
        is_moving = np.zeros(int(self._binding.table["n_inputs"]), dtype=bool)
        is_moving[self._binding.arrays["smooth"]] = True
        return is_moving

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

    def jacobian(
        self, u: Vector, directional: Callable[[Vector], Vector] | None = None
    ) -> tuple[Matrix, float]:
        """Return the partial derivatives of derivatives and outputs with respect to states and inputs.

        Parameters
        ----------
        u : the inputs of the point, where the instance is left.
        directional : returns the change of derivatives and outputs in a direction of states and moving
            inputs; ``None`` takes central differences.

        Returns
        -------
        The matrix ``[[A, B], [C, D]]`` with zeros for inputs that change at events only, and its estimated
        error relative to its largest element.
        """
        x = self.states()
        moving = np.concatenate([np.ones(x.size, dtype=bool), self.moving_inputs])
        self.set_inputs(u)
        w = np.concatenate([x, u])

        def evaluate(v: Vector) -> Vector:
            w[moving] = v
            self.set_states(w[: x.size])
            self.set_inputs(w[x.size :])
            return np.concatenate([self.derivatives(), self.outputs()])

        if directional is None:
            columns, error = central_differences(evaluate, w[moving])
            self.set_states(x)
            self.set_inputs(u)
        else:
            columns, error = np.array([directional(seed) for seed in np.eye(moving.sum())]).T, 0.0
        whole = np.zeros((x.size + len(self.outputs()), moving.size))
        if moving.any():
            whole[:, moving] = columns
        return whole, error
