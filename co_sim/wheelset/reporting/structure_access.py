"""The sections that ask what inputs reach and what sensors see of the driven wheelset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.prose.words import listed, number, quantity
from co_sim.wheelset.reporting.section import GRID_AXES, Column, Figure, Quantity, Section, Table
from co_sim.wheelset.reporting.setup import SENSORS, sensor_set_name
from estimator.linear_models import full_model
from estimator.structure import (
    LinearSystem,
    controllability_margins,
    controllability_rank,
    distance_to_uncontrollable,
    distance_to_unobservable,
    natural_scales,
    observability_margins,
    observability_rank,
)
from estimator.structure.filters import reach, sight
from estimator.structure.subspaces import TOLERANCE

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.reporting.setup import Setup
    from estimator.structure import Scales

__all__ = ["access_sections"]

Array = NDArray[np.float64]
Kind = Literal["reach", "sight"]

#: Outputs of the driven wheelset by what the sensors measure, and its inputs by what acts.
_OUTPUTS = {
    "yaw_rate": "yaw_rate",
    "lateral_acceleration": "lateral_acceleration",
    "left.wheel_speed": "omega_L",
    "right.wheel_speed": "omega_R",
    "lateral_displacement": "lateral_displacement",
}
_INPUTS = {
    "track": ("y_t",),
    "traction torque": ("T_t",),
    "suspension force": ("F_susp",),
    "all three": ("y_t", "T_t", "F_susp"),
}
_UNITS = {
    "state_units": ("m", "rad", "m/s", "rad/s", "rad/s", "rad/s", "rad"),
    "input_units": ("m", "N.m", "N", "N.m"),
    "output_units": ("rad/s", "m/s2", "rad/s", "rad/s", "m"),
}
_ORDER = 7
#: Looseness of the bounds of distances on maps of many decades.
_WITHIN = 0.2


@dataclass(frozen=True, eq=False)
class Access:
    """What sets of signals reach or see over a grid, with a first axis over the sets.

    Parameters
    ----------
    names : of the sets. rank, distance, lower : (set, condition, speed, point).
    singular_values : (set, condition, speed, point, direction).
    margin, lost : (set, condition, speed, point, mode). holds : stabilisable or detectable.
    reason : of that in words. hidden : states that are out of reach or sight, in words.
    poles, dominant : (condition, speed, point, mode) eigenvalues and the states that participate most.
    """

    names: tuple[str, ...]
    rank: NDArray[np.int64]
    distance: Array
    lower: Array
    singular_values: Array
    margin: Array
    lost: NDArray[np.bool_]
    holds: NDArray[np.bool_]
    reason: NDArray[np.str_]
    hidden: NDArray[np.str_]
    poles: NDArray[np.complex128]
    dominant: NDArray[np.str_]

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Whether all is reached or seen, and by more than rounding (set, condition, speed, point)."""
        return np.asarray((self.rank == _ORDER) & (self.distance > TOLERANCE))


def access_sections(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> tuple[Section, Section]:
    """Ask for ranks, margins and distances on the grid, of inputs and of sets of sensors."""
    outputs = {
        sensor_set_name(names): tuple(_OUTPUTS[m] for name in names for m in SENSORS[name].measures)
        for names in setup.sensors
    }
    points = grid.resolve(setup.wheelset)
    cells: dict[Kind, list[list[dict[str, object]]]] = {"reach": [], "sight": []}
    for i, at in enumerate(points):
        system = LinearSystem.of(full_model(at.point, setup.wheelset), **_UNITS)
        scales = natural_scales(system)
        cells["reach"].append([_asked("reach", system, names, scales) for names in _INPUTS.values()])
        cells["sight"].append([_asked("sight", system, names, scales) for names in outputs.values()])
        progress((i + 1) / len(points))
    main = sensor_set_name(setup.main_sensors)
    return (
        _section("reach", _gathered(cells["reach"], tuple(_INPUTS), grid), grid, "all three"),
        _section("sight", _gathered(cells["sight"], tuple(outputs), grid), grid, main),
    )


def _asked(kind: Kind, system: LinearSystem, names: tuple[str, ...], scales: Scales) -> dict[str, object]:
    if kind == "reach":
        rank = controllability_rank(system, names, scales=scales)
        margins = controllability_margins(system, names, scales=scales)
        distance = distance_to_uncontrollable(system, names, scales=scales, within=_WITHIN)
        verdict = reach(margins)
    else:
        rank = observability_rank(system, names, scales=scales)
        margins = observability_margins(system, names, scales=scales)
        distance = distance_to_unobservable(system, names, scales=scales, within=_WITHIN)
        verdict = sight(margins)
    return {
        "rank": rank.rank,
        "distance": distance.value,
        "lower": distance.lower,
        "singular_values": rank.singular_values,
        "margin": [m.margin for m in margins],
        "lost": [m.lost for m in margins],
        "holds": verdict.holds,
        "reason": verdict.reason,
        "hidden": ", ".join(rank.hidden_states),
        "poles": [complex(m.mode.growth, m.mode.exponent.imag) for m in margins],
        "dominant": [m.mode.dominant for m in margins],
    }


def _gathered(cells: list[list[dict[str, object]]], names: tuple[str, ...], grid: Grid) -> Access:
    def of(what: str) -> NDArray[np.generic]:
        values = np.array([[cell[what] for cell in row] for row in cells])
        return np.moveaxis(values.reshape(*grid.shape, len(names), *values.shape[2:]), 3, 0)

    return Access(
        names=names,
        rank=of("rank").astype(np.int64),
        distance=of("distance").astype(np.float64),
        lower=of("lower").astype(np.float64),
        singular_values=of("singular_values").astype(np.float64),
        margin=of("margin").astype(np.float64),
        lost=of("lost").astype(np.bool_),
        holds=of("holds").astype(np.bool_),
        reason=of("reason").astype(np.str_),
        hidden=of("hidden").astype(np.str_),
        poles=of("poles").astype(np.complex128)[0],
        dominant=of("dominant").astype(np.str_)[0],
    )


# The sections ----------------------------------------------------------------------------------------

_TITLES = {
    "reach": "What do track, traction torque and suspension force reach?",
    "sight": "What do the sensors see of the driven wheelset?",
}
_MAPS = {
    "reach": "How far is the wheelset from motions that an input does not reach?",
    "sight": "How far is the wheelset from motions that the sensors do not see?",
}
_BARS = {
    "reach": "How much does each direction that an input reaches add?",
    "sight": "How much does each direction that the sensors see add?",
}
_MARGINS = {
    "reach": "Which modes do the inputs nearly miss?",
    "sight": "Which modes do the sensors nearly miss?",
}
_LOSS = {"reach": "put a mode out of reach", "sight": "hide a mode"}
_VERBS = {
    "reach": ("reach", "reaches", "reached", "stabilisable"),
    "sight": ("see", "sees", "seen", "detectable"),
}


def _section(kind: Kind, found: Access, grid: Grid, main: str) -> Section:
    words, s = [*_words(kind, found, grid, main), _ABOUT], found.names.index(main)
    return Section(
        key=kind,
        title=_TITLES[kind],
        words=tuple(words),
        numbers=_numbers(kind, found),
        axes={
            "set": found.names,
            "mode": tuple(range(1, _ORDER + 1)),
            "direction": tuple(range(1, _ORDER + 1)),
        },
        tables=(_table(kind, found, grid),),
        figures=_figures(kind, found, grid),
        summary=(words[0], *_barely(kind, found, s), *_blind(kind, found, grid, s)),
    )


_ABOUT = (
    "The model is the torque-driven wheelset with seven states: (12), both wheel speeds and the twist of the "
    "axle. A distance is the smallest change of the scaled model, relative to its norm, after which a mode "
    "is lost, wherever that then lies; a margin is the same for a mode where it is. Units of states and "
    "signals are free in the scaled model: a distance tells how far the structure is from a loss, not how "
    "strong a signal is against its noise."
)


def _numbers(kind: Kind, found: Access) -> dict[str, Quantity]:
    verb, _, past, adjective = _VERBS[kind]
    over = ("set", *GRID_AXES)
    return {
        "rank": Quantity(found.rank, "1", f"dimensions of seven that are {past}", over),
        "singular_value": Quantity(
            found.singular_values,
            "1",
            "what each direction added, of the scaled model; counted up to the rank",
            (*over, "direction"),
        ),
        "tolerance": Quantity(TOLERANCE, "1", "what counts as zero in the scaled model"),
        "eigenvalue": Quantity(
            found.poles, "1/s", "of the driven wheelset, slowest to decay first", (*GRID_AXES, "mode")
        ),
        "dominant_state": Quantity(
            found.dominant, "1", "state that participates most in the mode", (*GRID_AXES, "mode")
        ),
        "margin": Quantity(found.margin, "1", "of each mode where it is", (*over, "mode")),
        "lost": Quantity(found.lost, "1", f"whether the mode is not {past} at all", (*over, "mode")),
        "distance": Quantity(found.distance, "1", f"to the nearest model with a mode not {past}", over),
        "distance_at_least": Quantity(found.lower, "1", "bound that no such model undercuts", over),
        adjective: Quantity(found.holds, "1", f"whether they {verb} every mode that does not decay", over),
        "reason": Quantity(found.reason, "1", "of that, in words", over),
        "hidden_states": Quantity(found.hidden, "1", f"states not {past}", over),
    }


def _words(kind: Kind, found: Access, grid: Grid, main: str) -> list[str]:
    verb, verbs, past, _ = _VERBS[kind]
    s = found.names.index(main)
    sensors = listed([_plain(name) for name in main.split("+")])
    singular = kind == "sight" and "+" not in main
    who = "all three inputs together" if kind == "reach" else f"the set {sensors}" if singular else sensors
    parts = [f"{_ranks(found.rank[s, :, :, k])} at {name}" for k, name in enumerate(grid.point_names)]
    words = [
        f"Of the driven wheelset's seven dimensions {who} {verbs if singular else verb} {listed(parts)}."
    ]
    words += _barely(kind, found, s)
    complete = found.complete[s]
    if complete.any():
        values = np.where(complete, found.distance[s], np.inf)
        i, j, k = (int(n) for n in np.unravel_index(int(np.argmin(values)), values.shape))
        words.append(
            f"Where all is {past}, it is nearest to a loss on {_plain(grid.conditions[i])} rail at "
            f"{quantity(grid.speeds[j], 'm/s')}, {grid.point_names[k]}: a relative change of "
            f"{number(float(values[i, j, k]), 2)} would {_LOSS[kind]}."
        )
    return words + _blind(kind, found, grid, s)


#: States of the driven wheelset in words.
_MEANING = {
    "y": "displacement",
    "psi": "yaw",
    "y_dot": "lateral velocity",
    "psi_dot": "yaw rate",
    "omega_L": "speed of the left wheel",
    "omega_R": "speed of the right wheel",
    "theta": "twist of the axle",
}


def _barely(kind: Kind, found: Access, s: int) -> list[str]:
    """Tell where set `s` has full rank by less than rounding."""
    past, complete = _VERBS[kind][2], found.complete[s]
    barely = int(np.sum(found.rank[s] == _ORDER) - np.sum(complete))
    if not barely:
        return []
    sentence = (
        f"At {barely} of {complete.size} points of the grid this is all by less than rounding errors, with a "
        f"distance below {number(TOLERANCE, 1)}: to all intents a mode is not {past} there."
    )
    return [sentence]


def _blind(kind: Kind, found: Access, grid: Grid, s: int) -> list[str]:
    """Tell what of the wheelset set `s` does not reach or see where no other does either."""
    _, verbs, past, _ = _VERBS[kind]
    words = []
    for p in range(grid.shape[2]):
        hidden = sorted({name for text in found.hidden[s, :, :, p].flat for name in text.split(", ") if name})
        if hidden and not found.complete[:, :, :, p].any():
            words.append(
                f"At {grid.point_names[p]} no set {verbs} everything; not {past} here: "
                f"{listed([_MEANING[name] for name in hidden])}."
            )
    return words


def _ranks(ranks: NDArray[np.int64]) -> str:
    low, high = int(ranks.min()), int(ranks.max())
    return "all" if low == _ORDER else f"{low}" if low == high else f"{low} to {high}"


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _table(kind: Kind, found: Access, grid: Grid) -> Table:
    _, _, _, adjective = _VERBS[kind]
    rows: list[tuple[Cell, ...]] = []
    for s, name in enumerate(found.names):
        for k, point in enumerate(grid.point_names):
            holds = found.holds[s, :, :, k]
            verdict = "yes" if holds.all() else "no" if not holds.any() else f"{holds.sum()} of {holds.size}"
            distances = found.distance[s, :, :, k]
            rows.append(
                (
                    _plain(name).replace("+", " + "),
                    point,
                    _ranks(found.rank[s, :, :, k]),
                    float(distances.min()),
                    float(distances.max()),
                    verdict,
                )
            )
    columns = (
        Column("inputs" if kind == "reach" else "sensors"),
        Column("point"),
        Column("rank of 7"),
        Column("least distance"),
        Column("largest distance"),
        Column(adjective),
    )
    return Table("Over all rails and speeds", columns, tuple(rows))


def _figures(kind: Kind, found: Access, grid: Grid) -> tuple[Figure, ...]:
    _, _, past, _ = _VERBS[kind]
    middle = quantity(grid.speeds[len(grid.speeds) // 2], "m/s")
    rail = _plain(grid.conditions[0])
    whose = "set of inputs" if kind == "reach" else "set of sensors"
    return (
        Figure(
            key=f"{kind}_distances",
            title=_MAPS[kind],
            caption=(
                f"Distance to the nearest model with a mode that is not {past}, for each {whose} and point, "
                f"over speed. A cross marks models that have such a mode already, or to rounding."
            ),
            alt=f"Maps of the distance for each {whose}, point, speed and rail.",
            draw=partial(_draw_maps, kind, found, grid),
        ),
        Figure(
            key=f"{kind}_singular_values",
            title=_BARS[kind],
            caption=(
                f"Singular values of the staircase algorithm at {middle}: what each further direction added "
                f"to those {past} before. Directions without a bar are not {past}."
            ),
            alt=f"Bars of singular values for each {whose} and point.",
            draw=partial(_draw_bars, kind, found, grid),
        ),
        Figure(
            key=f"{kind}_margins",
            title=_MARGINS[kind],
            caption=(
                f"Margin of each mode of the driven wheelset at {middle} on {rail} rail, one of each "
                f"conjugate pair. A cross marks modes that are not {past} at all."
            ),
            alt=f"Tables of margins for each {whose} and mode, one for each point.",
            draw=partial(_draw_margins, kind, found, grid),
        ),
    )


def _draw_maps(kind: Kind, found: Access, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.access import draw_distances

    return draw_distances(
        grid.conditions,
        grid.speeds,
        grid.point_names,
        found.names,
        found.distance,
        ~found.complete,
        _MAPS[kind],
    )


def _draw_bars(kind: Kind, found: Access, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.access import draw_singular_values

    j = len(grid.speeds) // 2
    values = np.where(
        np.arange(_ORDER) < found.rank[:, :, j, :, None], found.singular_values[:, :, j], np.nan
    )
    return draw_singular_values(grid.conditions, grid.point_names, found.names, values, _BARS[kind])


def _draw_margins(kind: Kind, found: Access, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.access import draw_mode_margins

    j = len(grid.speeds) // 2
    return draw_mode_margins(
        grid.point_names,
        found.names,
        found.poles[0, j],
        found.dominant[0, j],
        found.margin[:, 0, j],
        found.lost[:, 0, j],
        _MARGINS[kind],
    )
