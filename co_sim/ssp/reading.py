"""Reads SSP 1.0 and 2.0: archives (``.ssp``) and bare system structure descriptions (``.ssd``)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim.coupling import Coupling
from co_sim.errors import InputError
from co_sim.ssp.binding import bind
from co_sim.ssp.fmus import Fmu, name_of
from co_sim.ssp.network import Network, Pin
from co_sim.ssp.notes import notes_of
from co_sim.ssp.parsing import DEFAULT, read_structure
from co_sim.ssp.parts import make_parts, note
from co_sim.ssp.sources import PackedFile
from co_sim.system import Connection, System

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from os import PathLike

    from co_sim.ssp.binding import Bound
    from co_sim.ssp.chain import Chain
    from co_sim.ssp.document import Faults
    from co_sim.ssp.elements import Component
    from co_sim.ssp.network import Route
    from co_sim.ssp.parsing import Structure

__all__ = ["Assembly", "SspModel", "open_ssp", "read_ssp"]


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
    tolerance: float | None = None,
) -> System:
    """Return the system of an SSP; see `open_ssp` for what else the file tells."""
    return open_ssp(path, variant=variant, step=step, coupling=coupling, tolerance=tolerance).system


def open_ssp(
    path: PathLike[str] | str,
    *,
    variant: str = DEFAULT,
    step: float | None = None,
    coupling: Coupling | None = None,
    tolerance: float | None = None,
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
    tolerance : relative, for all FMUs; ``None`` takes that of a file written here, else that of each FMU's
        default experiment.

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
    model = Assembly(structure, faults).model(step, coupling, tolerance)
    if faults:
        raise InputError.from_faults(faults)
    return model


class Assembly:
    """Makes a model of a structure; faults are noted.

    Attributes
    ----------
    network : of its connectors. components : the elements of those FMUs that could be read, by path.
    bound : values of the variables of FMUs, after `model`.
    """

    def __init__(self, structure: Structure, faults: Faults) -> None:
        self._structure = structure
        self._faults = faults
        found = {path: (item, _fmu(item)) for path, item in structure.system.components()}
        self.components = {path: item for path, (item, fmu) in found.items() if fmu}
        self.network = Network(structure.system, {path: fmu for path, (_, fmu) in found.items() if fmu})
        self.bound: Bound = {}

    def model(
        self,
        step: float | None = None,
        coupling: Coupling | None = None,
        tolerance: float | None = None,
    ) -> SspModel:
        """Return the model; see `open_ssp` for the parameters."""
        structure = self._structure
        self.bound = bind(self.network)
        connections: list[Connection] = []
        inputs: dict[str, list[Connection]] = {}
        outputs: dict[str, Connection] = {}
        fed: set[Pin] = set()
        for pin, route in self._routes():
            connection = self._connection(pin, route)
            if connection is None:
                continue
            if not pin.path:
                outputs[connection.target] = connection
            elif not route.source.path:
                inputs.setdefault(route.source.name, []).append(connection)
            else:
                connections.append(connection)
                fed.add(pin)
        parts = make_parts(self.network, self.components, self.bound, fed, tolerance)
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
        steps = [fmu.step_size for fmu in self.network.fmus.values()]
        return min((size for size in steps if size), default=1e-3)

    def _routes(self) -> Iterator[tuple[Pin, Route]]:
        """Return the ways that lead to variables of FMUs and to connectors of the root system."""
        for pin in list(self.network.incoming):
            if pin.path in self.network.fmus or not pin.path:
                for route in self.network.routes(pin):
                    yield pin, route

    def _connection(self, pin: Pin, route: Route) -> Connection | None:
        """Return a way between two FMUs, or to or from a connector of the root system, as one connection."""
        from_fmu, from_root = route.source.path in self.network.fmus, not route.source.path
        if not (from_fmu or from_root) or (from_root and not pin.path):
            # What comes from nowhere leaves the start value.
            return None
        node = route.edges[-1].wire.node
        if not all(self.network.knows(end, node) for end in (route.source, pin) if end.path):
            return None
        if pin.path and (causality := self.network.causality(pin)) != "input":
            if from_fmu:
                expected = "an input, as parameters get their values before the run"
                node.fault(f'a connection to "{pin.name}" with causality {causality}', expected, "remove it")
            return None
        chain = self.network.chain(route, pin)
        if chain is None:
            return None
        linear = chain.relative if chain.is_plain else chain.total
        return Connection(
            _end(route.source) + route.source_index,
            _end(pin) + route.target_index,
            *linear,
            convert_units=self._converts(pin, route, chain),
        )

    def _converts(self, pin: Pin, route: Route, chain: Chain) -> bool:
        """Tell whether the master is to convert units: not where one end has none."""
        if not (route.source.path and pin.path):
            return not any(edge.wire.suppress for edge in route.edges)
        measures = [self.network.port_measure(end) for end in (route.source, pin)]
        return chain.is_plain and (measures[0] is None) == (measures[1] is None)


def _fmu(item: Component) -> Fmu | None:
    """Return what the description of an FMU says, or note why it cannot be had."""
    if item.fmu is None:
        return None
    try:
        return Fmu.read(item.fmu)
    except InputError as error:
        note(item, error)
        return None


def _end(pin: Pin) -> str:
    return f"{name_of(pin.path)}.{pin.name}" if pin.path else pin.name
