"""States and derivatives of a Model Exchange FMU at its present point, for linearisation."""

from __future__ import annotations

from ctypes import c_size_t, c_void_p
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fmpy.model_description import ModelVariable
    from numpy.typing import ArrayLike, NDArray

    from co_sim.component import Vector
    from co_sim.exchange_model import ExchangeModel

    References = NDArray[np.uint32]

__all__ = ["Jacobians", "PresentPoint"]


class Jacobians(NamedTuple):
    """Partial derivatives of the derivatives of the states (A, B) and of the outputs (C, D).

    With respect to the states: A (n, n) and C (q, n); to the inputs: B (n, p) and D (q, p). Inputs that
    change at events only have columns of zeros.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]


class PresentPoint:
    """The point of time, states and inputs at which an instance stands between two steps.

    States and inputs may be moved and derivatives and outputs be taken as often as wanted. States stay
    as they are set and the next step begins with them; inputs are those of the next step again.
    Arrays have an element for each element of `ExchangeFmu.states`, of its inputs or of its outputs. Calls
    that the FMU refuses raise `co_sim.fmi.FmuError`.
    """

    def __init__(
        self,
        model: ExchangeModel,
        states: Sequence[ModelVariable],
        derivatives: Sequence[ModelVariable],
        provides_jacobians: bool,
    ) -> None:
        self._model = model
        self._states = _references(states)
        self._derivatives = _references(derivatives)
        self._provides_jacobians = provides_jacobians

    @property
    def time(self) -> float:
        """Time of the point, s."""
        return float(self._model.table["time"])

    def states(self) -> Vector:
        """Return the states."""
        return np.array(self._model.arrays["x"])

    def set_states(self, x: ArrayLike) -> None:
        """Set all states."""
        states = self._model.arrays["x"]
        states[:] = x
        self._transfer("set_states", states)

    def set_inputs(self, u: ArrayLike) -> None:
        """Set the inputs that may change in continuous-time mode, given all inputs."""
        values = self._model.arrays["smooth_values"]
        values[:] = np.asarray(u, dtype=float)[self._model.arrays["smooth"]]
        self._model.transfer("set_floats", self._model.arrays["smooth_references"], values)

    def derivatives(self) -> Vector:
        """Return the derivatives of the states, in their unit per s."""
        return self._transfer("get_derivatives", np.zeros(self._model.arrays["x"].size))

    def nominals(self) -> Vector:
        """Return the typical magnitudes of the states, which may change at events."""
        return self._transfer("get_nominals", np.zeros(self._model.arrays["x"].size))

    def outputs(self) -> Vector:
        """Return the outputs."""
        references = self._model.arrays["output_references"]
        values = np.zeros(references.size)
        self._model.transfer("get_floats", references, values)
        return values

    def jacobians(self) -> Jacobians | None:
        """Return the partial derivatives that the FMU itself gives, or ``None`` if it offers none."""
        if not self._provides_jacobians:
            return None
        smooth = self._model.arrays["smooth"]
        A, B, C, D = (
            np.zeros((rows, columns))
            for rows in (self._model.arrays["x"].size, self._model.arrays["output_references"].size)
            for columns in (self._model.arrays["x"].size, int(self._model.table["n_inputs"]))
        )
        inputs = self._model.arrays["smooth_references"]
        for unknowns, to_states, to_inputs in (
            (self._derivatives, A, B),
            (self._model.arrays["output_references"], C, D),
        ):
            to_states[:] = self._partial(unknowns, self._states, to_states.shape)
            to_inputs[:, smooth] = self._partial(unknowns, inputs, (len(to_inputs), smooth.size))
        return Jacobians(A, B, C, D)

    def _partial(self, unknowns: References, knowns: References, shape: tuple[int, int]) -> Vector:
        """Return the partial derivatives of some variables with respect to others, column by column."""
        columns = np.zeros(shape[::-1])
        if columns.size:
            for seed, column in zip(np.eye(shape[1]), columns, strict=True):
                self._model.call(
                    "get_directional",
                    *_counted(unknowns),
                    *_counted(knowns),
                    *self._model.counted(seed),
                    *self._model.counted(column),
                )
        return columns.T

    def _transfer(self, function: str, values: Vector) -> Vector:
        if values.size:
            self._model.call(function, c_void_p(values.ctypes.data), c_size_t(values.size))
        return values


def _references(variables: Sequence[ModelVariable]) -> References:
    return np.array([variable.valueReference for variable in variables], dtype=np.uint32)


def _counted(references: References) -> tuple[c_void_p, c_size_t]:
    return c_void_p(references.ctypes.data), c_size_t(references.size)
