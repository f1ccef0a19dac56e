"""``documentation/index.html``: the equations as ``docs/model.md`` has them, and the table of variables."""

from __future__ import annotations

import html
import math
import re
from typing import TYPE_CHECKING

from fmu_wheelset.variables import VARIABLES, Variable

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["index_html", "plant_section"]

SYMBOLS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "Delta": "Δ", "kappa": "κ", "lambda": "λ",
    "mu": "μ", "omega": "ω", "Omega": "Ω", "pi": "π", "psi": "ψ", "theta": "θ", "sum": "Σ",
    "pm": "±", "le": "≤", "ge": "≥", "sqrt": "√", "infty": "∞", "cdot": "·", "to": "→",
}  # fmt: skip
ACCENTS = {"dot": "\N{COMBINING DOT ABOVE}", "ddot": "\N{COMBINING DIAERESIS}"}
SCRIPTS = {"_": "sub", "^": "sup"}
STYLE = (
    "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "pre{background:#f3f4f6;padding:1em;overflow-x:auto}.math{font-family:serif;font-style:italic}"
    "table{border-collapse:collapse;font-size:14px}th,td{text-align:left;padding:.2em .8em .2em 0;"
    "border-bottom:1px solid #ddd;vertical-align:top}"
)
EXCHANGE = """\
All eight states are announced in every drive mode; those that do not move have the derivative 0. There are no
events. Directional derivatives are exact."""
SOURCES = """\
I. Hussain et al., Identification of Wheel-Rail Contact Condition Using Multi-Kalman Filtering Approach,
Mehran Univ. Res. J. 31(4), 2012, has the equations of motion; O. Polach, Creep forces in simulations of
traction vehicles running on adhesion limit, Wear 258, 2005, 992-1000, the creep force."""


def plant_section(model: str) -> str:
    """Return what ``docs/model.md`` says about the plant, from its heading to that of the linear models.

    Raises
    ------
    ValueError
        One of the headings is missing.
    """
    found = re.search(r"^## Plant\n(.*?)^## Linear models\n", model, re.MULTILINE | re.DOTALL)
    if found is None:
        raise ValueError(
            "docs/model.md: got no part from '## Plant' to '## Linear models'; keep the headings"
        )
    return found[1]


def _symbol(name: str) -> str:
    if name not in SYMBOLS:
        raise ValueError(f"formula: got \\{name}, expected one of {', '.join(SYMBOLS)}; add it to SYMBOLS")
    return SYMBOLS[name]


def _math(tex: str) -> str:
    """Return the little TeX that the docs use as HTML."""
    tex = re.sub(
        r"\\(ddot|dot)\s*(?:\\([A-Za-z]+)|([A-Za-z]))",
        lambda found: (_symbol(found[2]) if found[2] else found[3]) + ACCENTS[found[1]],
        tex,
    )
    tex = re.sub(
        r"\\([A-Za-z]+)(?: (?=[A-Za-z]))?",
        lambda found: _symbol(found[1]),
        tex.replace(r"\,", "\N{THIN SPACE}"),
    )
    tex = re.sub(
        r"([_^])(?:\{([^{}]*)\}|(.))",
        lambda found: f"<{SCRIPTS[found[1]]}>{found[2] or found[3]}</{SCRIPTS[found[1]]}>",
        tex,
    )
    return f'<span class="math">{tex}</span>'


def _inline(text: str) -> str:
    """Return a paragraph of Markdown as HTML; what is a formula or code is left alone by the other rules."""
    parts = re.split(r"(\$[^$]+\$|`[^`]+`)", text)
    for i, part in enumerate(parts):
        escaped = html.escape(part, quote=False)
        if part.startswith("$"):
            parts[i] = _math(escaped[1:-1])
        elif part.startswith("`"):
            parts[i] = f"<code>{escaped[1:-1]}</code>"
        else:
            bold = re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", escaped)
            parts[i] = re.sub(r"\*([^*]+)\*", r"<em>\1</em>", bold)
    return "".join(parts)


def _block(text: str) -> str:
    if text.startswith("    "):
        lines = (line.removeprefix("    ") for line in text.splitlines())
        return f"<pre>{html.escape(chr(10).join(lines), quote=False)}</pre>"
    if text.startswith("## "):
        return f"<h2>{_inline(text[3:])}</h2>"
    return f"<p>{_inline(text)}</p>"


def _number(value: float | None) -> str:
    if value is None or math.isinf(value):
        return ""
    return "> 0" if value == math.nextafter(0.0, 1.0) else f"{value:g}"


def _row(reference: int, variable: Variable) -> str:
    facts = (
        *(str(reference), variable.name, variable.causality, variable.unit or "", _number(variable.start)),
        *(_number(variable.minimum), _number(variable.maximum), variable.description),
    )
    return "<tr>" + "".join(f"<td>{html.escape(fact)}</td>" for fact in facts) + "</tr>"


def index_html(title: str, model: str, variables: Sequence[Variable] = VARIABLES) -> str:
    """Return the documentation of the FMU as one HTML page.

    Parameters
    ----------
    title : what the model is.
    model : the text of ``docs/model.md``.
    variables : the table.
    """
    blocks = [_block(text.strip("\n")) for text in re.split(r"\n\s*\n", plant_section(model)) if text.strip()]
    columns = ("reference", "name", "causality", "unit", "start", "min", "max", "description")
    lines = [
        "<!DOCTYPE html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
        f"<style>{STYLE}</style></head><body>",
        f"<h1>{html.escape(title)}</h1>",
        "<h2>Equations</h2>",
        *blocks,
        "<h2>Model exchange</h2>",
        _block(EXCHANGE),
        "<h2>Variables</h2>",
        "<table><tr>" + "".join(f"<th>{name}</th>" for name in columns) + "</tr>",
        *(_row(reference, variable) for reference, variable in enumerate(variables)),
        "</table>",
        "<h2>Sources</h2>",
        _block(SOURCES),
        "</body></html>",
    ]
    return "\n".join(lines) + "\n"
