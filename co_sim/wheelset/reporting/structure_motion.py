"""The section that asks how the wheelset moves by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from co_sim.wheelset.prose.words import listed, number, quantity
from co_sim.wheelset.reporting.section import GRID_AXES, Column, Figure, Quantity, Section, Table
from estimator import CreepCurve, wheelset_model
from estimator.linear_models import OperatingPoint, operating_points, state_matrix
from estimator.stability import StableSpeeds, stable_speeds
from estimator.structure import LinearSystem, modes
from fmu_wheelset import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.grid import Grid
    from co_sim.wheelset.reporting.section import Cell
    from co_sim.wheelset.reporting.setup import Setup
    from estimator.structure import Mode
    from fmu_wheelset import WheelsetParameters

__all__ = ["motion_section"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_TITLE = "How does the wheelset move by itself?"
_PATHS = "Where do the modes go as creepage and speed grow?"
_MAP = "At which speeds and creepages is the wheelset stable?"
_LIMITS = "Up to which speed is the wheelset stable at a given creepage?"
_STATES = ("y", "psi", "y_dot", "psi_dot")
_UNITS = ("m", "rad", "m/s", "rad/s")
#: Creepages of the maps and of the paths, of that of the peak; creepages of the limits; speeds, m/s.
_RELATIVE = np.linspace(0.02, 2.0, 56)
_PATH = np.append(np.geomspace(0.005, 0.2, 50), np.linspace(0.22, 2.0, 50))
_CREEPAGES = np.geomspace(1e-5, 0.1, 33)
_FASTEST = 120.0
_SLOWEST = 2.0
_NO_PEAK = "the creep curve has no maximum at this speed"


@dataclass(frozen=True, eq=False)
class Motion:
    """What the eigenvalues of (12) say.

    Parameters
    ----------
    modes : of each point of the grid, over (condition, speed, point).
    path_speeds : m/s. paths : (condition, path speed, path creepage, 4) eigenvalues.
    map_speeds : m/s. growth : (condition, map speed, relative creepage) 1/s.
    limits : of each condition and creepage. of_points : of each condition and point of the grid, with the
        creepage that the point has at each speed.
    """

    modes: NDArray[np.object_]
    path_speeds: tuple[float, ...]
    paths: Complex
    map_speeds: Array
    growth: Array
    limits: tuple[tuple[StableSpeeds, ...], ...]
    of_points: tuple[tuple[StableSpeeds, ...], ...]

    def cells(self) -> list[tuple[Mode, ...]]:
        """Return the modes of each point of the grid, the last axis fastest."""
        return [cell for plane in self.modes for row in plane for cell in row]


def motion_section(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> Section:
    """Ask for modes on the grid, and for stability over creepage and speed."""
    found = _compute(setup, grid, progress)
    words = _words(found, grid)
    return Section(
        key="motion",
        title=_TITLE,
        words=tuple(words),
        numbers=_numbers(found, grid),
        axes={
            "mode": (1, 2, 3, 4),
            "state": _STATES,
            "path_speed": found.path_speeds,
            "map_speed": found.map_speeds.tolist(),
            "relative_creepage": _RELATIVE.tolist(),
            "path_creepage": _PATH.tolist(),
            "creepage": _CREEPAGES.tolist(),
        },
        tables=(_table(found, grid),),
        figures=_figures(found, grid),
        summary=tuple(words),
        brief={"critical speed": [[_limit(s) for s in row] for row in found.of_points]},
    )


# Numbers ---------------------------------------------------------------------------------------------


def _compute(setup: Setup, grid: Grid, progress: Callable[[float], None]) -> Motion:
    p = setup.wheelset
    every = np.empty(grid.shape, dtype=object)
    for at in grid.resolve(p):
        every[at.index] = modes(LinearSystem.of(wheelset_model(at.point, p), state_units=_UNITS))
    progress(0.2)
    middle = grid.speeds[len(grid.speeds) // 2]
    path_speeds = tuple(dict.fromkeys((grid.speeds[0], middle, grid.speeds[-1])))
    fastest = max(_FASTEST, grid.speeds[-1])
    map_speeds = np.linspace(min(_SLOWEST, grid.speeds[0]), fastest, 48)
    paths = np.array([[_along(c, v, p, _PATH) for v in path_speeds] for c in grid.conditions])
    growth = np.array(
        [[_along(c, v, p, _RELATIVE).real.max(axis=-1) for v in map_speeds] for c in grid.conditions]
    )
    progress(0.5)
    searched = (min(_SLOWEST, grid.speeds[0]), fastest)
    limits, of_points = [], []
    for i, name in enumerate(grid.conditions):
        find = partial(stable_speeds, CONDITIONS[name], wheelset=p, speeds=searched, resolution=4.0)
        limits.append(tuple(find(creep) for creep in _CREEPAGES.tolist()))
        of_points.append(tuple(find(_creep_of(point)) for point in grid.points))
        progress(0.5 + 0.5 * (i + 1) / len(grid.conditions))
    return Motion(every, path_speeds, paths, map_speeds, growth, tuple(limits), tuple(of_points))


def _along(condition: str, v: float, wheelset: WheelsetParameters, relative: Array) -> Complex:
    """Return the eigenvalues (relative creepage, 4) along the creep curve; nan where it has no maximum."""
    curve = CreepCurve(CONDITIONS[condition], v, wheelset.N, wheelset.patch)
    try:
        peak = curve.peak_creep
    except ValueError:
        return np.full((relative.size, 4), np.nan, dtype=np.complex128)
    slopes = zip(curve.tangent(relative * peak), curve.secant(relative * peak), strict=True)
    points = (OperatingPoint("", creep=0.0, force=0.0, g11=g11, g22=g22, v=v) for g11, g22 in slopes)
    matrices = [state_matrix(point, wheelset) for point in points]
    return np.linalg.eigvals(np.array(matrices)).astype(np.complex128)


def _creep_of(point: str | float) -> float | Callable[[CreepCurve], float]:
    if not isinstance(point, str):
        return point
    return lambda curve: next(p.creep for p in operating_points(curve) if p.name == point)


def _guiding(found: tuple[Mode, ...]) -> Mode | None:
    """Return the least damped oscillation."""
    swinging = [mode for mode in found if mode.frequency > 0.0]
    return min(swinging, key=lambda mode: mode.damping_ratio) if swinging else None


def _numbers(found: Motion, grid: Grid) -> dict[str, Quantity]:
    over = (*GRID_AXES, "mode")

    def of(what: str) -> NDArray[np.generic]:
        values = np.array([[getattr(m, what) for m in cell] for cell in found.cells()])
        return values.reshape(*grid.shape, *values.shape[1:])

    undamped = "the mode neither decays nor grows"
    meet = "the eigenvectors of the mode meet and no participation is defined"
    limits = np.array([[s.critical for s in row] for row in found.limits])
    points = np.array([[s.critical for s in row] for row in found.of_points])
    never = f"stable up to {quantity(found.map_speeds[-1], 'm/s')}, the fastest speed looked at"
    return {
        "eigenvalue": Quantity(of("exponent"), "1/s", "of (12), slowest to decay first", over),
        "behaviour": Quantity(of("behaviour"), "1", "whether the mode decays, grows or is undamped", over),
        "frequency": Quantity(of("frequency"), "Hz", "of the damped oscillation", over),
        "damping_ratio": Quantity(of("damping_ratio"), "1", "-Re/|s|", over),
        "time_constant": Quantity(of("time_constant"), "s", "to decay or grow by e", over, undamped),
        "mode_shape": Quantity(
            of("shape"), "of the state", "motion of the states in the mode", (*over, "state")
        ),
        "participation": Quantity(
            of("participation"), "1", "part of each state in the mode", (*over, "state"), meet
        ),
        "pole_path": Quantity(
            found.paths,
            "1/s",
            "eigenvalues of (12) along the creep curve",
            ("condition", "path_speed", "path_creepage", "mode"),
            _NO_PEAK,
        ),
        "growth_rate": Quantity(
            found.growth,
            "1/s",
            "greatest real part of an eigenvalue of (12)",
            ("condition", "map_speed", "relative_creepage"),
            _NO_PEAK,
        ),
        "critical_speed": Quantity(
            limits, "m/s", "speed at which stability is first lost", ("condition", "creepage"), never
        ),
        "critical_speed_of_point": Quantity(
            points,
            "m/s",
            "the same, with the creepage that the point has at each speed",
            ("condition", "point"),
            never,
        ),
    }


# Words, table, figures -------------------------------------------------------------------------------


def _limit(found: StableSpeeds) -> str:
    v = found.critical
    if v == 0.0:
        return "never stable" if not found.ranges else "unstable when slow"
    return f"over {found.searched[1]:g} m/s" if math.isinf(v) else quantity(v, "m/s")


def _words(found: Motion, grid: Grid) -> list[str]:
    growing, undamped = (
        np.array([any(m.behaviour == kind for m in cell) for cell in found.cells()]).reshape(grid.shape)
        for kind in ("grows", "undamped")
    )
    undamped &= ~growing
    parts = []
    for k, name in enumerate(grid.point_names):
        total = grid.shape[0] * grid.shape[1]
        counts = [
            (int(growing[:, :, k].sum()), "unstable"),
            (int(undamped[:, :, k].sum()), "without damping"),
            (total - int((growing | undamped)[:, :, k].sum()), "stable"),
        ]
        told = [
            f"{word} at all speeds on all rails" if count == total else f"{word} at {count} of {total} points"
            for count, word in counts
            if count
        ]
        parts.append(f"at {name} it is {listed(told)}")
    words = [f"Left alone, the wheelset moves differently along the creep curve: {'; '.join(parts)}."]
    critical = [
        f"{_limit(row[0])} on {name.replace('_', ' ')} rail"
        for name, row in zip(grid.conditions, found.limits, strict=True)
    ]
    words.append(
        f"Critical speeds with hardly any creepage ({number(100.0 * _CREEPAGES[0], 1)} %): "
        f"{listed(critical)}."
    )
    return words


def _table(found: Motion, grid: Grid) -> Table:
    middle = len(grid.speeds) // 2
    rows: list[tuple[Cell, ...]] = []
    for i, condition in enumerate(grid.conditions):
        for k, point in enumerate(grid.point_names):
            mode = _guiding(found.modes[i, middle, k])
            growth = max(m.growth for m in found.modes[i, middle, k])
            rows.append(
                (
                    condition.replace("_", " "),
                    point,
                    mode.frequency if mode else None,
                    mode.damping_ratio if mode else None,
                    growth,
                    _limit(found.of_points[i][k]),
                )
            )
    columns = (
        Column("rail"),
        Column("point"),
        Column("frequency", "Hz"),
        Column("damping ratio"),
        Column("growth rate", "1/s"),
        Column("critical speed"),
    )
    note = (
        "Frequency and damping ratio of the least damped oscillation, and the growth rate of whatever decays "
        "slowest or grows fastest. The critical speed lets the curve and the point move with the speed."
    )
    return Table(f"The guiding motion at {quantity(grid.speeds[middle], 'm/s')}", columns, tuple(rows), note)


def _figures(found: Motion, grid: Grid) -> tuple[Figure, ...]:
    fastest = quantity(found.map_speeds[-1], "m/s")
    return (
        Figure(
            key="pole_paths",
            title=_PATHS,
            caption=(
                "Eigenvalues of (12) while the creepage grows from 0.5 % of that of the peak to twice it "
                f"(colour), at {listed([quantity(v, 'm/s') for v in found.path_speeds])}. The pair turns "
                "from the well damped guiding motion into the undamped swing on the yaw spring at the peak "
                "and into a growing one past it; the fast creep modes slow down. Both axes are linear near "
                "zero and logarithmic beyond; conjugates are left out, and real eigenvalues of different "
                "speeds stand one below the other."
            ),
            alt="Paths of the eigenvalues in the complex plane, a panel for each rail condition.",
            draw=partial(_draw_paths, found, grid),
        ),
        Figure(
            key="stability_map",
            title=_MAP,
            caption=(
                "Growth rate of the least damped mode of (12) over creepage, as a part of that of the peak, "
                "and speed. The line is the critical speed: above it the wheelset hunts, right of it "
                "friction falls with slip."
            ),
            alt="Maps of the growth rate over creepage and speed, a panel for each rail condition.",
            draw=partial(_draw_map, found, grid),
        ),
        Figure(
            key="critical_speeds",
            title=_LIMITS,
            caption=(
                f"Critical speed over creepage; where a line is missing, the wheelset is stable up to "
                f"{fastest} or, past the peak, at no speed. Rising lines lose stability to hunting, falling "
                f"ones because the peak of the curve comes down to the creepage as the speed grows."
            ),
            alt="Critical speed over creepage, a line for each rail condition.",
            draw=partial(_draw_limits, found, grid),
        ),
    )


def _draw_paths(found: Motion, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.stability import draw_pole_paths

    return draw_pole_paths(grid.conditions, found.path_speeds, _PATH, found.paths, _PATHS)


def _draw_map(found: Motion, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.stability import draw_stability_map

    return draw_stability_map(grid.conditions, found.map_speeds, _RELATIVE, found.growth, _MAP)


def _draw_limits(found: Motion, grid: Grid) -> Sheet:
    from co_sim.wheelset.drawing.stability import draw_critical_speeds

    return draw_critical_speeds(grid.conditions, _CREEPAGES, found.limits, _LIMITS)
