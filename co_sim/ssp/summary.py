"""What an SSP is: components, ports, connections, parameter sets, and the diagrams of its systems."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from co_sim.errors import Fault, InputError
from co_sim.fmu_summary import summarise as summarise_fmu
from co_sim.fmu_variables import kind_of
from co_sim.ssp.binding import reaches
from co_sim.ssp.diagrams import on_the_way, pictures_of
from co_sim.ssp.elements import SystemElement
from co_sim.ssp.fmus import name_of
from co_sim.ssp.network import Pin
from co_sim.ssp.parsing import DEFAULT, read_structure
from co_sim.ssp.reading import Assembly
from co_sim.ssp.sources import PackedFile

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from os import PathLike

    from co_sim.diagram.blocks import Picture
    from co_sim.fmu_summary import FmuSummary
    from co_sim.ssp.binding import Bound, Reach
    from co_sim.ssp.document import Faults
    from co_sim.ssp.elements import Component
    from co_sim.ssp.elements import Path as ElementPath
    from co_sim.ssp.network import Edge, Network

__all__ = ["Link", "Part", "Setting", "Socket", "SspSummary", "summarise"]


@dataclass(frozen=True, slots=True)
class Socket:
    """A connector of a component or of the root system.

    Parameters
    ----------
    name, kind : as declared; where it is not, those of the FMU's variable.
    type : of its values in the terms of FMI 3; empty if nobody tells.
    unit : empty if there is none.
    start : the value to begin with: bound in the SSP, else the FMU's own; ``None`` if there is none.
    is_bound : whether that value is from the SSP.
    is_connected : whether a connection begins or ends here.
    """

    name: str
    kind: str
    type: str
    unit: str
    start: object
    is_bound: bool
    is_connected: bool


@dataclass(frozen=True, slots=True)
class Part:
    """A component.

    Parameters
    ----------
    name : with those of the systems around it, as in a run.
    source : of its FMU, as the document has it; empty if it has none.
    implementation : what the document asks for, such as ``"CoSimulation"`` or ``"any"``.
    fmi_version : of the FMU; empty if it cannot be read.
    cannot_run : why the FMU cannot be run here; ``None`` if nothing is known to be in the way.
    sockets : connectors that are declared or connected; inputs and outputs of the FMU if there are none.
    """

    name: str
    source: str
    implementation: str
    fmi_version: str
    cannot_run: str | None
    sockets: tuple[Socket, ...]


@dataclass(frozen=True, slots=True)
class Link:
    """A connection as it is written, in the direction of its values.

    Parameters
    ----------
    system : path of the system that it is in; empty for the root.
    source, target : element and connector, with a dot between; a connector of the system has no element.
    on_the_way : conversion of units, transformation and elements of arrays, in words.
    """

    system: str
    source: str
    target: str
    on_the_way: str


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter that is bound to a value.

    Parameters
    ----------
    element : path of the element with the binding; empty for the root system.
    source : file with the value; empty if it is in place.
    name, value : as they are written, after the mapping. unit : of the value; empty if there is none.
    sets : variables of FMUs that it counts for; empty if nothing has that name.
    overridden : variables for which another binding counts.
    """

    element: str
    source: str
    name: str
    value: object
    unit: str
    sets: tuple[str, ...]
    overridden: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SspSummary:
    """What an SSP is.

    Parameters
    ----------
    path, name, description, version, tool, author : texts; empty if there are none.
    experiment : start and stop that it suggests, s, as far as it does.
    inputs, outputs : connectors of the root system.
    parts : its components, those of nested systems too.
    links, settings : connections and parameters.
    fmus : what the FMUs are, by source.
    faults : what keeps it from running.
    pictures : of its systems, the root first; not part of `as_dict`.
    """

    path: str
    name: str
    description: str
    version: str
    tool: str
    author: str
    experiment: Mapping[str, float]
    inputs: tuple[Socket, ...]
    outputs: tuple[Socket, ...]
    parts: tuple[Part, ...]
    links: tuple[Link, ...]
    settings: tuple[Setting, ...]
    fmus: Mapping[str, FmuSummary]
    faults: tuple[Fault, ...]
    pictures: tuple[Picture, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the pictures as plain objects, for JSON."""
        told = {name: getattr(self, name) for name in self.__slots__ if name != "pictures"}
        return {name: _plain(value) for name, value in told.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [asdict(item) for item in value]
    if isinstance(value, dict):
        return {key: item.as_dict() if hasattr(item, "as_dict") else item for key, item in value.items()}
    return value


def summarise(path: PathLike[str] | str, *, variant: str = DEFAULT) -> SspSummary:
    """Return what an SSP is, as far as it can be told; no code of it runs.

    Parameters
    ----------
    path : an archive (``.ssp``) or a description (``.ssd``).
    variant : the description to be read, where an archive holds several.

    Raises
    ------
    InputError
        If there is no description to be read.
    """
    faults: Faults = []
    structure = read_structure(PackedFile(Path(path)), variant, faults)
    if structure is None:
        raise InputError.from_faults(faults)
    assembly = Assembly(structure, faults)
    model = assembly.model()
    if not faults:
        faults += model.system.faults()
    network, root = assembly.network, structure.root
    fmus = _fmus(structure.system)
    experiment = {"start": model.start_time, "stop": model.stop_time}
    return SspSummary(
        path=str(path),
        name=model.name or structure.system.name,
        description=model.description,
        version=root.get("version", "1.0"),
        tool=root.get("generationTool"),
        author=root.get("author"),
        experiment={name: value for name, value in experiment.items() if value is not None},
        inputs=tuple(_border(network, "input")),
        outputs=tuple(_border(network, "output")),
        parts=tuple(_parts(network, assembly.bound, fmus)),
        links=tuple(_links(network, structure.system, ())),
        settings=tuple(_settings(network)),
        fmus=fmus,
        faults=tuple(faults),
        pictures=tuple(pictures_of(network, model.name or structure.system.name)),
    )


def _fmus(system: SystemElement) -> dict[str, FmuSummary]:
    """Return what the FMUs are that can be read; what is wrong with the others is a fault already."""
    found: dict[str, FmuSummary] = {}
    for _, item in system.components():
        source = item.node.get("source")
        if item.fmu is not None and source not in found:
            try:
                found[source] = summarise_fmu(item.fmu.path)
            except InputError:
                continue
    return found


def _parts(network: Network, bound: Bound, fmus: Mapping[str, FmuSummary]) -> Iterator[Part]:
    for path, item in network.root.components():
        source = item.node.get("source")
        fmu = fmus.get(source)
        wanted = {"any": ("CoSimulation", "ModelExchange")}.get(item.implementation, (item.implementation,))
        reasons = [i.cannot_run for i in fmu.interfaces if i.kind in wanted] if fmu else []
        yield Part(
            name_of(path),
            source,
            item.implementation,
            fmu.fmi_version if fmu else "",
            None if not reasons or None in reasons else reasons[0],
            tuple(_sockets(network, path, item, bound)),
        )


def _sockets(network: Network, path: ElementPath, item: Component, bound: Bound) -> Iterator[Socket]:
    variables = network.fmus[path].variables if path in network.fmus else {}
    connected = [pin.name for pin in (*network.incoming, *network.outgoing) if pin.path == path]
    names = [*item.connectors, *connected]
    if not item.connectors:
        names += [name for name, v in variables.items() if v.causality in {"input", "output"}]
    for name in dict.fromkeys(names):
        yield _socket(network, Pin(path, name), bound)


def _border(network: Network, kind: str) -> Iterator[Socket]:
    for name, connector in network.root.connectors.items():
        if connector.kind == kind:
            yield _socket(network, Pin((), name), {})


def _socket(network: Network, pin: Pin, bound: Bound) -> Socket:
    values = bound.get(pin.path, {})
    variable = network.fmus[pin.path].variables.get(pin.name) if pin.path in network.fmus else None
    measure = network.measure(pin) if variable is not None or pin.path not in network.fmus else None
    connector = network.elements.get(pin.path, network.root).connectors.get(pin.name)
    declared = connector.type if connector else ""
    return Socket(
        pin.name,
        network.kind(pin),
        (kind_of(variable) if variable is not None else declared) or "",
        measure.name if measure else "",
        values.get(pin.name, variable.start if variable is not None else None),
        pin.name in values,
        bool(network.incoming.get(pin) or network.outgoing.get(pin)),
    )


def _links(network: Network, system: SystemElement, path: ElementPath) -> Iterator[Link]:
    for wire in system.wires:
        edge = network.edge_of(wire)
        if edge is not None:
            yield _link(network, edge, "/".join(path))
    for name, element in system.elements.items():
        if isinstance(element, SystemElement):
            yield from _links(network, element, (*path, name))


def _link(network: Network, edge: Edge, system: str) -> Link:
    source, target = (f"{e.element}.{e.connector}" if e.element else e.connector for e in edge.ends)
    return Link(system, source, target, on_the_way(network, edge))


def _settings(network: Network) -> Iterator[Setting]:
    found = list(reaches(network))
    counts = {pin: reach for reach in found for pin, _ in reach.targets}
    for reach in found:
        pins = [pin for pin, _ in reach.targets]
        parameter = reach.parameter
        yield Setting(
            "/".join(reach.path),
            reach.source,
            parameter.name,
            parameter.values[0] if not parameter.shape else list(parameter.values),
            _unit(network, reach),
            tuple(_variable(pin) for pin in pins if counts[pin] is reach),
            tuple(_variable(pin) for pin in pins if counts[pin] is not reach),
        )


def _unit(network: Network, reach: Reach) -> str:
    """Return the unit of a value: where none is told, that of what it sets."""
    measure = reach.parameter.measure
    if measure is None and reach.targets:
        measure = network.port_measure(reach.targets[0][0])
    return measure.name if measure else ""


def _variable(pin: Pin) -> str:
    return f"{name_of(pin.path)}.{pin.name}"
