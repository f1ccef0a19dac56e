"""From time stamps as they come to samples at a uniform step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import Fault, InputError
from co_sim.wheelset.identifying.uniform import fit_grid, gaps, near, placed
from estimator.log import Log

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.table import Columns

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["Clock", "Sampled", "on_grid"]

#: Rms of the stamps' distance from the grid, in steps, up to which samples count as on it.
_TOLERATED = 0.05
#: Distance of one stamp from the grid, in steps, that is told as jitter.
_JITTER = 0.1
#: Time from which on a log counts from its own start, s.
_LATE = 1e5
#: Longest way back in time that is a packet out of order, s; more is a clock that was set anew.
_BACK = 1.0
#: No train is faster, m/s.
_FASTEST = 170.0
#: Noise of a speed sensor at rest, m/s.
_SPEED_NOISE = 0.3
#: Fewest samples of a log.
_FEWEST = 100


@dataclass(frozen=True)
class Clock:
    """What the time stamps of a log are like.

    Parameters
    ----------
    rows : of the file. h : step of the grid, s. start, end : first and last time, s.
    offset : what was taken off all times, s, because a clock that counts from 1970 has too few digits left.
    jitter_rms, jitter_max : distance of the stamps from the grid, s.
    resampled : whether the samples were interpolated onto the grid because of it.
    duplicated : rows left out because an earlier one has the same time, or the same place on the grid.
    unordered : rows that came before one with an earlier time, and were sorted.
    undated : rows left out because they have no time.
    gaps : (since, until) of each stretch without rows, s. empty : places of the grid without a row.
    """

    rows: int
    h: float
    offset: float
    start: float
    end: float
    jitter_rms: float
    jitter_max: float
    resampled: bool
    duplicated: int
    unordered: int
    undated: int
    gaps: tuple[tuple[float, float], ...]
    empty: int


@dataclass(frozen=True)
class Sampled:
    """A log on a uniform grid, and where it is not as it came.

    Parameters
    ----------
    log : the samples; NaN where there is none. clock : about the time stamps.
    jitter : (T,) where a stamp was off the grid. gap : (T,) where there is no row.
    filled : (T,) by ``"speed"`` and ``"traction_torque"``, where the value is interpolated.
    """

    log: Log
    clock: Clock
    jitter: Mask
    gap: Mask
    filled: Mapping[str, Mask] = field(default_factory=dict)


def on_grid(file: str, columns: Columns, speed: float | None = None) -> Sampled:
    """Bring the columns of a log onto a uniform grid.

    Parameters
    ----------
    file : name for messages. speed : constant speed where there is no column, m/s.

    Raises
    ------
    InputError
        If there are too few samples, the clock was set anew, the rate is out of range, most of the time has
        no samples, or the speed is no speed.
    """
    values = dict(columns.values)
    time, rows, counts = _in_order(file, values.pop("time"))
    values = {name: column[rows] for name, column in values.items()}
    offset = float(time[0]) if abs(time[0]) > _LATE else 0.0
    time = time - offset
    grid = fit_grid(file, time)
    jitter_rms = float(np.sqrt(np.mean(grid.off**2)))
    resampled = jitter_rms > _TOLERATED * grid.h
    if resampled:
        gap = ~near(time, grid.times, grid.h)
        signals = {name: np.where(gap, np.nan, np.interp(grid.times, time, v)) for name, v in values.items()}
    else:
        gap = placed(np.zeros(len(grid.first)), grid) != 0.0
        signals = {name: placed(v[grid.first], grid) for name, v in values.items()}
        counts["duplicated"] += len(time) - len(grid.first)
    jitter = np.zeros(len(gap), dtype=np.bool_)
    jitter[grid.k] |= np.abs(grid.off) > _JITTER * grid.h
    log, filled = _log(file, grid.times, signals, speed)
    clock = Clock(
        **counts,
        h=grid.h,
        offset=offset,
        start=offset + float(grid.times[0]),
        end=offset + float(grid.times[-1]),
        jitter_rms=jitter_rms,
        jitter_max=float(np.max(np.abs(grid.off))),
        resampled=resampled,
        gaps=gaps(gap, offset + grid.times),
        empty=int(gap.sum()),
    )
    return Sampled(log, clock, jitter, gap, filled)


def _log(
    file: str, time: Array, signals: Mapping[str, Array], constant: float | None
) -> tuple[Log, dict[str, Mask]]:
    """Return the log, and where its speed and torque are interpolated."""
    filled = {}
    speed, filled["speed"] = _speed(file, signals.get("speed"), constant, len(time))
    torque = signals.get("traction_torque")
    if torque is not None:
        torque, filled["traction_torque"] = _filled(file, "traction_torque", torque)
    log = Log(
        time=time,
        yaw_rate=signals["yaw_rate"],
        lateral_acceleration=signals["lateral_acceleration"],
        speed=speed,
        traction_torque=torque,
    )
    return log, filled


def _in_order(file: str, time: Array) -> tuple[Array, NDArray[np.int64], dict[str, int]]:
    """Return rising times, the rows that they belong to, and what was left out or moved."""
    rows = np.flatnonzero(np.isfinite(time))
    counts = {"rows": len(time), "undated": len(time) - len(rows)}
    t = time[rows]
    latest = np.maximum.accumulate(t)
    back = latest - t
    counts["unordered"] = int(np.count_nonzero(back > 0.0))
    if counts["unordered"]:
        worst = int(np.argmax(back))
        if back[worst] > _BACK:
            raise InputError(
                f"{file} row {rows[worst] + 1}: time",
                got=f"{t[worst]:.9g} s after {latest[worst]:.9g} s",
                expected="times that rise",
                remedy="the clock was set anew or there are several runs; give one of them",
            )
        order = np.argsort(t, kind="stable")
        rows, t = rows[order], t[order]
    new = np.diff(t, prepend=-np.inf) > 0.0
    counts["duplicated"] = int(len(t) - np.count_nonzero(new))
    t, rows = t[new], rows[new]
    if len(t) < _FEWEST:
        raise InputError(
            file, got=f"{len(t)} samples", expected=f"at least {_FEWEST}", remedy="give a longer log"
        )
    if counts["duplicated"] > 0.1 * len(time):
        raise InputError(
            f"{file}: time",
            got=f"{counts['duplicated']} of {len(time)} rows with the time of the row before",
            expected="a time for each sample",
            remedy="write the time with more digits",
        )
    return t, rows, counts


def _filled(file: str, name: str, values: Array) -> tuple[Array, Mask]:
    """Return values without NaN, interpolated, and where they were."""
    bad = ~np.isfinite(values)
    if bad.all():
        raise InputError(
            f"{file}: column {name}", got="no number in it", expected="numbers", remedy="leave the column out"
        )
    if bad.any():
        good = np.flatnonzero(~bad)
        values = np.interp(np.arange(len(values)), good, values[good])
    return values, bad


def _speed(file: str, values: Array | None, constant: float | None, T: int) -> tuple[Array, Mask]:
    """Return a speed that is at least 0, and where it is interpolated."""
    if constant is not None or values is None:
        values = np.full(T, constant)
    values, bad = _filled(file, "speed", values)
    faults = []
    if values.min() < -_SPEED_NOISE:
        faults.append(
            Fault(f"{file}: speed", f"{values.min():.4g} m/s", "at least 0 m/s", "give its magnitude")
        )
    if values.max() > _FASTEST:
        faults.append(
            Fault(
                f"{file}: speed",
                f"{values.max():.4g} m/s",
                f"at most {_FASTEST:g} m/s",
                "give it in m/s, or write its unit in the heading: speed [km/h]",
            )
        )
    if faults:
        raise InputError.from_faults(faults)
    return np.maximum(values, 0.0), bad
