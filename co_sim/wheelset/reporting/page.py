"""One self-contained HTML page, the JSON file and the files of the figures."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

from co_sim.files import whole_file
from co_sim.wheelset.prose.words import listed, number
from co_sim.wheelset.reporting.json_text import dumps
from co_sim.wheelset.reporting.report import versions

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim.wheelset.reporting.report import Report
    from co_sim.wheelset.reporting.section import Cell

__all__ = ["cell_text", "html", "write_report"]


def write_report(report: Report, folder: Path) -> None:
    """Write report.html, report.json and figures/ into `folder`; each file appears when it is complete."""
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for key, image in report.images.items():
        for suffix, data in (("png", image.png), ("svg", image.svg)):
            with whole_file(figures / f"{key}.{suffix}") as temporary:
                temporary.write_bytes(data)
    for name, text in (("report.json", dumps(report.as_json())), ("report.html", html(report))):
        with whole_file(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def html(report: Report) -> str:
    """Return the page; it needs no other file and no network."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("co_sim.wheelset"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["cell"] = cell_text
    return environment.get_template("grid_report.html.jinja").render(
        report=report,
        images={key: base64.b64encode(image.png).decode("ascii") for key, image in report.images.items()},
        versions_text=listed([f"{name} {found}" for name, found in versions().items()]),
    )


def cell_text(cell: Cell) -> str:
    """Return a cell of a table as text."""
    if cell is None:
        return "–"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return cell if isinstance(cell, str) else number(cell)
