"""A component that is an FMU for Model Exchange, FMI 2.0 or 3.0, with an integrator of our own."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from co_sim.errors import Fault, InputError
from co_sim.exchange_binding import METHODS, ExchangeBinding, Integration, is_smooth
from co_sim.exchange_model import ExchangeModel, model_type
from co_sim.exchange_point import PresentPoint
from co_sim.fmu import FmuComponent
from co_sim.local_model import LocalModel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from os import PathLike

    from co_sim.component import Vector
    from co_sim.fmi import Slave
    from co_sim.fmu import ContinuousState
    from co_sim.fmu_parameters import Value
    from co_sim.units import Unit

__all__ = ["ExchangeFmu"]


class ExchangeFmu(FmuComponent):
    """An FMU for Model Exchange, integrated with fixed substeps.

    Its archive is unpacked when the run starts; the files are removed on `close`. Variables of every type but
    binaries and clocks can be ports. The step is machine code, unless texts are among the ports.

    Inputs of type float64 and variability ``continuous`` follow their polynomial through the step; the
    others are set in event mode at the start of a step in which one of them is new. Sign changes of event
    indicators are located to 1e-12 of a step, or a few roundings of the time where that is more; an
    indicator that changes its sign twice within one substep goes unseen. Time events up to that tolerance
    behind the end of a step belong to it: its outputs are those after the event. More than 1000 events in
    one step are an error.

    Parameters
    ----------
    path : the FMU.
    inputs : names of the inputs that become ports; ``None`` takes all.
    outputs : names of the variables that become ports, of any causality; ``None`` takes all with
        causality ``output``.
    parameters : values set before initialisation: parameters, also structural ones, and start values of local
        and output variables; of inputs the value that they keep while nothing is connected. An enumeration
        takes the name of its literal or its number, an array nested sequences of its shape.
    units : of variables for which the FMU declares none, or none with a definition: name and, if there is
        one, definition.
    tolerance : as of `FmuComponent`; the substeps do not depend on it.
    substep : longest substep, s; each step is divided into equal ones. ``None`` takes the step size of the
        FMU's default experiment, or else the whole step.
    method : of integration: ``"rk4"`` (classical Runge-Kutta), ``"midpoint"`` or ``"euler"``, of
        orders 4, 2 and 1.

    Raises
    ------
    InputError
        If the archive cannot be read or does not run here, a name is unknown, or a value is of the
        wrong type or shape or out of its bounds.
    """

    def __init__(
        self,
        path: PathLike[str] | str,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        parameters: Mapping[str, Value] = MappingProxyType({}),
        units: Mapping[str, tuple[str, Unit | None]] = MappingProxyType({}),
        tolerance: float | None = None,
        substep: float | None = None,
        method: Literal["rk4", "midpoint", "euler"] = "rk4",
    ) -> None:
        faults: list[Fault] = []
        try:
            super().__init__(
                path, inputs=inputs, outputs=outputs, parameters=parameters, units=units, tolerance=tolerance
            )
        except InputError as error:
            faults.extend(error.faults)
        faults.extend(_faults(f"of {path}", substep, method))
        if faults:
            raise InputError.from_faults(faults)
        self._method = method
        self._substep = self._default_substep if substep is None else substep
        self._t0 = 0.0

    @property
    def method(self) -> Literal["rk4", "midpoint", "euler"]:
        """The method of integration."""
        return self._method

    @property
    def substep(self) -> float:
        """The longest substep, s; 0 for the whole step."""
        return self._substep

    @property
    def states(self) -> tuple[ContinuousState, ...]:
        """The continuous states, in the order of the FMU."""
        return super().states or ()

    def start(self, t0: float, h: float) -> None:
        """Unpack and load the FMU, set its parameters and enter initialisation mode."""
        self._t0 = t0
        super().start(t0, h)

    def enter_steps(self) -> None:
        """End initialisation mode and settle the discrete states, unless that has been done."""
        if not self._exchange_binding.table["running"]:
            self._exchange_binding.enter_steps()

    def point(self) -> PresentPoint:
        """Return the present point, after `enter_steps`: states to be moved, derivatives to be read."""
        return PresentPoint(cast("ExchangeModel", self._running), self._exchange_binding)

    def linearize(self, t: float, u: Vector) -> LocalModel:
        """Return the linear model near the present point, from the FMU's own derivatives where it has them.

        Inputs that change at events only have columns of zeros. Before the first step this ends
        initialisation mode.
        """
        self.enter_steps()
        directional = self._move if self._has_directional_derivatives else None
        J, error = self.point().jacobian(np.array(u[: self._n_inputs]), directional)
        n = J.shape[1] - self._n_inputs
        named = [(name, state.unit) for state in self.states for name in state.elements]
        return LocalModel(
            J[:n, :n],
            J[:n, n:],
            J[n:, :n],
            J[n:, n:],
            tuple(name for name, _ in named),
            tuple(unit for _, unit in named),
            method="directional derivatives" if directional else "central differences",
            error=error,
        )

    @property
    def _n_inputs(self) -> int:
        return sum(port.size for port in self.inputs)

    @property
    def _has_directional_derivatives(self) -> bool:
        """Whether the FMU gives the derivatives of all that is wanted, the outputs included."""
        declared = {unknown.variable.name for unknown in self._description.outputs}
        return self.provides_derivatives and all(
            port.kind == "float64" and port.name in declared for port in self.outputs
        )

    def _move(self, seed: Vector) -> Vector:
        """Return how derivatives and outputs change in a direction of states and moving inputs."""
        unknowns = [*(state.derivative for state in self.states), *(port.name for port in self.outputs)]
        smooth = [port.name for port in self.inputs if is_smooth(port)]
        knowns = [*(state.name for state in self.states), *smooth]
        return cast("Vector", self.directional_derivative(unknowns, knowns, seed))

    def _adapter(self) -> type[Slave]:
        return model_type(self._path, self._description)

    def _takes_derivatives(self) -> bool:
        return True

    def _bind(self, slave: Slave) -> ExchangeBinding:
        return ExchangeBinding(
            cast("ExchangeModel", slave),
            self.inputs,
            self.outputs,
            self._value_references,
            Integration(self._method, self._substep, self._t0),
        )

    @property
    def _exchange_binding(self) -> ExchangeBinding:
        return cast("ExchangeBinding", self._bound)

    @property
    def _default_substep(self) -> float:
        step_size = getattr(self._description.defaultExperiment, "stepSize", None)
        given = float(step_size) if step_size else 0.0
        return given if 0.0 < given < np.inf else 0.0


def _faults(where: str, substep: float | None, method: str) -> list[Fault]:
    faults = []
    if substep is not None and not 0.0 < substep < np.inf:
        faults.append(Fault(f"substep {where}", f"{substep!r}", "a positive number of s", "correct it"))
    if method not in METHODS:
        known = f"one of {', '.join(METHODS)}"
        faults.append(Fault(f"method {where}", repr(method), known, "choose one of them"))
    return faults
