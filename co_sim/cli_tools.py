"""The commands for any FMU or SSP: `wheelset inspect` and `wheelset check`."""

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

    from co_sim.fmu_summary import FmuSummary
    from co_sim.ssp.summary import SspSummary

__all__ = ["check", "inspect"]

_FILE = click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
_JSON = click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
_SYSTEMS = (".ssp", ".ssd")
_ENDINGS = (".fmu", *_SYSTEMS)
_PICTURES = (".png", ".svg", ".pdf")


@click.command(
    epilog="""\b
Examples:
  wheelset inspect vehicle.fmu
  wheelset inspect vehicle.fmu --all
  wheelset inspect vehicle.fmu --json | jq '.variables[] | select(.causality == "input") | .name'
  wheelset inspect bogie.ssp --diagram bogie.svg
"""
)
@_FILE
@click.option("--all", "every", is_flag=True, help="List local variables and free connectors too.")
@click.option(
    "--diagram",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PICTURE",
    help="Draw the system of an SSP, as .png, .svg or .pdf.",
)
@_JSON
def inspect(file: Path, every: bool, diagram: Path | None, as_json: bool) -> None:
    """Show what FILE, an FMU or an SSP, is: ports, units, start values, capabilities, connections.

    No code of it runs.
    """
    is_system = _require_known(file)
    if diagram is not None:
        _require_picture(diagram, is_system=is_system)
    summary: FmuSummary | SspSummary
    if is_system:
        from co_sim.ssp.summary import summarise as summarise_ssp
        from co_sim.ssp.tables import ssp_tables

        summary = summarise_ssp(file)
        tables = ssp_tables(summary, every=every)
        if diagram is not None:
            _draw(summary, diagram)
    else:
        from co_sim.fmu_summary import summarise
        from co_sim.tables import summary_tables

        summary = summarise(file)
        tables = summary_tables(summary, every=every)
    if as_json:
        click.echo(json.dumps(summary.as_dict(), indent=2, ensure_ascii=False))
    else:
        _show(tables)
        if diagram is not None:
            click.echo(f"{diagram}: the diagram")


@click.command(
    epilog="""\b
Examples:
  wheelset check vehicle.fmu
  wheelset check vehicle.fmu --no-run
  wheelset check vehicle.fmu --json > findings.json
  wheelset check bogie.ssp

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
    """Find everything that is wrong with FILE, an FMU or an SSP.

    That is documents, variables, libraries, connections, parameters, and a short run. Libraries are read
    without loading them; the run is in a process of its own, which may crash or hang.
    """
    from co_sim.checking import check_fmu, check_ssp
    from co_sim.tables import report_tables

    report = (check_ssp if _require_known(file) else check_fmu)(file, run=run, timeout=timeout)
    if as_json:
        click.echo(json.dumps(asdict(report) | {"passed": report.passed}, indent=2, ensure_ascii=False))
    else:
        _show(report_tables(report))
    sys.exit(0 if report.passed else 1)


def _require_known(file: Path) -> bool:
    """Tell whether a file is a system rather than an FMU."""
    if file.suffix.lower() not in _ENDINGS:
        raise InputError(
            str(file),
            got=f"the ending {file.suffix!r}",
            expected=f"one of {', '.join(_ENDINGS)}",
            remedy="rename it if it is one",
        )
    return file.suffix.lower() in _SYSTEMS


def _require_picture(path: Path, *, is_system: bool) -> None:
    if not is_system:
        raise InputError(
            "--diagram", got="an FMU", expected="an SSP, which has components to draw", remedy="leave it out"
        )
    if path.suffix.lower() not in _PICTURES:
        raise InputError(
            f"--diagram {path}",
            got=f"the ending {path.suffix!r}",
            expected=f"one of {', '.join(_PICTURES)}",
            remedy="choose one of them",
        )


def _draw(summary: SspSummary, path: Path) -> None:
    from co_sim.diagram.drawing import draw

    try:
        draw(summary.pictures, path)
    except OSError as error:
        raise InputError(
            f"--diagram {path}", got=str(error.strerror), expected="a file to write", remedy="choose another"
        ) from error


def _show(parts: Iterable[RenderableType]) -> None:
    console = Console(highlight=False)
    for part in parts:
        console.print(part)
