"""The sections that ask what can be known at all, and what the sensors must be like for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.reporting.confirmation import Confirmation, confirm
from co_sim.wheelset.reporting.information import ERROR, Limits, NoiseLimits, limits, noise_limits
from co_sim.wheelset.reporting.information_numbers import information_numbers, sensor_numbers
from co_sim.wheelset.reporting.information_words import (
    brief_of,
    information_summary,
    information_words,
    sensor_summary,
    sensor_words,
)
from co_sim.wheelset.reporting.pairs import Design, Pair, chosen_pairs, designs, errors_over, ranking_of
from co_sim.wheelset.reporting.section import Column, Figure, Section, Table
from co_sim.wheelset.reporting.setup import sensor_set_name
from co_sim.wheelset.reporting.slope_bounds import SlopeBounds, slope_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.reporting.setup import Setup
    from estimator.identifiability import ErrorProbability

__all__ = ["information_sections"]

Array = NDArray[np.float64]

#: Speeds near which pairs of rails are looked at, m/s: slow and fast.
_SPEEDS = (20.0, 60.0)
_FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)
_WINDOWS = np.geomspace(0.05, 20.0, 60)
#: Parts of the progress that each computation takes.
_PARTS = {"bounds": 0.15, "limits": 0.4, "noise": 0.05, "designs": 0.15, "confirm": 0.25}


@dataclass(frozen=True)
class _Study:
    """Everything that both sections show."""

    bounds: SlopeBounds
    limits: Limits
    noise: NoiseLimits
    pairs: tuple[Pair, ...]
    errors: ErrorProbability
    rates: Array
    designs: Mapping[str, Design]
    confirmations: tuple[Confirmation, ...]


def information_sections(
    setup: Setup, grid: Grid, progress: Callable[[float], None]
) -> tuple[Section, Section]:
    """Compute what can be known at best, and what of it depends on the sensors."""
    study = _studied(setup, grid, progress)
    return _information(study, setup, grid), _sensors(study, setup)


def _studied(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> _Study:
    def part(name: str) -> Callable[[float], None]:
        names = list(_PARTS)
        before = sum(_PARTS[other] for other in names[: names.index(name)])
        return lambda share: progress(before + _PARTS[name] * share)

    speeds = sorted({min(grid.speeds, key=lambda v: abs(v - wanted)) for wanted in _SPEEDS})
    bounds = slope_bounds(setup, grid, part("bounds"))
    over_creep = limits(setup, grid.conditions, grid.speeds, part("limits"))
    over_noise = noise_limits(setup, grid.conditions, speeds[0], _FACTORS)
    pairs = chosen_pairs(setup, grid.conditions, speeds)
    part("noise")(1.0)
    return _Study(
        bounds,
        over_creep,
        over_noise,
        pairs,
        errors_over(pairs, setup, _WINDOWS),
        ranking_of(pairs, setup),
        designs(pairs, setup, ERROR, part("designs")),
        confirm(pairs, setup, part("confirm")),
    )


# What can be known -----------------------------------------------------------------------------------


def _information(study: _Study, setup: Setup, grid: Grid) -> Section:
    names = [pair.name for pair in study.pairs]
    return Section(
        key="information",
        title="How much can be known, and how soon?",
        words=tuple(information_words(study.limits, study.bounds, study.confirmations, grid)),
        numbers=information_numbers(
            study.limits, study.bounds, study.noise, _WINDOWS, study.errors, study.confirmations
        ),
        axes={
            "map_speed": study.limits.speeds,
            "share": study.limits.shares,
            "noise_factor": study.noise.factors,
            "pair": names,
            "window": [float(T) for T in _WINDOWS],
            "confirmed": [one.pair.name for one in study.confirmations],
        },
        tables=(_counted(study.confirmations),) if study.confirmations else (),
        figures=tuple(_information_figures(study, setup)),
        summary=tuple(information_summary(study.limits, study.confirmations)),
        brief={f"g11 known in {setup.window:g} s to": brief_of(study.bounds)},
    )


def _counted(confirmations: tuple[Confirmation, ...]) -> Table:
    columns = (
        Column("rails"),
        Column("window", "s"),
        Column("possible, bounds (%)"),
        Column("estimate (%)"),
        Column("counted (%)"),
        Column("95 % interval (%)"),
        Column("decisions"),
    )
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            one.pair.name,
            one.window,
            f"{100.0 * one.lower:.1f} – {100.0 * one.upper:.1f}",
            f"{100.0 * one.estimate:.1f}",
            f"{100.0 * one.share:.1f}",
            f"{100.0 * one.low:.1f} – {100.0 * one.high:.1f}",
            f"{one.decisions}",
        )
        for one in confirmations
    )
    return Table(
        "Errors of the best decision, possible and counted on the plant",
        columns,
        rows,
        "The plant is the nonlinear FMU with the creepage imposed, a new track and new noise in each run. "
        "Each window is given to the rail of higher likelihood of the linear model with averaged slopes.",
    )


def _information_figures(study: _Study, setup: Setup) -> list[Figure]:
    figures = [
        Figure(
            key="information_window",
            title="How long must one measure to tell a rail from its nearest rival?",
            caption=(
                "Length of record after which the best possible decision between the true rail and the rail "
                f"that is hardest to tell from it at the same traction force errs in {100.0 * ERROR:g} % of "
                f"the cases. Hatched: no method decides within {setup.window:g} s, by linear theory. Dots: "
                "no other rail carries the force, so the force alone tells. Windows below a tenth of a "
                "second are shorter than the motion remembers and only an order of magnitude."
            ),
            alt="Maps of the window needed over speed and creep, one for each rail.",
            draw=partial(_draw_windows, study.limits),
        ),
        Figure(
            key="information_bounds",
            title="How well could creep and peak adhesion be known?",
            caption=(
                f"Cramér-Rao bounds in a record of {setup.window:g} s. Above: the creep on a known curve. "
                "Below: the peak adhesion, with the force known and friction and contact stiffness unknown. "
                "Hatched: the standard deviation exceeds the value, so nothing is known of it."
            ),
            alt="Maps of the least standard deviation of creep and peak adhesion over speed and creep.",
            draw=partial(_draw_bounds, study.limits),
        ),
        Figure(
            key="information_errors",
            title="How fast does the least error fall with time?",
            caption=(
                "Least error probability for pairs of rails, with half the adhesion of the first in use. "
                "Line: saddlepoint estimate; band: between the lower bound of Kailath and the upper bound "
                f"of Chernoff. Dashed: {100.0 * ERROR:g} %."
            ),
            alt="Error probability over the window for pairs of rails, falling exponentially.",
            draw=partial(_draw_errors, study),
        ),
    ]
    if study.confirmations:
        figures.append(
            Figure(
                key="information_confirmed",
                title="Does the plant keep to the limits?",
                caption=(
                    "Least error probability of the linear model and errors counted in decisions on runs of "
                    "the FMU. The likelihood is that of the linear model, so counted errors may lie above "
                    "what is possible where the motion is not linear."
                ),
                alt="Bounds of the error probability beside counted errors for each pair of rails.",
                draw=partial(_draw_confirmation, study.confirmations),
            )
        )
    return figures


# What the sensors must be like -----------------------------------------------------------------------


def _sensors(study: _Study, setup: Setup) -> Section:
    sets = [sensor_set_name(names) for names in setup.sensors]
    return Section(
        key="sensor_design",
        title="Which sensors tell most, and how good must they be?",
        words=tuple(sensor_words(study.pairs, sets, study.rates, study.designs, setup)),
        numbers=sensor_numbers(study.rates, study.designs),
        axes={
            "sensor_set": sets,
            "pair": [pair.name for pair in study.pairs],
            **{f"{name}_values": [float(x) for x in d.values] for name, d in study.designs.items()},
        },
        tables=(_ranked(sets, study),) if study.pairs else (),
        figures=tuple(_sensor_figures(study, setup, sets)) if study.pairs else (),
        summary=tuple(sensor_summary(study.pairs, sets, study.rates)),
    )


def _ranked(sets: list[str], study: _Study) -> Table:
    order = np.argsort(-np.mean(np.log(study.rates), axis=1))
    rows = tuple(
        (sets[k].replace("_", " ").replace("+", " + "), *(float(rate) for rate in study.rates[k]))
        for k in order
    )
    columns = (Column("sensors"), *(Column(pair.name, "1/s") for pair in study.pairs))
    return Table(
        "Chernoff rates of sets of sensors",
        columns,
        rows,
        "After a window T the least error probability is about exp(-rate T)/2 or less. The set that tells "
        "most over all pairs comes first.",
    )


def _sensor_figures(study: _Study, setup: Setup, sets: list[str]) -> list[Figure]:
    return [
        Figure(
            key="sensor_ranking",
            title="Which set of sensors tells most?",
            caption=(
                "Chernoff rate of each set of sensors over that of the best set for the same pair of rails: "
                "the part of the record's length that the best set would need for the same error."
            ),
            alt="Relative information rates of sets of sensors, one dot for each pair of rails.",
            draw=partial(_draw_ranking, study, sets),
        ),
        Figure(
            key="sensor_noise",
            title="Where would quieter sensors help?",
            caption=(
                f"Window needed at {study.noise.speed:g} m/s, as above, when the noise of all sensors "
                "changes. Where a column stays dark to the left, the track itself hides the difference, and "
                "no sensor helps."
            ),
            alt="Maps of the window needed over noise and creep, one for each rail.",
            draw=partial(_draw_noise, study, setup.window),
        ),
        Figure(
            key="sensor_properties",
            title="How quiet, how quick and how often?",
            caption=(
                f"Least error probability after {setup.window:g} s when the noise, the bandwidth (low-pass "
                "before the noise) or the sample rate (same noise in each sample) of all sensors changes, "
                f"the others as assumed. Dots: where {100.0 * ERROR:g} % are reached."
            ),
            alt="Error probability over noise, bandwidth and sample rate for pairs of rails.",
            draw=partial(_draw_design, study),
        ),
    ]


# Drawing, imported where it is needed ----------------------------------------------------------------


def _draw_windows(found: Limits) -> Sheet:
    from co_sim.wheelset.drawing.information_maps import draw_windows

    return draw_windows(found, ERROR, "How long must one measure to tell a rail from its nearest rival?")


def _draw_bounds(found: Limits) -> Sheet:
    from co_sim.wheelset.drawing.information_maps import draw_bounds

    return draw_bounds(found, "How well could creep and peak adhesion be known?")


def _draw_noise(study: _Study, T: float) -> Sheet:
    from co_sim.wheelset.drawing.information_maps import draw_noise

    found = study.limits
    return draw_noise(study.noise, found.conditions, found.shares, T, "Where would quieter sensors help?")


def _draw_errors(study: _Study) -> Sheet:
    from co_sim.wheelset.drawing.information_curves import draw_errors

    names = [pair.name for pair in study.pairs]
    return draw_errors(names, _WINDOWS, study.errors, ERROR, "How fast does the least error fall with time?")


def _draw_confirmation(confirmations: tuple[Confirmation, ...]) -> Sheet:
    from co_sim.wheelset.drawing.information_curves import draw_confirmation

    return draw_confirmation(confirmations, "Does the plant keep to the limits?")


def _draw_ranking(study: _Study, sets: list[str]) -> Sheet:
    from co_sim.wheelset.drawing.information_curves import draw_ranking

    return draw_ranking(sets, [p.name for p in study.pairs], study.rates, "Which set of sensors tells most?")


def _draw_design(study: _Study) -> Sheet:
    from co_sim.wheelset.drawing.information_curves import draw_design

    names = [pair.name for pair in study.pairs]
    return draw_design(names, study.designs, ERROR, "How quiet, how quick and how often?")
