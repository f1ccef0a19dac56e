"""The commands for any FMU: `wheelset inspect` and `wheelset check`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import RenderableType

__all__ = ["check", "inspect"]

_FILE = click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
_JSON = click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
_ENDINGS = (".fmu",)


@click.command(
    epilog="""\b
Examples:
  wheelset inspect vehicle.fmu
  wheelset inspect vehicle.fmu --all
  wheelset inspect vehicle.fmu --json | jq '.variables[] | select(.causality == "input") | .name'
"""
)
@_FILE
@click.option("--all", "every", is_flag=True, help="List local variables too.")
@_JSON
def inspect(file: Path, every: bool, as_json: bool) -> None:
    """Show what FILE is: ports, units, start values, capabilities. No code of it runs."""
    from co_sim.fmu_summary import summarise
    from co_sim.tables import summary_tables

    _require_known(file)
    summary = summarise(file)
    if as_json:
        click.echo(json.dumps(summary.as_dict(), indent=2, ensure_ascii=False))
    else:
        _show(summary_tables(summary, every=every))


@click.command(
    epilog="""\b
Examples:
  wheelset check vehicle.fmu
  wheelset check vehicle.fmu --no-run
  wheelset check vehicle.fmu --json > findings.json

\b
Exit code: 0 no errors, 1 errors, 2 the file cannot be checked.
"""
)
@_FILE
@click.option("--run/--no-run", default=True, help="Whether to run it for a hundred steps.  [default: run]")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.0, min_open=True),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="Longest time of that run.",
)
@_JSON
def check(file: Path, run: bool, timeout: float, as_json: bool) -> None:
    """Find everything that is wrong with FILE: documents, variables, libraries, and a short run.

    Its libraries are read without loading them; the run is in a process of its own, which may crash or hang.
    """
    from co_sim.checking import check_fmu
    from co_sim.tables import report_tables

    _require_known(file)
    report = check_fmu(file, run=run, timeout=timeout)
    if as_json:
        click.echo(json.dumps(asdict(report) | {"passed": report.passed}, indent=2, ensure_ascii=False))
    else:
        _show(report_tables(report))
    sys.exit(0 if report.passed else 1)


def _require_known(file: Path) -> None:
    if file.suffix.lower() not in _ENDINGS:
        raise InputError(
            str(file),
            got=f"the ending {file.suffix!r}",
            expected=f"one of {', '.join(_ENDINGS)}",
            remedy="rename it if it is one",
        )


def _show(parts: Iterable[RenderableType]) -> None:
    console = Console(highlight=False)
    for part in parts:
        console.print(part)
