"""Writes systems of FMUs as SSP 1.0 or 2.0 archives."""

from __future__ import annotations

import zipfile
from dataclasses import astuple, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args
from urllib.parse import quote

from lxml import etree

from co_sim.errors import Fault, InputError
from co_sim.files import whole_file
from co_sim.fmu import FmuComponent
from co_sim.model_exchange import ExchangeFmu
from co_sim.ssp.document import NAMESPACES
from co_sim.ssp.fmus import element_of
from co_sim.ssp.network import GIVING
from co_sim.ssp.notes import write_notes, write_ports
from co_sim.ssp.value_types import parameter_type, port_type, write_value
from co_sim.units import Unit, UnknownUnitError, define

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from co_sim.component import Port
    from co_sim.ssp.document import Faults
    from co_sim.system import Connection, System

__all__ = ["Version", "write_ssp"]

Version = Literal["1.0", "2.0"]

#: The same for every file, so that the same system makes the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


def write_ssp(
    system: System,
    path: PathLike[str] | str,
    *,
    version: Version = "1.0",
    name: str | None = None,
    start_time: float | None = None,
    stop_time: float | None = None,
) -> None:
    """Write a system of FMUs with its connections and parameters as an archive (``.ssp``).

    Step, rates, coupling and the choice of ports, for which SSP has no place, go into annotations that
    other tools pass over; `read_ssp` returns a system that gives the same run. Names with slashes
    stay names of components of one flat system.

    Parameters
    ----------
    system : its components must be FMUs. In SSP 1.0, arrays can be neither connected nor set.
    path : is replaced if it is there, and left as it is if anything fails.
    version : of SSP. Of the values for `version`, the first is read by more tools.
    name : of the system; ``None`` takes that of the file.
    start_time, stop_time : of the default experiment, s.

    Raises
    ------
    InputError
        If the system has faults, or cannot be written; all reasons are told together.
    """
    if version not in get_args(Version):
        raise InputError("version", got=repr(version), expected='"1.0" or "2.0"', remedy="choose one of them")
    system.check()
    path = Path(path)
    faults: Faults = []
    writer = _Writer(system, version, faults)
    document = writer.document(name or path.stem, {"startTime": start_time, "stopTime": stop_time})
    if faults:
        raise InputError.from_faults(faults)
    with whole_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        _store(archive, "SystemStructure.ssd", document, zipfile.ZIP_DEFLATED)
        for file, fmu in writer.resources.items():
            # An FMU is compressed in itself.
            _store(archive, f"resources/{file}", fmu.read_bytes(), zipfile.ZIP_STORED)


def _store(archive: zipfile.ZipFile, name: str, data: bytes, method: int) -> None:
    archive.writestr(zipfile.ZipInfo(name, _DATE), data, compress_type=method)


def _tag(name: str) -> str:
    """Return the name of an element with its namespace, from ``"ssd:System"``."""
    short, _, local = name.partition(":")
    return f"{{{NAMESPACES[short]}}}{local}"


def _add(parent: Any, name: str, attributes: Mapping[str, str] | None = None) -> Any:
    return etree.SubElement(parent, _tag(name), dict(attributes or {}))


class _Writer:
    """Makes the description of one system."""

    def __init__(self, system: System, version: Version, faults: Faults) -> None:
        self._system = system
        self._version = version
        self._faults = faults
        self._units: dict[str, Unit] = {}
        #: FMUs by the names of their files in the archive.
        self.resources: dict[str, Path] = {}
        self._targets = {self._split(c.target, "inputs")[:2] for c in system.connections}
        self._sources = {self._split(c.source, "outputs")[:2] for c in system.connections}

    def document(self, name: str, experiment: Mapping[str, float | None]) -> bytes:
        """Return the description; faults are noted."""
        attributes = {"version": self._version, "name": name, "generationTool": "wheelset-cosim"}
        root = etree.Element(_tag("ssd:SystemStructureDescription"), attributes, nsmap=NAMESPACES)
        outer = _add(root, "ssd:System", {"name": name})
        elements = _add(outer, "ssd:Elements")
        for key, component in self._system.components.items():
            if isinstance(component, FmuComponent):
                self._component(elements, key, component)
            else:
                self._fault(
                    f'component "{key}"', f"a {type(component).__name__}", "an FMU", "export it as an FMU"
                )
        if self._system.connections:
            connections = _add(outer, "ssd:Connections")
            for connection in self._system.connections:
                self._connection(connections, connection)
        self._unit_definitions(root)
        times = {key: repr(float(value)) for key, value in experiment.items() if value is not None}
        if times:
            _add(root, "ssd:DefaultExperiment", times)
        write_notes(root, self._system)
        return etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True)  # type: ignore[no-any-return]

    def _fault(self, what: str, got: str, expected: str, remedy: str) -> None:
        self._faults.append(Fault(what, got, expected, remedy))

    def _component(self, elements: Any, name: str, component: FmuComponent) -> None:
        is_exchange = isinstance(component, ExchangeFmu)
        attributes = {
            "name": element_of(name),
            "type": "application/x-fmu-sharedlibrary",
            "source": f"resources/{quote(self._resource(component.path))}",
            "implementation": "ModelExchange" if is_exchange else "CoSimulation",
        }
        xml = _add(elements, "ssd:Component", attributes)
        self._connectors(xml, name, component)
        self._parameters(xml, name, component)
        integration: dict[str, Any] = {}
        if component.tolerance is not None:
            integration["tolerance"] = component.tolerance
        if isinstance(component, ExchangeFmu):
            integration["method"] = component.method
            if component.substep:
                integration["substep"] = component.substep
        write_ports(xml, component, integration)

    def _resource(self, path: Path) -> str:
        """Return the name in the archive for an FMU, one for each file."""
        whole = path.resolve()
        for file, known in self.resources.items():
            if known == whole:
                return file
        file, n = path.name, 1
        while file in self.resources:
            n += 1
            file = f"{path.stem}_{n}{path.suffix}"
        self.resources[file] = whole
        return file

    def _connectors(self, xml: Any, name: str, component: FmuComponent) -> None:
        """Add connectors for connected inputs and for all outputs that SSP allows."""
        found: dict[str, tuple[Port, str]] = {}
        for port in component.inputs:
            if (name, port.name) in self._targets:
                found[port.name] = port, "input"
        for port in component.outputs:
            kind = component.variables[port.name].causality
            is_connected = (name, port.name) in self._sources
            if self._version == "1.0" and kind == "local" and is_connected:
                # SSP 1.0 has no such kind.
                kind = "output"
            if kind in GIVING - ({"local", "independent"} if self._version == "1.0" else {"independent"}):
                found[port.name] = port, kind
            elif is_connected:
                got = f"a connection from a variable with causality {kind}"
                self._fault(f"{name}.{port.name}", got, "an output", "connect an output of the FMU")
        if not found:
            return
        connectors = _add(xml, "ssd:Connectors")
        for port, kind in found.values():
            connector = _add(connectors, "ssd:Connector", {"name": port.name, "kind": kind})
            self._type(connector, f"{name}.{port.name}", port)

    def _type(self, connector: Any, what: str, port: Port) -> None:
        typed = port_type(port.kind, self._version)
        if typed is not None:
            xml = _add(connector, f"ssc:{typed}")
            if port.kind in {"float64", "float32"} and self._defines(port):
                xml.set("unit", port.unit)
        if port.shape and self._version != "1.0":
            for size in port.shape:
                _add(connector, "ssc:Dimension", {"size": str(size)})
        elif port.shape and (tuple(what.split(".", 1)) in self._targets | self._sources):
            self._fault(what, "an array", "scalars in SSP 1.0", 'write version="2.0"')

    def _defines(self, port: Port) -> bool:
        """Tell whether the document defines the unit of a port as the port means it."""
        if port.unit in {"", "1"}:
            return False
        try:
            meaning = port.definition or define(port.unit)
        except UnknownUnitError:
            return False
        return self._units.setdefault(port.unit, meaning) == meaning

    def _unit_definitions(self, root: Any) -> None:
        if not self._units:
            return
        units = _add(root, "ssd:Units")
        for name, unit in sorted(self._units.items()):
            values = zip((item.name for item in fields(Unit)), astuple(unit), strict=True)
            base = {key: repr(value) for key, value in values if value != (1.0 if key == "factor" else 0)}
            _add(_add(units, "ssc:Unit", {"name": name}), "ssc:BaseUnit", base)

    def _parameters(self, xml: Any, name: str, component: FmuComponent) -> None:
        values = {**component.parameters, **self._system.parameters_of(name)}
        if not values:
            return
        binding = _add(_add(xml, "ssd:ParameterBindings"), "ssd:ParameterBinding")
        inside = _add(binding, "ssd:ParameterValues")
        parameters = _add(
            _add(inside, "ssv:ParameterSet", {"version": self._version, "name": element_of(name)}),
            "ssv:Parameters",
        )
        for key, value in values.items():
            what = f"{name}.{key}"
            typed = parameter_type(component.variables[key], self._version)
            parameter = _add(parameters, "ssv:Parameter", {"name": key})
            try:
                write_value(
                    _add(parameter, f"ssv:{typed}"), parameter, component.variables[key], value, self._version
                )
            except ValueError as error:
                self._fault(what, str(error), f"a value that SSP {self._version} can hold", "change it")

    def _connection(self, connections: Any, connection: Connection) -> None:
        attributes = {}
        for side, end in (("start", connection.source), ("end", connection.target)):
            name, port, indices = self._split(end, "outputs" if side == "start" else "inputs")
            attributes[f"{side}Element"] = element_of(name)
            attributes[f"{side}Connector"] = port
            if indices:
                attributes[f"{side}Indices"] = " ".join(indices)
        if not connection.convert_units:
            attributes["suppressUnitConversion"] = "true"
        xml = _add(connections, "ssd:Connection", attributes)
        if (connection.gain, connection.offset) != (1.0, 0.0):
            linear = {"factor": repr(float(connection.gain)), "offset": repr(float(connection.offset))}
            _add(xml, "ssc:LinearTransformation", linear)

    def _split(self, end: str, side: str) -> tuple[str, str, tuple[str, ...]]:
        """Return component, port and indices of the end of a sound connection."""
        name, _, port = end.partition(".")
        if any(port == item.name for item in getattr(self._system.components[name], side)):
            return name, port, ()
        whole, _, indices = port.removesuffix("]").rpartition("[")
        return name, whole, tuple(indices.split(","))
