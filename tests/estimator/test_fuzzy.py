from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.fuzzy import Clause, FuzzySystem, Rule, Term, Variable, identification_system
from estimator.residuals import duels, equal_level

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

COUNTS = range(2, 13)
COMPILED = {n: identification_system(n).compile() for n in COUNTS}


def probabilities(E: Array) -> Array:
    """Fuzzy probabilities of the residuals (15) of all filters."""
    return COMPILED[len(E)](duels(np.asarray(E)))


# The centroid on the system's grid of 200 midpoints is exact to its width squared.
GRID = 1e-4


@st.composite
def normalised_residuals(draw: st.DrawFn, low: float, high: float) -> Array:
    """Residuals of any number of filters whose squares sum to one."""
    n = draw(st.sampled_from(COUNTS))
    raw = np.array(draw(st.lists(st.floats(low, high), min_size=n, max_size=n)))
    return np.asarray(raw / np.linalg.norm(raw))


# Any, and such near the equal level, where the terms overlap.
inputs = st.one_of(normalised_residuals(0.01, 1.0), normalised_residuals(0.8, 1.2))


# Against the textbook --------------------------------------------------------------------------------


def membership(term: Term, x: Array | float) -> Array:
    """Trapezoid by interpolation between its corners, which a vertical flank makes coincide."""
    corners: list[float] = []
    values: list[float] = []
    for corner, value in ((term.a, 0.0), (term.b, 1.0), (term.c, 1.0), (term.d, 0.0)):
        if corners and corner == corners[-1]:
            values[-1] = max(values[-1], value)
        else:
            corners.append(corner)
            values.append(value)
    return np.asarray(np.interp(x, corners, values, left=0.0, right=0.0))


def mamdani(system: FuzzySystem, x: Array, points: int = 20_000) -> Array:
    """Minimum, maximum and centroid as in a textbook, by names and on a fine grid."""
    crisp = {v.name: min(max(value, v.low), v.high) for v, value in zip(system.inputs, x, strict=True)}
    terms = {(v.name, t.name): t for v in (*system.inputs, *system.outputs) for t in v.terms}

    def truth(clause: Clause) -> float:
        degree = float(membership(terms[clause.variable, clause.term], crisp[clause.variable]))
        return 1.0 - degree if clause.negated else degree

    result = []
    for output in system.outputs:
        grid = np.linspace(output.low, output.high, 2 * points + 1)[1::2]
        total = np.zeros_like(grid)
        for rule in system.rules:
            if rule.then.variable == output.name:
                clipped = np.minimum(
                    min(map(truth, rule.when)), membership(terms[output.name, rule.then.term], grid)
                )
                total = np.maximum(total, clipped)
        middle = (output.low + output.high) / 2.0
        result.append(np.sum(total * grid) / np.sum(total) if total.any() else middle)
    return np.array(result)


@given(inputs)
def test_identification_is_the_textbook_mamdani(E: Array) -> None:
    found = COMPILED[len(E)](E)
    assert found == pytest.approx(mamdani(identification_system(len(E)), E, 2000), abs=GRID)


CLIMATE = FuzzySystem(
    inputs=(
        Variable("temperature", (Term("cold", -10, -10, 5, 15), Term("warm", 5, 15, 40, 40)), -10.0, 40.0),
        Variable("wind", (Term("calm", 0, 0, 2, 6), Term("gale", 4, 12, 12, 12)), 0.0, 12.0),
    ),
    outputs=(
        Variable("window", (Term("shut", 0, 0, 0, 40), Term("open", 20, 80, 100, 100)), 0.0, 100.0),
        Variable("heater", (Term("off", -5, -5, -4, 0), Term("on", -1, 2, 3, 3)), -5.0, 3.0),
    ),
    rules=(
        Rule((Clause("temperature", "warm"), Clause("wind", "gale", negated=True)), Clause("window", "open")),
        Rule((Clause("temperature", "cold"),), Clause("window", "shut")),
        Rule((Clause("wind", "gale"),), Clause("window", "shut")),
        Rule((Clause("temperature", "cold"), Clause("wind", "calm")), Clause("heater", "on")),
        Rule((Clause("temperature", "warm"),), Clause("heater", "off")),
    ),
)


@given(st.floats(-30.0, 60.0), st.floats(-5.0, 20.0))
def test_any_system_is_the_textbook_mamdani(temperature: float, wind: float) -> None:
    x = np.array([temperature, wind])
    width = np.array([100.0, 8.0])
    assert CLIMATE.compile()(x) / width == pytest.approx(mamdani(CLIMATE, x) / width, abs=GRID)


@given(inputs)
def test_identification_is_that_of_scikit_fuzzy(E: Array) -> None:
    skfuzzy = pytest.importorskip("skfuzzy", reason="scikit-fuzzy is not a dependency")
    system = identification_system(len(E))
    for o, output in enumerate(system.outputs):
        grid = np.linspace(output.low, output.high, 2001)
        terms = {t.name: skfuzzy.trapmf(grid, [t.a, t.b, t.c, t.d]) for t in output.terms}
        total = np.zeros_like(grid)
        for rule in system.rules:
            if rule.then.variable == output.name:
                degrees = []
                for clause in rule.when:
                    i = int(clause.variable[1:]) - 1
                    t = next(t for t in system.inputs[i].terms if t.name == clause.term)
                    degree = float(skfuzzy.trapmf(np.array([E[i]]), [t.a, t.b, t.c, t.d])[0])
                    degrees.append(1.0 - degree if clause.negated else degree)
                total = np.fmax(total, np.fmin(min(degrees), terms[rule.then.term]))
        assert COMPILED[len(E)](E)[o] == pytest.approx(skfuzzy.defuzz(grid, total, "centroid"), abs=GRID)


@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4).map(sorted), st.floats(-3.0, 3.0))
def test_membership_is_a_trapezoid(corners: list[float], x: float) -> None:
    term = Term("t", *corners)
    a, b, c, d = corners
    degree = float(term.membership(x))
    assert 0.0 <= degree <= 1.0
    assert (degree == 1.0) == (b <= x <= c) or degree > 1.0 - 1e-12
    assert (degree > 0.0) <= (a <= x <= d)
    if a < x < b:
        assert degree == pytest.approx((x - a) / (b - a))
    if c < x < d:
        assert degree == pytest.approx((d - x) / (d - c))


def test_membership_keeps_the_shape() -> None:
    term = Term("t", 0.0, 1.0, 2.0, 4.0)
    assert term.membership(np.array([[-1.0, 0.5], [1.0, 3.0]])).tolist() == [[0.0, 0.5], [1.0, 0.5]]


# Laws of the identification --------------------------------------------------------------------------


@given(inputs.flatmap(lambda E: st.tuples(st.just(E), st.permutations(range(len(E))))))
def test_no_filter_is_preferred(case: tuple[Array, list[int]]) -> None:
    E, order = case
    assert np.array_equal(probabilities(E[order]), probabilities(E)[order])


@given(st.sampled_from(COUNTS).flatmap(lambda n: st.lists(st.floats(-1.0, 3.0), min_size=n, max_size=n)))
def test_probabilities_lie_between_zero_and_one(E: list[float]) -> None:
    p = COMPILED[len(E)](np.array(E))
    assert np.all((p >= 0.0) & (p <= 1.0))


@pytest.mark.parametrize("n", COUNTS)
@pytest.mark.parametrize("ratio", [0.0, 0.5, 0.8])
def test_one_clearly_smallest_residual_is_ninety_percent_sure(n: int, ratio: float) -> None:
    E = np.full(n, 1.0)
    E[-1] = ratio
    p = probabilities(E / np.linalg.norm(E))
    assert p == pytest.approx([*[0.1] * (n - 1), 0.9], abs=GRID)


@pytest.mark.parametrize("n", COUNTS)
def test_equal_residuals_are_undecided(n: int) -> None:
    assert probabilities(np.full(n, equal_level(n))) == pytest.approx(np.full(n, 0.5), abs=1e-12)


@pytest.mark.parametrize("n", range(3, 13))
def test_two_equally_small_residuals_are_undecided_between_them(n: int) -> None:
    E = np.full(n, 1.0)
    E[:2] = 0.3
    p = probabilities(E / np.linalg.norm(E))
    assert p == pytest.approx([0.5, 0.5, *[0.1] * (n - 2)], abs=GRID)


@pytest.mark.parametrize("n", range(3, 13))
@pytest.mark.parametrize("hopeless", [1.0, 10.0, 1e6])
def test_a_hopeless_filter_changes_nothing_among_the_others(n: int, hopeless: float) -> None:
    E = np.linspace(0.9, 1.1, n)
    without = probabilities(E[:-1] / np.linalg.norm(E[:-1])) if n > 2 else None
    E[-1] = 2.0 * hopeless
    assert probabilities(E / np.linalg.norm(E))[:-1] == pytest.approx(without, abs=1e-9)


@pytest.mark.parametrize("n", [2, 3, 12])
def test_probability_moves_without_jumps(n: int) -> None:
    # From every residual equal to the first clearly smallest and to the first clearly largest.
    level = equal_level(n)

    def path(points: int) -> Array:
        first = np.linspace(0.7 * level, 1.3 * level, points)
        rest = np.sqrt(np.maximum(1.0 - first**2, 0.0) / (n - 1))
        return np.array(
            [probabilities(np.append(a, np.full(n - 1, b))) for a, b in zip(first, rest, strict=True)]
        )

    coarse, fine = (float(np.abs(np.diff(path(points), axis=0)).max()) for points in (601, 1201))
    assert coarse < 0.05
    assert fine == pytest.approx(coarse / 2.0, rel=0.15)


@given(inputs, st.integers(0, 11))
def test_a_larger_residual_never_makes_a_filter_more_probable(E: Array, i: int) -> None:
    i %= len(E)
    larger = E.copy()
    larger[i] *= 1.02
    assert probabilities(larger)[i] <= probabilities(E)[i] + GRID


# When no rule speaks ---------------------------------------------------------------------------------


def test_where_no_rule_fires_the_output_is_the_middle_not_the_last_value() -> None:
    low = Term("low", 0.0, 0.0, 0.2, 0.4)
    system = FuzzySystem(
        (Variable("x", (low,)),),
        (Variable("y", (Term("high", 5.0, 7.0, 7.0, 7.0),), 3.0, 7.0),),
        (Rule((Clause("x", "low"),), Clause("y", "high")),),
    ).compile()
    assert system(np.array([0.1]))[0] > 6.0
    assert system(np.array([0.9]))[0] == pytest.approx(5.0, rel=1e-15)


@pytest.mark.parametrize("n", [2, 5])
def test_a_broken_residual_is_never_sure(n: int) -> None:
    p = COMPILED[n](np.full(n, math.nan))
    assert p == pytest.approx(np.full(n, 0.5), abs=1e-12)


# Mistakes in the data --------------------------------------------------------------------------------

X = Variable("x", (Term("small", 0.0, 0.0, 0.2, 0.4), Term("large", 0.2, 0.4, 1.0, 1.0)))
Y = Variable("y", (Term("no", 0.0, 0.0, 0.2, 0.4), Term("yes", 0.2, 0.4, 1.0, 1.0)))
RULE = Rule((Clause("x", "small"),), Clause("y", "yes"))


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (replace(RULE, when=()), r"^rule 2: got no condition, expected IF"),
        (replace(RULE, then=Clause("y", "yes", negated=True)), r"^rule 2: got a negated conclusion"),
        (replace(RULE, when=(Clause("z", "small"),)), r"^rule 2: got input 'z', expected one of x"),
        (replace(RULE, when=(Clause("y", "yes"),)), r"^rule 2: got input 'y', expected one of x"),
        (replace(RULE, then=Clause("x", "small")), r"^rule 2: got output 'x', expected one of y"),
        (
            replace(RULE, when=(Clause("x", "tiny"),)),
            r"^variable 'x': got term 'tiny', expected .* small, large",
        ),
        (replace(RULE, then=Clause("y", "maybe")), r"^variable 'y': got term 'maybe', expected .* no, yes"),
    ],
)
def test_faulty_rules_are_named(rule: Rule, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FuzzySystem((X,), (Y,), (RULE, rule)).compile()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FuzzySystem((), (Y,), ()).compile(), r"got inputs \[\], expected at least one"),
        (lambda: FuzzySystem((X,), (), ()).compile(), r"got outputs \[\], expected at least one"),
        (lambda: FuzzySystem((X, X), (Y,), ()).compile(), r"got inputs \[x, x\], .* no name twice"),
        (lambda: FuzzySystem((X,), (Y, Y), ()).compile(), r"got outputs \[y, y\], .* no name twice"),
        (lambda: replace(X, terms=()), r"^variable 'x': got terms \[\], expected at least one"),
        (lambda: replace(X, terms=X.terms * 2), r"^variable 'x': got terms .* no name twice"),
        (lambda: replace(X, low=1.0), r"^variable 'x': got the interval \[1, 1\], expected low < high"),
        (lambda: replace(X, high=math.nan), r"^variable 'x': got the interval \[0, nan\]"),
        (lambda: Term("t", 0.0, 2.0, 1.0, 3.0), r"^term 't': got corners 0, 2, 1, 3, expected ascending"),
        (lambda: Term("t", 0.0, math.nan, 1.0, 3.0), r"^term 't': got corners 0, nan"),
        (lambda: identification_system(1), r"got 1 filter\(s\), expected at least 2"),
        (lambda: COMPILED[3](np.zeros(2)), r"got inputs of shape \(2,\), expected \(3,\)"),
    ],
)
def test_faulty_data_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
