"""The command that identifies a recorded log."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from co_sim.errors import Fault, InputError, RunError

if TYPE_CHECKING:
    from co_sim.wheelset.identifying.results import Identified

__all__ = ["identify"]

_POSITIVE = click.FloatRange(min=0.0, min_open=True)
_PAIR = "GYRO ACC"


@click.command(
    epilog="""\b
Examples:
  wheelset identify example                            a packaged journey, to try it
  wheelset identify ride.csv --out ride
  wheelset identify ride.parquet --vehicle loco.toml --noise 2e-3 0.1
  wheelset identify ride.mat --speed 30 --column yaw_rate=gyro_z
  wheelset identify ride.csv --bank paper

\b
LOG (.csv, .parquet, .mat) has the columns, SI:
  time, yaw_rate, lateral_acceleration, speed, traction_torque
The torque (total on the axle, N m) may be missing, the speed if --speed is given. A heading may tell another
unit: speed [km/h].

\b
Writes to DIR:
  identification.csv   region, rail condition and adhesion with probabilities, one row every 10 ms
  advice.csv           what a driver or a traction controller should do
  fuzzy.csv            the same by the fuzzy identifier on the residuals (adhesion bank)
  summary.json         every number of the report, versions, settings, faults found
  report.html          one self-contained page with figures, which are in figures/ as well
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[default: results/LOG]")
@click.option(
    "--bank",
    type=click.Choice(["adhesion", "paper"]),
    default="adhesion",
    show_default=True,
    help="Filters for conditions and branches of the creep curve, or the paper's three.",
)
@click.option(
    "--vehicle", type=click.Path(path_type=Path), metavar="FILE", help="TOML of WheelsetParameters."
)
@click.option("--speed", type=float, metavar="M_S", help="Constant speed, where the log has none, m/s.")
@click.option(
    "--every", type=_POSITIVE, default=0.01, show_default=True, metavar="S", help="Time between rows, s."
)
@click.option(
    "--noise",
    type=(_POSITIVE, _POSITIVE),
    default=(1e-3, 0.05),
    show_default=True,
    metavar=_PAIR,
    help="Rms of gyro (rad/s) and accelerometer (m/s2), of one sample.",
)
@click.option(
    "--track",
    type=click.Choice(["erri_low", "erri_high"]),
    default="erri_low",
    show_default=True,
    help="Level of track irregularity.",
)
@click.option(
    "--full-scale",
    type=(_POSITIVE, _POSITIVE),
    default=(float("inf"), float("inf")),
    metavar=_PAIR,
    help="Where the sensors saturate, rad/s and m/s2.  [default: learned from flat tops]",
)
@click.option(
    "--bias-limit",
    type=(_POSITIVE, _POSITIVE),
    default=(0.05, 1.0),
    show_default=True,
    metavar=_PAIR,
    help="Greatest mean over 2 s that is no fault, rad/s and m/s2.",
)
@click.option(
    "--column", "columns", multiple=True, metavar="NAME=HEADING", help="Heading of a column in LOG."
)
def identify(
    log: Path,
    out: Path | None,
    bank: str,
    vehicle: Path | None,
    speed: float | None,
    every: float,
    noise: tuple[float, float],
    track: str,
    full_scale: tuple[float, float],
    bias_limit: tuple[float, float],
    columns: tuple[str, ...],
) -> None:
    """Identify rail and adhesion from LOG, a recording of the gyro and the accelerometer of a wheelset.

    `example` records a packaged journey first and writes it to DIR as log.csv.
    """
    from co_sim.wheelset.identifying import pipeline
    from co_sim.wheelset.identifying.example import EXAMPLE, write_example
    from co_sim.wheelset.identifying.progress import Shown
    from co_sim.wheelset.identifying.results import Settings
    from co_sim.wheelset.output import check_folder
    from co_sim.wheelset.vehicle_file import Vehicle, read_vehicle

    out = out or Path("results") / ("identify-example" if str(log) == EXAMPLE else log.stem)
    settings = Settings(
        bank=bank,
        every=every,
        noise=noise,
        track=track,
        vehicle=Vehicle() if vehicle is None else read_vehicle(vehicle),
        vehicle_file=None if vehicle is None else vehicle.name,
        speed=_checked_speed(speed),
        renamed=_renamed(columns),
        full_scale=full_scale,
        bias_limit=bias_limit,
    )
    check_folder(out)
    try:
        with Shown() as stages:
            if str(log) == EXAMPLE:
                with stages.stage("recording"):
                    log = write_example(out)
            done = pipeline.identify(log, settings, stages)
            pipeline.write(done, out, stages)
    except RunError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(1)
    _print(done, out)


def _checked_speed(speed: float | None) -> float | None:
    if speed is not None and not 0.0 <= speed < float("inf"):
        raise InputError("--speed", got=f"{speed:g}", expected="at least 0 m/s", remedy="give it in m/s")
    return speed


def _renamed(texts: tuple[str, ...]) -> dict[str, str]:
    """Return the headings of ``NAME=HEADING``, by name."""
    from co_sim.wheelset.identifying.table import COLUMNS

    faults = [
        Fault(
            f'--column "{text}"',
            "no NAME=HEADING" if "=" not in text else f'the name "{text.partition("=")[0]}"',
            f"one of {', '.join(COLUMNS)}, an equals sign and a heading of the log",
            "as in --column yaw_rate=gyro_z",
        )
        for text in texts
        if "=" not in text or text.partition("=")[0].strip() not in COLUMNS
    ]
    if faults:
        raise InputError.from_faults(faults)
    pairs = (text.split("=", 1) for text in texts)
    return {name.strip(): heading.strip() for name, heading in pairs}


def _print(done: Identified, out: Path) -> None:
    """Say on the terminal what was found."""
    from co_sim.wheelset.identifying.words import answer_sentences, fault_sentences, log_sentences

    for sentence in (*log_sentences(done), *fault_sentences(done), "", *answer_sentences(done)):
        click.echo(sentence.replace("\N{NO-BREAK SPACE}", " "))
    times = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in done.seconds.items())
    click.echo(f"\n{out / 'identification.csv'} has {len(done.answer.time)} rows; {times}")
    click.echo(f"{out / 'report.html'} has the figures and what to make of them")
