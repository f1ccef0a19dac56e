"""A linear model with the names and units of its signals: what all questions of this package are asked of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

__all__ = ["LinearSystem", "as_system"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """A model ``x' = A x + B u, y = C x + D u``, or ``x+ = ...`` where it is sampled.

    `of` makes one of a `control.StateSpace`; every function of the package also takes that directly.

    Parameters
    ----------
    A : (n, n). B : (n, m). C : (p, n). D : (p, m).
    states, inputs, outputs : names. state_units, input_units, output_units : their units.
    dt : sampling time, s; 0 for a continuous model.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    dt: float = 0.0

    def __post_init__(self) -> None:
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (p, n)), ("D", (p, m))):
            matrix = getattr(self, name)
            if matrix.shape != shape or not np.all(np.isfinite(matrix)):
                raise ValueError(
                    f"{name}: got shape {matrix.shape}, expected finite numbers of shape {shape}; "
                    f"check names and matrices of the model against each other"
                )
        for kind, expected in (("state", n), ("input", m), ("output", p)):
            found = len(getattr(self, f"{kind}_units"))
            if found != expected:
                raise ValueError(
                    f"{kind}_units: got {found}, expected {expected}; give one unit for each {kind}"
                )

    @classmethod
    def of(
        cls,
        model: control.StateSpace,
        *,
        state_units: Sequence[str] | None = None,
        input_units: Sequence[str] | None = None,
        output_units: Sequence[str] | None = None,
    ) -> LinearSystem:
        """Return a `control.StateSpace` with units; signals without one get ``"-"``.

        Raises
        ------
        ValueError
            If a unit is missing or too many, or the model has numbers that are not finite.
        """
        A, B, C, D = (np.asarray(M, dtype=np.float64) for M in (model.A, model.B, model.C, model.D))
        states, inputs, outputs = (
            tuple(names) for names in (model.state_labels, model.input_labels, model.output_labels)
        )
        return cls(
            *(A, B, C, D, states, inputs, outputs),
            state_units=_units(state_units, states),
            input_units=_units(input_units, inputs),
            output_units=_units(output_units, outputs),
            dt=float(model.dt or 0.0),
        )

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def sampled(self) -> bool:
        """Whether the model is in discrete time."""
        return self.dt > 0.0

    def select(
        self, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> LinearSystem:
        """Return the same system with some of its inputs and outputs; ``None`` keeps all.

        Raises
        ------
        ValueError
            If a name is not one of the model's.
        """
        i, o = _rows(inputs, self.inputs, "input"), _rows(outputs, self.outputs, "output")
        return replace(
            self,
            B=self.B[:, i],
            C=self.C[o],
            D=self.D[np.ix_(o, i)],
            inputs=tuple(self.inputs[k] for k in i),
            outputs=tuple(self.outputs[k] for k in o),
            input_units=tuple(self.input_units[k] for k in i),
            output_units=tuple(self.output_units[k] for k in o),
        )

    @property
    def dual(self) -> LinearSystem:
        """The system ``(A', C', B', D')``: what holds for its inputs holds for the outputs of this one."""
        return LinearSystem(
            *(self.A.T, self.C.T, self.B.T, self.D.T),
            *(self.states, self.outputs, self.inputs),
            *(self.state_units, self.output_units, self.input_units),
            self.dt,
        )


def as_system(model: control.StateSpace | LinearSystem | Any) -> LinearSystem:
    """Return `model` as a `LinearSystem`, without units where it comes as a `control.StateSpace`."""
    return model if isinstance(model, LinearSystem) else LinearSystem.of(model)


def _units(given: Sequence[str] | None, names: tuple[str, ...]) -> tuple[str, ...]:
    return ("-",) * len(names) if given is None else tuple(given)


def _rows(wanted: Sequence[str] | None, names: tuple[str, ...], kind: str) -> list[int]:
    if wanted is None:
        return list(range(len(names)))
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise ValueError(
            f"{kind}s: got {', '.join(map(repr, unknown))}, expected some of {', '.join(names)}; "
            f"use the names of the model"
        )
    return [names.index(name) for name in wanted]
