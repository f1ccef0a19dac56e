"""The page that tells what the bogie did and why it was coupled as it was."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

import jinja2

from co_sim.files import whole_file

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from co_sim.wheelset.bogie.run import BogieRun

__all__ = ["write_report"]


def write_report(run: BogieRun, drawings: Sequence[Path], path: Path) -> None:
    """Write the report to `path`; it holds the drawings and needs no other file."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("co_sim.wheelset"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pictures = [(file.stem, base64.b64encode(file.read_bytes()).decode()) for file in drawings]
    page = environment.get_template("bogie.html.jinja").render(run=run, pictures=pictures)
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
