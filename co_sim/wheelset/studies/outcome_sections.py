"""Sections on what follows from an identification: adhesion, alarms, what unknowns cost, failures."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.prose.words import listed, number, percent, quantity
from co_sim.wheelset.reporting.section import Column, Quantity, Section, Table
from co_sim.wheelset.studies.findings import TOO_MUCH, USED_ENOUGH
from co_sim.wheelset.studies.section_parts import (
    draw,
    figure,
    per_bank,
    share_cells,
    share_numbers,
    share_words,
)
from co_sim.wheelset.studies.trial import Trial

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.studies.findings import Findings
    from co_sim.wheelset.studies.study import Study

__all__ = [
    "adhesion_section",
    "failures_section",
    "false_alarms_section",
    "latency_section",
    "losses_section",
]

#: Latencies that are asked for: of half the drops, and of 95 in 100, s.
WANTED_LATENCY = (0.5, 1.0)
_BANK_AND_TIME = (Column("bank"), Column("watched", "s"))


def adhesion_section(findings: Findings) -> Section | None:
    """Return how well the peak adhesion is known; ``None`` if no bank says anything about it."""
    found = {bank: one for bank in findings.banks if (one := findings.adhesion(bank)) and one.windows}
    if not found:
        return None
    words = [
        f"Where at least {percent(USED_ENOUGH)} of the adhesion is used, the {bank} bank's estimate of its "
        f"peak is off by {percent(one.error)} in the median; its interval of 90 % holds the truth in "
        f"{share_words(one.covered)} of the windows, and {percent(one.too_much.value)} of the estimates "
        f"promise over {percent(TOO_MUCH)} too much."
        for bank, one in found.items()
    ]
    covered, too_much = ([getattr(o, part) for o in found.values()] for part in ("covered", "too_much"))
    rows: list[tuple[Cell, ...]] = [
        (
            bank,
            one.windows,
            percent(one.error),
            percent(one.bias) if one.bias >= 0.0 else f"−{percent(-one.bias)}",
            *share_cells(one.covered),
            percent(one.too_much.value),
        )
        for bank, one in found.items()
    ]
    columns = tuple(
        map(Column, ("bank", "windows", "median error", "median bias", "covered", "interval", "too much"))
    )
    banks = list(found)
    numbers = {
        "median_error": per_bank([o.error for o in found.values()], "1", "median of |estimate/truth - 1|"),
        "median_bias": per_bank([o.bias for o in found.values()], "1", "median of estimate/truth - 1"),
        **dict(share_numbers("covered", "share of intervals that hold the truth", "bank", covered)),
        **dict(share_numbers("too_much", "share of estimates 10 % and more too high", "bank", too_much)),
    }
    return Section(
        key="adhesion",
        title="How well is the peak adhesion known?",
        words=tuple(words),
        numbers=numbers,
        axes={"bank": banks},
        tables=(Table("Estimates of the peak adhesion", columns, tuple(rows)),),
        summary=tuple(words[:1]),
    )


def latency_section(study: Study, findings: Findings) -> Section | None:
    """Return how soon drops are announced; ``None`` if there were none."""
    found = {bank: one for bank in findings.banks if (one := findings.latency(bank)) is not None}
    if not found:
        return None
    words, rows = [], []
    for bank, one in found.items():
        half, most = one.quantile(0.5), one.quantile(0.95)
        words.append(
            f"The {bank} bank announces half of the drops {_within(half)} and 95 % {_within(most)}; "
            f"{one.missed} of {one.seconds.size + one.missed} it does not announce."
        )
        rows.append((bank, one.seconds.size + one.missed, one.missed, _finite(half), _finite(most)))
    title = "How soon is a drop of adhesion announced?"
    columns = (Column("bank"), Column("drops"), Column("missed"), Column("median", "s"), Column("95 %", "s"))
    never = "not announced before the end of the case"
    return Section(
        key="latency",
        title=title,
        words=tuple(words),
        numbers={
            "median": per_bank([o.quantile(0.5) for o in found.values()], "s", "median latency", never),
            "quantile_95": per_bank([o.quantile(0.95) for o in found.values()], "s", "95 % latency", never),
            "missed": per_bank([o.missed for o in found.values()], "1", "drops not announced"),
        },
        axes={"bank": list(found)},
        tables=(
            Table("From the drop to the alarm", columns, tuple(rows)),
            *_latencies(study, findings, list(found)),
        ),
        figures=(
            figure(
                "latency",
                title,
                "Share of all drops that have been announced over the time since the drop. Dotted: "
                f"{listed([quantity(t, 's') for t in WANTED_LATENCY])}.",
                partial(draw, "draw_latency", title, found, WANTED_LATENCY),
            ),
        ),
        summary=tuple(words[:1]),
    )


def _latencies(study: Study, findings: Findings, banks: Sequence[str]) -> Iterator[Table]:
    """Yield for each quantity of the grid median and 95 % latency at each of its values."""
    for name, values in study.grid.items():
        if len(values) < 2:
            continue
        rows: list[tuple[Cell, ...]] = []
        for bank in banks:
            for share, label in ((0.5, "median"), (0.95, "95 %")):
                found = [findings.latency(bank, **{name: value}) for value in values]
                rows.append(
                    (bank, label, *(None if o is None else _finite(o.quantile(share)) for o in found))
                )
        columns = (Column("bank"), Column("latency"), *(Column(f"{name} {value}", "s") for value in values))
        yield Table(f"From the drop to the alarm by {name.replace('_', ' ')}", columns, tuple(rows))


def _within(seconds: float) -> str:
    return f"within {quantity(seconds, 's', 2)}" if np.isfinite(seconds) else "never"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def false_alarms_section(findings: Findings) -> Section | None:
    """Return how often alarms are false; ``None`` if none could have been."""
    found = {bank: findings.false_alarms(bank) for bank in findings.banks}
    found = {bank: rate for bank, rate in found.items() if rate.seconds > 0.0}
    if not found:
        return None
    words = [
        f"The {bank} bank gives {rate.events} false alarm{'' if rate.events == 1 else 's'} in "
        f"{number(rate.seconds)} s: "
        f"{number(rate.value, 2)} in 1000 s ({number(rate.low, 2)} to {number(rate.high, 2)})."
        for bank, rate in found.items()
    ]
    rows: list[tuple[Cell, ...]] = [
        (bank, rate.seconds, rate.events, rate.value, f"{number(rate.low, 2)} to {number(rate.high, 2)}")
        for bank, rate in found.items()
    ]
    columns = (*_BANK_AND_TIME, Column("false alarms"), Column("rate", "in 1000 s"), Column("interval"))
    rates = list(found.values())
    numbers = {
        "rate": per_bank([r.value for r in rates], "1/(1000 s)", "rate of false alarms"),
        "rate_low": per_bank([r.low for r in rates], "1/(1000 s)", "low end of its interval"),
        "rate_high": per_bank([r.high for r in rates], "1/(1000 s)", "high end of its interval"),
        "watched": per_bank([r.seconds for r in rates], "s", "time in which they could come"),
    }
    return Section(
        key="false_alarms",
        title="How often is low adhesion announced where there is none?",
        words=tuple(words),
        numbers=numbers,
        axes={"bank": list(found)},
        tables=(Table("False alarms", columns, tuple(rows)),),
        summary=tuple(words[:1]),
    )


def losses_section(findings: Findings, what: str) -> Section:
    """Return what each variant costs of the accuracy of a ``"region"`` or ``"condition"``."""
    banks = [bank for bank in findings.banks if findings.says(bank, what)]
    losses = {bank: findings.losses(bank, what) for bank in banks}
    first, variants = losses[banks[0]], list(findings.variants[1:])
    worst = min(first, key=lambda variant: first[variant][0])
    title = "Which unknown costs most?"
    words = (
        (
            f"Beside “{findings.variants[0]}”, “{worst}” costs the {banks[0]} bank most: "
            f"{number(-100.0 * first[worst][0], 2)} percentage points of the windows "
            f"({number(-100.0 * first[worst][2], 2)} to {number(-100.0 * first[worst][1], 2)})."
        ),
    )
    few = "fewer than two cases to compare"
    return Section(
        key="losses",
        title=title,
        words=words,
        numbers={
            f"{part}_{bank}": Quantity(
                [losses[bank][variant][i] for variant in variants], "1", meaning, ("variant",), few
            )
            for bank in banks
            for i, (part, meaning) in enumerate(
                (
                    ("change", f"share of windows right, less that of {findings.variants[0]}"),
                    ("low", "low end of its interval of 95 %"),
                    ("high", "high end of its interval of 95 %"),
                )
            )
        },
        axes={"variant": variants},
        figures=(
            figure(
                "losses",
                title,
                "Change of the share of windows that are right, with intervals of 95 % over pairs of cases "
                "that have track and noise in common.",
                partial(draw, "draw_losses", title, losses),
            ),
        ),
        summary=words,
    )


def failures_section(findings: Findings) -> Section:
    """Return the cases that failed, with their reasons."""
    known = [name for name in Trial.model_fields if any(name in row for row in findings.failures)]
    rows: list[tuple[Cell, ...]] = [
        (row["case"], row["reason"], ", ".join(f"{name} {row[name]}" for name in known if name in row))
        for row in findings.failures[:50]
    ]
    total = len(findings.cases) + len(findings.failures)
    words = f"{len(findings.failures)} of {total} cases failed; they are in no other number of this page."
    columns = (Column("case"), Column("reason"), Column("quantities"))
    return Section(
        key="failures",
        title="Which cases failed?",
        words=(words if findings.failures else f"None of the {total}.",),
        numbers={
            "failed": Quantity(len(findings.failures), "1", "cases that failed"),
            "computed": Quantity(total, "1", "cases that were computed"),
        },
        tables=(Table("", columns, tuple(rows)),) if rows else (),
        summary=(words,) if findings.failures else (),
    )
