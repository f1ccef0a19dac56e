"""Validation against the schemas of the standard, which lie beside this file unchanged."""

from __future__ import annotations

import zipfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lxml import etree

from co_sim.errors import Fault
from co_sim.ssp.document import NAMESPACES, parse

if TYPE_CHECKING:
    from os import PathLike

    from co_sim.ssp.document import Faults, Node

__all__ = ["schema_faults"]

_SCHEMAS = Path(__file__).parent / "schema"
#: Root elements by the ending of the files, and the schemas for them.
_ROOTS = {
    ".ssd": ("SystemStructureDescription", "SystemStructureDescription"),
    ".ssv": ("ParameterSet", "SystemStructureParameterValues"),
    ".ssm": ("ParameterMapping", "SystemStructureParameterMapping"),
    ".ssb": ("SignalDictionary", "SystemStructureSignalDictionary"),
}
#: What may be contained in a description, where its schema accepts anything.
_INLINE = {"ssv": ".ssv", "ssm": ".ssm", "ssb": ".ssb"}


def schema_faults(path: PathLike[str] | str) -> list[Fault]:
    """Return all violations of the schemas of SSP 1.0 and 2.0; empty for a valid file.

    Parameters
    ----------
    path : an archive (``.ssp``), or one document (``.ssd``, ``.ssv``, ``.ssm`` or ``.ssb``).
    """
    faults: Faults = []
    for name, data in _documents(Path(path), faults):
        ending = Path(name).suffix.lower()
        root = parse(data, name, _ROOTS[ending][0], faults)
        if root is not None:
            _validate(root, ending)
    return faults


def _documents(path: Path, faults: Faults) -> list[tuple[str, bytes]]:
    try:
        if path.suffix.lower() in _ROOTS:
            return [(path.name, path.read_bytes())]
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if Path(name).suffix.lower() in _ROOTS]
            if "SystemStructure.ssd" not in names:
                faults.append(Fault(path.name, "no SystemStructure.ssd", "one at the top", "add it"))
            return [(f"{path.name}/{name}", archive.read(name)) for name in names]
    except (OSError, RuntimeError, zipfile.BadZipFile) as error:
        faults.append(Fault(str(path), str(error), "an archive or a document of SSP", "check the path"))
        return []


def _validate(root: Node, ending: str) -> None:
    """Note the violations in a document and in those that it contains."""
    version = "1.0" if root.get("version", "1.0").startswith("1") else "2.0"
    parts = [(root.xml, ending, version)]
    if ending == ".ssd":
        for short, inner in _INLINE.items():
            tag = f"{{{NAMESPACES[short]}}}{_ROOTS[inner][0]}"
            parts.extend(
                (xml, inner, "1.0" if xml.get("version", version).startswith("1") else "2.0")
                for xml in root.xml.iter(tag)
            )
    for xml, kind, its_version in parts:
        schema = _schema(kind, its_version)
        if not schema.validate(xml):
            root.faults.extend(
                Fault(
                    f"{root.file}, line {entry.line}",
                    _plain(entry.message),
                    f"SSP {its_version}",
                    "correct it",
                )
                for entry in schema.error_log
            )


@cache
def _schema(ending: str, version: str) -> Any:
    return etree.XMLSchema(file=str(_SCHEMAS / version / f"{_ROOTS[ending][1]}.xsd"))


def _plain(message: str) -> str:
    """Return a message without the namespaces, which all begin alike."""
    for namespace in NAMESPACES.values():
        message = message.replace(f"{{{namespace}}}", "")
    return message
