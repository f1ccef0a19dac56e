"""Annotations of our own: what SSP has no place for, so that a file written here runs again as it did."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

from lxml import etree

from co_sim.coupling import Coupling

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.fmu import FmuComponent
    from co_sim.ssp.document import Node
    from co_sim.system import System

__all__ = ["Notes", "Ports", "notes_of", "ports_of", "write_notes", "write_ports"]

TYPE = "wheelset-cosim.master"
_NAMESPACE = "urn:wheelset-cosim:master:1"
_NUMBERS = {"order": int, "max_iterations": int, "tolerance": float, "divergence": float}


@dataclass(frozen=True)
class Notes:
    """How a system is run: step (s), steps of components in those steps, and coupling, where noted."""

    step: float | None = None
    rates: Mapping[str, int] = field(default_factory=dict)
    coupling: Coupling | None = None


@dataclass(frozen=True)
class Ports:
    """Which variables of an FMU are ports, in their order, and how it is integrated, where noted."""

    inputs: Sequence[str] | None = None
    outputs: Sequence[str] | None = None
    integration: Mapping[str, Any] = field(default_factory=dict)


def notes_of(root: Node) -> Notes:
    """Return what the annotation of a document says."""
    xml = _annotation(root, "Master")
    if xml is None:
        return Notes()
    try:
        values = {
            item.name: _NUMBERS.get(item.name, str)(xml.get(item.name))
            for item in fields(Coupling)
            if xml.get(item.name) is not None
        }
        return Notes(
            float(xml.get("step")) if xml.get("step") else None,
            {rate.get("component"): int(rate.get("steps")) for rate in xml.iterchildren("{*}Rate")},
            Coupling(**values),
        )
    except (TypeError, ValueError) as error:
        root.fault(f"an annotation {TYPE} that cannot be read: {error}", "one as it was written")
        return Notes()


def ports_of(component: Node) -> Ports:
    """Return what the annotation of a component says."""
    xml = _annotation(component, "Ports")
    if xml is None:
        return Ports()
    integration: dict[str, Any] = {}
    if xml.get("method"):
        integration["method"] = xml.get("method")
    try:
        for name in ("substep", "tolerance"):
            if xml.get(name):
                integration[name] = float(xml.get(name))
    except ValueError as error:
        component.fault(f"an annotation {TYPE} that cannot be read: {error}", "one as it was written")
    inputs, outputs = (
        [str(port.get("name")) for port in xml.iterchildren(f"{{*}}{tag}")] for tag in ("Input", "Output")
    )
    return Ports(inputs, outputs, integration)


def write_notes(parent: Any, system: System) -> None:
    """Add the annotation of a document."""
    xml = _add(parent, "Master")
    xml.set("step", repr(float(system.step)))
    for name, value in asdict(system.coupling).items():
        xml.set(name, value if isinstance(value, str) else repr(value))
    for name, steps in system.rates.items():
        etree.SubElement(xml, f"{{{_NAMESPACE}}}Rate", component=name, steps=str(steps))


def write_ports(parent: Any, component: FmuComponent, integration: Mapping[str, Any]) -> None:
    """Add the annotation of a component."""
    xml = _add(parent, "Ports")
    for name, value in integration.items():
        xml.set(name, value if isinstance(value, str) else repr(value))
    for tag, ports in (("Input", component.inputs), ("Output", component.outputs)):
        for port in ports:
            etree.SubElement(xml, f"{{{_NAMESPACE}}}{tag}", name=port.name)


def _annotation(node: Node, tag: str) -> Any:
    for annotation in node.grandchildren("Annotations", "Annotation"):
        if annotation.get("type") == TYPE:
            return annotation.xml.find(f"{{{_NAMESPACE}}}{tag}")
    return None


def _add(parent: Any, tag: str) -> Any:
    namespace = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
    annotations = etree.SubElement(parent, parent.tag.partition("}")[0] + "}Annotations")
    annotation = etree.SubElement(annotations, f"{namespace}Annotation", type=TYPE)
    return etree.SubElement(annotation, f"{{{_NAMESPACE}}}{tag}", nsmap={None: _NAMESPACE})
