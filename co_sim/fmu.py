"""A component that is an FMU for co-simulation, FMI 2.0 or 3.0."""

from __future__ import annotations

import copy
import struct
import warnings
from contextlib import ExitStack
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from co_sim.component import Port, StateError
from co_sim.errors import Fault, InputError, suggestion
from co_sim.fmi import FmuError, slave_type
from co_sim.fmi_binding import Binding, interpolated, is_native
from co_sim.fmi_description import read_description
from co_sim.fmu_archive import unpacked
from co_sim.fmu_linearize import local_model
from co_sim.fmu_parameters import parameter_faults, plain_values, sizes_of, start_of
from co_sim.fmu_variables import (
    attribute,
    feedthrough,
    kind_of,
    port_faults,
    port_of,
    select,
    shape_of,
    units_of,
    variables_of,
)
from co_sim.local_model import NotLinearizableError
from co_sim.native import NativeComponent
from co_sim.responses import model_from_responses

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from os import PathLike

    from fmpy.model_description import ModelVariable

    from co_sim.component import Kind, Vector
    from co_sim.fmi import Slave
    from co_sim.fmu_parameters import Value
    from co_sim.local_model import LocalModel
    from co_sim.native import NativeState, NativeStep
    from co_sim.units import Unit

__all__ = ["ContinuousState", "FmuComponent", "StepSizeWarning"]

#: Of a serialized state: whether the initialisation is over, and the lengths of the token of the FMU and of
#: the binding's memory, which follow.
_HEADER = struct.Struct("<?II")
#: Part of a step by which decimal numbers may miss a multiple.
_STEP_TOLERANCE = 1e-9


class StepSizeWarning(UserWarning):
    """A communication step that an FMU's own fixed steps do not fill: it gets to other times than asked."""


@dataclass(frozen=True, slots=True)
class ContinuousState:
    """A continuous state of an FMU: names and units of the state and of its derivative, and its shape."""

    name: str
    unit: str
    derivative: str
    derivative_unit: str
    shape: tuple[int, ...] = ()

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of the elements."""
        return Port(self.name, shape=self.shape).elements


class _State:
    """A saved state; the FMU's copy is freed some time after nobody knows this any more."""

    __slots__ = ("is_stepping", "memory", "pointer", "slave")

    def __init__(self, slave: Slave, pointer: int, memory: bytes, *, is_stepping: bool) -> None:
        self.slave = slave
        self.pointer = pointer
        self.memory = memory
        self.is_stepping = is_stepping

    def __del__(self) -> None:
        self.slave.drop(self.pointer)


class FmuComponent(NativeComponent):
    """An FMU for co-simulation.

    Its archive is unpacked when the run starts; the files are removed on `close`. Variables of every type but
    binaries and clocks can be ports. A number that a variable cannot hold, such as 0.5 for an integer, and a
    whole number beyond 2**53 stop the run. The step is machine code, unless texts are among the ports.

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
    tolerance : relative, for the solver and the algorithms within the FMU. ``None`` takes that of the default
        experiment, or leaves it to the FMU.

    Raises
    ------
    InputError
        If the archive cannot be read or does not run here, a name is unknown, or a value is of the
        wrong type or shape or out of its bounds; all faults of names and values are told together.
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
    ) -> None:
        # Held as it is, because it may own the folder in which the FMU lies.
        self._given_path = path
        self._path = Path(path)
        self._description = read_description(self._path)
        self._slave_type = self._adapter()
        self._variables = variables_of(self._description)
        name = self._path.name
        faults = [
            *port_faults(name, self._variables, inputs or (), "input"),
            *port_faults(name, self._variables, outputs or (), "output"),
            *parameter_faults(name, self._variables, parameters),
            *_tolerance_faults(name, tolerance),
        ]
        if faults:
            raise InputError.from_faults(faults)
        self._inputs = select(self._variables, inputs, "input")
        self._outputs = select(self._variables, outputs, "output")
        self._units = dict(units)
        self._tolerance = self._default_tolerance if tolerance is None else tolerance
        self._definitions = units_of(self._description)
        self._own_parameters = dict(parameters)
        self._parameters = self._own_parameters
        super().__init__(*self._ports(), feedthrough(self._description, self._inputs, self._outputs))
        self.takes_derivatives = self._takes_derivatives()
        self._slave: Slave | None = None
        self._binding: Binding | None = None
        self._resources = ExitStack()
        self._h = 0.0

    def __deepcopy__(self, memo: object) -> Self:
        # Nothing is shared that ever changes.
        duplicate = copy.copy(self)
        duplicate._slave = duplicate._binding = None
        duplicate._resources = ExitStack()
        return duplicate

    @property
    def path(self) -> Path:
        """The archive."""
        return self._path

    @property
    def parameters(self) -> Mapping[str, Value]:
        """The parameters of the constructor."""
        return MappingProxyType(self._own_parameters)

    @property
    def tolerance(self) -> float | None:
        """The relative tolerance that the FMU is told; ``None`` if it is told none."""
        return self._tolerance

    @property
    def variables(self) -> Mapping[str, ModelVariable]:
        """All variables of the FMU by name, as fmpy describes them."""
        return MappingProxyType(self._variables)

    def __getstate__(self) -> dict[str, object]:
        if self._slave is not None:
            raise StateError(f"{self._path.name} is running; only a component that is not can be pickled")
        # Another process has another working directory.
        return self.__dict__ | {"_path": self._path.absolute()}

    @property
    def identity(self) -> str:
        """File and version of the FMU."""
        return f"{self._path.name}, FMI {self._description.fmiVersion}"

    def parameter_faults(self, values: Mapping[str, Value]) -> Iterable[Fault]:
        """Find parameters that are unknown or whose value is not allowed."""
        joined = self._own_parameters | dict(values)
        return parameter_faults(self._path.name, self._variables, joined)

    def set_parameters(self, values: Mapping[str, Value]) -> None:
        """Take parameters without faults besides those of the constructor; shapes of ports may follow."""
        self._parameters = self._own_parameters | dict(values)
        self.inputs, self.outputs = self._ports()

    def start(self, t0: float, h: float) -> None:
        """Unpack and load the FMU, set its parameters and enter initialisation mode.

        Warns
        -----
        StepSizeWarning
            If `h` is no multiple of the fixed steps that the FMU says it makes inside (FMI 3).
        """
        self._compare_steps(h)
        self._h = h
        alone = self._interface.canBeInstantiatedOnlyOncePerProcess
        folder = self._resources.enter_context(unpacked(self._path, alone=alone))
        slave = self._slave_type(self._description, folder, self.instance_name)
        self._resources.callback(slave.release)
        slave.instantiate()
        structural = list(self._values(structural=True))
        if structural:
            slave.configure(structural)
        for value in self._values(structural=False):
            slave.set(*value)
        slave.enter_initialisation(t0, self.stop_time, self._tolerance)
        self._binding = self._bind(slave)
        self._slave = slave

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set the inputs and get the outputs in initialisation mode."""
        self._bound.exchange(u, y)

    def enter_steps(self) -> None:
        """End initialisation mode."""
        self._running.enter_steps()

    def native(self) -> NativeStep | None:
        """Return the step as machine code; ``None`` if texts are among the ports."""
        return self._bound.native

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Do a step of the FMU."""
        if self._bound.native:
            super().step(t, h, u, y)
        else:
            self._bound.step(t, h, u, y)

    def failure(self, status: int) -> Exception:
        """Return what the FMU says about a step that failed."""
        return self._bound.failure(status)

    def save(self) -> object:
        """Return the present state."""
        self._require("canGetAndSetFMUstate")
        self._bound.may_return()
        slave = self._running
        try:
            pointer = slave.save()
        except FmuError as error:
            raise StateError(str(error)) from error
        return _State(slave, pointer, self._bound.memory, is_stepping=slave.is_stepping)

    def restore(self, state: object) -> None:
        """Return to a state of `save`, also after a step that failed."""
        own = self._own(state)
        try:
            own.slave.restore(own.pointer, is_stepping=own.is_stepping)
        except FmuError as error:
            raise StateError(str(error)) from error
        self._bound.memory = own.memory

    def native_state(self) -> NativeState | None:
        """Return the calls that keep the state and go back to it."""
        self._require("canGetAndSetFMUstate")
        return self._bound.native_state()

    def serialize(self, state: object) -> bytes:
        """Return a state of `save` as bytes that another run of the same FMU takes."""
        self._require("canSerializeFMUstate")
        own = self._own(state)
        token = self._description.guid.encode()
        try:
            data = own.slave.serialize(own.pointer)
        except FmuError as error:
            raise StateError(str(error)) from error
        header = _HEADER.pack(own.is_stepping, len(token), len(own.memory))
        return b"".join((header, token, own.memory, data))

    def deserialize(self, data: bytes) -> object:
        """Return the state from the bytes of `serialize`."""
        self._require("canGetAndSetFMUstate")
        self._require("canSerializeFMUstate")
        token = self._description.guid.encode()
        header, rest = data[: _HEADER.size], data[_HEADER.size :]
        if len(header) < _HEADER.size or not rest.startswith(token):
            raise StateError(f"the bytes are no state of {self._path.name}")
        is_stepping, n, n_memory = _HEADER.unpack(header)
        self._bound.may_return()
        slave = self._running
        try:
            pointer = slave.deserialize(rest[n + n_memory :])
        except FmuError as error:
            raise StateError(str(error)) from error
        return _State(slave, pointer, rest[n : n + n_memory], is_stepping=is_stepping)

    @property
    def states(self) -> tuple[ContinuousState, ...] | None:
        """The continuous states, in the order of the description; ``None`` if it does not tell."""
        derivatives = [unknown.variable for unknown in self._description.derivatives]
        if not derivatives:
            return None
        sizes = self._sizes
        return tuple(
            ContinuousState(
                variable.derivative.name,
                attribute(variable.derivative, "unit") or "1",
                variable.name,
                attribute(variable, "unit") or "1",
                shape_of(variable, sizes),
            )
            for variable in derivatives
        )

    @property
    def provides_derivatives(self) -> bool:
        """Whether the FMU provides directional derivatives."""
        return bool(self._interface.providesDirectionalDerivative)

    def directional_derivative(
        self, unknowns: Sequence[str], knowns: Sequence[str], seed: Vector
    ) -> Vector | None:
        """Return how the unknowns move when the knowns do, in the present state.

        Parameters
        ----------
        unknowns : names of outputs or derivatives of states.
        knowns : names of inputs or states.
        seed : direction, one number for each element of the knowns.

        Returns
        -------
        One number for each element of the unknowns; ``None`` if the FMU provides no derivatives.

        Raises
        ------
        InputError
            If a name is unknown.
        FmuError
            If the FMU refuses.
        """
        if not self.provides_derivatives:
            return None
        references = self._references(unknowns), self._references(knowns)
        result = np.zeros(self.size_of(unknowns))
        self._running.derivative(*references, np.ascontiguousarray(seed, dtype=np.float64), result)
        return result

    def size_of(self, names: Sequence[str]) -> int:
        """Return the number of elements of variables."""
        return sum(prod(shape_of(self._variables[name], self._sizes)) for name in names)

    def linearize(self, t: float, u: Vector) -> LocalModel:
        """Return the linear model near the present state, from directional derivatives.

        An FMU that provides none, or does not tell its states, answers to pulses instead, if it can save
        its state (`co_sim.responses`). Ports that are not continuous stay as they are: their rows and columns
        are zero. An FMU without inputs that tells no states acts on the others and does not react: its model
        is empty.
        """
        if not self.inputs and self.states is None:
            return super().linearize(t, u)
        try:
            if self._can_return and (self.states is None or not self.provides_derivatives):
                return model_from_responses(self, t, self._h, np.array(u))
            self._bound.set_inputs(u)
            return local_model(self)
        except (FmuError, StateError) as error:
            raise NotLinearizableError(str(error)) from error

    def close(self) -> None:
        """Terminate and free the FMU, unload its library and remove its files."""
        self._slave = self._binding = None
        self._resources.close()

    @property
    def _interface(self) -> Any:
        """What the description says about the interface type that is used."""
        return self._slave_type.interface(self._description)

    @property
    def _can_return(self) -> bool:
        return bool(self._interface.canGetAndSetFMUstate)

    @property
    def _default_tolerance(self) -> float | None:
        told = getattr(self._description.defaultExperiment, "tolerance", None)
        return float(told) if told and 0.0 < float(told) < np.inf else None

    def _compare_steps(self, h: float) -> None:
        own = getattr(self._interface, "fixedInternalStepSize", None)
        if own is None or not float(own) > 0.0:
            return
        count = h / float(own)
        if round(count) < 1 or abs(count - round(count)) > _STEP_TOLERANCE * count:
            warnings.warn(
                f"{self._path.name} makes fixed steps of {float(own):g} s inside, of which {h:g} s is no"
                " multiple; choose the communication step, or the rate, accordingly",
                StepSizeWarning,
                stacklevel=2,
            )

    def _adapter(self) -> type[Slave]:
        return slave_type(self._path, self._description)

    def _bind(self, slave: Slave) -> Binding:
        return Binding(
            slave, self.inputs, self.outputs, self._value_references, slopes=self.takes_derivatives
        )

    @property
    def _value_references(self) -> dict[str, int]:
        return {v.name: v.valueReference for v in (*self._inputs, *self._outputs)}

    @property
    def _running(self) -> Slave:
        return cast("Slave", self._slave)

    @property
    def _bound(self) -> Binding:
        return cast("Binding", self._binding)

    @property
    def _sizes(self) -> dict[str, int]:
        return sizes_of(self._variables, self._parameters)

    def _ports(self) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
        return tuple(map(self._port, self._inputs)), tuple(map(self._port, self._outputs))

    def _port(self, variable: ModelVariable) -> Port:
        port = port_of(variable, self._sizes, self._definitions)
        unit, definition = self._units.get(variable.name, ("", None))
        if unit and port.definition is None and attribute(variable, "unit") in {None, "", unit}:
            port = replace(port, unit=unit, definition=definition)
        if variable.causality == "input" and variable.name in self._parameters:
            port = replace(port, start=start_of(variable, self._parameters[variable.name]))
        return port

    def _takes_derivatives(self) -> bool:
        """Tell whether to set derivatives of inputs; in FMI 3 there is no such call."""
        can = self._description.fmiMajorVersion == 2 and self._description.coSimulation.canInterpolateInputs
        return can and bool(interpolated(self.inputs)) and is_native([*self.inputs, *self.outputs])

    def _values(self, *, structural: bool) -> Iterator[tuple[ModelVariable, Kind, list[object]]]:
        ports = {port.name for port in self.inputs}
        for name, value in self._parameters.items():
            variable = self._variables[name]
            if name in ports:
                # The master sets it, in initialisation mode.
                continue
            if (variable.causality == "structuralParameter") == structural:
                yield variable, cast("Kind", kind_of(variable)), plain_values(variable, value)

    def _references(self, names: Sequence[str]) -> np.ndarray[tuple[int], np.dtype[np.uint32]]:
        faults = [
            Fault(
                f'variable "{name}" of {self._path.name}',
                "an unknown name",
                "a name from its description",
                suggestion(name, self._variables),
            )
            for name in names
            if name not in self._variables
        ]
        if faults:
            raise InputError.from_faults(faults)
        return np.array([self._variables[name].valueReference for name in names], dtype=np.uint32)

    def _require(self, flag: str) -> None:
        if not getattr(self._interface, flag):
            raise StateError(f"{self._path.name} does not declare {flag}")

    def _own(self, state: object) -> _State:
        if not isinstance(state, _State) or state.slave is not self._slave:
            raise StateError(f"the state is not one of this run of {self._path.name}")
        return state


def _tolerance_faults(name: str, tolerance: float | None) -> Iterator[Fault]:
    if tolerance is not None and not 0.0 < tolerance < np.inf:
        yield Fault(f"tolerance of {name}", repr(tolerance), "a positive number", "correct it")
