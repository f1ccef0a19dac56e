"""The command that runs any FMU or SSP."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from co_sim.coupling import Algorithm
from co_sim.errors import InputError, RunError

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.observers import Observer, Recorder
    from co_sim.system import System
    from co_sim.tool.loading import Loaded

__all__ = ["simulate"]

_FORMATS = ("csv", "parquet", "mat")


@click.command(
    epilog="""\b
Examples:
  wheelset simulate motor.fmu --stop 2 --record 'torque*' --plot
  wheelset simulate vehicle.ssp --step 1e-4 --algorithm gauss-seidel --check
  wheelset simulate wheelset.fmu --set drive_mode=free_rolling --set speed=30

\b
Writes to DIR:
  results.csv     the recorded signals, units in the header (or .parquet, .mat)
  results.png     with --plot: the same as a picture
"""
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--start", type=float, help="Start time, s.  [default: of FILE, or 0]")
@click.option("--stop", type=float, help="Stop time, s.  [default: of FILE, or 1]")
@click.option("--step", type=float, help="Communication step, s.  [default: of FILE, or a thousandth]")
@click.option("--tolerance", type=float, help="Relative, for all FMUs.  [default: of each FMU]")
@click.option(
    "--algorithm", type=click.Choice(get_args(Algorithm)), help="Of the coupling.  [default: of FILE]"
)
@click.option(
    "--order", type=click.IntRange(0, 2), help="Of the extrapolation of inputs.  [default: of FILE]"
)
@click.option(
    "--record", multiple=True, metavar="PATTERN", help="Signals to record; ! leaves out.  [default: *]"
)
@click.option(
    "--every", type=click.IntRange(min=1), default=1, show_default=True, help="Record every N-th step."
)
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A parameter or a free input.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[default: results/FILE]")
@click.option(
    "--format", "kind", type=click.Choice(_FORMATS), default="csv", show_default=True, help="Of results."
)
@click.option("--timeout", type=float, default=10.0, show_default=True, help="Longest time for one step, s.")
@click.option("--in-process", is_flag=True, help="Run in this process, without protection; for debugging.")
@click.option("--plot", "with_plot", is_flag=True, help="Draw the recorded signals.")
@click.option("--check", "with_check", is_flag=True, help="Estimate the error of the coupling first.")
def simulate(
    file: Path,
    start: float | None,
    stop: float | None,
    step: float | None,
    tolerance: float | None,
    algorithm: Algorithm | None,
    order: int | None,
    record: tuple[str, ...],
    every: int,
    settings: tuple[str, ...],
    out: Path | None,
    kind: str,
    timeout: float,
    in_process: bool,
    with_plot: bool,
    with_check: bool,
) -> None:
    """Run FILE, an FMU (FMI 2.0 or 3.0) or an SSP, and write its results."""
    from co_sim.master import Master
    from co_sim.observers import Progress, Recorder
    from co_sim.supervisor import Supervised
    from co_sim.tool.loading import load, parse_settings, with_settings

    try:
        loaded = load(file, tolerance=tolerance)
        system = with_settings(loaded.system, parse_settings(settings))
        system = _coupled(system, step, algorithm, order)
        t0 = start if start is not None else loaded.start or 0.0
        duration = _duration(loaded, stop, t0)
        system.check()
        folder = out or Path("results") / file.stem
        folder.mkdir(parents=True, exist_ok=True)
        if with_check:
            _print_check(system, duration, t0, record, in_process=in_process)
        path, patterns = folder / f"results.{kind}", record or ("*",)
        recorder = Recorder(patterns, every=every)
        observers = [recorder, _writer(path, patterns, every), Progress()]
        master: Master | Supervised
        if in_process:
            master = Master(system, t0, observers=observers, stop_time=t0 + duration)
        else:
            master = Supervised(system, t0, observers=observers, timeout=timeout, stop_time=t0 + duration)
        started = time.perf_counter()
        with master:
            master.run(duration)
        _print_done(path, recorder, duration, time.perf_counter() - started)
    except OSError as error:
        raise InputError(
            f"{out}", got=str(error.strerror), expected="a folder to write to", remedy="check --out"
        ) from error
    except RunError as error:
        click.echo(f"error: {error}", err=True)
        for note in getattr(error, "__notes__", ()):
            click.echo(note, err=True)
        sys.exit(1)
    if with_plot:
        _plot(recorder, folder / "results.png", file.name)


def _coupled(system: System, step: float | None, algorithm: Algorithm | None, order: int | None) -> System:
    coupling = system.coupling
    if algorithm is not None:
        coupling = replace(coupling, algorithm=algorithm)
    if order is not None:
        coupling = replace(coupling, order=order)
    return replace(system, step=system.step if step is None else step, coupling=coupling)


def _duration(loaded: Loaded, stop: float | None, t0: float) -> float:
    end = stop if stop is not None else loaded.stop if loaded.stop is not None else t0 + 1.0
    if end < t0:
        raise InputError("stop time", got=f"{end:g} s", expected=f"{t0:g} s or later", remedy="raise --stop")
    return end - t0


def _print_check(
    system: System, duration: float, t0: float, record: tuple[str, ...], *, in_process: bool
) -> None:
    from co_sim.coupling_check import check_coupling

    click.echo(str(check_coupling(system, duration, t0=t0, patterns=record or ("*",), in_process=in_process)))
    click.echo()


def _writer(path: Path, patterns: tuple[str, ...], every: int) -> Observer:
    from co_sim.observers import CsvWriter, MatWriter, ParquetWriter

    writers: dict[str, Callable[..., Observer]] = {
        ".csv": CsvWriter,
        ".parquet": ParquetWriter,
        ".mat": MatWriter,
    }
    return writers[path.suffix](path, patterns, every)


def _print_done(path: Path, recorder: Recorder, duration: float, wall: float) -> None:
    click.echo(
        f"{path}: {len(recorder.names)} signals, {len(recorder.time)} times to t = {recorder.time[-1]:g} s"
    )
    click.echo(f"{duration:g} s in {wall:.2g} s, {duration / wall:.2g} times real time")


def _plot(recorder: Recorder, path: Path, title: str) -> None:
    from co_sim.tool.plotting import plot

    left_out = plot(recorder, path, title)
    click.echo(f"{path}" + (f", without {len(left_out)} signals; choose with --record" if left_out else ""))
