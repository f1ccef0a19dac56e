"""XML documents of SSP, read without trust: no entities, no other files, and each fault with its place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from lxml import etree

from co_sim.errors import Fault

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import TypeAlias

    _Xml: TypeAlias = etree._Element

__all__ = ["NAMESPACES", "Faults", "Node", "parse"]

_BASE = "http://ssp-standard.org/SSP1/SystemStructure"
#: SSP 2.0 has kept the namespaces of SSP 1.0; the attribute ``version`` tells the two apart.
NAMESPACES = {
    "ssc": f"{_BASE}Common",
    "ssd": f"{_BASE}Description",
    "ssv": f"{_BASE}ParameterValues",
    "ssm": f"{_BASE}ParameterMapping",
    "ssb": f"{_BASE}SignalDictionary",
}
#: Attributes that tell the reader of a message which element is meant.
_TELLING = ("name", "startElement", "startConnector", "endElement", "endConnector", "source", "target")
_FLAGS = {"true": True, "1": True, "false": False, "0": False}

Faults = list[Fault]


@dataclass(frozen=True, slots=True)
class Node:
    """An element of a document, with the list to which its faults go.

    Parameters
    ----------
    xml : the element.
    file : name of the document in messages.
    faults : collects what is wrong.
    """

    xml: _Xml
    file: str
    faults: Faults

    @property
    def tag(self) -> str:
        """Name of the element without its namespace."""
        return cast("str", etree.QName(self.xml).localname)

    @property
    def namespace(self) -> str:
        """Namespace of the element."""
        return cast("str", etree.QName(self.xml).namespace or "")

    def __str__(self) -> str:
        told = [f'{name}="{self.xml.get(name)}"' for name in _TELLING if self.xml.get(name) is not None]
        return f"{self.file}, line {self.xml.sourceline}, <{' '.join([self.tag, *told])}>"

    def fault(self, got: str, expected: str, remedy: str = "correct the file") -> None:
        """Note a fault of this element."""
        self.faults.append(Fault(str(self), got, expected, remedy))

    def children(self, *tags: str) -> Iterator[Node]:
        """Return the child elements with one of these names, or all, from the namespaces of SSP."""
        for xml in self.xml.iterchildren(tag=etree.Element):
            node = Node(xml, self.file, self.faults)
            if node.namespace.startswith(_BASE) and (not tags or node.tag in tags):
                yield node

    def child(self, *path: str) -> Node | None:
        """Return the first descendant along a path of names."""
        node: Node | None = self
        for tag in path:
            node = next(node.children(tag), None) if node else None
        return node

    def grandchildren(self, *path: str) -> Iterator[Node]:
        """Return all elements with the last name of a path, below the first of those before."""
        above = self.child(*path[:-1])
        return above.children(path[-1]) if above else iter(())

    def get(self, name: str, default: str = "") -> str:
        """Return an attribute."""
        return cast("str", self.xml.get(name, default))

    def given(self, name: str) -> str | None:
        """Return an attribute, or ``None`` where it is absent."""
        return cast("str | None", self.xml.get(name))

    def required(self, name: str) -> str:
        """Return an attribute that must be there."""
        if self.xml.get(name) is None:
            self.fault(f"no attribute {name}", "one")
        return self.get(name)

    def choice(self, name: str, allowed: tuple[str, ...], default: str) -> str:
        """Return an attribute that is one of several words."""
        value = self.get(name, default)
        if value not in allowed:
            self.fault(f'{name}="{value}"', f"one of {', '.join(allowed)}")
            return default
        return value

    def number(self, name: str, default: float) -> float:
        """Return an attribute that is a finite number."""
        text = self.given(name)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            self.fault(f'{name}="{text}"', "a finite number")
            return default
        return value

    def whole(self, name: str, default: int = 0) -> int:
        """Return an attribute that is a whole number."""
        text = self.given(name)
        if text is None:
            return default
        try:
            return int(text)
        except ValueError:
            self.fault(f'{name}="{text}"', "a whole number")
            return default

    def flag(self, name: str) -> bool:
        """Return an attribute that is true or false; false where it is absent."""
        text = self.get(name, "false").strip()
        if text not in _FLAGS:
            self.fault(f'{name}="{text}"', "true or false")
        return _FLAGS.get(text, False)


def parse(data: bytes, file: str, root: str, faults: Faults) -> Node | None:
    """Read a document; ``None`` if it is none of this kind, which the faults then tell.

    Parameters
    ----------
    data : its bytes.
    file : its name in messages.
    root : name that its root element must have.
    faults : collects what is wrong.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        xml = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        got = " ".join(str(error).split())
        faults.append(Fault(file, got, "well-formed XML", "write the file again"))
        return None
    node = Node(xml, file, faults)
    if xml.getroottree().docinfo.internalDTD is not None:
        node.fault("a document type declaration", "none, as its entities are not resolved", "remove it")
        return None
    if node.tag != root or not node.namespace.startswith(_BASE):
        node.fault(f"the root element {{{node.namespace}}}{node.tag}", f"{root} of SSP 1.0 or 2.0")
        return None
    version = node.get("version", "1.0")
    if version.partition(".")[0] not in {"1", "2"}:
        node.fault(f"version {version}", "SSP 1.0 or 2.0", "write the file for one of these")
        return None
    return node
