"""The command `wheelset campaign`."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click

from co_sim.errors import InputError

if TYPE_CHECKING:
    from distributed import Client
    from rich.progress import Progress

    from co_sim.campaign import Case, Journal
    from co_sim.campaign.journal import Entry
    from co_sim.wheelset.studies.study import Study

__all__ = ["campaign"]

#: Cases from whose time the rest is estimated.
_PILOT = 100


@click.command(
    epilog="""\b
Examples:
  wheelset campaign                          the names of the packaged studies
  wheelset campaign condition --out cond     a packaged study, results in ./cond
  wheelset campaign mine.toml --workers 2
  wheelset campaign mine.toml --scheduler tcp://head:8786

\b
Stopped, or killed? The same line goes on where it stopped.

\b
Writes to DIR:
  report.html        question, set-up, answer, figures with confidence intervals, failures
  summary.json       every number of the report
  cases.parquet      a row for each case
  windows.parquet    a row for each window of each case: what was true, what each bank said
  journal.jsonl      what has been computed, while it is computed
"""
)
@click.argument("study", required=False)
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[default: results/STUDY]")
@click.option("--scheduler", metavar="ADDRESS", help="Use this dask cluster instead of workers here.")
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="[default: one for each core]")
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Compute at most N further cases.")
@click.option("--retry", is_flag=True, help="Compute the cases that failed once more.")
@click.option("--fields", is_flag=True, help="List the quantities of a study.")
def campaign(
    study: str | None,
    out: Path | None,
    scheduler: str | None,
    workers: int | None,
    limit: int | None,
    retry: bool,
    fields: bool,
) -> None:
    """Run STUDY: thousands of cases on the cores of this machine or on a cluster.

    STUDY is the name of a packaged study or a TOML file.
    """
    from co_sim.wheelset.studies.study import load_study, packaged_studies

    if fields:
        _print_fields()
        return
    if study is None:
        click.echo("\n".join(packaged_studies()))
        return
    try:
        _check_packages()
        loaded = load_study(study)
        name = Path(study).stem
        complete = _run(loaded, out or Path("results") / name, scheduler, workers, limit, retry)
    except InputError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)
    sys.exit(0 if complete else 1)


def _check_packages() -> None:
    """Raise `InputError` unless what campaigns need beyond the rest is installed."""
    missing = [name for name in ("distributed", "pyarrow") if find_spec(name) is None]
    if missing:
        raise InputError(
            "wheelset campaign",
            got=f"no {' and no '.join(missing)}",
            expected="the packages that campaigns need",
            remedy="install them with: pip install 'wheelset-cosim[campaign]'",
        )


def _run(
    study: Study, out: Path, scheduler: str | None, workers: int | None, limit: int | None, retry: bool
) -> bool:
    """Compute what is missing and write what there is; return whether all cases are computed."""
    from co_sim.campaign import Journal
    from co_sim.campaign.cluster import connect
    from co_sim.wheelset.output import check_folder

    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    with Journal(out, study.key, {"title": study.title}) as journal:
        if retry:
            journal.forget_failed()
        missing = [case for case in study.cases() if case.number not in journal.entries]
        click.echo(f"{study.size} cases, {study.size - len(missing)} of them computed already")
        stopped = None
        if missing:
            try:
                with connect(scheduler, workers) as client:
                    _compute(study, missing[:limit], journal, client)
            except KeyboardInterrupt:
                stopped = "interrupted"
            except _lost() as error:
                stopped = str(error)
        _write(study, journal, out)
        failed = [entry for entry in journal.entries.values() if entry.status == "failed"]
        if failed:
            click.echo(
                f"{len(failed)} cases failed, such as case {failed[0].case}: {failed[0].reason}", err=True
            )
        missing = [case for case in missing if case.number not in journal.entries]
    if stopped:
        click.echo(f"stopped early, {stopped}; {len(missing)} cases are missing", err=True)
    if missing:
        click.echo("the same command goes on where this one stopped", err=True)
    return not missing and len(failed) < study.size


def _lost() -> type[Exception]:
    from co_sim.campaign.engine import ClusterLostError

    return ClusterLostError


def _compute(study: Study, cases: list[Case], journal: Journal, client: Client) -> None:
    """Compute cases under a progress bar; the first ones tell how long the others will take."""
    from co_sim.campaign import estimate, run_campaign
    from co_sim.wheelset.studies.evaluation import function_of

    function = function_of(study)
    with _bar() as bar:
        task = bar.add_task("Cases", total=len(cases))

        def show(entry: Entry) -> None:
            bar.advance(task)

        pilot = cases[:_PILOT]
        outcome = run_campaign(function, pilot, journal, client, show=show)
        if len(cases) > len(pilot):
            seconds = estimate(outcome, len(cases) - len(pilot))
            told = f"{len(pilot)} cases took {_duration(outcome.seconds)}; "
            bar.console.print(f"{told}the other {len(cases) - len(pilot)} will take {_duration(seconds)}")
            run_campaign(function, cases[len(pilot) :], journal, client, show=show)


def _bar() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, highlight=False)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True)


def _duration(seconds: float) -> str:
    """Return a duration as people say it."""
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def _write(study: Study, journal: Journal, out: Path) -> None:
    from co_sim.wheelset.studies.output import write

    click.echo(f"\n{study.question or study.title}\n")
    for sentence in write(study, journal, out).summary:
        click.echo(f"- {sentence}")
    click.echo(f"\n{out / 'report.html'} has the figures and the rest")


def _print_fields() -> None:
    """List the quantities of a study with default and meaning."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from co_sim.wheelset.studies.trial import Trial

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("quantity", "default", "meaning"):
        table.add_column(heading)
    for name, declared in Trial.model_fields.items():
        default = "left out" if declared.default is None else f"{declared.default}"
        table.add_row(name, default, declared.description)
    Console(highlight=False).print(table)
