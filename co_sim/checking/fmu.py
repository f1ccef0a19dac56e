"""The check of an FMU: archive, documents, variables, structure, libraries and a short run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from co_sim.archives import DEFAULT_LIMITS, contents, damage, read_entry
from co_sim.checking.binaries import binary_findings
from co_sim.checking.findings import Finding, Report, from_fault
from co_sim.checking.structure import structure_findings
from co_sim.checking.trial import trial_findings
from co_sim.checking.variables import variable_findings
from co_sim.errors import InputError
from co_sim.fmi_description import DESCRIPTION, description_schema, read_description, schema_folder
from co_sim.fmu_elements import Declaration, reference_faults
from co_sim.safe_xml import parse, schema_faults

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from lxml.etree import _Element

    from co_sim.archives import Limits
    from co_sim.errors import Fault

__all__ = ["check_fmu"]

#: Further documents of FMI 3 and their schemas.
_DOCUMENTS = {
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons.xsd",
    "sources/buildDescription.xml": "fmi3BuildDescription.xsd",
}
_MANIFEST = "fmi-ls-manifest.xml"


def check_fmu(
    path: Path, *, run: bool = True, timeout: float = 60.0, limits: Limits = DEFAULT_LIMITS
) -> Report:
    """Find everything that is wrong with an FMU.

    Nothing of it is loaded into this process, and nothing raises because of what the FMU is.

    Parameters
    ----------
    path : the FMU.
    run : whether to run it as well, in a process of its own, if it can be run here.
    timeout : longest time of a run, s.
    limits : what the archive may ask for.
    """
    return Report(str(path), tuple(_findings(path, limits, timeout if run else None)))


def _findings(path: Path, limits: Limits, timeout: float | None) -> Iterator[Finding]:
    what = f"{path}: {DESCRIPTION}"
    try:
        names = contents(path, limits)
    except InputError as error:
        yield from (from_fault(fault, "archive", str(path)) for fault in error.faults)
        return
    for fault in damage(path, limits):
        yield from_fault(fault, "archive", str(path))
    try:
        root = parse(read_entry(path, DESCRIPTION, limits), what)
        schema = description_schema(root, what)
    except InputError as error:
        yield from (from_fault(fault, "model description", str(path)) for fault in error.faults)
        return
    yield from _schema(root, schema, what)
    for name in names:
        if name.rpartition("/")[2] == _MANIFEST or name in _DOCUMENTS:
            yield from _document(path, name, limits)
    if root.get("fmiVersion") == "1.0":
        message = "is for FMI 1.0; this master runs FMI 2.0 and 3.0, so that nothing else is checked"
        yield Finding("error", "model description", DESCRIPTION, message)
        return
    yield from _declared(path, root, what)
    if timeout is not None:
        yield from _trials(path, timeout)


def _schema(root: _Element, schema: Path, what: str) -> Iterator[Finding]:
    yield from (_violation(fault, what) for fault in schema_faults(root, schema, what))


def _document(path: Path, name: str, limits: Limits) -> Iterator[Finding]:
    what = f"{path}: {name}"
    try:
        root = parse(read_entry(path, name, limits), what)
    except InputError as error:
        yield from (from_fault(fault, "schema", str(path)) for fault in error.faults)
        return
    schema = schema_folder(3) / _DOCUMENTS.get(name, "fmi3LayeredStandardManifest.xsd")
    yield from (_violation(fault, str(path)) for fault in schema_faults(root, schema, what))


def _violation(fault: Fault, what: str) -> Finding:
    """Return a fault by the schema, whose message says already what was expected."""
    finding = from_fault(fault, "schema", what)
    return replace(finding, message=fault.got)


def _declared(path: Path, root: _Element, what: str) -> Iterator[Finding]:
    declaration = Declaration(root)
    for fault in reference_faults(declaration, what):
        yield from_fault(fault, "references", what)
    yield from variable_findings(declaration)
    yield from structure_findings(declaration)
    yield from binary_findings(path, declaration)


def _trials(path: Path, timeout: float) -> Iterator[Finding]:
    """Run each interface type that can be run here."""
    from co_sim.exchange_model import model_type
    from co_sim.fmi import slave_type

    try:
        description = read_description(path)
    except InputError:
        yield Finding("note", "short run", "", "left out: a run would refuse the description")
        return
    for kind, interface, adapter in (
        ("CoSimulation", description.coSimulation, slave_type),
        ("ModelExchange", description.modelExchange, model_type),
    ):
        if interface is None:
            continue
        try:
            adapter(path, description)
        except InputError as error:
            yield Finding("note", "short run", kind, f"left out: {error.faults[0].got}")
            continue
        yield from trial_findings(path, kind, timeout)
