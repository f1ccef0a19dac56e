"""The numbers of a report as JSON, which knows neither infinities nor things that are not a number."""

from __future__ import annotations

import json
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from co_sim.wheelset.reporting.section import Quantity, Section

__all__ = ["FORMAT", "dumps", "quantity_json", "schema", "section_json"]

#: Name and version of the format of report.json.
FORMAT = "wheelset-report/1"
#: Significant digits of a number: beyond them lies rounding of the computation.
_DIGITS = 9


def dumps(content: dict[str, Any]) -> str:
    """Return a report as JSON text, the innermost arrays on one line each."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def schema() -> dict[str, Any]:
    """Return the JSON schema (2020-12) of report.json."""
    text = (resources.files("co_sim.wheelset.reporting") / "report.schema.json").read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text)
    return loaded


def section_json(section: Section) -> dict[str, Any]:
    """Return a section for report.json; figures by the names of their files."""
    return {
        "key": section.key,
        "title": section.title,
        "words": list(section.words),
        "summary": list(section.summary),
        "faults": list(section.faults),
        "axes": {axis: list(values) for axis, values in section.axes.items()},
        "numbers": {name: quantity_json(quantity) for name, quantity in section.numbers.items()},
        "figures": [
            {
                "key": figure.key,
                "title": figure.title,
                "caption": figure.caption,
                "alt": figure.alt,
                "files": [f"figures/{figure.key}.png", f"figures/{figure.key}.svg"],
            }
            for figure in section.figures
        ],
    }


def quantity_json(quantity: Quantity) -> dict[str, Any]:
    """Return a quantity for report.json; what is missing is null, its reason and places stand beside it."""
    array, over = np.asarray(quantity.value), list(quantity.over)
    if array.dtype.kind == "c":
        array = np.stack([array.real, array.imag], axis=-1)
        over.append("real_imaginary")
    missing = _missing(quantity, array)
    found: dict[str, Any] = {"unit": quantity.unit, "meaning": quantity.meaning, "over": over}
    found["value"] = _plain(array)
    if missing:
        found["missing"] = missing
    return found


def _missing(quantity: Quantity, array: np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    if array.dtype.kind != "f":
        return []
    kinds = {"nan": np.isnan(array), "inf": np.isposinf(array), "-inf": np.isneginf(array)}
    return [
        {"was": kind, "reason": quantity.reason(kind), "at": np.argwhere(where).tolist()}
        for kind, where in kinds.items()
        if where.any()
    ]


def _plain(array: np.ndarray[Any, Any]) -> Any:
    if array.ndim:
        return [_plain(row) for row in array]
    value = array.item()
    if not isinstance(value, float):
        return value
    return float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None
