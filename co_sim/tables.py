"""Summaries and reports as tables for a terminal of any width."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rich import box
from rich.table import Table
from rich.text import Text

from co_sim.fmi import this_platform
from co_sim.fmu_summary import CAPABILITIES

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from co_sim.checking import Finding, Report
    from co_sim.fmu_summary import FmuSummary, Quantity

__all__ = ["facts", "plain_text", "report_tables", "shortened", "summary_tables"]

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}
_LABELS = {"CoSimulation": "co-simulation", "ModelExchange": "model exchange"}
#: Characters of a start value that are shown.
_LONGEST_START = 20
#: Characters of a column, which leave room for descriptions on a terminal of 80.
_WIDEST_NAME = 26
_WIDEST = {"unit or type": 13, "start": 11, "range": 9}
_SMALLEST = sys.float_info.min


def summary_tables(summary: FmuSummary, *, every: bool) -> Iterator[RenderableType]:
    """Iterate over the tables of an FMU.

    Parameters
    ----------
    summary : of the FMU.
    every : whether to list local variables too, instead of their number.
    """
    yield _head(summary)
    yield _capabilities(summary)
    groups = [
        ("Inputs", ("input",)),
        ("Outputs", ("output",)),
        ("Parameters", ("parameter", "structuralParameter")),
        ("Calculated parameters", ("calculatedParameter",)),
    ]
    if every:
        groups.append(("Local variables", ("local", "independent")))
    for title, causalities in groups:
        if quantities := summary.of(*causalities):
            yield _variables(title, quantities)
    if not every and (n := len(summary.of("local"))):
        yield Text(f"{n} local variables (--all lists them)")


def report_tables(report: Report) -> Iterator[RenderableType]:
    """Iterate over the findings of a report, and their number."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    for (severity, topic, message), group in _alike(report.findings).items():
        where = "; ".join(finding.where for finding in group if finding.where)
        cell = plain_text(f"{topic}: {where}\n" if where else f"{topic}\n").append_text(plain_text(message))
        grid.add_row(Text(severity, style=_STYLES[severity]), cell)
    yield grid
    n, m = len(report.of("error")), len(report.of("warning"))
    verdict = f"{n} error{'s' * (n != 1)}, {m} warning{'s' * (m != 1)}"
    yield Text(f"{report.path}: {verdict}", style="bold red" if n else "bold")


def _alike(findings: Iterable[Finding]) -> dict[tuple[str, str, str], list[Finding]]:
    """Return groups of findings that say the same of several places."""
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.topic, finding.message), []).append(finding)
    return groups


def _head(summary: FmuSummary) -> RenderableType:
    rows = {
        "description": summary.description,
        "FMI": summary.fmi_version,
        "exported by": summary.tool,
        "author": summary.author,
        "version": summary.version,
        "platforms": _platforms(summary),
        "states": _states(summary),
        "experiment": _experiment(summary),
    }
    return facts(summary.model or summary.path, rows)


def facts(title: str, rows: Mapping[str, str | None]) -> Table:
    """Return facts with their names below a title; those without a value are left out."""
    grid = Table.grid(padding=(0, 2))
    grid.title = plain_text(title)
    grid.title.stylize("bold")
    grid.title_justify = "left"
    grid.add_column(no_wrap=True, style="dim")
    grid.add_column()
    for name, value in rows.items():
        if value:
            grid.add_row(name, plain_text(value))
    return grid


def _platforms(summary: FmuSummary) -> str:
    here = this_platform(int(summary.fmi_version[0]))
    found = [f"{name} (this machine)" if name == here else name for name in summary.platforms]
    return ", ".join([*found, *(["sources"] if summary.has_sources else [])]) or "none"


def _states(summary: FmuSummary) -> str:
    if not summary.n_states and not summary.n_event_indicators:
        return ""
    return f"{summary.n_states} continuous, {summary.n_event_indicators} event indicators"


def _experiment(summary: FmuSummary) -> str:
    units = {"start": " s", "stop": " s", "step": " s", "tolerance": ""}
    return ", ".join(f"{name} {value:g}{units[name]}" for name, value in summary.experiment.items())


def _capabilities(summary: FmuSummary) -> RenderableType:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("Capabilities")
    for interface in summary.interfaces:
        table.add_column(_LABELS.get(interface.kind, "scheduled execution"))
    reasons = [interface.cannot_run for interface in summary.interfaces]
    table.add_row("runs here", *(Text("yes") if r is None else plain_text(f"no: {r}") for r in reasons))
    for flag, words in CAPABILITIES.items():
        cells = [interface.capabilities.get(flag) for interface in summary.interfaces]
        if any(cell is not None for cell in cells):
            table.add_row(words, *("" if cell is None else "yes" if cell else "no" for cell in cells))
    return table


def _variables(title: str, quantities: Sequence[Quantity]) -> Table:
    """Return a table of variables; columns in which all cells are empty are left out."""
    columns = {
        title: [quantity.name for quantity in quantities],
        "unit or type": [_unit_or_type(quantity) for quantity in quantities],
        "start": [_start(quantity) for quantity in quantities],
        "range": [_range(quantity) for quantity in quantities],
        "description": [_description(quantity) for quantity in quantities],
    }
    # Descriptions, where there are any, take what the others leave.
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, expand=any(columns["description"]))
    shown = {name: cells for name, cells in columns.items() if any(cells)}
    for name in shown:
        is_last = name == "description"
        table.add_column(
            plain_text(name),
            overflow="fold",
            justify="right" if name == "start" else "left",
            ratio=1 if is_last else None,
            max_width=None if is_last else _WIDEST.get(name, _WIDEST_NAME),
        )
    for row in zip(*shown.values(), strict=True):
        table.add_row(*map(plain_text, row))
    return table


def _unit_or_type(quantity: Quantity) -> str:
    """Return the unit, with the type before it unless it is a float64 that moves smoothly."""
    shape = f"[{','.join(map(str, quantity.shape))}]" if quantity.shape else ""
    discrete = " discrete" if quantity.variability == "discrete" and quantity.kind.startswith("float") else ""
    plain = quantity.kind == "float64" and quantity.unit and not shape and not discrete
    kind = "" if plain else f"{quantity.kind}{shape}{discrete}"
    return f"{kind} {quantity.unit}".strip()


def _start(quantity: Quantity) -> str:
    if quantity.start is None:
        return ""
    if quantity.kind == "string":
        texts = [quantity.start] if isinstance(quantity.start, str) else quantity.start
        return shortened(" ".join(f'"{text}"' for text in texts))
    words = str(quantity.start).split()
    if quantity.kind == "enumeration":
        words = [quantity.literals.get(int(word), word) for word in words]
    elif quantity.kind.startswith("float"):
        words = [f"{float(word):.15g}" for word in words]
    return shortened(" ".join(words))


def shortened(text: str) -> str:
    """Return a value as it is shown, without the end of a long one."""
    return text if len(text) <= _LONGEST_START else f"{text[: _LONGEST_START - 3]}..."


def _range(quantity: Quantity) -> str:
    low, high = quantity.minimum, quantity.maximum
    # The smallest number there is stands for an open interval.
    above = "" if low is None else "> 0" if 0.0 < float(low) <= _SMALLEST else f"≥ {float(low):g}"
    below = "" if high is None else f"≤ {float(high):g}"
    return "\n".join(filter(None, (above, below)))


def _description(quantity: Quantity) -> str:
    literals = ", ".join(quantity.literals.values())
    return f"{quantity.description} ({literals})".strip() if literals else quantity.description


def plain_text(content: str) -> Text:
    """Return a text from somebody else: no markup, and nothing that moves the cursor."""
    return Text("".join(c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in content))
