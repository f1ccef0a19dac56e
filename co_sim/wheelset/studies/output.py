"""Writes what a study has computed: tables of cases and of windows, summary and report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from co_sim.campaign.results import rows, write_parquet

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim.campaign import Journal
    from co_sim.wheelset.studies.study import Study

__all__ = ["tables", "write"]


def tables(study: Study, journal: Journal) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
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


def write(study: Study, journal: Journal, folder: Path) -> None:
    """Write all results of a study to its folder."""
    cases, windows = tables(study, journal)
    write_parquet(cases, folder / "cases.parquet")
    write_parquet(windows, folder / "windows.parquet")
