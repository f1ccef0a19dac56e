"""The command `wheelset`.

Exit codes: 0 done, 1 a run stopped early (its results are kept), 2 a fault in what was given (nothing
is written), 130 interrupted.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click
from rich import box
from rich.console import Console
from rich.table import Table

from co_sim.cli_tools import check, inspect
from co_sim.errors import InputError, RunError
from co_sim.tool.simulate import simulate
from co_sim.wheelset.identifying.command import identify
from co_sim.wheelset.report_command import report
from co_sim.wheelset.studies.command import campaign

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray
    from rich.progress import Progress

    from co_sim.component import Vector
    from co_sim.system import Signal
    from co_sim.wheelset.bogie.choice import Choice
    from co_sim.wheelset.experiment import Laboratory
    from co_sim.wheelset.results import Experiment, Stretch

__all__ = ["main"]


@click.group(
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="""\b
Examples:
  wheelset run                              the packaged default: dry rail, P1, P2 and P3
  wheelset run adhesion-drop --out drop     the other packaged scenario, results in ./drop
  wheelset scenario default > mine.toml     a scenario file to start from
  wheelset run mine.toml --out mine
  wheelset inspect vehicle.fmu              ports, units and capabilities of any FMU or SSP
  wheelset check vehicle.fmu                everything that is wrong with it
""",
)
@click.version_option(package_name="wheelset-cosim", prog_name="wheelset")
def cli() -> None:
    """FMI co-simulation for wheel-rail adhesion.

    A nonlinear wheelset FMU, a bank of Kalman filters and a fuzzy identifier that tells from a gyro and
    an accelerometer where on the creep curve the wheelset runs.
    """


@cli.command(
    epilog="""\b
Examples:
  wheelset run
  wheelset run adhesion-drop --out drop
  wheelset run mine.toml --out mine --seed 7
  wheelset run bogie

\b
Writes to DIR:
  report.html     one self-contained page: what was run, what came out, what to make of it
  summary.json    every number of the report, the scenario, the seed and the versions
  results.csv     all signals of all runs, units in the header
  logs/           what the sensors said in each run, for `wheelset identify`
  figures/        the figures of the report as PNG
"""
)
@click.argument("scenario", default="default")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for the results.  [default: results/SCENARIO]",
)
@click.option("--seed", type=click.IntRange(min=0), help="Use this seed instead of the scenario's.")
@click.option("--in-process", is_flag=True, help="Run in this process, without protection; for debugging.")
def run(scenario: str, out: Path | None, seed: int | None, in_process: bool) -> None:
    """Run SCENARIO: a packaged scenario by name (`default`, `adhesion-drop`) or a TOML file.

    `bogie` runs two wheelset FMUs under a frame of another exporter.
    """
    if scenario == "bogie":
        _run_bogie(out or Path("results") / "bogie", seed, in_process=in_process)
        return
    from co_sim.wheelset.experiment import Laboratory
    from co_sim.wheelset.output import check_folder, write
    from co_sim.wheelset.scenario_file import load_scenario

    try:
        loaded, folder = load_scenario(scenario)
        if seed is not None:
            loaded = loaded.model_copy(update={"seed": seed})
        name = Path(scenario).stem
        out = out or Path("results") / name
        check_folder(out)
        experiment = _simulate(Laboratory(loaded, name, folder, in_process=in_process))
    except InputError as error:
        _refuse(error)
    except RunError as error:
        _stop(error)
    with Console(stderr=True).status("Drawing figures and writing the report"):
        write(experiment, out)
    console = Console(highlight=False)
    console.print(_result_table(experiment))
    console.print(_legend(experiment))
    click.echo(f"\n{out / 'report.html'} has the figures and what to make of them")
    stopped = [f"{r.name}: {r.stopped}" for r in experiment.runs if r.stopped]
    for line in stopped:
        click.echo(f"stopped early, {line}", err=True)
    if any(run.interrupted for run in experiment.runs):
        sys.exit(130)
    sys.exit(1 if stopped else 0)


def _run_bogie(out: Path, seed: int | None, *, in_process: bool) -> None:
    from co_sim.wheelset.bogie.run import prepare
    from co_sim.wheelset.output import check_folder

    status = Console(stderr=True).status("Choosing step and algorithm")
    try:
        check_folder(out)
        with status:
            bogie = prepare(out, 1 if seed is None else seed, in_process=in_process)
            click.echo(_choice_table(bogie.choice))
            status.update("Running the bogie")
            bogie.write_system(out)
            bogie.write(bogie.simulate(out), out)
    except InputError as error:
        _refuse(error)
    except RunError as error:
        _stop(error)
    click.echo(f"\n{out / 'report.html'} has the figures, {out / 'bogie.ssp'} the system for other tools")


def _choice_table(choice: Choice) -> str:
    """Return what was tried, and the check of what was chosen in full."""
    lines = ["algorithm     order  step       largest error, of its range"]
    for trial in choice.trials:
        worst, coupling = trial.check.signals[0], trial.coupling
        lines.append(
            f"{coupling.algorithm:12}  {coupling.order:5}  {trial.check.step:g} s"
            f"{worst.relative:10.2%}  {worst.name}"
        )
    return "\n".join([*lines, "", str(choice.chosen.check)])


def _simulate(laboratory: Laboratory) -> Experiment:
    """Run the experiment under a progress bar, where there is a terminal to show it."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    console = Console(stderr=True)
    with Progress(
        *columns, TimeRemainingColumn(), console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        return laboratory.run(observers=[_ProgressBar(bar, laboratory.steps)])


class _ProgressBar:
    """Observer that moves a bar on over all runs of an experiment."""

    def __init__(self, bar: Progress, steps: int) -> None:
        self._bar = bar
        self._task = bar.add_task("Co-simulation", total=steps)

    def begin(self, signals: Sequence[Signal], t0: float, h: float, n_steps: int) -> None:
        """Nothing to prepare: the bar spans all runs."""

    def observe(self, k: int, time: Vector, values: NDArray[np.float64]) -> None:
        """Move on by the steps of a block; the first row of a run is no step."""
        self._bar.advance(self._task, len(time) if k > 0 else 0)

    def end(self, error: BaseException | None) -> None:
        """Leave the bar where it is for the next run."""


def _result_table(experiment: Experiment) -> Table:
    """Return one row for each stretch of each run."""
    table = Table(title=experiment.scenario.title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    several = len(experiment.runs) > 1
    table.add_column("run" if several else "time", no_wrap=True)
    table.add_column("rail")
    for name in experiment.filter_names:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("S/N", justify="right")
    for stretch in experiment.stretches:
        table.add_row(
            stretch.run if several else f"{stretch.since:g}-{stretch.until:g} s",
            stretch.condition,
            *(_cell(stretch, name) for name in experiment.filter_names),
            f"{stretch.signal_to_noise['gyro']:.2g}" if stretch.signal_to_noise else "-",
        )
    return table


def _legend(experiment: Experiment) -> str:
    limit = experiment.scenario.identifier.valid_offset
    return (
        f"Share of windows in which the filter's residual was the smallest, and its mean fuzzy probability, "
        f"while the wheelset was within {limit * 1e3:g} mm of the track. * true hypothesis. "
        f"S/N: rms of the true yaw rate over the rms of the gyro's noise."
    )


def _cell(stretch: Stretch, name: str) -> str:
    shares, p = stretch.share_smallest_valid, stretch.mean_probability_valid
    if shares is None or p is None:
        return "-"
    return f"{'*' if name in stretch.expected else ''} {shares[name]:.0%}  {p[name]:.2f}"


@cli.command(
    epilog="""\b
Examples:
  wheelset scenario                         the names of the packaged scenarios
  wheelset scenario default > mine.toml     a file to start from
  wheelset scenario --fields                every field with its default and meaning
"""
)
@click.argument("name", required=False)
@click.option("--fields", is_flag=True, help="List every field of a scenario file.")
def scenario(name: str | None, fields: bool) -> None:
    """Show the packaged scenario NAME, or the names of all."""
    from co_sim.wheelset.scenario_file import field_table, packaged_names, packaged_text

    try:
        if fields:
            _print_fields(list(field_table()))
        elif name is not None:
            click.echo(packaged_text(name), nl=False)
        else:
            click.echo("\n".join(packaged_names()))
    except InputError as error:
        _refuse(error)


@cli.command(
    epilog="""\b
Examples:
  wheelset export --out wheelset.fmu
  wheelset export --fmi 2 --out heavy.fmu --parameters heavy.toml

\b
FILE.toml holds start values by the names of the FMU's variables:
  m_w = 1500.0
  drive_mode = "torque_driven"
  patch.a = 7e-3
"""
)
@click.option("--fmi", type=click.Choice(["2", "3"]), default="3", show_default=True, help="FMI version.")
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", required=True, help="File to write.")
@click.option("--parameters", type=click.Path(path_type=Path), metavar="FILE", help="TOML of start values.")
def export(fmi: str, out: Path, parameters: Path | None) -> None:
    """Write the wheelset FMU for other tools, with start values of your own if asked."""
    import fmu_wheelset
    from fmu_wheelset.exporting import read_start_values

    try:
        start_values = read_start_values(parameters) if parameters else None
        click.echo(fmu_wheelset.export(out, 2 if fmi == "2" else 3, start_values))
    except (ValueError, RuntimeError, FileNotFoundError) as error:
        _refuse(error)
    except OSError as error:
        _refuse(
            InputError(str(out), got=str(error.strerror), expected="a file to write", remedy="check the path")
        )


cli.add_command(inspect)
cli.add_command(check)
cli.add_command(simulate)
cli.add_command(identify)
cli.add_command(report)
cli.add_command(campaign)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command with `arguments`, by default those of the process, and exit."""
    try:
        cli(args=arguments, prog_name="wheelset", standalone_mode=False)
    except InputError as error:
        _refuse(error)
    except click.UsageError as error:
        error.show()
        sys.exit(2)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; files that are there are complete", err=True)
        sys.exit(130)
    except BrokenPipeError:  # the reader of the output, such as `head`, has had enough
        sys.stderr.close()
        sys.exit(0)
    sys.exit(0)


def _stop(error: RunError) -> NoReturn:
    for line in (f"error: {error}", *getattr(error, "__notes__", ())):
        click.echo(line, err=True)
    sys.exit(1)


def _refuse(error: Exception) -> NoReturn:
    for line in str(error).splitlines():
        click.echo(f"error: {line}", err=True)
    sys.exit(2)


def _print_fields(rows: list[tuple[str, str, str]]) -> None:
    table = Table("field", "default", "meaning", box=None, pad_edge=False)
    for row in rows:
        table.add_row(*row)
    Console(soft_wrap=not sys.stdout.isatty()).print(table, markup=False)
