"""The section that asks where there is a steady-state Kalman filter, and how much reaches it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.prose.words import listed, quantity
from co_sim.wheelset.reporting.section import GRID_AXES, Column, Figure, Quantity, Section, Table
from co_sim.wheelset.reporting.setup import SENSORS, sensor_set_name
from estimator import filter_model, wheelset_model
from estimator.linear_models import TRACK_DECAY
from estimator.structure import LinearSystem, filter_exists, gramians, natural_scales, steady_filter

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.grid import Grid, GridPoint
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.reporting.setup import Setup
    from estimator.structure import SteadyFilter

__all__ = ["filter_section"]

Array = NDArray[np.float64]

_TITLE = "Is there a steady-state Kalman filter?"
_HANKEL = "Through how many motions does the track reach the sensors?"
_NOISES = ("track alone", "track and unmodelled accelerations")
#: Intensity of the unmodelled lateral acceleration, m2/s3.
_UNMODELLED = 1e-4
#: What the filter model (13) has an output for.
_SEEN = ("gyro", "accelerometer", "displacement")
#: Rates of error modes within this part of the decay of the track offset are that decay, 1/s.
_OWN = 0.1
_NONE = "no steady filter exists"
_ORDER = 4
#: Offset of the track in which Hankel singular values count, m.
_OFFSET = 1e-3


@dataclass(frozen=True, eq=False)
class Filters:
    """Where filters exist.

    Parameters
    ----------
    names : of the sets of sensors.
    exists, reason : (noise, set, condition, speed, point).
    forgets : (set, condition, speed, point) time constant (s) of the slowest error besides that of the track
        offset, with both noises; nan where there is no filter.
    hankel : (condition, speed, point, direction).
    """

    names: tuple[str, ...]
    exists: NDArray[np.bool_]
    reason: NDArray[np.str_]
    forgets: Array
    hankel: Array


def filter_section(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> Section:
    """Ask for filters of (13) on the grid, and for Hankel singular values from track to sensors."""
    found = _compute(setup, grid, progress)
    main = _main(setup, found)
    words = _words(found, grid, main)
    over = ("noise", "set", *GRID_AXES)
    return Section(
        key="filters",
        title=_TITLE,
        words=tuple(words),
        numbers={
            "exists": Quantity(found.exists, "1", "whether (13) has a steady-state Kalman filter", over),
            "reason": Quantity(found.reason, "1", "of that, in words", over),
            "forgets": Quantity(
                found.forgets,
                "s",
                "time constant of the slowest error but the track offset's own, with both noises",
                ("set", *GRID_AXES),
                _NONE,
            ),
            "hankel_singular_value": Quantity(
                found.hankel,
                "1",
                "of (12) from the track offset in mm to the sensors in rms of their noise",
                (*GRID_AXES, "direction"),
            ),
            "horizon": Quantity(setup.window, "s", "of the Hankel singular values"),
            "unmodelled_acceleration": Quantity(_UNMODELLED, "m2/s3", "intensity, where it counts"),
        },
        axes={"noise": _NOISES, "set": found.names, "direction": tuple(range(1, _ORDER + 1))},
        tables=(_table(found, grid),),
        figures=(_figure(setup, found, grid),) if found.hankel.any() else (),
        summary=(words[0],),
        brief={"steady filter": _brief(found, main, grid)},
    )


# Numbers ---------------------------------------------------------------------------------------------


def _compute(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> Filters:
    sets = _sets(setup)
    shape = (len(_NOISES), len(sets), *grid.shape)
    exists, forgets = np.zeros(shape, dtype=bool), np.full(shape[1:], np.nan)
    reason = np.full(shape, "", dtype=object)
    hankel = np.zeros((*grid.shape, _ORDER))
    points = grid.resolve(setup.wheelset)
    outputs = [[SENSORS[name].measures[0] for name in names] for names in sets]
    for n, at in enumerate(points):
        model, noises = _filter_model(setup, at), _noises(setup, at.speed)
        scales = natural_scales(model)
        for i, s in np.ndindex(shape[:2]):
            place = (i, s, *at.index)
            verdict = filter_exists(model, noises[i], outputs=outputs[s], scales=scales)
            exists[place], reason[place] = verdict.holds, verdict.reason
        for s, names in enumerate(sets):
            R = np.diag([setup.noise[name] ** 2 / setup.sample_rate for name in names])
            found = steady_filter(model, noises[1], R, outputs=outputs[s], scales=scales)
            forgets[(s, *at.index)] = _forgets(found)
        hankel[at.index] = _reaching(setup, at)
        progress((n + 1) / len(points))
    names = tuple(sensor_set_name(names) for names in sets)
    return Filters(names, exists, reason.astype(np.str_), forgets, hankel)


def _sets(setup: Setup) -> tuple[tuple[str, ...], ...]:
    """Return the sets of sensors without those that (13) has no output for."""
    kept = (tuple(name for name in names if name in _SEEN) for names in setup.sensors)
    return tuple(dict.fromkeys(names for names in kept if names))


def _filter_model(setup: Setup, at: GridPoint) -> LinearSystem:
    """Return (13) with the lateral displacement as a further output."""
    system = LinearSystem.of(filter_model(at.point, setup.wheelset))
    displacement = np.array([[0.0, 0.0, 0.0, 1.0, 1.0]])  # y = y_t + (y - y_t)
    return replace(
        system,
        C=np.vstack([system.C, displacement]),
        D=np.zeros((3, 3)),
        outputs=(*system.outputs, "lateral_displacement"),
        output_units=("rad/s", "m/s2", "m"),
    )


def _noises(setup: Setup, v: float) -> tuple[Array, Array]:
    """Return the intensities of the inputs of (13): track alone, and with unmodelled accelerations."""
    track, yaw = setup.spectrum.rate_intensity(v), setup.wheelset.m_w / setup.wheelset.I_w
    return np.diag([track, 0.0, 0.0]), np.diag([track, _UNMODELLED, _UNMODELLED * yaw])


def _forgets(found: SteadyFilter) -> float:
    rates = [-s.real for s in found.error_modes if abs(s.real + TRACK_DECAY) > _OWN * TRACK_DECAY]
    return 1.0 / min(rates) if rates else math.nan


def _reaching(setup: Setup, at: GridPoint) -> Array:
    """Return the Hankel singular values of (12) over the window, in mm and in rms of the noise."""
    system = LinearSystem.of(wheelset_model(at.point, setup.wheelset))
    noise = np.array([[setup.noise["gyro"]], [setup.noise["accelerometer"]]])
    weighted = replace(system, B=_OFFSET * system.B, C=system.C / noise, D=_OFFSET * system.D / noise)
    return gramians(weighted, horizon=setup.window).hankel


def _main(setup: Setup, found: Filters) -> int:
    name = sensor_set_name(tuple(n for n in setup.main_sensors if n in _SEEN))
    return found.names.index(name) if name in found.names else 0


# Words, table, figure --------------------------------------------------------------------------------


def _words(found: Filters, grid: Grid, main: int) -> list[str]:
    if not found.names:
        return ["None of the sets of sensors has a gyro, an accelerometer or a displacement to filter."]
    sensors = _plain(found.names[main])
    parts = []
    for k, name in enumerate(grid.point_names):
        here = found.exists[0, main, :, :, k]
        share = (
            "exists at all speeds on all rails"
            if here.all()
            else "exists nowhere"
            if not here.any()
            else f"exists at {int(here.sum())} of {here.size} speeds and rails"
        )
        parts.append(f"at {name} it {share}")
    words = [
        f"Of the steady-state filter (13) with {sensors} and the track as its only noise: {listed(parts)}."
    ]
    words += _reasons(found, grid, main)
    known = found.forgets[main][np.isfinite(found.forgets[main])]
    if known.size:
        words.append(
            f"With both noises it forgets its start within {quantity(float(known.min()), 's', 2)} to "
            f"{quantity(float(known.max()), 's', 2)} (time constants), but for the track offset, which is "
            f"seen only through its own decay in {quantity(1.0 / TRACK_DECAY, 's')}."
        )
    words.append(
        f"Unmodelled accelerations, where they count, have an intensity of {quantity(_UNMODELLED, 'm2/s3')} "
        f"across the track, and in yaw the same over the square of the radius of gyration."
    )
    return words


def _reasons(found: Filters, grid: Grid, main: int) -> list[str]:
    """Return why the main filter is missing, and where other sensors or noises change that."""
    told = [
        f"At {point}: {text}."
        for k, point in enumerate(grid.point_names)
        for text in _against(found, 0, main, k)
    ]
    for s, name in enumerate(found.names):
        for k, point in enumerate(grid.point_names):
            if s == main or _state(found, 0, s, k) + _state(found, 1, s, k) == 2 * _state(found, 0, main, k):
                continue
            alone, both = (_share(found.exists[i, s, :, :, k]) for i in range(2))
            reasons = listed(_against(found, 0, s, k))
            told.append(
                f"With {_plain(name)} at {point}: {alone} with the track alone"
                + (f" ({reasons})" if reasons else "")
                + f", {both} with unmodelled accelerations as well."
            )
    return told


def _state(found: Filters, noise: int, s: int, k: int) -> int:
    """Return at how many speeds and rails a filter exists."""
    return int(found.exists[noise, s, :, :, k].sum())


def _against(found: Filters, noise: int, s: int, k: int) -> list[str]:
    missing = ~found.exists[noise, s, :, :, k]
    return list(dict.fromkeys(found.reason[noise, s, :, :, k][missing].tolist()))


def _plain(name: str) -> str:
    return listed([part.replace("_", " ") for part in name.split("+")])


def _table(found: Filters, grid: Grid) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for s, name in enumerate(found.names):
        for k, point in enumerate(grid.point_names):
            known = found.forgets[s, :, :, k]
            known = known[np.isfinite(known)]
            slowest = float(known.max()) if known.size else None
            rows.append(
                (
                    name.replace("_", " ").replace("+", " + "),
                    point,
                    *(_share(found.exists[i, s, :, :, k]) for i in range(len(_NOISES))),
                    slowest,
                )
            )
    columns = (
        Column("sensors"),
        Column("point"),
        *(Column(noise) for noise in _NOISES),
        Column("forgets within at most", "s"),
    )
    note = "Whether a filter exists, over all rails and speeds; the last column is with both noises."
    return Table("Existence of the steady-state filter of (13)", columns, tuple(rows), note)


def _share(here: NDArray[np.bool_]) -> str:
    return "yes" if here.all() else "no" if not here.any() else f"{int(here.sum())} of {here.size}"


def _brief(found: Filters, main: int, grid: Grid) -> list[list[str]]:
    if not found.names:
        return [["–"] * grid.shape[2] for _ in grid.conditions]
    return [
        [_share(found.exists[0, main, i, :, k]) for k in range(grid.shape[2])] for i in range(grid.shape[0])
    ]


def _figure(setup: Setup, found: Filters, grid: Grid) -> Figure:
    middle = grid.speeds[len(grid.speeds) // 2]
    silent = [
        name for k, name in enumerate(grid.point_names) if not found.hankel[:, len(grid.speeds) // 2, k].any()
    ]
    nothing = f" At {listed(silent)} there is none: the track does not move the wheelset." if silent else ""
    return Figure(
        key="hankel_track",
        title=_HANKEL,
        caption=(
            f"Hankel singular values of (12) at {quantity(middle, 'm/s')} over "
            f"{quantity(setup.window, 's')}, from the track offset in mm to gyro and accelerometer in "
            f"multiples of their noise ({quantity(setup.noise['gyro'], 'rad/s')} and "
            f"{quantity(setup.noise['accelerometer'], 'm/s2')}): how much of the track's past each "
            f"independent motion carries to the sensors.{nothing}"
        ),
        alt="Hankel singular values over direction, a panel for each rail condition.",
        draw=partial(_draw, found, grid),
    )


def _draw(found: Filters, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.energies import draw_directions

    values = found.hankel[:, len(grid.speeds) // 2]
    return draw_directions(grid.conditions, grid.point_names, values, _HANKEL)
