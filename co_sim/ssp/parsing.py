"""Reads system structure descriptions, and the documents and archives that they refer to."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from co_sim.errors import InputError
from co_sim.ssp.document import Faults, Node, parse
from co_sim.ssp.elements import (
    Binding,
    Component,
    Connector,
    Element,
    End,
    Experiment,
    Reference,
    SystemElement,
    Wire,
)
from co_sim.ssp.sources import PackedFile, Place, SourceError, open_place
from co_sim.ssp.values import measure_of, parameters_of, transformation_of, units_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from co_sim.ssp.elements import Measure
    from co_sim.units import Unit

__all__ = ["Structure", "read_structure"]

DEFAULT = "SystemStructure.ssd"
_FMU = "application/x-fmu-sharedlibrary"
_SSD, _SSP = "application/x-ssp-definition", "application/x-ssp-package"
_TYPE_OF = {
    "ParameterSet": "application/x-ssp-parameter-set",
    "ParameterMapping": "application/x-ssp-parameter-mapping",
    "SignalDictionary": "application/x-ssp-signal-dictionary",
}
_TYPES = (
    "Real", "Float64", "Float32", "Integer", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64",
    "UInt64", "Boolean", "String", "Enumeration", "Binary", "Clock",
)  # fmt: skip
_KINDS = (
    "input", "output", "parameter", "calculatedParameter", "structuralParameter", "constant", "local",
    "inout", "unspecified",
)  # fmt: skip
_IMPLEMENTATIONS = ("any", "CoSimulation", "ModelExchange", "ScheduledExecution")


@dataclass(frozen=True)
class Structure:
    """A system structure description: its root system, and what belongs to the whole document."""

    root: Node
    system: SystemElement
    experiment: Experiment


@dataclass(frozen=True)
class _Document:
    """The document that is being read: where it lies, what it defines, and which are open around it."""

    root: Node
    place: Place
    units: Mapping[str, Unit]
    around: tuple[str, ...]
    faults: Faults = field(repr=False)


def read_structure(path: PackedFile, variant: str, faults: Faults) -> Structure | None:
    """Read an archive (``.ssp``) or a bare description (``.ssd``); ``None`` if there is nothing to be read.

    Parameters
    ----------
    path : the file.
    variant : name of the description in an archive.
    faults : collects what is wrong.

    Raises
    ------
    InputError
        If an archive cannot be unpacked.
    """
    place = open_place(path, path.path.name)
    name = variant if place.root else path.path.name
    document = _open(place, name, (), faults)
    if document is None:
        return None
    system = _root_system(document)
    if system is None:
        return None
    experiment = document.root.child("DefaultExperiment")
    times = [
        experiment.number(name, 0.0) if experiment and experiment.given(name) else None
        for name in ("startTime", "stopTime")
    ]
    return Structure(document.root, system, Experiment(*times))


def _open(place: Place, name: str, around: tuple[str, ...], faults: Faults) -> _Document | None:
    """Read the description of this name at a place."""
    label = f"{place.name}/{name}" if place.root else name
    try:
        file = place.file(name)
    except SourceError as error:
        faults.append(InputError(label, got=str(error), expected="it", remedy="add it").faults[0])
        return None
    root = parse(file.path.read_bytes(), label, "SystemStructureDescription", faults)
    if root is None:
        return None
    identity = str(file.path)
    return _Document(root, place, units_of(root), (*around, identity), faults)


def _root_system(document: _Document) -> SystemElement | None:
    node = document.root.child("System")
    if node is None:
        document.root.fault("no System", "one")
        return None
    return _system(node, document)


def _system(node: Node, document: _Document) -> SystemElement:
    system = SystemElement(node.required("name"), node, _connectors(node, document), inside=node)
    _bind(system, document, None)
    elements = node.child("Elements")
    for child in elements.children("Component", "System", "SignalDictionaryReference") if elements else ():
        element = _element(child, document)
        if element.name in system.elements:
            child.fault("a second element of this name", "one", "rename one of the two")
        system.elements[element.name] = element
    system.wires.extend(_wire(child) for child in node.grandchildren("Connections", "Connection"))
    for child in node.grandchildren("SignalDictionaries", "SignalDictionary"):
        system.dictionaries[child.required("name")] = _dictionary(child, document)
    return system


def _element(node: Node, document: _Document) -> Element:
    if node.tag == "System":
        return _system(node, document)
    if node.tag == "SignalDictionaryReference":
        name, dictionary = node.required("name"), node.required("dictionary")
        return Reference(name, node, _connectors(node, document), dictionary=dictionary)
    return _component(node, document)


def _component(node: Node, document: _Document) -> Element:
    """Return a component, without an FMU if it has none that can be had."""
    source = node.given("source")
    kind = node.get("type", _FMU).partition(";")[0].strip()
    component = Component(node.required("name"), node, _connectors(node, document))
    if source is None:
        node.fault("no source", "one, as a component without an implementation cannot run", "add an FMU")
        return component
    if kind not in {_FMU, _SSD, _SSP}:
        node.fault(f'the type "{kind}"', f"one of {_FMU}, {_SSD}, {_SSP}", "export it as an FMU")
        return component
    is_fmu = kind == _FMU and not urlsplit(source).path.lower().endswith((".ssp", ".ssd"))
    with _told(node):
        if not is_fmu:
            return _nested(component, source, document) or component
        component.fmu = document.place.file(source)
        component.implementation = node.choice("implementation", _IMPLEMENTATIONS, "any")
        _bind(component, document, component.fmu)
    return component


def _nested(component: Component, source: str, document: _Document) -> SystemElement | None:
    """Return the system that a component refers to, with the component's own name and bindings."""
    node = component.node
    fragment = unquote(urlsplit(source).fragment)
    if not urlsplit(source).path:
        _bind(component, document, None)
        system = _same_document(node, fragment, document)
    else:
        file = document.place.file(source)
        _bind(component, document, file)
        place = open_place(file, f"{document.place.name}/{file.path.name}", document.place)
        name = (fragment or DEFAULT) if place.folder != file.path.parent else file.path.name
        if str(place.folder / name) in document.around or len(document.around) > 20:
            node.fault("a description that contains itself", "an end of it")
            return None
        opened = _open(place, name, document.around, document.faults)
        system = None if opened is None else _root_system(opened)
    if system is None:
        return None
    system.name, system.node = component.name, node
    # The component's own bindings come after those of the system it stands for.
    system.bindings.extend(component.bindings)
    system.connectors = system.connectors | component.connectors
    return system


def _same_document(node: Node, fragment: str, document: _Document) -> SystemElement | None:
    """Return once more the system of this document with an id."""
    for xml in document.root.xml.iter("{*}System"):
        if xml.get("id") == fragment:
            if any(above is xml for above in node.xml.iterancestors()):
                node.fault("a system that contains itself", "an end of it")
                return None
            inner = replace(document, around=(*document.around, f"#{fragment}"))
            if document.around.count(f"#{fragment}"):
                node.fault("a system that contains itself", "an end of it")
                return None
            return _system(Node(xml, node.file, node.faults), inner)
    node.fault(f'no system with the id "{fragment}"', "one", "correct the source")
    return None


def _connectors(node: Node, document: _Document) -> dict[str, Connector]:
    """Return the connectors of an element."""
    found: dict[str, Connector] = {}
    for child in node.grandchildren("Connectors", "Connector"):
        typed = next(child.children(*_TYPES), None)
        kind = child.choice("kind", _KINDS, "unspecified")
        name = child.required("name")
        if name in found:
            child.fault("a second connector of this name", "one")
        found[name] = Connector(
            name, kind, typed.tag if typed else "", measure_of(typed, document.units), child
        )
    return found


def _bind(element: Element, document: _Document, file: PackedFile | None) -> None:
    """Add the parameter bindings of an element."""
    for node in element.node.grandchildren("ParameterBindings", "ParameterBinding"):
        with _told(node):
            element.bindings.append(_binding(node, document, file))


def _binding(node: Node, document: _Document, file: PackedFile | None) -> Binding:
    values = _content(node, node.child("ParameterValues"), "ParameterSet", document, file)
    mapping = node.child("ParameterMapping")
    mapped = _content(mapping, mapping, "ParameterMapping", document, file) if mapping else None
    source = unquote(node.get("source"))
    if values is None or (mapping and mapped is None):
        return Binding(source, ())
    return Binding(source, parameters_of(values, node.get("prefix"), mapped))


def _content(
    node: Node, holder: Node | None, tag: str, document: _Document, file: PackedFile | None
) -> Node | None:
    """Return the root element of what `node` refers to, or of what `holder` contains."""
    if node.get("type", _TYPE_OF[tag]) != _TYPE_OF[tag]:
        node.fault(f'the type "{node.get("type")}"', _TYPE_OF[tag], "convert it")
        return None
    source = node.given("source")
    if source is None:
        found = holder.child(tag) if holder else None
        if found is None:
            node.fault(f"neither a source nor a {tag}", "one of them")
        return found
    base = node.choice("sourceBase", ("SSD", "component"), "SSD")
    within = file if base == "component" else None
    if base == "component" and file is None:
        node.fault('sourceBase="component"', "a component that has a source", 'use sourceBase="SSD"')
        return None
    data = document.place.read(source, within)
    return parse(data, f"{document.place.name}/{unquote(source)}", tag, document.faults)


def _dictionary(node: Node, document: _Document) -> dict[str, Measure | None]:
    """Return the entries of a signal dictionary."""
    with _told(node):
        found = _content(node, node, "SignalDictionary", document, None)
        if found is not None:
            units = units_of(found)
            return {
                entry.required("name"): measure_of(next(entry.children(*_TYPES), None), units)
                for entry in found.children("DictionaryEntry")
            }
    return {}


def _wire(node: Node) -> Wire:
    return Wire(
        _end(node, "start"),
        _end(node, "end"),
        transformation_of(node),
        node.flag("suppressUnitConversion"),
        node,
    )


def _end(node: Node, side: str) -> End:
    # Some tools write an empty name for the system itself.
    element = node.get(f"{side}Element") or None
    indices = node.get(f"{side}Indices").split()
    index = f"[{','.join(indices)}]" if indices else ""
    return End(element, node.required(f"{side}Connector"), index)


@contextmanager
def _told(node: Node) -> Iterator[None]:
    """Turn what is wrong with a source into faults of the element that names it."""
    try:
        yield
    except SourceError as error:
        node.fault(str(error), "a file of this system", "add it, or correct the source")
    except InputError as error:
        for fault in error.faults:
            node.fault(f"{fault.what}: {fault.got}", fault.expected, fault.remedy)
