"""Writes what the identification of a log produced."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict
from importlib.metadata import version
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.files import whole_file
from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from co_sim.wheelset.identifying.results import Identified

    Array = NDArray[np.float64]

__all__ = [
    "HEADINGS",
    "summarise",
    "write_advice",
    "write_fuzzy",
    "write_identification",
    "write_summary",
]

#: Columns of identification.csv.
HEADINGS = (
    "time",
    "region",
    *(f"p_{name}" for name in REGIONS),
    "condition",
    *(f"p_{name}" for name in CONDITION_NAMES),
    "mu_used",
    "mu_max",
    "mu_max_low",
    "mu_max_high",
    "identifiable",
    "sensor_status",
)
_PACKAGES = ("wheelset-cosim", "numpy", "scipy", "numba")


def write_identification(done: Identified, path: Path) -> None:
    """Write one line for each row; a cell is empty where nothing is known."""
    answer = done.answer
    n = len(answer.time)
    conditions: list[Iterable[str]] = [repeat("", n) for _ in range(1 + len(CONDITION_NAMES))]
    if answer.p_condition is not None and answer.condition is not None:
        conditions = [_named(answer.condition, CONDITION_NAMES), *map(_cells, answer.p_condition.T)]
    adhesion = (answer.mu_used, answer.mu_max, answer.mu_max_low, answer.mu_max_high)
    _write(
        path,
        HEADINGS,
        (
            _times(done.clock.offset + answer.time),
            _named(answer.region, REGIONS),
            *map(_cells, answer.p_region.T),
            *conditions,
            *(repeat("", n) if column is None else _cells(column) for column in adhesion),
            _named(answer.identifiable.astype(np.int64), ("false", "true")),
            done.words,
        ),
    )


def write_advice(done: Identified, path: Path) -> None:
    """Write one line for each row: time, advice in words, and its score from -1 to 1."""
    columns = (_times(done.clock.offset + done.answer.time), done.advice.words, _cells(done.advice.score))
    _write(path, ("time", "advice", "score"), columns)


def write_fuzzy(done: Identified, path: Path) -> None:
    """Write one line for each row of what the fuzzy identifier says; no file if the bank has none."""
    said, advice = done.answer.fuzzy, done.fuzzy_advice
    if said is None or advice is None:
        path.unlink(missing_ok=True)  # of an earlier run with another bank
        return
    classes = {"region": (REGIONS, said.region), "condition": (CONDITION_NAMES, said.condition)}
    headings, columns = ["time"], [_times(done.clock.offset + done.answer.time)]
    for what, (names, degrees) in classes.items():
        headings += [what, *(f"d_{name}" for name in names)]
        columns += [_named(degrees.argmax(axis=1), names), *map(_cells, degrees.T)]
    headings += ["d_known", "clear", "advice", "score"]
    columns += [_cells(said.known), _named(said.clear.astype(np.int64), ("false", "true"))]
    _write(path, headings, [*columns, advice.words, _cells(advice.score)])


def write_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Write the summary as JSON, with null for what is no number."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(_plain(summary), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def summarise(done: Identified) -> dict[str, Any]:
    """Return the content of summary.json."""
    log, clock, settings = done.log, done.clock, done.settings
    return {
        "versions": {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}},
        "log": {
            "file": done.file,
            "rows": clock.rows,
            "samples": len(log),
            "rate_hz": 1.0 / clock.h,
            "start_s": clock.start,
            "end_s": clock.end,
            "speed": _range(log.speed),
            "traction_torque": None if log.traction_torque is None else _range(log.traction_torque),
            "ignored_columns": done.ignored,
            "notes": done.notes,
        },
        "clock": {
            "jitter_rms_s": clock.jitter_rms,
            "jitter_max_s": clock.jitter_max,
            "resampled": clock.resampled,
            "duplicated": clock.duplicated,
            "unordered": clock.unordered,
            "undated": clock.undated,
            "gaps": [{"since": since, "until": until} for since, until in clock.gaps],
            "empty_samples": clock.empty,
        },
        "settings": asdict(settings),
        "bank": {"name": done.answer.bank, "notes": done.answer.notes},
        "rows": len(done.answer.time),
        "identifiable_share": done.identifiable_share,
        "region_shares": done.region_shares,
        "condition_shares": done.condition_shares,
        "adhesion": _adhesion(done),
        "usable_share": dict(zip(("gyro", "accelerometer"), _usable(done), strict=True)),
        "faults": [asdict(fault) for fault in done.status.found()],
        "advice_shares": done.advice.shares,
        "fuzzy": _fuzzy(done),
        "seconds": dict(done.seconds),
    }


def _usable(done: Identified) -> list[float]:
    return [float(share) for share in np.mean(np.asarray(done.log.usable), axis=0)]


def _adhesion(done: Identified) -> dict[str, Any] | None:
    """Return medians over the identifiable rows."""
    answer, where = done.answer, done.answer.identifiable
    columns = {name: getattr(answer, name) for name in ("mu_used", "mu_max", "mu_max_low", "mu_max_high")}
    if any(column is None for column in columns.values()) or not where.any():
        return None
    return {f"{name}_median": _median(column[where]) for name, column in columns.items()}


def _fuzzy(done: Identified) -> dict[str, Any] | None:
    """Return how often the fuzzy identifier is clear, and says there what the probabilities say."""
    if done.answer.fuzzy is None or done.fuzzy_advice is None:
        return None
    return {
        "clear_share": float(np.mean(done.answer.fuzzy.clear)),
        "same_condition_share": done.same_condition,
        "advice_shares": done.fuzzy_advice.shares,
    }


def _median(values: Array) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else None


def _range(values: Array) -> dict[str, float]:
    return {"min": float(values.min()), "median": float(np.median(values)), "max": float(values.max())}


def _write(path: Path, headings: Iterable[str], columns: Iterable[Iterable[str]]) -> None:
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(headings) + "\n")
        file.writelines(f"{','.join(cells)}\n" for cells in zip(*columns, strict=True))


def _times(time: Array) -> list[str]:
    return [f"{t:.15g}" for t in time.tolist()]


def _cells(values: Array) -> list[str]:
    return [f"{x:.6g}" if x == x else "" for x in values.tolist()]  # noqa: PLR0124 - not NaN


def _named(which: NDArray[np.int64], names: tuple[str, ...]) -> list[str]:
    return [names[i] for i in which.tolist()]


def _plain(value: Any) -> Any:
    """Return a value as JSON has it."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
