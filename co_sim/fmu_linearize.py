"""The linear model of an FMU for co-simulation, from its directional derivatives."""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING

import numpy as np

from co_sim.local_model import LocalModel, NotLinearizableError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from co_sim.component import Port
    from co_sim.fmu import FmuComponent
    from co_sim.kernel import Matrix

__all__ = ["local_model"]


def local_model(fmu: FmuComponent) -> LocalModel:
    """Return the model of a running FMU at its present state and inputs.

    Raises
    ------
    NotLinearizableError
        If the FMU does not provide derivatives or does not tell its states.
    FmuError
        If it refuses a derivative.
    """
    states = fmu.states
    if states is None:
        raise NotLinearizableError("its description tells no continuous states")
    if not fmu.provides_derivatives:
        raise NotLinearizableError("it provides no directional derivatives")
    n = sum(prod(state.shape) for state in states)
    derivatives, names = [s.derivative for s in states], [s.name for s in states]
    smooth_inputs, columns = _smooth(fmu.inputs)
    smooth_outputs, rows = _smooth(fmu.outputs)
    B, D = np.zeros((n, len(columns))), np.zeros((len(rows), len(columns)))
    C = np.zeros((len(rows), n))
    A = _jacobian(fmu, derivatives, names, n)
    B[:, columns] = _jacobian(fmu, derivatives, smooth_inputs, int(columns.sum()))
    C[rows] = _jacobian(fmu, smooth_outputs, names, n)
    D[np.ix_(rows, columns)] = _jacobian(fmu, smooth_outputs, smooth_inputs, int(columns.sum()))
    elements = [(e, s.unit) for s in states for e in s.elements]
    return LocalModel(
        A,
        B,
        C,
        D,
        tuple(name for name, _ in elements),
        tuple(unit for _, unit in elements),
        method="directional derivatives",
    )


def _smooth(ports: Sequence[Port]) -> tuple[list[str], np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Return the names of the continuous float64 ports, and which elements are theirs."""
    smooth = [port.kind == "float64" and port.continuous for port in ports]
    names = [port.name for port, is_smooth in zip(ports, smooth, strict=True) if is_smooth]
    return names, np.repeat(np.array(smooth, dtype=bool), [port.size for port in ports])


def _jacobian(fmu: FmuComponent, unknowns: Sequence[str], knowns: Sequence[str], n: int) -> Matrix:
    """Return how the elements of the unknowns move with the `n` elements of the knowns."""
    if not n or not unknowns:
        return np.zeros((fmu.size_of(unknowns), n))
    columns = [fmu.directional_derivative(unknowns, knowns, seed) for seed in np.eye(n)]
    return np.array(columns, dtype=np.float64).T
