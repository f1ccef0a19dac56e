"""The command `wheelset report`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from co_sim.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.report import Report
    from co_sim.wheelset.reporting.setup import Setup

__all__ = ["report"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Options:
    """What was typed for a report over a grid; ``None`` where nothing was."""

    conditions: str | None
    speeds: str | None
    points: str | None
    sensors: str | None
    noise: str | None
    sample_rate: float | None
    window: float | None
    track: str | None
    parameters: Path | None
    seed: int | None


@click.command(
    epilog="""\b
Examples:
  wheelset report
  wheelset report --conditions dry,low --speeds 10:60:10 --out study
  wheelset report --points 0.1%,0.5%,2% --noise gyro=2e-4,accelerometer=0.01
  wheelset report --model results/bogie/bogie.ssp --at 2

\b
Writes to DIR:
  report.html     one self-contained page with a summary in words
  report.json     every number with its unit
  figures/        the figures as PNG and SVG

\b
Exit code: 0 done, 1 a check within the report failed (it is written), 2 a fault in what was given.
"""
)
@click.option("--conditions", metavar="NAMES", help="Rail conditions.  [default: dry,wet,low,very_low]")
@click.option("--speeds", metavar="RANGE", help="m/s, from:to:by or a list.  [default: 5:80:5]")
@click.option(
    "--points",
    metavar="POINTS",
    help="P1 (linear), P2 (peak), P3 (past it), or creepages.  [default: P1,P2,P3]",
)
@click.option(
    "--sensors", metavar="SETS", help="Sets to compare, as in gyro,gyro+accelerometer.  [default: five sets]"
)
@click.option("--noise", metavar="SENSOR=RMS,...", help="Of each sample, SI units.")
@click.option("--sample-rate", type=float, metavar="HZ", help="Of all sensors.  [default: 1000]")
@click.option("--window", type=float, metavar="SECONDS", help="Record to tell from.  [default: 1]")
@click.option("--track", metavar="NAME", help="erri_low or erri_high.  [default: erri_low]")
@click.option("--parameters", type=click.Path(path_type=Path), metavar="FILE", help="TOML: of the wheelset.")
@click.option("--seed", type=click.IntRange(min=0), help="Of all random numbers.  [default: 1]")
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Report on this FMU or SSP instead, linearised.",
)
@click.option("--at", type=float, metavar="TIME", help="With --model: run until then first, s.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="With --model: see simulate.")
@click.option(
    "--input", "inputs", multiple=True, metavar="PATTERN", help="With --model.  [default: all free]"
)
@click.option("--output", "outputs", multiple=True, metavar="PATTERN", help="With --model.  [default: all]")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[default: results/report]")
def report(
    model: Path | None,
    at: float | None,
    settings: tuple[str, ...],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    out: Path | None,
    **options: Any,
) -> None:
    """Tell what can be seen, steered and identified of a wheelset, and what cannot.

    Over a grid of rail conditions, speeds and points of the creep curve; or, with --model, of any FMU or SSP.
    """
    from co_sim.wheelset.output import check_folder
    from co_sim.wheelset.reporting.page import write_report

    given = _Options(**options)
    only_model = {"--at": at is not None, "--set": settings, "--input": inputs, "--output": outputs}
    if model is None:
        _refuse_stray([name for name, used in only_model.items() if used], "a model", "add --model FILE")
        setup, grid = _checked(given)
        folder = out or Path("results") / "report"
        check_folder(folder)
        made = _over_grid(setup, grid)
    else:
        stray = [f"--{name.replace('_', '-')}" for name, value in options.items() if value is not None]
        _refuse_stray(stray, "a report over a grid", "leave out --model, or this")
        folder = out or Path("results") / f"report-{model.stem}"
        check_folder(folder)
        made = _on_model(model, at, settings, inputs, outputs)
    write_report(made, folder)
    _show(made, folder)
    sys.exit(1 if made.faults else 0)


def _refuse_stray(names: Sequence[str], of: str, remedy: str) -> None:
    if names:
        raise InputError.from_faults([Fault(name, "given", f"only for {of}", remedy) for name in names])


def _checked(given: _Options) -> tuple[Setup, Grid]:
    """Return what was typed as objects, or raise all faults at once."""
    from co_sim.wheelset.reporting.grid import Grid, parse_conditions, parse_points, parse_speeds
    from co_sim.wheelset.reporting.setup import Setup, parse_noise, parse_sensors
    from co_sim.wheelset.vehicle_file import read_wheelset

    faults: list[Fault] = []

    def taken(parse: Callable[[Any], Any], value: object) -> Any:
        try:
            return None if value is None else parse(value)
        except InputError as error:
            faults.extend(error.faults)
            return None

    axes = {
        "conditions": taken(parse_conditions, given.conditions),
        "speeds": taken(parse_speeds, given.speeds),
        "points": taken(parse_points, given.points),
    }
    assumed = {
        "wheelset": taken(read_wheelset, given.parameters),
        "sensors": taken(parse_sensors, given.sensors),
        "noise": taken(parse_noise, given.noise),
        "sample_rate": given.sample_rate,
        "window": given.window,
        "track": given.track,
        "seed": given.seed,
    }
    # A value that could not be read is as if not given, so that the rest is checked as well.
    grid = taken(lambda values: Grid(**values), _without_none(axes))
    setup = taken(lambda values: Setup(**values), _without_none(assumed))
    if grid is not None and setup is not None:
        taken(grid.resolve, setup.wheelset)
    if faults:
        raise InputError.from_faults(faults)
    return setup, grid


def _without_none(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _over_grid(setup: Setup, grid: Grid) -> Report:
    """Compute the report under a bar for each section, where there is a terminal to show it."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from co_sim.wheelset.reporting.report import over_grid
    from co_sim.wheelset.reporting.sections import SECTIONS

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    console = Console(stderr=True)
    with Progress(
        *columns, TimeElapsedColumn(), console=console, transient=True, disable=not console.is_terminal
    ) as bars:
        tasks = [bars.add_task(name, total=1.0) for name in SECTIONS]
        return over_grid(
            setup,
            grid,
            list(SECTIONS.values()),
            progress=lambda index, share: bars.update(tasks[index], completed=share),
        )


def _on_model(
    model: Path,
    at: float | None,
    settings: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> Report:
    from rich.console import Console

    from co_sim.wheelset.reporting.model_report import report_fmu

    with Console(stderr=True).status("Linearising and analysing"):
        return report_fmu(model, at=at, settings=settings, inputs=inputs or None, outputs=outputs or None)


def _show(made: Report, folder: Path) -> None:
    """Print the short table, the failed checks and where everything is."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from co_sim.wheelset.reporting.page import cell_text

    if made.brief:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for column in made.brief.columns:
            table.add_column(column.name)
        for row in made.brief.rows:
            table.add_row(*map(cell_text, row))
        Console(highlight=False, markup=False).print(table)
    for text in made.faults:
        click.echo(f"check failed: {text}", err=True)
    click.echo(f"{folder / 'report.html'} has the answers, {folder / 'report.json'} every number")
