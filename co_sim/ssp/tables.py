"""The summary of an SSP as tables for a terminal of any width."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table
from rich.text import Text

from co_sim.tables import facts, plain_text, shortened

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rich.console import RenderableType

    from co_sim.ssp.summary import Part, Setting, Socket, SspSummary

__all__ = ["ssp_tables"]

_KINDS = {"calculatedParameter": "calculated", "structuralParameter": "structural"}
_LABELS = {"CoSimulation": "co-simulation", "ModelExchange": "model exchange", "any": ""}
_NOWHERE = "nothing has this name"
_ROOT = "the system"


def ssp_tables(summary: SspSummary, *, every: bool) -> Iterator[RenderableType]:
    """Iterate over the tables of an SSP.

    Parameters
    ----------
    summary : of the SSP.
    every : whether to list outputs and parameters that are neither connected nor set too, instead of
        their number.
    """
    yield _head(summary)
    if summary.parts:
        yield _parts(summary)
    for title, sockets in (("System inputs", summary.inputs), ("System outputs", summary.outputs)):
        if sockets:
            yield _sockets(title, sockets)
    hidden = 0
    for part in summary.parts:
        shown = [socket for socket in part.sockets if every or _matters(socket)]
        hidden += len(part.sockets) - len(shown)
        if shown:
            yield _sockets(part.name, shown)
    if hidden:
        yield Text(f"{hidden} more connectors without a connection (--all lists them)\n")
    yield from _links(summary)
    if summary.settings:
        yield _settings(summary.settings)
    if summary.faults:
        yield Text("What keeps it from running", style="bold red")
        for fault in summary.faults:
            yield plain_text(f"  {fault}")


def _matters(socket: Socket) -> bool:
    return socket.is_connected or socket.is_bound or socket.kind == "input"


def _head(summary: SspSummary) -> RenderableType:
    experiment = ", ".join(f"{name} {value:g} s" for name, value in summary.experiment.items())
    rows = {
        "description": summary.description,
        "SSP": summary.version,
        "written by": summary.tool,
        "author": summary.author,
        "experiment": experiment,
    }
    return facts(summary.name or summary.path, rows)


def _table(columns: dict[str, Sequence[str]], *, right: str = "") -> Table:
    """Return a table of texts; columns in which all cells are empty are left out."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    shown = {name: cells for name, cells in columns.items() if any(cells)}
    for name in shown:
        table.add_column(plain_text(name), overflow="fold", justify="right" if name == right else "left")
    for row in zip(*shown.values(), strict=True):
        table.add_row(*map(plain_text, row))
    return table


def _parts(summary: SspSummary) -> Table:
    parts = summary.parts
    return _table(
        {
            "Components": [part.name for part in parts],
            "source": [part.source or "none" for part in parts],
            "FMI": [part.fmi_version for part in parts],
            "as": [_LABELS.get(part.implementation, part.implementation) for part in parts],
            "runs here": [_runs(part) for part in parts],
        }
    )


def _runs(part: Part) -> str:
    if not part.fmi_version:
        return "no: see below"
    return "yes" if part.cannot_run is None else f"no: {part.cannot_run}"


def _sockets(title: str, sockets: Sequence[Socket]) -> Table:
    return _table(
        {
            title: [socket.name for socket in sockets],
            "kind": [_KINDS.get(socket.kind, socket.kind) for socket in sockets],
            "unit or type": [_unit_or_type(socket) for socket in sockets],
            "start": [_start(socket) for socket in sockets],
            "from": ["SSP" if s.is_bound else "FMU" if s.start is not None else "" for s in sockets],
            "connected": ["yes" if socket.is_connected else "no" for socket in sockets],
        },
        right="start",
    )


def _unit_or_type(socket: Socket) -> str:
    if socket.unit and socket.type in {"float64", "Real", "Float64", ""}:
        return socket.unit
    return f"{socket.type} {socket.unit}".strip()


def _start(socket: Socket) -> str:
    """Return a start value; numbers of FMUs are texts as their description has them."""
    if isinstance(socket.start, str) and socket.type.startswith("float"):
        return shortened(" ".join(f"{float(word):.15g}" for word in socket.start.split()))
    return _value(socket.start)


def _value(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.15g}"
    if isinstance(value, list):
        return shortened(" ".join(map(_value, value)))
    return shortened(str(value).lower() if isinstance(value, bool) else str(value))


def _links(summary: SspSummary) -> Iterator[Table]:
    """Iterate over the connections, a table for each system."""
    for system, group in groupby(summary.links, key=lambda link: link.system):
        links = list(group)
        yield _table(
            {
                f"Connections in {system}" if system else "Connections": [link.source for link in links],
                "to": [link.target for link in links],
                "on the way": [link.on_the_way for link in links],
            }
        )


def _settings(settings: Iterable[Setting]) -> Table:
    settings = list(settings)
    return _table(
        {
            "Parameters": [setting.name for setting in settings],
            "value": [_value(setting.value) for setting in settings],
            "unit": [setting.unit for setting in settings],
            "of": [setting.element or _ROOT for setting in settings],
            "in": [setting.source for setting in settings],
            "sets": ["\n".join(_effect(setting)) for setting in settings],
        },
        right="value",
    )


def _effect(setting: Setting) -> list[str]:
    """Return what a parameter sets, where its own names do not say so already."""
    own = f"{setting.element}.{setting.name}"
    lines = ["" if name == own else name for name in setting.sets]
    lines += [f"{'' if name == own else name} overridden".strip() for name in setting.overridden]
    return lines or [_NOWHERE]
