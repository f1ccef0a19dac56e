"""What a system structure description says, as plain data: systems, components, connectors, bindings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from co_sim.ssp.document import Node
    from co_sim.ssp.sources import PackedFile
    from co_sim.units import Unit

__all__ = [
    "Binding",
    "Component",
    "Connector",
    "Element",
    "End",
    "Experiment",
    "Linear",
    "Mapped",
    "Measure",
    "Parameter",
    "Path",
    "Reference",
    "SystemElement",
    "Transformation",
    "Wire",
]

#: Of an element: the names from the root system, whose own path is empty, down to it.
Path = tuple[str, ...]

#: Values of one parameter: a scalar has one.
Values = tuple[float | int | bool | str, ...]


class Measure(NamedTuple):
    """A unit by name, and its definition where the document has one."""

    name: str
    definition: Unit | None


class Linear(NamedTuple):
    """``target = factor*source + offset``, in the unit of the target."""

    factor: float = 1.0
    offset: float = 0.0


class Mapped(NamedTuple):
    """Values that are replaced by others; those that are not named stay as they are."""

    kind: Literal["Boolean", "Integer", "Enumeration"]
    table: Mapping[object, float | int | bool | str]


Transformation = Linear | Mapped


@dataclass(frozen=True)
class Connector:
    """A connector of an element.

    Parameters
    ----------
    name, kind : as declared. type : of its values, as ``"Real"``; empty if the document does not tell.
    measure : ``None`` where the document tells no unit.
    node : to be named in messages.
    """

    name: str
    kind: str
    type: str
    measure: Measure | None
    node: Node


@dataclass(frozen=True)
class Parameter:
    """A value that is bound to a name, hierarchical below the element of the binding.

    Parameters
    ----------
    name : of the target, after prefix and mapping.
    values : one for a scalar, else row by row.
    shape : of an array; empty for a scalar.
    measure : unit of the values, where told.
    transformation : after the conversion of units.
    suppress : whether units are not converted.
    node : to be named in messages.
    """

    name: str
    values: Values
    shape: tuple[int, ...]
    measure: Measure | None
    transformation: Transformation
    suppress: bool
    node: Node


class Binding(NamedTuple):
    """The parameters of one parameter binding; `source` is the file that holds them, or empty."""

    source: str
    parameters: tuple[Parameter, ...]


class End(NamedTuple):
    """One end of a connection: an element of the system, or ``None`` for the system itself."""

    element: str | None
    connector: str
    indices: str


@dataclass(frozen=True)
class Wire:
    """A connection as it is written; which way values flow follows from the connectors."""

    start: End
    end: End
    transformation: Transformation
    suppress: bool
    node: Node


@dataclass
class Element:
    """What systems, components and references to signal dictionaries have in common."""

    name: str
    node: Node
    connectors: dict[str, Connector] = field(default_factory=dict)
    bindings: list[Binding] = field(default_factory=list)


@dataclass
class Component(Element):
    """A component with an FMU; `fmu` is ``None`` where the document names none, or none that is there."""

    fmu: PackedFile | None = None
    implementation: str = "any"


@dataclass
class Reference(Element):
    """A reference to a signal dictionary."""

    dictionary: str = ""


@dataclass
class SystemElement(Element):
    """A system: its elements, the connections between them, and its signal dictionaries.

    `node` is where it stands in the system around it, and `inside` where it is described.
    """

    inside: Node | None = None
    elements: dict[str, Element] = field(default_factory=dict)
    wires: list[Wire] = field(default_factory=list)
    dictionaries: dict[str, dict[str, Measure | None]] = field(default_factory=dict)

    def components(self, path: Path = ()) -> Iterator[tuple[Path, Component]]:
        """Return all components with their paths, in the order of the document."""
        for name, element in self.elements.items():
            if isinstance(element, SystemElement):
                yield from element.components((*path, name))
            elif isinstance(element, Component):
                yield (*path, name), element


class Experiment(NamedTuple):
    """The default experiment: times in s, ``None`` where not told."""

    start: float | None
    stop: float | None
