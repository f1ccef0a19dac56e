"""The fuzzy system: its structure, its membership functions and one inference (the paper's Figs. 8, 9)."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import FancyBboxPatch

from co_sim.wheelset.drawing.sheet import GREY, Picture, Sheet, colour, shorten
from co_sim.wheelset.prose.findings import valid_windows
from co_sim.wheelset.prose.words import percent, quantity
from estimator.residuals import duels, equal_level

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from co_sim.wheelset.results import Experiment, Run
    from estimator import FuzzySystem
    from estimator.fuzzy import Rule, Term, Variable

__all__ = ["draw_membership", "draw_output", "draw_system"]

_WIDTH = 8.2
#: Boxes and panels of a figure; of more variables, some stand for the others.
_SHOWN = 4
_TERM_SHADES = ("#B8B8B8", "#7D7D7D", "#3C3C3C")


def draw_system(experiment: Experiment) -> Picture:
    """Draw residuals -> rules -> probabilities as blocks (the paper's Fig. 8)."""
    fuzzy, names = experiment.fuzzy, experiment.filter_names
    sheet = Sheet(_WIDTH, 4.2, "How do residuals become probabilities?")
    ax = sheet.axes(0.0, 0.0, sheet.width, sheet.top)
    ax.set_xlim(0.0, sheet.width)
    ax.set_ylim(0.0, sheet.top)
    ax.set_axis_off()
    rows = _rows_shown(len(names))
    pitch = (sheet.top - 0.2) / len(rows)
    for row, i in enumerate(rows):
        y = sheet.top - 0.1 - pitch * (row + 0.5)
        if i is None:
            for x in (1.2, 7.0):
                ax.text(x, y, "⋮", ha="center", va="center", size=16)
            continue
        for x, variable in ((0.15, fuzzy.inputs[i]), (5.95, fuzzy.outputs[i])):
            _draw_variable(ax, x, y, variable, names[i], colour(i))
        _arrow(ax, (2.3, y), (2.75, y))
        _arrow(ax, (5.45, y), (5.9, y))
    _draw_rules(ax, fuzzy, sheet.top)
    caption = (
        f"Mamdani system with {len(fuzzy.inputs)} inputs, {len(fuzzy.rules)} rules and "
        f"{len(fuzzy.outputs)} outputs. Each input is the residual E of a filter against its best rival, "
        f"D = E/√(E² + E_rival²). AND and implication are minima, rules are joined by the maximum, the "
        f"output is the centroid. "
        f"An output that no rule reaches is {percent(0.5)}, undecided."
    )
    return Picture(sheet, caption, "Block diagram: normalised residuals, fuzzy rules, probabilities.")


def draw_membership(experiment: Experiment) -> Picture:
    """Draw the membership functions of one residual and of one probability."""
    residual, probability = experiment.fuzzy.inputs[0], experiment.fuzzy.outputs[0]
    n = len(experiment.fuzzy.inputs)
    level = equal_level(2)
    sheet = Sheet(_WIDTH, 2.95, "What counts as a small residual, and what as a high probability?")
    left = sheet.axes(0.75, 0.55, 3.3, 1.75)
    right = sheet.axes(4.7, 0.55, 3.3, 1.75)
    _draw_terms(left, residual)
    left.plot([level, level], [0.0, 1.03], color="black", linestyle="--", linewidth=1.0)
    left.set_xlabel(f"residual {residual.name}, enlarged  (dashed: 1/√2 = {level:.3f})")
    left.set_ylabel("membership")
    _draw_terms(right, probability)
    right.set_xlabel(f"probability {probability.name}")
    caption = (
        f"All {n} residuals and all {n} probabilities have the same terms. A residual is taken against the "
        f"smallest of the others, D = E/√(E² + E_rival²); its terms lie around 1/√2 = {level:.3f}, where "
        f"the two are equally good."
    )
    return Picture(sheet, caption, f"Membership functions: {_terms(residual)}; {_terms(probability)}.")


def draw_output(experiment: Experiment) -> Picture | None:
    """Draw the outputs and their centroids in a typical window of the first run (the paper's Fig. 9).

    ``None`` if the run has no window within the range of the model.
    """
    run = experiment.runs[0]
    chosen = _typical_window(experiment, run)
    if chosen is None:
        return None
    k, reference = chosen
    fuzzy = experiment.fuzzy.compile()
    p = np.empty(len(experiment.filters))
    areas = fuzzy.aggregate(duels(run.E[k]), p)
    ranked = sorted(np.argsort(-p, kind="stable")[:_SHOWN].tolist())
    sheet = Sheet(
        _WIDTH, 2.95, f"How do the outputs of one window come about? {_window_name(run, float(run.time[k]))}"
    )
    width = (_WIDTH - 0.75 - 0.15) / len(ranked)
    for column, i in enumerate(ranked):
        ax = sheet.axes(0.7 + column * width, 0.55, width - 0.22, 1.65)
        _draw_area(ax, experiment.fuzzy.outputs[i], fuzzy.tables.grid[i], areas[i], float(p[i]), i)
        ax.set_title(shorten(experiment.filter_names[i]), size=9.5, color=colour(i), weight="bold", pad=5)
        ax.set_xlabel(f"{experiment.fuzzy.outputs[i].name} (%)")
        ax.set_xticks((0, 50, 100))
        ax.set_ylabel("membership" if column == 0 else "")
        ax.tick_params(labelleft=column == 0)
    told = ", ".join(f"{experiment.filter_names[i]} {percent(float(p[i]))}" for i in ranked)
    residuals = ", ".join(f"{experiment.filter_names[i]} {run.E[k, i]:.3f}" for i in ranked)
    caption = (
        f"The window that ends at {quantity(run.time[k], 's', 4)}, in which {reference} has its median "
        f"probability. Residuals: {residuals}. Filled: the terms (lines) cut at the strength of their "
        f"rules and joined; the vertical line is the centroid. Outputs: {told}."
    )
    return Picture(sheet, caption, f"Aggregated output areas with centroids: {told}.")


def _typical_window(experiment: Experiment, run: Run) -> tuple[int, str] | None:
    """Return the sample that ends the median window of the run's first stretch, and by whose probability."""
    stretch = next(s for s in experiment.stretches if s.run == run.name)
    counted = np.flatnonzero(valid_windows(run, stretch, experiment.scenario.identifier.window))
    if counted.size == 0:
        return None
    names = experiment.filter_names
    mean = run.probabilities[counted].mean(axis=0)
    i = names.index(stretch.expected[0]) if stretch.expected else int(mean.argmax())
    order = np.argsort(run.probabilities[counted, i], kind="stable")
    return int(counted[order[order.size // 2]]), names[i]


def _window_name(run: Run, time: float) -> str:
    name = f"run {run.name}" if run.point else run.name.replace("_", " ")
    return f"({name}, {quantity(time, 's')})"


def _draw_area(
    ax: Axes, variable: Variable, grid: np.ndarray, area: np.ndarray, centroid: float, index: int
) -> None:
    for term in variable.terms:
        ax.plot(*_outline(term, variable, 100.0), color="0.6", linewidth=1.0)
    ax.fill_between(100.0 * grid, area, color=colour(index), alpha=0.45, linewidth=0.0)
    ax.plot(100.0 * grid, area, color=colour(index), linewidth=1.2)
    ax.axvline(100.0 * centroid, color="black", linewidth=1.4)
    to_left = centroid > 0.5
    ax.annotate(
        percent(centroid),
        (100.0 * centroid, 1.1),
        xytext=(-4 if to_left else 4, 0),
        textcoords="offset points",
        ha="right" if to_left else "left",
        va="center",
        weight="bold",
    )
    ax.set_xlim(100.0 * variable.low, 100.0 * variable.high)
    ax.set_ylim(0.0, 1.2)
    ax.set_yticks((0.0, 0.5, 1.0))


def _view(variable: Variable) -> tuple[float, float]:
    """Return the part of a variable's interval in which its terms change, with some margin."""
    corners = {corner for t in variable.terms for corner in (t.a, t.b, t.c, t.d)}
    inner = sorted(corners - {variable.low, variable.high})
    margin = inner[-1] - inner[0]
    return max(variable.low, inner[0] - margin), min(variable.high, inner[-1] + margin)


def _draw_terms(ax: Axes, variable: Variable) -> None:
    low, high = _view(variable)
    for term, shade in zip(variable.terms, _shades(variable), strict=True):
        ax.plot(*_outline(term, variable, 1.0), color=shade, linewidth=1.8)
        top = (max(term.b, low) + min(term.c, high)) / 2.0
        side = "left" if top <= low else "right" if top >= high else "center"
        ax.text(top, 1.07, term.name, color=shade, weight="bold", ha=side)
    ax.set_xlim(low, high)
    ax.set_ylim(0.0, 1.2)
    ax.set_yticks((0.0, 0.5, 1.0))


def _shades(variable: Variable) -> list[str]:
    return [_TERM_SHADES[i % len(_TERM_SHADES)] for i in range(len(variable.terms))]


def _outline(term: Term, variable: Variable, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a term as x (scaled) and membership."""
    x = np.array([variable.low, term.a, term.b, term.c, term.d, variable.high])
    y = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    y[0] = 1.0 if term.b <= variable.low else 0.0
    y[-1] = 1.0 if term.c >= variable.high else 0.0
    y[1] = 1.0 if term.a == term.b else 0.0
    y[4] = 1.0 if term.c == term.d else 0.0
    return scale * x, y


def _rows_shown(n: int) -> list[int | None]:
    """Return the variables to show, ``None`` for those left out."""
    return list(range(n)) if n <= _SHOWN else [0, 1, None, n - 1]


def _draw_variable(ax: Axes, x: float, y: float, variable: Variable, filter_name: str, shade: str) -> None:
    """Draw a box with a variable's name, its filter and its membership functions."""
    width, height = 2.1, 0.72
    _box(ax, x, y - height / 2.0, width, height)
    ax.text(x + 0.1, y + 0.13, variable.name, weight="bold", size=11, color=shade, va="center")
    ax.text(x + 0.1, y - 0.17, shorten(filter_name, 12), size=8.0, color=shade, va="center")
    left, bottom, plot_width, plot_height = x + 1.05, y - 0.22, 0.92, 0.44
    low, high = _view(variable)
    for term, grey in zip(variable.terms, _shades(variable), strict=True):
        u = np.linspace(low, high, 101)
        v = term.membership(u)
        share = (u - low) / (high - low)
        ax.plot(left + plot_width * share, bottom + plot_height * v, color=grey, linewidth=1.1)
    ax.plot([left, left + plot_width], [bottom, bottom], color="black", linewidth=0.8)


def _draw_rules(ax: Axes, fuzzy: FuzzySystem, height: float) -> None:
    _box(ax, 2.8, 0.25, 2.6, height - 0.5)
    ax.text(4.1, height - 0.5, f"{len(fuzzy.rules)} rules", weight="bold", size=11, ha="center", va="center")
    examples = "\n\n".join(_in_words(rule) for rule in _examples(fuzzy))
    ax.text(
        4.1, height / 2.0, f"for example\n\n{examples}", size=8.5, ha="center", va="center", linespacing=1.3
    )
    ax.text(4.1, 0.6, "minimum · maximum · centroid", size=8.5, ha="center", va="center", color=GREY)


def _examples(fuzzy: FuzzySystem) -> list[Rule]:
    """Return the first rule for each term of the first output."""
    output = fuzzy.outputs[0]
    rules = [rule for rule in fuzzy.rules if rule.then.variable == output.name]
    firsts = {rule.then.term: rule for rule in reversed(rules)}
    return [firsts[term.name] for term in reversed(output.terms) if term.name in firsts]


def _in_words(rule: Rule) -> str:
    """Return a rule as lines; of many conditions the first two and the last."""
    clauses = [f"{c.variable} is {'not ' if c.negated else ''}{c.term}" for c in rule.when]
    if len(clauses) > _SHOWN:
        clauses = [*clauses[:2], "…", clauses[-1]]
    condition = textwrap.fill(f"if {' and '.join(clauses)}", 34)
    return f"{condition}\nthen {rule.then.variable} is {rule.then.term}"


def _terms(variable: Variable) -> str:
    return f"{variable.name} is {', '.join(term.name for term in variable.terms)}"


def _box(ax: Axes, x: float, y: float, width: float, height: float) -> None:
    ax.add_patch(
        FancyBboxPatch(
            (x, y),
            width,
            height,
            boxstyle="round,pad=0,rounding_size=0.08",
            facecolor="white",
            edgecolor="0.4",
        )
    )


def _arrow(ax: Axes, tail: tuple[float, float], head: tuple[float, float]) -> None:
    ax.annotate("", head, xytext=tail, arrowprops={"arrowstyle": "-|>", "color": "0.3", "linewidth": 1.2})
