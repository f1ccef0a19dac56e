"""A component that is an FMU for co-simulation, FMI 2.0 or 3.0."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

from co_sim.component import Component
from co_sim.errors import InputError
from co_sim.fmi import Slave, read_description, slave_type
from co_sim.fmu_variables import parameter_faults, plain_value, port_faults, port_of, select

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.component import Vector

__all__ = ["FmuComponent"]


class FmuComponent(Component):
    """An FMU for co-simulation.

    The archive is unpacked when the run starts and its files are removed on `close`.

    Parameters
    ----------
    path : the FMU.
    inputs : names of the inputs that become ports; ``None`` takes all scalar float64 inputs.
    outputs : names of the scalar float64 variables that become ports, of any causality; ``None`` takes
        all with causality ``output``.
    parameters : values set before initialisation: parameters and start values of local and output
        variables. An enumeration takes the name of its literal or its number.

    Raises
    ------
    InputError
        If the archive cannot be read or does not run here, a name is unknown, or a value is of the
        wrong type or out of its bounds; all faults of names and values are told together.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        parameters: Mapping[str, float | int | bool | str] = MappingProxyType({}),
    ) -> None:
        self._path = Path(path)
        self._description = read_description(self._path)
        self._slave_type = slave_type(self._path, self._description)
        variables = {variable.name: variable for variable in self._description.modelVariables}
        name = self._path.name
        faults = [
            *port_faults(name, variables, inputs or (), "input"),
            *port_faults(name, variables, outputs or (), "output"),
            *parameter_faults(name, variables, parameters),
        ]
        if faults:
            raise InputError.from_faults(faults)
        self._inputs = select(variables, inputs, "input")
        self._outputs = select(variables, outputs, "output")
        self._parameters = [(variables[name], value) for name, value in parameters.items()]
        super().__init__([port_of(v) for v in self._inputs], [port_of(v) for v in self._outputs])
        self._slave: Slave | None = None
        self._resources = ExitStack()

    def start(self, t0: float, h: float) -> None:
        """Unpack and load the FMU, set its parameters and enter initialisation mode."""
        folder = self._resources.enter_context(TemporaryDirectory(prefix=f"{self._path.stem}_"))
        slave = self._slave_type(self._description, self._path, folder)
        self._resources.callback(slave.release)
        slave.instantiate()
        for variable, value in self._parameters:
            slave.set_parameter(variable, plain_value(variable, value))
        slave.enter_initialisation(t0)
        slave.bind(self._inputs, self._outputs)
        self._slave = slave

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set the inputs and get the outputs in initialisation mode."""
        cast("Slave", self._slave).exchange(u, y)

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Do a step of the FMU; the first one ends initialisation mode."""
        cast("Slave", self._slave).step(t, h, u, y)

    def close(self) -> None:
        """Terminate and free the FMU, unload its library and remove its files."""
        self._slave = None
        self._resources.close()
