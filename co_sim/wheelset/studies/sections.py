"""The sections of the report on a study: each a question, answered in words, tables and figures."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.wheelset.prose.words import percent, quantity
from co_sim.wheelset.reporting.section import Column, Figure, Quantity, Section, Table
from co_sim.wheelset.studies.findings import CLASSES
from co_sim.wheelset.studies.outcome_sections import (
    adhesion_section,
    failures_section,
    false_alarms_section,
    latency_section,
    losses_section,
)
from co_sim.wheelset.studies.place_section import place_section
from co_sim.wheelset.studies.section_parts import draw, figure, share_cells, share_numbers, share_words

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.studies.findings import Findings
    from co_sim.wheelset.studies.intervals import Share
    from co_sim.wheelset.studies.study import Study

__all__ = ["sections_of"]

_UNITS = {"speed": "m/s", "noise": "1", "utilisation": "1"}


def sections_of(study: Study, findings: Findings) -> tuple[Section, ...]:
    """Return the sections that a study has something to say in."""
    made: list[Section] = []
    for what in CLASSES:
        banks = [bank for bank in findings.banks if findings.says(bank, what)]
        if banks and _asked(study, what):
            made += [
                _accuracy(study, findings, what, banks),
                _confusion(findings, what, banks),
                _calibration(findings, what, banks),
            ]
            places = place_section(study, findings, banks) if what == "region" else None
            made += [places] if places else []
    made += [
        s
        for s in (
            adhesion_section(findings),
            latency_section(study, findings),
            false_alarms_section(findings),
        )
        if s
    ]
    if study.variant and made:
        made.append(losses_section(findings, "region" if _asked(study, "region") else "condition"))
    return (*made, failures_section(findings))


def _asked(study: Study, what: str) -> bool:
    """Return whether a study asks for the class: the region of an imposed creep, conditions that vary."""
    values = {name: set(values) for name, values in study.grid.items()}
    manoeuvres = values.get("manoeuvre", {study.fixed.get("manoeuvre", "steady")})
    if what == "region":
        return "prescribed" in manoeuvres
    return "prescribed" not in manoeuvres or "condition" in study.grid


def _trust(overall: Share, trusted: Share) -> str:
    """Return how often a bank trusts its answer, and how often it may."""
    if trusted.windows == 0:
        return "it trusts none of its answers"
    share = trusted.windows / overall.windows
    return (
        f"it trusts its answer in {percent(share)} of them and is right in {percent(trusted.value)} of those"
    )


def _accuracy(study: Study, findings: Findings, what: str, banks: Sequence[str]) -> Section:
    overall = [findings.accuracy(bank, what) for bank in banks]
    trusted = [findings.accuracy(bank, what, findings.trusted(bank)) for bank in banks]
    words = [
        f"The {bank} bank has the {what} right in {share_words(all_)} of the windows of "
        f"{quantity(study.window, 's')}; {_trust(all_, some)}."
        for bank, all_, some in zip(banks, overall, trusted, strict=True)
        if all_.windows
    ]
    if {"adhesion", "matched"} <= set(banks):
        reached, matched = (overall[banks.index(bank)].value for bank in ("adhesion", "matched"))
        words.append(
            f"The adhesion bank reaches {percent(reached / matched)} of what the matched one does, which "
            "knows the parameters, noise and track of the plant: the likelihood of the exact model, as far "
            "as an extended Kalman filter has it."
        )
    axes = _grid_axes(study, findings, what, banks)
    names = CLASSES[what]
    true = findings.column(what)
    rows: list[tuple[Cell, ...]] = [
        (
            name.replace("_", " "),
            *(cell for bank in banks for cell in share_cells(findings.accuracy(bank, what, true == i))),
        )
        for i, name in enumerate(names)
        if np.any(true == i)
    ]
    columns = [Column(f"true {what}"), *(c for bank in banks for c in (Column(bank), Column("interval")))]
    title = f"How often is the {what} right?"
    numbers = dict(share_numbers("share_right", f"share of windows whose {what} is right", "bank", overall))
    numbers |= dict(
        share_numbers("share_right_trusted", "the same where the bank trusts its answer", "bank", trusted)
    )
    figures: tuple[Figure, ...] = ()
    if axes:
        figures = (
            figure(
                f"accuracy_{what}",
                title,
                "Share of windows that are right, with intervals of 95 % that know that the windows of one "
                "case are alike.",
                partial(draw, "draw_accuracy", title, axes),
            ),
        )
    return Section(
        key=f"accuracy_{what}",
        title=title,
        words=tuple(words),
        numbers=numbers,
        axes={"bank": list(banks)},
        tables=(
            Table(f"Windows right by true {what}", tuple(columns), tuple(rows)),
            # Points say more than the regions that they are in, see `place_section`.
            *(() if "point" in study.grid else _crossed(study, findings, what, banks)),
        ),
        figures=figures,
        summary=tuple(words[:2]),
    )


def _grid_axes(study: Study, findings: Findings, what: str, banks: Sequence[str]) -> dict[str, Any]:
    """Return accuracies over each quantity of the grid that has several values."""
    axes: dict[str, Any] = {}
    for name, values in study.grid.items():
        if len(values) < 2:
            continue
        of_case = findings.of_case(name)
        shares = {
            bank: [findings.accuracy(bank, what, of_case == value) for value in values] for bank in banks
        }
        shown = ["yes" if value else "no" for value in values] if values[0] in {True, False} else list(values)
        unit = _UNITS.get(name)
        axes[f"{name}, {unit}" if unit and unit != "1" else name.replace("_", " ")] = (shown, shares)
    return axes


def _crossed(study: Study, findings: Findings, what: str, banks: Sequence[str]) -> Iterator[Table]:
    """Yield for each quantity of the grid how often each class is right at each of its values."""
    true = findings.column(what)
    for name, values in study.grid.items():
        # Points of the creep curve and flanges have tables of their own.
        if len(values) < 2 or name in {what, "point", "flanges"}:
            continue
        of_case = findings.of_case(name)
        rows: list[tuple[Cell, ...]] = [
            (
                label.replace("_", " "),
                bank,
                *(
                    _percent(findings.accuracy(bank, what, (true == i) & (of_case == v)).value)
                    for v in values
                ),
            )
            for i, label in enumerate(CLASSES[what])
            if np.any(true == i)
            for bank in banks
        ]
        heading = name.replace("_", " ")
        texts = [f"{v:g}" if isinstance(v, int | float) else str(v).replace("_", " ") for v in values]
        columns = (Column(f"true {what}"), Column("bank"), *(Column(f"{heading} {text}") for text in texts))
        yield Table(f"Windows right by true {what} and {heading}", columns, tuple(rows))


def _percent(share: float) -> Cell:
    return percent(share) if np.isfinite(share) else None


def _confusion(findings: Findings, what: str, banks: Sequence[str]) -> Section:
    counts = {bank: findings.confusion(bank, what) for bank in banks}
    classes = CLASSES[what]
    title = f"Which {what} is taken for which?"
    words = [_worst_confusion(bank, table, classes) for bank, table in counts.items()]
    return Section(
        key=f"confusion_{what}",
        title=title,
        words=tuple(words),
        numbers={
            f"windows_{bank}": Quantity(
                table, "1", f"windows by true and declared {what}", ("true", "declared")
            )
            for bank, table in counts.items()
        },
        axes={"true": list(classes), "declared": list(classes)},
        figures=(
            figure(
                f"confusion_{what}",
                title,
                f"Windows in per cent of those of the true {what}; rows sum to 100.",
                partial(draw, "draw_confusion", title, classes, counts),
            ),
        ),
    )


def _worst_confusion(bank: str, table: Any, classes: Sequence[str]) -> str:
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    np.fill_diagonal(share, 0.0)
    true, said = np.unravel_index(int(share.argmax()), share.shape)
    if share[true, said] == 0.0:
        return f"The {bank} bank takes none for another."
    names = [name.replace("_", " ") for name in classes]
    often = percent(float(share[true, said]))
    return f"The {bank} bank most often takes {names[true]} for {names[said]}: {often}."


def _calibration(findings: Findings, what: str, banks: Sequence[str]) -> Section:
    found = {bank: findings.calibration(bank, what) for bank in banks}
    title = f"Do the probabilities of the {what} mean what they say?"
    words, numbers, axes = [], {}, {}
    for bank, one in found.items():
        weights = np.array([share.windows for share in one.right], dtype=np.float64)
        right = np.array([share.value for share in one.right])
        gap = float(np.sum(weights * np.abs(right - one.probability)) / max(weights.sum(), 1.0))
        side = float(np.sum(weights * (right - one.probability)))
        words.append(
            f"The {bank} bank's probabilities are off by {percent(gap)} on average"
            + (f", it is {'too modest' if side > 0.0 else 'too sure'}." if gap > 0.005 else ".")
        )
        axes[f"bin_{bank}"] = [f"bin {i + 1}" for i in range(right.size)]
        numbers[f"probability_{bank}"] = Quantity(
            one.probability, "1", "mean probability given", (f"bin_{bank}",)
        )
        numbers |= dict(
            share_numbers(f"right_{bank}", "share of answers that are right", f"bin_{bank}", one.right)
        )
        numbers[f"gap_{bank}"] = Quantity(gap, "1", "mean distance of probability and share right")
    return Section(
        key=f"calibration_{what}",
        title=title,
        words=tuple(words),
        numbers=numbers,
        axes=axes,
        figures=(
            figure(
                f"calibration_{what}",
                title,
                "Share of answers that are right over the probability that they were given; on the dotted "
                "line a probability says what it means.",
                partial(draw, "draw_calibration", title, found),
            ),
        ),
    )
