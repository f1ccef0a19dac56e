"""One self-contained HTML page about an identified log."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import jinja2

from co_sim.files import whole_file
from co_sim.wheelset.identifying.words import answer_sentences, fault_sentences, log_sentences
from co_sim.wheelset.prose.words import number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from co_sim.wheelset.figures import Drawing
    from co_sim.wheelset.identifying.results import Identified

__all__ = ["write_page"]


def write_page(done: Identified, drawings: Sequence[Drawing], summary: Mapping[str, Any], path: Path) -> None:
    """Write the page to `path`; it holds the drawings and needs no other file."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("co_sim.wheelset"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    page = environment.get_template("identify.html.jinja").render(
        done=done,
        versions=summary["versions"],
        answers=answer_sentences(done),
        about_log=log_sentences(done),
        faults=fault_sentences(done),
        setup=_setup(done),
        drawings=[(drawing, _embedded(drawing)) for drawing in drawings],
    )
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _embedded(drawing: Drawing) -> str:
    return base64.b64encode(drawing.file.read_bytes()).decode("ascii")


def _setup(done: Identified) -> list[tuple[str, str]]:
    settings = done.settings
    gyro, accelerometer = settings.noise
    return [
        ("Bank", settings.bank),
        ("Vehicle", settings.vehicle_file or "the parameters of the paper"),
        ("Sensor noise", f"gyro {number(gyro)} rad/s, accelerometer {number(accelerometer)} m/s² rms"),
        ("Track", f"{settings.track} of ERRI B176"),
        ("Rows", f"one every {number(settings.every)} s"),
        ("Speed", "constant, as given" if settings.speed is not None else "from the log"),
    ]
