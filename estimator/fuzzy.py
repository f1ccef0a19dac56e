"""A Mamdani fuzzy system whose membership functions and rules are data.

Inference: minimum for AND and for implication, ``1 - x`` for NOT, maximum to aggregate, centroid to
defuzzify on a grid of midpoints (a grid that includes the end points is wrong by 4e-3 at 101 points).

`identification_system` holds the rules of this project, for any number of filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.residuals import equal_level

__all__ = [
    "Clause",
    "CompiledFuzzySystem",
    "FuzzySystem",
    "Rule",
    "Tables",
    "Term",
    "Variable",
    "identification_system",
    "infer",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_GRID_POINTS = 200


@dataclass(frozen=True, slots=True)
class Term:
    """A trapezoidal membership function: 0 at `a`, 1 from `b` to `c`, 0 at `d`.

    Shoulders and triangles are trapezoids with coinciding corners.
    """

    name: str
    a: float
    b: float
    c: float
    d: float

    def __post_init__(self) -> None:
        if not self.a <= self.b <= self.c <= self.d:
            raise ValueError(
                f"term {self.name!r}: got corners {self.a:g}, {self.b:g}, {self.c:g}, {self.d:g}, "
                f"expected ascending order; sort them"
            )

    def membership(self, x: Array | float) -> Array:
        """Return the membership of `x`, any shape."""
        points = np.asarray(x, dtype=np.float64)
        return np.asarray(np.vectorize(_trapezoid, otypes=[float])(points, self.a, self.b, self.c, self.d))


@dataclass(frozen=True, slots=True)
class Variable:
    """A fuzzy input or output on the interval [low, high]."""

    name: str
    terms: tuple[Term, ...]
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(
                f"variable {self.name!r}: got the interval [{self.low:g}, {self.high:g}], "
                f"expected low < high; swap or widen its bounds"
            )
        _check_names(f"variable {self.name!r}", "term", [t.name for t in self.terms])

    def index(self, term: str) -> int:
        """Return the position of a term, by name."""
        names = [t.name for t in self.terms]
        if term not in names:
            raise ValueError(f"variable {self.name!r}: got term {term!r}, expected one of {', '.join(names)}")
        return names.index(term)


@dataclass(frozen=True, slots=True)
class Clause:
    """``variable is term``, or ``variable is not term``."""

    variable: str
    term: str
    negated: bool = False


@dataclass(frozen=True, slots=True)
class Rule:
    """IF all clauses of `when` hold THEN the output of `then` is that term."""

    when: tuple[Clause, ...]
    then: Clause


@dataclass(frozen=True, slots=True)
class FuzzySystem:
    """Variables and rules as plain data; `compile` checks them and makes them fast."""

    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    rules: tuple[Rule, ...]

    def compile(self) -> CompiledFuzzySystem:
        """Return the system as arrays.

        Raises
        ------
        ValueError
            If there are no inputs or outputs or two of one name, or if a rule names an unknown variable
            or term, negates its conclusion or has no condition.
        """
        return CompiledFuzzySystem(self)


class Tables(NamedTuple):
    """A fuzzy system as `infer` reads it.

    `corners` (inputs, terms, 4), `bounds` (inputs, 2), `clauses` (clauses, 4) with columns rule, input, term,
    negated, `conclusions` (rules, 2) with columns output, term, `shapes` (outputs, terms, grid), `grid`
    (outputs, grid).
    """

    corners: Array
    bounds: Array
    clauses: Indices
    conclusions: Indices
    shapes: Array
    grid: Array


class CompiledFuzzySystem:
    """A fuzzy system and its tables."""

    def __init__(self, system: FuzzySystem) -> None:
        self.system = system
        _check_names("fuzzy system", "input", [v.name for v in system.inputs])
        _check_names("fuzzy system", "output", [v.name for v in system.outputs])
        inputs = {v.name: i for i, v in enumerate(system.inputs)}
        outputs = {v.name: i for i, v in enumerate(system.outputs)}
        clauses, conclusions = [], []
        for r, rule in enumerate(system.rules):
            if not rule.when or rule.then.negated:
                raise ValueError(
                    f"rule {r + 1}: got {'no condition' if not rule.when else 'a negated conclusion'}, "
                    f"expected IF ... THEN output IS term; complete the rule"
                )
            for clause in rule.when:
                i = _position(inputs, clause.variable, "input", r)
                clauses.append((r, i, system.inputs[i].index(clause.term), int(clause.negated)))
            o = _position(outputs, rule.then.variable, "output", r)
            conclusions.append((o, system.outputs[o].index(rule.then.term)))
        grid = np.array([_midpoints(v) for v in system.outputs])
        shapes = np.zeros((len(outputs), max(len(v.terms) for v in system.outputs), _GRID_POINTS))
        for o, variable in enumerate(system.outputs):
            for t, term in enumerate(variable.terms):
                shapes[o, t] = term.membership(grid[o])
        self.tables = Tables(
            _corners(system.inputs),
            np.array([(v.low, v.high) for v in system.inputs]),
            np.array(clauses, dtype=np.int64).reshape(-1, 4),
            np.array(conclusions, dtype=np.int64).reshape(-1, 2),
            shapes,
            grid,
        )

    def __call__(self, x: Array) -> Array:
        """Return the crisp outputs (outputs,) for crisp inputs (inputs,)."""
        x = np.ascontiguousarray(x, dtype=np.float64)
        n = len(self.tables.bounds)
        if x.shape != (n,):
            raise ValueError(
                f"fuzzy system: got inputs of shape {x.shape}, expected ({n},); "
                f"give one number for each input variable"
            )
        y = np.empty(len(self.tables.grid))
        self.aggregate(x, y)
        return y

    def aggregate(self, x: Array, y: Array) -> Array:
        """Write the crisp outputs into `y`; return the aggregated membership (outputs, grid)."""
        area = np.empty_like(self.tables.grid)
        infer(self.tables, x, np.empty(len(self.tables.conclusions)), area, y)
        return area


def _check_names(owner: str, kind: str, names: list[str]) -> None:
    if not names or len(set(names)) < len(names):
        raise ValueError(
            f"{owner}: got {kind}s [{', '.join(names)}], expected at least one and no name twice; "
            f"give each {kind} its own name"
        )


def _position(names: dict[str, int], name: str, kind: str, rule: int) -> int:
    if name not in names:
        raise ValueError(f"rule {rule + 1}: got {kind} {name!r}, expected one of {', '.join(names)}")
    return names[name]


def _midpoints(variable: Variable) -> Array:
    width = (variable.high - variable.low) / _GRID_POINTS
    return np.asarray(variable.low + width * (np.arange(_GRID_POINTS) + 0.5))


def _corners(variables: tuple[Variable, ...]) -> Array:
    corners = np.zeros((len(variables), max(len(v.terms) for v in variables), 4))
    for i, variable in enumerate(variables):
        for t, term in enumerate(variable.terms):
            corners[i, t] = term.a, term.b, term.c, term.d
    return corners


@njit(cache=True, error_model="numpy")
def _trapezoid(x: float, a: float, b: float, c: float, d: float) -> float:  # pragma: no cover - compiled
    if b <= x <= c:
        return 1.0
    if x <= a or x >= d:
        return 0.0
    return (x - a) / (b - a) if x < b else (d - x) / (d - c)


@njit(cache=True, error_model="numpy")
def infer(  # pragma: no cover - compiled
    tables: Tables, x: Array, strength: Array, area: Array, y: Array
) -> None:
    """Infer the crisp outputs `y` (outputs,) of the inputs `x` (inputs,), clipped to their intervals.

    `strength` (rules,) receives how far the rules hold, `area` (outputs, grid) the aggregated membership.
    An output that no rule reaches takes the middle of its interval: it says "undecided", never the value of
    an earlier call.
    """
    corners, bounds, clauses, conclusions, shapes, grid = tables
    strength[:] = 1.0
    for c in range(clauses.shape[0]):
        rule, i, t, negated = clauses[c]
        crisp = min(max(x[i], bounds[i, 0]), bounds[i, 1])
        degree = _trapezoid(crisp, corners[i, t, 0], corners[i, t, 1], corners[i, t, 2], corners[i, t, 3])
        strength[rule] = min(strength[rule], 1.0 - degree if negated == 1 else degree)
    area[:] = 0.0
    for rule in range(conclusions.shape[0]):
        o, t = conclusions[rule]
        if strength[rule] > 0.0:
            for g in range(grid.shape[1]):
                area[o, g] = max(area[o, g], min(strength[rule], shapes[o, t, g]))
    for o in range(grid.shape[0]):
        weight, moment = 0.0, 0.0
        for g in range(grid.shape[1]):
            weight += area[o, g]
            moment += area[o, g] * grid[o, g]
        y[o] = moment / weight if weight > 0.0 else 0.5 * (grid[o, 0] + grid[o, -1])


def identification_system(n: int) -> FuzzySystem:
    """Return the rules that turn n residuals D1..Dn, each against its best rival, into probabilities p1..pn.

    The terms lie around ``1/sqrt(2)``, where a filter and its best rival (`estimator.residuals.duel`) are
    equally good. A small residual is probable, an equal one undecided and a large one improbable.
    """
    if n < 2:
        raise ValueError(f"fuzzy system: got {n} filter(s), expected at least 2; a comparison needs two")
    level = equal_level(2)
    residual_terms = (
        Term("small", 0.0, 0.0, 0.96 * level, level),
        Term("equal", 0.96 * level, level, level, 1.04 * level),
        Term("large", level, 1.04 * level, 1.0, 1.0),
    )
    probability_terms = (
        Term("low", 0.0, 0.0, 0.0, 0.3),
        Term("medium", 0.2, 0.5, 0.5, 0.8),
        Term("high", 0.7, 1.0, 1.0, 1.0),
    )
    conclusions = {"small": "high", "equal": "medium", "large": "low"}
    numbers = range(1, n + 1)
    return FuzzySystem(
        tuple(Variable(f"D{i}", residual_terms) for i in numbers),
        tuple(Variable(f"p{i}", probability_terms) for i in numbers),
        tuple(
            Rule((Clause(f"D{i}", residual),), Clause(f"p{i}", probability))
            for i in numbers
            for residual, probability in conclusions.items()
        ),
    )
