"""The check of an SSP: archive, documents, connections, parameters, units, types, FMUs and a short run."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from urllib.parse import unquote

from co_sim.archives import DEFAULT_LIMITS, contents, damage, safe_extract
from co_sim.checking.findings import Finding, Report, from_fault
from co_sim.checking.fmu import check_fmu
from co_sim.errors import Fault, InputError, RunError
from co_sim.fmu_variables import kind_of
from co_sim.ssp.binding import reaches
from co_sim.ssp.chain import Chain, MismatchError
from co_sim.ssp.network import GIVING, NO_UNIT, Pin
from co_sim.ssp.parsing import DEFAULT, read_structure
from co_sim.ssp.reading import Assembly
from co_sim.ssp.sources import PackedFile
from co_sim.ssp.validation import schema_faults
from co_sim.ssp.value_types import fits

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from co_sim.archives import Limits
    from co_sim.ssp.document import Faults, Node
    from co_sim.ssp.elements import Connector
    from co_sim.ssp.elements import Path as ElementPath
    from co_sim.ssp.network import Network
    from co_sim.ssp.reading import SspModel

__all__ = ["check_ssp"]

#: Topics of faults by the element that they are about.
_TOPICS = {
    "Connection": "connections",
    "LinearTransformation": "connections",
    "Connector": "connectors",
    "Component": "components",
    "System": "components",
    "SignalDictionaryReference": "connections",
    "DictionaryEntry": "connections",
}
_ABOUT = re.compile(r"<(\w+)[^>]*>")
#: Steps of the short run.
_STEPS = 100
#: Inputs named where several are free.
_MOST_NAMES = 5


def check_ssp(
    path: Path, *, run: bool = True, timeout: float = 60.0, limits: Limits = DEFAULT_LIMITS
) -> Report:
    """Find everything that is wrong with an SSP.

    Nothing of its FMUs is loaded into this process, and nothing raises because of what the file is.

    Parameters
    ----------
    path : an archive (``.ssp``) or a description (``.ssd``) with its sources beside it.
    run : whether to run it as well, and each of its FMUs, in processes of their own.
    timeout : longest time of the run of an FMU, and of a step of the whole, s.
    limits : what the archives may ask for.
    """
    return Report(str(path), tuple(_findings(path, limits, timeout if run else None)))


def _findings(path: Path, limits: Limits, timeout: float | None) -> Iterator[Finding]:
    if path.suffix.lower() == ".ssp":
        try:
            contents(path, limits)
        except InputError as error:
            yield from (from_fault(fault, "archive", str(path)) for fault in error.faults)
            return
        for fault in damage(path, limits):
            yield from_fault(fault, "archive", str(path))
    violations = list(_schema(path))
    yield from violations
    faults: Faults = []
    try:
        structure = read_structure(PackedFile(path), DEFAULT, faults)
    except InputError as error:
        yield from (from_fault(fault, "archive", str(path)) for fault in error.faults)
        return
    told = {finding.where for finding in violations}
    if structure is None:
        yield from (_finding(fault) for fault in faults if fault.what not in told)
        return
    assembly = Assembly(structure, faults)
    model = assembly.model()
    if not faults:
        faults += model.system.faults()
    # A document that cannot be read was told with the schemas.
    yield from (_finding(fault) for fault in faults if fault.what not in told)
    network = assembly.network
    yield from _connectors(network, {fault.what for fault in faults})
    yield from _parameters(network)
    yield from _experiment(model)
    yield from _free_inputs(network, model)
    yield from _fmus(assembly, timeout, limits)
    if timeout is not None:
        if faults:
            yield Finding("note", "short run", "", "left out: a run would refuse the system")
        else:
            yield _trial(model, timeout)


def _schema(path: Path) -> Iterator[Finding]:
    """Validate the documents of an archive and of those within it, or one beside which others lie."""
    for fault in schema_faults(path):
        yield _violation(fault)
    if path.suffix.lower() != ".ssp":
        return
    with TemporaryDirectory(prefix="check_") as folder:
        try:
            safe_extract(path, Path(folder))
        except InputError:  # told with the damage of the archive
            return
        for inner in sorted(Path(folder).rglob("*.[sS][sS][pP]")):
            for fault in schema_faults(inner):
                yield _violation(replace(fault, what=f"{path.name}/{fault.what}"))


def _violation(fault: Fault) -> Finding:
    """Return a fault by the schema, whose message says already what was expected."""
    return Finding("error", "schema", fault.what, f"{fault.got} ({fault.expected})")


def _finding(fault: Fault) -> Finding:
    """Return what keeps a system from running, under the topic of what it is about."""
    about = _ABOUT.search(fault.what)
    topic = _TOPICS.get(about[1], "parameters") if about else "system"
    if fault.got.startswith("units"):
        topic = "units"
    elif '>: parameter "' in fault.what:
        topic = "parameters"
    return Finding("error", topic, fault.what, f"{fault.got}; expected {fault.expected}")


def _connectors(network: Network, told: Collection[str]) -> Iterator[Finding]:
    """Hold declared connectors against the variables that they stand for; units unless told already."""
    for path in network.fmus:
        variables = network.fmus[path].variables
        for name, connector in network.elements[path].connectors.items():
            if name not in variables:
                continue  # A fault already.
            variable = variables[name]
            kind = kind_of(variable)
            if connector.type and kind is not None and not fits(connector.type, kind):
                message = f"is {connector.type}, but the FMU's variable is {variable.type}"
                yield Finding("error", "types", str(connector.node), message)
            if not _may_be(connector.kind, variable.causality):
                message = f"is of the kind {connector.kind}, but the FMU's variable is {variable.causality}"
                yield Finding("warning", "connectors", str(connector.node), message)
            if str(connector.node) not in told:
                yield from _connector_unit(network, path, connector)


def _may_be(kind: str, causality: str) -> bool:
    """Tell whether a connector of a kind can stand for a variable; SSP 1.0 has no connectors for some."""
    known = {"inout", "unspecified", causality}
    return kind in known or (kind == "output" and causality in GIVING)


def _connector_unit(network: Network, path: ElementPath, connector: Connector) -> Iterator[Finding]:
    if connector.measure is None:
        return
    if connector.measure.definition is None and connector.measure.name not in NO_UNIT:
        message = f'unit "{connector.measure.name}" is not among the Units of the document'
        yield Finding("error", "units", str(connector.node), message)
    try:
        Chain(network.fmus[path].measure(connector.name)).to(network.measure(Pin(path, connector.name)))
    except MismatchError as error:
        yield Finding("error", "units", str(connector.node), f"does not fit that of the FMU: {error}")


def _parameters(network: Network) -> Iterator[Finding]:
    """Find values that reach nothing, and those that others override at the same place."""
    last: dict[Pin, ElementPath] = {}
    for reach in reaches(network):
        node, name = reach.parameter.node, reach.parameter.name
        if not reach.targets:
            what = _told(node, reach.source)
            yield Finding("warning", "parameters", what, f'"{name}": nothing in the system has this name')
        for pin, _ in reach.targets:
            if last.get(pin) == reach.path:
                message = f"a second value for {'/'.join(pin.path)}.{pin.name}; this one counts"
                yield Finding("warning", "parameters", _told(node, reach.source), message)
            last[pin] = reach.path


def _told(node: Node, source: str) -> str:
    return str(node) if not source or source in node.file else f"{node} with {source}"


def _experiment(model: SspModel) -> Iterator[Finding]:
    start, stop = model.start_time or 0.0, model.stop_time
    if stop is not None and stop <= start:
        message = f"stops at {stop:g} s, not after its start at {start:g} s"
        yield Finding("warning", "experiment", "DefaultExperiment", message)


def _free_inputs(network: Network, model: SspModel) -> Iterator[Finding]:
    """Tell which inputs nobody feeds: they keep the values that they begin with."""
    ends = [*model.system.connections, *(wire for wires in model.inputs.values() for wire in wires)]
    # An element of an array has its index in brackets.
    fed = {end.target for end in ends} | {end.target.rpartition("[")[0] for end in ends}
    inputs = [f"{name}.{port.name}" for name, part in model.system.components.items() for port in part.inputs]
    free = [name for name in inputs if name not in fed]
    if free:
        more = f" and {len(free) - _MOST_NAMES} more" if len(free) > _MOST_NAMES else ""
        message = f"not connected, so that they keep their values: {', '.join(free[:_MOST_NAMES])}{more}"
        yield Finding("note", "inputs", "", message)


def _fmus(assembly: Assembly, timeout: float | None, limits: Limits) -> Iterator[Finding]:
    """Check each FMU as if it were alone; what several components use is checked once."""
    files: dict[Path, str] = {}
    for _, item in assembly.network.root.components():
        if item.fmu is not None:
            files.setdefault(item.fmu.path, unquote(item.node.get("source")))
    for file, source in files.items():
        report = check_fmu(file, run=timeout is not None, timeout=timeout or 1.0, limits=limits)
        for finding in report.findings:
            where = f"{source}: {finding.where}" if finding.where else source
            yield replace(finding, where=where)


def _trial(model: SspModel, timeout: float) -> Finding:
    """Run the system for some steps in a process of its own."""
    from co_sim.supervisor import Supervised

    h = model.system.step
    start = model.start_time or 0.0
    stop = model.stop_time if model.stop_time is not None and model.stop_time > start else None
    n = _STEPS if stop is None else max(1, min(_STEPS, round((stop - start) / h)))
    try:
        with Supervised(model.system, start, timeout=timeout) as supervised:
            supervised.run(n * h)
    except InputError as error:
        return Finding("error", "short run", "", f"refused: {' '.join(str(error).split())}")
    except RunError as error:
        words = f'; its last words: "{error.log[-1]}"' if error.log else ""
        return Finding("error", "short run", error.component, f"{error}{words}")
    message = f"{n} steps of {h:g} s from t = {start:g} s, free inputs at their values: outputs finite"
    return Finding("note", "short run", "", message)
