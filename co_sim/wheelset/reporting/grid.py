"""The grid of a report: rail conditions, speeds, and points of the creep curve."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError, suggestion
from estimator import CreepCurve, operating_points
from estimator.linear_models import point_at
from fmu_wheelset import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from estimator import OperatingPoint
    from fmu_wheelset import WheelsetParameters

__all__ = ["NAMED_POINTS", "Grid", "GridPoint", "parse_conditions", "parse_points", "parse_speeds"]

#: Points of the paper's Fig. 2: in the linear region, at the maximum, past it.
NAMED_POINTS = ("P1", "P2", "P3")
#: Speeds and points up to which a report is still a report and not a study of days.
_LARGEST = 4000
_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class GridPoint:
    """One point of a grid.

    Parameters
    ----------
    index : its place (condition, speed, point) in arrays over the grid.
    condition : name of the rail condition under both wheels.
    speed : m/s.
    name : of the point: ``"P1"``, ``"P2"``, ``"P3"`` or its creep, such as ``"0.25 %"``.
    point : creep, force and slopes there.
    """

    index: tuple[int, int, int]
    condition: str
    speed: float
    name: str
    point: OperatingPoint

    def __str__(self) -> str:
        return f"{self.condition} rail, {self.speed:g} m/s, {self.name}"


@dataclass(frozen=True, slots=True)
class Grid:
    """Rail conditions, speeds and points of the creep curve; every combination is a point of the grid.

    Parameters
    ----------
    conditions : names of `fmu_wheelset.CONDITIONS`.
    speeds : m/s, rising.
    points : ``"P1"``, ``"P2"``, ``"P3"``, or common longitudinal creepages as numbers (0.01 is 1 %).

    Raises
    ------
    InputError
        If an axis is empty, repeats itself, or has an unknown name or a number out of its bounds; all faults
        are told.
    """

    conditions: tuple[str, ...] = tuple(CONDITIONS)
    speeds: tuple[float, ...] = tuple(5.0 * k for k in range(1, 17))
    points: tuple[str | float, ...] = NAMED_POINTS

    def __post_init__(self) -> None:
        faults = list(self._faults())
        if faults:
            raise InputError.from_faults(faults)

    def _faults(self) -> Iterator[Fault]:
        for what in ("conditions", "speeds", "points"):
            values: tuple[object, ...] = getattr(self, what)
            if not values:
                yield Fault(f"grid.{what}", "none", "at least one", f"name the {what} of the grid")
            for value in dict.fromkeys(v for v in values if values.count(v) > 1):
                yield Fault(f"grid.{what}", f"{value} twice", "each once", "leave one out")
        for name in self.conditions:
            if name not in CONDITIONS:
                yield Fault(
                    "grid.conditions", f'"{name}"', "a rail condition", suggestion(name, tuple(CONDITIONS))
                )
        for speed in self.speeds:
            if not (math.isfinite(speed) and speed > 0.0):
                yield Fault("grid.speeds", f"{speed:g} m/s", "a finite speed > 0 m/s", "leave it out")
        if list(self.speeds) != sorted(self.speeds):
            yield Fault("grid.speeds", "speeds that fall", "rising speeds", "sort them")
        for point in self.points:
            if isinstance(point, str) and point not in NAMED_POINTS:
                yield Fault("grid.points", f'"{point}"', "P1, P2, P3 or a creepage", "as in P1,P2,0.5%")
            if not isinstance(point, str) and not 0.0 <= point <= 1.0:
                yield Fault(
                    "grid.points", f"the creepage {point:g}", "one from 0 to 1", "write 1 % as 1% or 0.01"
                )
        if self.size > _LARGEST:
            yield Fault(
                "grid",
                f"{self.size} points",
                f"at most {_LARGEST}",
                "take fewer of its values",
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of conditions, speeds and points: the shape of arrays over the grid."""
        return len(self.conditions), len(self.speeds), len(self.points)

    @property
    def size(self) -> int:
        """Number of points of the grid."""
        return math.prod(self.shape)

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the points, creepages in percent."""
        return tuple(p if isinstance(p, str) else f"{100.0 * p:g} %" for p in self.points)

    def resolve(self, wheelset: WheelsetParameters) -> tuple[GridPoint, ...]:
        """Return all points, the last axis fastest, with the slopes for these loads and contact patches.

        Raises
        ------
        InputError
            If a creep curve has no maximum, so that P1 to P3 are nowhere; all such curves are told.
        """
        found: list[GridPoint] = []
        faults: list[Fault] = []
        for i, condition in enumerate(self.conditions):
            for j, speed in enumerate(self.speeds):
                curve = CreepCurve(CONDITIONS[condition], speed, wheelset.N, wheelset.patch)
                try:
                    points = self._points(curve)
                except ValueError:
                    got = "a creep curve without a maximum below 100 % creep"
                    remedy = "take higher speeds, or creepages instead of P1 to P3"
                    what = f"grid: {condition} rail at {speed:g} m/s"
                    faults.append(Fault(what, got, "one with a maximum", remedy))
                    continue
                found += [GridPoint((i, j, k), condition, speed, p.name, p) for k, p in enumerate(points)]
        if faults:
            raise InputError.from_faults(faults)
        return tuple(found)

    def _points(self, curve: CreepCurve) -> list[OperatingPoint]:
        named = any(isinstance(point, str) for point in self.points)
        known = {point.name: point for point in operating_points(curve)} if named else {}
        return [
            known[point] if isinstance(point, str) else point_at(curve, name, point)
            for point, name in zip(self.points, self.point_names, strict=True)
        ]

    def as_json(self) -> dict[str, list[str] | list[float]]:
        """Return the axes for the report's JSON file."""
        return {
            "condition": list(self.conditions),
            "speed": list(self.speeds),
            "point": list(self.point_names),
        }


def parse_conditions(text: str) -> tuple[str, ...]:
    """Return the names in ``dry,wet``; the grid checks them."""
    return _items(text)


def parse_speeds(text: str) -> tuple[float, ...]:
    """Return the speeds (m/s) in ``20``, ``10,20,40`` or ``5:80:5`` (from, to, by; both ends are in).

    Raises
    ------
    InputError
        If an item is neither a number nor a range; all faults are told.
    """
    speeds: list[float] = []
    faults: list[Fault] = []
    for item in _items(text):
        try:
            speeds += _range(item)
        except ValueError:
            faults.append(
                Fault("--speeds", f'"{item}"', "speeds in m/s or from:to:by", "as in 5:80:5 or 10,20,40")
            )
    if faults:
        raise InputError.from_faults(faults)
    return tuple(speeds)


def _range(item: str) -> list[float]:
    parts = [float(part) for part in item.split(":")]
    if len(parts) == 1:
        return parts
    first, last, step = parts
    if not (math.isfinite(first) and math.isfinite(last) and step > 0.0 and last >= first):
        raise ValueError(item)
    count = math.floor((last - first) / step * (1.0 + _TOLERANCE) + _TOLERANCE)
    if count >= _LARGEST:
        raise ValueError(item)
    # Decimal numbers, not sums of rounding errors: 0.1:0.3:0.1 has 0.3 in it.
    return [round(first + k * step, 12) for k in range(count + 1)]


def parse_points(text: str) -> tuple[str | float, ...]:
    """Return the points in ``P1,P2,P3``, ``0.1%,2%`` or ``0.001,0.02``.

    Raises
    ------
    InputError
        If an item is neither a name nor a number; all faults are told.
    """
    points: list[str | float] = []
    faults: list[Fault] = []
    for item in _items(text):
        number = re.fullmatch(r"([^%\s]+)\s*(%?)", item)
        try:
            value = float(number[1]) if number else math.nan
        except ValueError:
            value = math.nan
        if item in NAMED_POINTS:
            points.append(item)
        elif number and not math.isnan(value):
            points.append(value / 100.0 if number[2] else value)
        else:
            faults.append(
                Fault("--points", f'"{item}"', "P1, P2, P3 or creepages", "as in P1,P2,P3 or 0.1%,0.5%,2%")
            )
    if faults:
        raise InputError.from_faults(faults)
    return tuple(points)


def _items(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())
