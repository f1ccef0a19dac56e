"""A component that is an FMU for Model Exchange, FMI 2.0 or 3.0, with an integrator of our own."""

from __future__ import annotations

import zipfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, cast
from xml.etree import ElementTree as ET

import numpy as np

from co_sim.component import StateError
from co_sim.errors import Fault, InputError
from co_sim.exchange_model import METHODS, Binding, ExchangeModel, model_type
from co_sim.exchange_point import PresentPoint
from co_sim.exchange_states import ExchangeState, SavedStates
from co_sim.fmi import read_description
from co_sim.fmu_variables import parameter_faults, plain_value, port_faults, port_of, select
from co_sim.native import NativeComponent, NativeStep

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from fmpy.model_description import ModelDescription, ModelVariable

    from co_sim.component import Port, Scalar, Vector

__all__ = ["ExchangeFmu"]


class ExchangeFmu(NativeComponent):
    """An FMU for Model Exchange, integrated with fixed substeps.

    Inputs of variability ``continuous`` follow their polynomial through the step; the others are set in
    event mode at the start of a step in which they are new. Sign changes of event indicators are
    located to 1e-12 of a step (or a few roundings of the time, where that is more); an indicator that changes
    its sign twice within one substep goes unseen. More than 1000 events in one step are an error. Time events
    at the end of a step, up to that tolerance, belong to that step: its outputs are those after the event.

    Parameters
    ----------
    path : the FMU.
    inputs : names of the inputs that become ports; ``None`` takes all scalar float64 inputs.
    outputs : names of the scalar float64 variables that become ports, of any causality; ``None`` takes
        all with causality ``output``.
    parameters : values set before initialisation: parameters and start values of local and output
        variables. An enumeration takes the name of its literal or its number.
    substep : longest substep, s; each step is divided into equal ones. ``None`` takes the step size of the
        FMU's default experiment, or else the whole step.
    method : of integration: ``"rk4"`` (classical Runge-Kutta), ``"midpoint"`` or ``"euler"``, of
        orders 4, 2 and 1.

    Raises
    ------
    InputError
        If the archive cannot be read or does not run here, a name is unknown, or a value is of the
        wrong type or out of its bounds; all faults of names and values are told together.
    """

    takes_derivatives = True

    def __init__(
        self,
        path: Path | str,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        parameters: Mapping[str, Scalar] = MappingProxyType({}),
        substep: float | None = None,
        method: Literal["rk4", "midpoint", "euler"] = "rk4",
    ) -> None:
        self._path = Path(path)
        self._description = read_description(self._path)
        self._model_type = model_type(self._path, self._description)
        self._variables = {variable.name: variable for variable in self._description.modelVariables}
        name = self._path.name
        faults = [
            *port_faults(name, self._variables, inputs or (), "input"),
            *port_faults(name, self._variables, outputs or (), "output"),
            *self.parameter_faults(parameters),
            *_integration_faults(name, substep, method),
        ]
        if faults:
            raise InputError.from_faults(faults)
        self._inputs = select(self._variables, inputs, "input")
        self._outputs = select(self._variables, outputs, "output")
        self._parameters = dict(parameters)
        self._binding = Binding(
            self._inputs,
            self._outputs,
            [_is_smooth(variable) for variable in self._inputs],
            _default_substep(self._description) if substep is None else substep,
            method,
        )
        super().__init__(
            [replace(port_of(v), continuous=_is_smooth(v)) for v in self._inputs],
            [replace(port_of(v), continuous=_is_smooth(v)) for v in self._outputs],
            {v.name: self._dependencies(v) for v in self._outputs},
        )
        self._model: ExchangeModel | None = None
        self._saved: SavedStates | None = None
        self._initial_inputs = np.zeros(0)
        self._resources = ExitStack()

    @property
    def states(self) -> tuple[Port, ...]:
        """Names, units and shapes of the continuous states, in the order of the FMU."""
        return tuple(port_of(variable) for variable in self._state_variables())

    def parameter_faults(self, values: Mapping[str, Scalar]) -> Iterable[Fault]:
        """Find parameters that are unknown or cannot be set, and values of a wrong type or out of bounds."""
        return parameter_faults(self._path.name, self._variables, values)

    def set_parameters(self, values: Mapping[str, Scalar]) -> None:
        """Take parameters, besides those given before, for the next `start`."""
        self._parameters.update(values)

    def start(self, t0: float, h: float) -> None:
        """Unpack and load the FMU, set its parameters and enter initialisation mode."""
        folder = self._resources.enter_context(TemporaryDirectory(prefix=f"{self._path.stem}_"))
        model = self._model_type(self._description, self._path, folder)
        self._resources.callback(model.release)
        model.instantiate()
        for name, value in self._parameters.items():
            variable = self._variables[name]
            model.set_parameter(variable, plain_value(variable, value))
        model.enter_initialisation(t0)
        model.tabulate(self._binding, t0)
        self._saved = SavedStates(model)
        self._resources.callback(self._saved.close)
        self._initial_inputs = np.zeros(3 * len(self._inputs))
        self._model = model

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set the inputs and get the outputs in initialisation mode."""
        model = self._running()
        self._initial_inputs[: u.size] = u
        model.exchange(u, y)

    def native(self) -> NativeStep:
        """Return the addresses of the step; the first one ends initialisation mode."""
        from co_sim.exchange_step import exchange_step

        return NativeStep(cast("int", exchange_step.address), self._running().table.ctypes.data)

    def failure(self, status: int) -> Exception:
        """Return the error that tells which call failed or what stopped the step, and when."""
        return self._running().failure(status)

    def point(self) -> PresentPoint:
        """Return the present point, for linearisation; before the first step it ends initialisation mode.

        Raises
        ------
        FmuError
            If the FMU refuses to leave initialisation mode.
        """
        model = self._running()
        if not model.table["running"]:
            self.step(float(model.table["time"]), 0.0, self._initial_inputs, np.zeros(len(self._outputs)))
        derivatives = [unknown.variable for unknown in self._description.derivatives]
        offers = _offers_directional_derivatives(self._path, self._description)
        return PresentPoint(model, self._state_variables(), derivatives, offers)

    def save(self) -> object:
        """Return the present state, of the FMU and of its integration."""
        return self._states().save()

    def restore(self, state: object) -> None:
        """Return to a state of `save`."""
        self._states().restore(cast("ExchangeState", state))

    def serialize(self, state: object) -> bytes:
        """Return a state of `save` as bytes."""
        return self._states().serialize(cast("ExchangeState", state))

    def deserialize(self, data: bytes) -> object:
        """Return the state from the bytes of `serialize`."""
        return self._states().deserialize(data)

    def close(self) -> None:
        """Terminate and free the FMU, unload its library and remove its files."""
        self._model = self._saved = None
        self._resources.close()

    def _running(self) -> ExchangeModel:
        if self._model is None:
            raise RuntimeError(f"{self._path.name} is not started")
        return self._model

    def _states(self) -> SavedStates:
        if self._saved is None:
            raise StateError(f"{self._path.name} is not started")
        return self._saved

    def _state_variables(self) -> list[ModelVariable]:
        return [unknown.variable.derivative for unknown in self._description.derivatives]

    def _dependencies(self, output: ModelVariable) -> list[str]:
        """Return the inputs on which a variable depends directly; all, where nothing is said."""
        inputs = [variable.name for variable in self._inputs]
        if output.causality == "parameter" or output in self._state_variables():
            return []
        for unknown in (*self._description.outputs, *self._description.derivatives):
            if unknown.variable is output and unknown.dependencies is not None:
                known = {variable.name for variable in unknown.dependencies}
                return [name for name in inputs if name in known]
        return inputs


def _is_smooth(variable: ModelVariable) -> bool:
    """Return whether a float variable may change between events."""
    return variable.variability in {None, "continuous"}


def _default_substep(description: ModelDescription) -> float:
    step_size = getattr(description.defaultExperiment, "stepSize", None)
    return float(step_size) if step_size else 0.0


def _integration_faults(fmu: str, substep: float | None, method: str) -> Iterable[Fault]:
    if substep is not None and not 0.0 < substep < np.inf:
        yield Fault(f"substep of {fmu}", f"{substep!r}", "a positive number of s", "correct it")
    if method not in METHODS:
        yield Fault(f"method of {fmu}", repr(method), f"one of {', '.join(METHODS)}", "choose one of them")


def _offers_directional_derivatives(path: Path, description: ModelDescription) -> bool:
    """Read it from the description itself: fmpy does not know the attribute of FMI 3."""
    with zipfile.ZipFile(path) as archive:
        interface = ET.fromstring(archive.read("modelDescription.xml")).find("ModelExchange")
    plural = "s" if description.fmiMajorVersion == 3 else ""
    return interface is not None and interface.get(f"providesDirectionalDerivative{plural}") in {"1", "true"}
