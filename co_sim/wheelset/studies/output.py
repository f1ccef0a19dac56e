"""Writes what a study has computed: tables of cases and of windows, and the report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from co_sim.campaign.results import rows, write_parquet
from co_sim.wheelset.prose.words import listed, quantity
from co_sim.wheelset.studies.scoring import settled_at

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim.campaign import Journal
    from co_sim.wheelset.reporting.report import Report
    from co_sim.wheelset.studies.study import Study

__all__ = ["report_on", "tables", "write"]

Rows = list[dict[str, Any]]


def tables(study: Study, journal: Journal) -> tuple[Rows, Rows]:
    """Return a row for each case, and a row for each window of each case that was computed."""
    cases, windows = [], []
    for row in rows(study.cases(), journal):
        columns = row.pop("windows", {})
        cases.append(row)
        length = len(next(iter(columns.values()), []))
        windows += [
            {"case": row["case"], **{name: values[i] for name, values in columns.items()}}
            for i in range(length)
        ]
    return cases, windows


def write(study: Study, journal: Journal, folder: Path) -> Report:
    """Write all results of a study to its folder and return the report."""
    from co_sim.wheelset.reporting.page import write_report

    cases, windows = tables(study, journal)
    write_parquet(cases, folder / "cases.parquet")
    write_parquet(windows, folder / "windows.parquet")
    report = report_on(study, cases, windows)
    write_report(report, folder)
    return report


def report_on(study: Study, cases: Rows, windows: Rows) -> Report:
    """Return the report on the tables of a study."""
    from co_sim.wheelset.reporting.report import Report, with_images
    from co_sim.wheelset.studies.findings import Findings
    from co_sim.wheelset.studies.sections import sections_of

    findings = Findings(cases, windows, study.banks, tuple(study.variant))
    sections, images = with_images(sections_of(study, findings))
    return Report(
        title=study.question or study.title,
        about=tuple(_about(study, len(cases))),
        setup={"study": study.model_dump(mode="json")},
        grid={},
        sections=sections,
        images=images,
    )


def _about(study: Study, computed: int) -> list[tuple[str, str]]:
    """Return what was computed as (subject, sentences)."""
    told = [
        f"{name.replace('_', ' ')} {listed([str(v) for v in values])}" for name, values in study.grid.items()
    ]
    drawn = [f"{name.replace('_', ' ')} {_distribution(draw)}" for name, draw in study.draw.items()]
    about = [
        ("Study", study.title),
        ("Cases", f"{computed} of {study.size} computed; seed {study.seed}."),
        ("Grid", "; ".join(told) + f"; {study.repeat} of each." if told else "none"),
    ]
    if drawn:
        about.append(("Drawn", "; ".join(drawn) + "."))
    if study.variant:
        about.append(("Variants", "; ".join(study.variant) + "."))
    fixed = [f"{name.replace('_', ' ')} {value}" for name, value in study.fixed.items()]
    about += [
        ("Fixed", "; ".join(fixed) + "." if fixed else "all defaults, see wheelset campaign --fields."),
        ("Plant", "The wheelset FMU, torque driven with axle torsion unless the creep is imposed."),
        ("Windows", _windows(study)),
        ("Banks", _banks(study)),
    ]
    return about


def _distribution(draw: Any) -> str:
    if draw.uniform:
        return f"uniform from {draw.uniform[0]:g} to {draw.uniform[1]:g}"
    if draw.normal:
        return f"normal, mean {draw.normal[0]:g}, standard deviation {draw.normal[1]:g}"
    return f"one of {listed([str(value) for value in draw.choice])}"


def _windows(study: Study) -> str:
    since = quantity(settled_at(study.trial(next(study.cases()))), "s")
    return f"Of {quantity(study.window, 's')}, one after the other, from {since} on."


_MEANING = {
    "adhesion": "adhesion: extended Kalman filters with the nominal parameters, evidence that fades",
    "window": "window: the same with the evidence of one window",
    "known": "known: linear filters along the curve of the rail, which they know",
    "exact": "exact: as known, with the parameters, noise and track of the plant, and with the creepages of "
    "P1, knee, P2 and beyond alone",
    "paper": "paper: the three filters of Hussain et al. on the dry curve",
    "matched": "matched: as window, with the parameters, noise and track of the plant",
}


def _banks(study: Study) -> str:
    return "; ".join(_MEANING[bank] for bank in study.banks) + "."
