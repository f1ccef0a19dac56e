"""The results of a campaign as one table: a row for each case, values and record side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from co_sim.files import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from co_sim.campaign.journal import Journal
    from co_sim.campaign.plan import Case

__all__ = ["rows", "write_parquet"]


def rows(cases: Iterable[Case], journal: Journal) -> list[dict[str, Any]]:
    """Return a row for each case that has a result, in the order of the plan.

    Columns: ``case``, ``variant``, ``seed``, ``status``, ``reason``, the values, the record.
    The time that a case took is in the journal alone, so that the same study gives the same file.
    """
    return [
        {
            "case": case.number,
            "variant": case.variant,
            "seed": case.seed,
            "status": entry.status,
            "reason": entry.reason,
            **case.values,
            **entry.record,
        }
        for case in cases
        if (entry := journal.entries.get(case.number)) is not None
    ]


def write_parquet(table: list[dict[str, Any]], path: Path) -> None:
    """Write rows of `rows` as Parquet; a name that a row does not have is null there."""
    import pyarrow as pa
    from pyarrow import parquet

    names = list(dict.fromkeys(name for row in table for name in row))
    columns = {name: [row.get(name) for row in table] for name in names}
    with whole_file(path) as temporary:
        parquet.write_table(pa.table(columns), temporary)
