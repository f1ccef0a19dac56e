"""Reads SSP 1.0 and 2.0: archives (``.ssp``) and bare system structure descriptions (``.ssd``)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim.coupling import Coupling
from co_sim.errors import Fault, InputError, suggestion
from co_sim.fmi_description import read_description
from co_sim.fmu import FmuComponent
from co_sim.fmu_variables import is_signal, select
from co_sim.model_exchange import ExchangeFmu
from co_sim.ssp.binding import bind
from co_sim.ssp.network import GIVING, Fmu, Network, Pin, name_of
from co_sim.ssp.notes import notes_of, ports_of
from co_sim.ssp.parsing import DEFAULT, read_structure
from co_sim.ssp.sources import PackedFile
from co_sim.system import Connection, System

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from co_sim.component import Component as Part
    from co_sim.fmu_parameters import Value
    from co_sim.ssp.document import Faults, Node
    from co_sim.ssp.elements import Component
    from co_sim.ssp.network import Path as ElementPath
    from co_sim.ssp.network import Route
    from co_sim.ssp.parsing import Structure
    from co_sim.units import Unit

__all__ = ["SspModel", "open_ssp", "read_ssp"]


@dataclass(frozen=True)
class SspModel:
    """A system that was read from an SSP, with what belongs to the whole.

    Parameters
    ----------
    name, description : of the root system's description.
    system : its components, connections and parameters.
    inputs : by connector of the root system, the connections that lead on from it, whose `source` is the
        connector's own name. To drive it, connect an output instead:
        ``dataclasses.replace(connection, source="driver.speed")``.
    outputs : by connector of the root system, the connection that leads to it, whose `target` is the
        connector's own name.
    start_time, stop_time : of the default experiment, s; ``None`` where it does not tell.
    """

    name: str
    description: str
    system: System
    inputs: Mapping[str, tuple[Connection, ...]]
    outputs: Mapping[str, Connection]
    start_time: float | None
    stop_time: float | None


def read_ssp(
    path: PathLike[str] | str,
    *,
    variant: str = DEFAULT,
    step: float | None = None,
    coupling: Coupling | None = None,
) -> System:
    """Return the system of an SSP; see `open_ssp` for what else the file tells."""
    return open_ssp(path, variant=variant, step=step, coupling=coupling).system


def open_ssp(
    path: PathLike[str] | str,
    *,
    variant: str = DEFAULT,
    step: float | None = None,
    coupling: Coupling | None = None,
) -> SspModel:
    """Read an SSP 1.0 or 2.0.

    Nested systems are flattened: a component ``frame`` in a system ``bogie`` becomes ``bogie/frame``. A
    dot in the name of an element becomes ``%2E``, because dots separate components from ports.

    Parameters
    ----------
    path : an archive (``.ssp``), or a bare system structure description (``.ssd``) with its sources
        beside it.
    variant : the description to be read, where an archive holds several.
    step : communication step, s. ``None`` takes that of a file written here, else the shortest step size of
        the FMUs' default experiments, else 1 ms.
    coupling : how values pass; ``None`` takes that of a file written here, else the default.

    Raises
    ------
    InputError
        If the file cannot be read or describes what cannot be run; all faults are told together, with
        file, line and element.
    """
    faults: Faults = []
    file = PackedFile(Path(path))
    if not file.path.is_file():
        raise InputError(f"SSP {file.path}", got="no file", expected="one", remedy="correct the path")
    structure = read_structure(file, variant, faults)
    if structure is None:
        raise InputError.from_faults(faults)
    model = _Assembly(structure, faults).model(step, coupling)
    if faults:
        raise InputError.from_faults(faults)
    return model


class _Assembly:
    """Makes components and connections of a structure."""

    def __init__(self, structure: Structure, faults: Faults) -> None:
        self._structure = structure
        self._faults = faults
        self._components = dict(structure.system.components())
        fmus = {path: fmu for path, item in self._components.items() if (fmu := self._fmu(item))}
        self._network = Network(structure.system, fmus)
        self._routes = {
            pin: list(self._network.routes(pin))
            for pin in list(self._network.incoming)
            if pin.path in fmus or not pin.path
        }

    def model(self, step: float | None, coupling: Coupling | None) -> SspModel:
        """Return the model; faults are noted."""
        structure = self._structure
        bound = bind(self._network)
        connections: list[Connection] = []
        inputs: dict[str, list[Connection]] = {}
        outputs: dict[str, Connection] = {}
        for pin, routes in self._routes.items():
            for route in routes:
                connection = self._connection(pin, route)
                if connection is None:
                    continue
                if not pin.path:
                    outputs[pin.name] = connection
                elif route.source.path:
                    connections.append(connection)
                else:
                    inputs.setdefault(route.source.name, []).append(connection)
        parts = self._parts(bound)
        notes = notes_of(structure.root)
        system = System(
            parts,
            connections,
            step=next(value for value in (step, notes.step, self._default_step) if value is not None),
            rates=notes.rates,
            coupling=coupling or notes.coupling or Coupling(),
        )
        return SspModel(
            structure.root.get("name"),
            structure.root.get("description") or structure.system.node.get("description"),
            system,
            {name: tuple(ends) for name, ends in inputs.items()},
            outputs,
            structure.experiment.start,
            structure.experiment.stop,
        )

    @property
    def _default_step(self) -> float:
        """The shortest step size that an FMU's default experiment tells, s; else 1 ms."""
        experiments = [
            read_description(item.fmu.path).defaultExperiment
            for path, item in self._components.items()
            if item.fmu and path in self._network.fmus
        ]
        steps = [float(size) for item in experiments if (size := getattr(item, "stepSize", None))]
        return min((size for size in steps if size > 0.0), default=1e-3)

    def _fmu(self, item: Component) -> Fmu | None:
        """Return what the description of an FMU says, or note why it cannot be had."""
        if item.fmu is None:
            return None
        try:
            return Fmu.read(item.fmu)
        except InputError as error:
            self._note(item, error)
            return None

    def _note(self, item: Component, error: InputError) -> None:
        """Note what is wrong with an FMU as faults of the component."""
        self._faults.extend(
            Fault(f"{item.node}: {fault.what}", fault.got, fault.expected, fault.remedy)
            for fault in error.faults
        )

    def _connection(self, pin: Pin, route: Route) -> Connection | None:
        """Return a way between two FMUs, or to or from a connector of the root system, as one connection."""
        fmus = self._network.fmus
        from_fmu, from_root = route.source.path in fmus, not route.source.path
        if not route.edges or not (from_fmu or from_root) or (from_root and not pin.path):
            # What comes from nowhere leaves the start value.
            return None
        node = route.edges[-1].wire.node
        if not all(self._is_known(end, node) for end in (route.source, pin) if end.path):
            return None
        if pin.path and (causality := fmus[pin.path].variables[pin.name].causality) != "input":
            if from_fmu:
                expected = "an input, as parameters get their values before the run"
                node.fault(f'a connection to "{pin.name}" with causality {causality}', expected, "remove it")
            return None
        chain = self._network.chain(route, pin)
        if chain is None:
            return None
        linear = chain.relative if chain.is_plain else chain.total
        if from_root or not pin.path:
            converts = not any(edge.wire.suppress for edge in route.edges)
        else:
            converts = chain.is_plain and self._units_meet(route.source, pin)
        return Connection(
            self._end(route.source) + route.source_index,
            self._end(pin) + route.target_index,
            *linear,
            convert_units=converts,
        )

    def _units_meet(self, source: Pin, target: Pin) -> bool:
        """Tell whether both ends have a unit or none has: where one has none, numbers pass as they are."""
        measures = [self._network.port_measure(pin) for pin in (source, target)]
        return (measures[0] is None) == (measures[1] is None)

    def _is_known(self, pin: Pin, node: Node) -> bool:
        if pin.name in self._network.fmus[pin.path].variables:
            return True
        known = suggestion(pin.name, self._network.fmus[pin.path].variables)
        node.fault(f'a connector "{pin.name}" that the FMU does not have', "one of its variables", known)
        return False

    @staticmethod
    def _end(pin: Pin) -> str:
        return f"{name_of(pin.path)}.{pin.name}" if pin.path else pin.name

    def _parts(self, bound: Mapping[ElementPath, Mapping[str, Value]]) -> dict[str, Part]:
        """Return the components by name."""
        parts: dict[str, Part] = {}
        for path, item in self._components.items():
            if path not in self._network.fmus:
                continue
            name = name_of(path)
            if name in parts:
                item.node.fault(f'a second component "{name}"', "one of this name", "rename one of the two")
            try:
                parts[name] = self._part(path, item, bound.get(path, {}))
            except InputError as error:
                self._note(item, error)
        return parts

    def _part(self, path: ElementPath, item: Component, values: Mapping[str, Value]) -> Part:
        """Return the component for one FMU.

        Ports are all inputs that have a value to begin with or a connection, and those connectors that give
        values; all outputs where no connector is declared.
        """
        ports = ports_of(item.node)
        inputs = self._inputs(path, values) if ports.inputs is None else ports.inputs
        outputs = self._outputs(path, item) if ports.outputs is None else ports.outputs
        units: dict[str, tuple[str, Unit | None]] = {
            name: measure
            for name in (*inputs, *(outputs or ()))
            if (measure := self._network.port_measure(Pin(path, name)))
        }
        assert item.fmu is not None
        kind = self._kind(item)
        return kind(
            item.fmu, inputs=inputs, outputs=outputs, parameters=values, units=units, **ports.integration
        )

    def _kind(self, item: Component) -> type[FmuComponent]:
        """Return the class for the interface type of the FMU that is to be used."""
        assert item.fmu is not None
        description = read_description(item.fmu.path)
        offered = {"CoSimulation": description.coSimulation, "ModelExchange": description.modelExchange}
        wanted = item.implementation
        if wanted == "any":
            return FmuComponent if offered["CoSimulation"] or not offered["ModelExchange"] else ExchangeFmu
        if not offered.get(wanted):
            there = [name for name, interface in offered.items() if interface]
            raise InputError(
                f"FMU {item.fmu.path.name}",
                got=f"no {wanted}",
                expected="what the component asks for",
                remedy=f"choose from {', '.join(there)}",
            )
        return ExchangeFmu if wanted == "ModelExchange" else FmuComponent

    def _inputs(self, path: ElementPath, values: Mapping[str, Value]) -> list[str]:
        fmu = self._network.fmus[path]
        return [
            variable.name
            for variable in select(fmu.variables, None, "input")
            if variable.start is not None
            or variable.name in values
            or self._routes.get(Pin(path, variable.name))
        ]

    def _outputs(self, path: ElementPath, item: Component) -> list[str] | None:
        fmu, outgoing = self._network.fmus[path], self._network.outgoing
        for connector in item.connectors.values():
            self._is_known(Pin(path, connector.name), connector.node)
        connected = [name for name in fmu.variables if outgoing.get(Pin(path, name))]
        if item.connectors:
            wanted = {name for name, connector in item.connectors.items() if connector.kind in GIVING}
        else:
            wanted = {variable.name for variable in select(fmu.variables, None, "output")}
        return [
            variable.name
            for variable in fmu.variables.values()
            if variable.name in connected or (variable.name in wanted and is_signal(variable))
        ]
