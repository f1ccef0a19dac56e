"""The fuzzy identifier on the residuals of a bank: against formulas and scikit-fuzzy, and its laws."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.adhesion import AdhesionBank, FuzzyIdentifier, Hypothesis, fuzzy_system, new_judgement
from estimator.adhesion.block import CREEP, FRICTION, ITSELF, LOOKED, N_TOLD, NOBODY
from estimator.adhesion.curves import PAST_PEAK, landmarks
from estimator.adhesion.ekf import COUNT, LOG_L, SQUARE
from estimator.adhesion.hypotheses import FRICTIONS, stand_ins, unlike_rails, with_torque, without_torque
from estimator.advice import LEVELS
from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.adhesion import Verdict
    from estimator.fuzzy import FuzzySystem
    from estimator.log import Log

    Array = NDArray[np.float64]

NAMES = list(CONDITIONS)
SPEED, SAMPLES = 30.0, 20
BANK = AdhesionBank()
HYPOTHESES = (*with_torque(), *unlike_rails(["dry", "low"]))
OWN = BANK.rules(HYPOTHESES).condition
N = len(HYPOTHESES)
# The centroid on the system's grid of 200 midpoints is exact to its width squared.
GRID = 1e-4


def landmark(hypothesis: Hypothesis) -> tuple[float, float]:
    """Creeps of the knee and of the end of the peak."""
    rules = BANK.rules([hypothesis])
    at = [landmarks(rules.curves, rules.curve[0, side], SPEED, 0.0) for side in range(2)]
    return math.exp(min(a[2] for a in at)), PAST_PEAK * math.exp(min(a[1] for a in at))


def system_of(hypotheses: tuple[Hypothesis, ...]) -> FuzzySystem:
    rails = [NAMES[c] for c in BANK.rules(hypotheses).condition]
    return fuzzy_system([h.name for h in hypotheses], rails, NAMES)


def told_of(residuals: Array, spreads: Array, creeps: Array | None = None) -> Array:
    """Blocks of filters with these rms of normalised innovations and logarithms of variances (rows, n)."""
    rows = np.zeros((*np.shape(residuals), N_TOLD))
    rows[..., COUNT] = SAMPLES
    rows[..., SQUARE] = SAMPLES * np.square(residuals)
    rows[..., LOG_L] = -0.5 * (SAMPLES * np.asarray(spreads) + rows[..., SQUARE])
    rows[..., CREEP] = 1e-4 if creeps is None else creeps
    rows[..., LOOKED] = ITSELF
    return rows


def verdict_of(told: Array, hypotheses: tuple[Hypothesis, ...] = HYPOTHESES, **options: float) -> Verdict:
    said = new_judgement(len(told), len(hypotheses), len(NAMES))
    said.identifiable[:] = True
    said.mu[:] = [0.03, 0.1, 0.1, 0.1]
    identifier = FuzzyIdentifier(BANK, hypotheses, **options)
    return identifier.run(told, np.full(len(told), SPEED), said)


def blocks(low: float = 0.9, high: float = 1.1, rows: int = 1) -> st.SearchStrategy[Array]:
    """Residuals of all filters in some blocks."""
    return st.lists(st.floats(low, high), min_size=rows * N, max_size=rows * N).map(
        lambda values: np.reshape(values, (rows, N))
    )


@st.composite
def situations(draw: st.DrawFn) -> tuple[Array, Array, Array]:
    """Residuals, logarithms of variances and creeps of a block."""
    spreads = draw(blocks(-0.3, 0.3))
    scale = draw(st.floats(-14.0, 3.0))
    return draw(blocks(0.8, 1.5)), spreads + scale, 10.0 ** draw(blocks(-4.0, -0.5))


# Against formulas and another implementation ---------------------------------------------------------


def degrees_of_inputs(residuals: Array, spreads: Array, creeps: Array) -> tuple[Array, Array, Array]:
    """How far the misfit is small, the residual too large (n,) and the creep where (n, 3), by formulas."""
    # Rms of the innovations themselves, in units that all filters share.
    g = np.exp(spreads / 2.0) * residuals
    misfit = SAMPLES * np.log(g / g.min())
    at = []
    for hypothesis, creep in zip(HYPOTHESES, creeps, strict=True):
        knee, past = landmark(hypothesis)
        place = np.interp(creep, [0.0, knee, past, 2.0 * past], [0.0, 1.0, 2.0, 3.0])
        linear, unstable = (
            float(np.interp(place, [0.75, 1.25], [1, 0])),
            float(np.interp(place, [1.75, 2.25], [0, 1])),
        )
        at.append([linear, 1.0 - linear - unstable, unstable])
    too_large = np.interp(residuals, [1.08, 1.28], [0.0, 1.0])
    return np.maximum(1.0 - misfit / 10.0, 0.0), too_large, np.array(at)


def answers(small: Array, too_large: Array, at: Array) -> tuple[Array, Array]:
    """How far each answer is yes and no: regions, conditions, known."""
    yes = [np.minimum(small, at[:, r]).max() for r in range(3)]
    no = [np.minimum(small, 1.0 - at[:, r]).max() for r in range(3)]
    for c in range(len(NAMES)):
        yes.append(small[c == OWN].max())
        no.append(small[c != OWN].max())
    yes.append(np.minimum(small, 1.0 - too_large).max())
    no.append(np.minimum(small, too_large).max())
    return np.array(yes), np.array(no)


def centroid(yes: float, no: float) -> float:
    """Centroid of two clipped triangles with their feet at 0.7 and 0.3, by integration over the height."""
    area, moment = 0.0, 0.0
    for height, foot, slope in ((yes, 0.85, 0.15), (no, 0.15, -0.15)):
        area += 0.3 * (height - height**2 / 2.0)
        moment += 0.3 * (foot * height + (slope - foot) * height**2 / 2.0 - slope * height**3 / 3.0)
    return moment / area


def flat(verdict: Verdict) -> Array:
    return np.concatenate([verdict.region[-1], verdict.condition[-1], verdict.known[-1:]])


@settings(deadline=None)
@given(situations())
def test_degrees_are_those_of_the_formulas(situation: tuple[Array, Array, Array]) -> None:
    residuals, spreads, creeps = situation
    yes, no = answers(*degrees_of_inputs(residuals[0], spreads[0], creeps[0]))
    expected = [centroid(*both) for both in zip(yes, no, strict=True)]
    assert flat(verdict_of(told_of(*situation))) == pytest.approx(expected, abs=GRID)


@settings(deadline=None, max_examples=30)
@given(situations())
def test_degrees_are_those_of_scikit_fuzzy(situation: tuple[Array, Array, Array]) -> None:
    skfuzzy = pytest.importorskip("skfuzzy", reason="scikit-fuzzy is not a dependency")
    residuals, spreads, creeps = (values[0] for values in situation)
    g = np.exp(spreads / 2.0) * residuals
    x: list[float] = []
    for i, hypothesis in enumerate(HYPOTHESES):
        knee, past = landmark(hypothesis)
        place = np.interp(creeps[i], [0.0, knee, past, 2.0 * past], [0.0, 1.0, 2.0, 3.0])
        x += (min(SAMPLES * math.log(g[i] / g.min()), 10.0), min(residuals[i], 2.0), place)
    system = system_of(HYPOTHESES)
    crisp = {v.name: value for v, value in zip(system.inputs, x, strict=True)}
    terms = {(v.name, t.name): [t.a, t.b, t.c, t.d] for v in system.inputs for t in v.terms}
    grid = np.linspace(0.0, 1.0, 2001)
    found = flat(verdict_of(told_of(*situation)))
    for output, degree in zip(system.outputs, found, strict=True):
        shapes = {t.name: skfuzzy.trapmf(grid, [t.a, t.b, t.c, t.d]) for t in output.terms}
        total = np.zeros_like(grid)
        for rule in (rule for rule in system.rules if rule.then.variable == output.name):
            truths = []
            for clause in rule.when:
                value = np.array([crisp[clause.variable]])
                truth = float(skfuzzy.trapmf(value, terms[clause.variable, clause.term])[0])
                truths.append(1.0 - truth if clause.negated else truth)
            total = np.fmax(total, np.fmin(min(truths), shapes[rule.then.term]))
        assert degree == pytest.approx(skfuzzy.defuzz(grid, total, "centroid"), abs=GRID)


@pytest.mark.parametrize("deviations", [0.0, 1.0, 3.0, 5.0])
def test_friction_of_another_condition_is_held_against_a_filter(deviations: float) -> None:
    """By the logarithm of its prior density, in nats: 12.5 at five standard deviations."""
    told = told_of(np.ones((1, N)), np.where(OWN <= 1, 0.0, 2.0)[None])
    told[0, OWN == 1, FRICTION] = deviations * BANK.assumed.unknown.friction
    rival = max(1.0 - 0.5 * deviations**2 / 10.0, 0.0)
    expected = [centroid(1.0, rival), centroid(rival, 1.0), 0.1, 0.1]
    assert verdict_of(told).condition[0] == pytest.approx(expected, abs=GRID)


def test_misfit_is_that_of_the_innovations_themselves() -> None:
    """Any sequence of innovations and variances: the rms in common units is all that counts."""
    rng = np.random.default_rng(3)
    S = np.exp(rng.normal(-4.0, 1.0, (2, 500)))
    e = rng.standard_normal((2, 500)) * np.sqrt(S) * [[1.0], [1.01]]
    g = np.exp(0.5 * np.log(S).mean(axis=1)) * np.sqrt((e**2 / S).mean(axis=1))
    misfit = 500 * math.log(g.max() / g.min())
    hypotheses = (Hypothesis("dry"), Hypothesis("low"))
    told = np.zeros((25, 2, N_TOLD))
    parts_e, parts_S = e.reshape(2, 25, 20), S.reshape(2, 25, 20)
    told[..., COUNT] = 20
    told[..., SQUARE] = (parts_e**2 / parts_S).sum(axis=2).T
    told[..., LOG_L] = -0.5 * (np.log(parts_S) + parts_e**2 / parts_S).sum(axis=2).T
    told[..., CREEP] = 1e-4
    told[..., LOOKED] = ITSELF
    degrees = verdict_of(told, hypotheses).condition[-1]
    rival = max(1.0 - misfit / 10.0, 0.0)
    assert degrees.max() == pytest.approx(centroid(1.0, rival), abs=GRID)


# Rules -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hypotheses", [with_torque(), without_torque(), with_torque(["wet", "low"])])
def test_rules_follow_from_the_hypotheses(hypotheses: tuple[Hypothesis, ...]) -> None:
    system = system_of(hypotheses)
    assert len(system.rules) == len(hypotheses) * (len(NAMES) + 2 * 3 + 2)
    for rule in system.rules:
        subject = rule.when[0].variable.partition("(")[2].split(" ")[0]
        output, answer = rule.then.variable, rule.then.term
        if output.startswith("condition"):
            assert (answer == "yes") == (output == f"condition {subject}")
    system.compile()


def test_two_filters_of_one_hypothesis_are_one_voice() -> None:
    hypotheses = (*HYPOTHESES, HYPOTHESES[0])
    told = told_of(np.linspace(1.0, 1.2, N)[None], np.zeros((1, N)))
    twice = np.concatenate([told, told[:, :1]], axis=1)
    assert flat(verdict_of(twice, hypotheses)).tolist() == flat(verdict_of(told)).tolist()


@pytest.mark.parametrize("chosen", range(9))
def test_the_best_of_a_kind_speaks_for_it(chosen: int) -> None:
    """Filters for other patches and frictions of one rail: all but one so bad that they do not count."""
    variants = with_torque(["dry"], (0.93, 1.0, 1.07), FRICTIONS)
    hypotheses = (*variants, *with_torque(["low"]))
    residuals = np.ones(len(hypotheses))
    residuals[: len(variants)] = 3.0
    residuals[chosen] = 1.05
    told = told_of(residuals[None], np.zeros((1, len(hypotheses))))
    told[0, :, FRICTION] = [BANK.assumed.unknown.friction * h.friction[0] for h in hypotheses]
    kinds = sorted(set(stand_ins(hypotheses)))
    places = [chosen if i in range(9) else i for i in kinds]
    alone = told[:, places].copy()
    alone[..., FRICTION] = 0.0
    found = verdict_of(told, hypotheses)
    assert flat(found) == pytest.approx(flat(verdict_of(alone, tuple(hypotheses[i] for i in kinds))))


def test_a_filter_that_has_not_looked_says_nothing() -> None:
    told = told_of(np.ones((1, N)), np.zeros((1, N)))
    told[0, OWN != 0, LOOKED] = NOBODY
    found = verdict_of(told).condition[0]
    assert found[0] == pytest.approx(0.9, abs=GRID)
    assert found[1:] == pytest.approx(0.1, abs=GRID)


# Laws ------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(situations(), st.permutations(range(N)))
def test_the_order_of_the_filters_does_not_matter(
    situation: tuple[Array, Array, Array], order: list[int]
) -> None:
    told = told_of(*situation)
    there = verdict_of(told)
    again = verdict_of(told[:, order].copy(), tuple(HYPOTHESES[i] for i in order))
    for one, other in zip(there, again, strict=True):
        assert np.array_equal(one, other, equal_nan=True)


@settings(deadline=None)
@given(situations(), st.floats(-20.0, 20.0))
def test_units_do_not_matter(situation: tuple[Array, Array, Array], shift: float) -> None:
    residuals, spreads, creeps = situation
    there = verdict_of(told_of(*situation))
    again = verdict_of(told_of(residuals, spreads + shift, creeps))
    assert flat(again) == pytest.approx(flat(there), abs=1e-9)


@settings(deadline=None)
@given(situations(), st.floats(0.8, 1.3))
def test_sensors_noisier_than_told_change_no_verdict(
    situation: tuple[Array, Array, Array], noisier: float
) -> None:
    """Only whether any filter is as good as it expects to be."""
    residuals, spreads, creeps = situation
    there = verdict_of(told_of(*situation))
    again = verdict_of(told_of(residuals * noisier, spreads, creeps))
    assert again.condition == pytest.approx(there.condition, abs=1e-9)
    assert again.region == pytest.approx(there.region, abs=1e-9)
    if noisier > 1.0:
        assert again.known[0] <= there.known[0] + 1e-9


@settings(deadline=None)
@given(situations(), st.integers(0, N - 1), st.floats(0.7, 1.0))
def test_a_smaller_residual_speaks_for_its_filter(
    situation: tuple[Array, Array, Array], i: int, less: float
) -> None:
    residuals, spreads, creeps = situation
    creeps[0, i] = 1e-6  # certainly linear
    there = verdict_of(told_of(residuals, spreads, creeps))
    residuals[0, i] *= less
    again = verdict_of(told_of(residuals, spreads, creeps))
    own, rounding = OWN[i], 1e-9
    assert again.condition[0, own] >= there.condition[0, own] - rounding
    assert np.all(np.delete(again.condition[0] - there.condition[0], own) <= rounding)
    assert again.region[0, 0] >= there.region[0, 0] - rounding
    assert np.all(again.region[0, 1:] <= there.region[0, 1:] + rounding)


@settings(deadline=None)
@given(situations(), st.floats(1.0, 100.0))
def test_more_creep_is_never_more_torque(situation: tuple[Array, Array, Array], more: float) -> None:
    residuals, spreads, creeps = situation
    residuals[0, :2] *= 0.1  # dry, whatever the others say
    there = verdict_of(told_of(residuals, spreads, creeps))
    again = verdict_of(told_of(residuals, spreads, creeps * more))
    if there.clear[0] and again.clear[0]:
        assert again.score[0] <= there.score[0] + 1e-9


def test_every_advice_is_given() -> None:
    creeps = np.geomspace(1e-4, 1.0, 60)
    told = told_of(np.ones((60, N)), np.where(OWN == 0, -2.0, 0.0)[None].repeat(60, axis=0), creeps[:, None])
    said = verdict_of(told, window=0.01)
    assert np.all(np.diff(said.score) <= 1e-9)
    assert set(said.advice.words) == set(LEVELS)


# Where nothing is said -------------------------------------------------------------------------------


def alone(i: int, residual: float = 1.0) -> Array:
    """A block in which one filter is far better than the others."""
    spreads = np.full((1, N), 2.0)
    spreads[0, i] = 0.0
    return told_of(np.full((1, N), residual), spreads)


@pytest.mark.parametrize("i", range(N))
def test_one_good_filter_is_ninety_percent_sure(i: int) -> None:
    said = verdict_of(alone(i))
    assert said.condition[0] == pytest.approx(np.where(np.arange(len(NAMES)) == OWN[i], 0.9, 0.1), abs=GRID)
    assert said.region[0] == pytest.approx([0.9, 0.1, 0.1], abs=GRID)
    assert said.advice.words == ("more torque possible",)


def test_two_conditions_alike_are_undecided() -> None:
    said = verdict_of(told_of(np.ones((1, N)), np.where(OWN <= 1, 0.0, 2.0)[None]))
    assert said.condition[0] == pytest.approx([0.5, 0.5, 0.1, 0.1], abs=GRID)
    assert not said.clear[0]
    assert said.advice.words == ("no statement",)


def test_linear_and_unstable_alike_are_no_region() -> None:
    creeps = np.where(np.arange(N) % 2 == 0, 1e-4, 0.9)[None]
    said = verdict_of(told_of(np.ones((1, N)), np.where(OWN == 0, 0.0, 2.0)[None], creeps))
    assert said.region[0, 0] == said.region[0, 2] == pytest.approx(0.5, abs=GRID)
    assert not said.clear[0]


def test_residuals_that_no_filter_expects_are_none_of_these() -> None:
    said = verdict_of(alone(0, residual=1.5))
    assert said.known[0] == pytest.approx(0.1, abs=GRID)
    assert said.condition[0, 0] == pytest.approx(0.9, abs=GRID)  # what it would be
    assert said.advice.words == ("no statement",)


def test_without_data_nothing_is_said() -> None:
    said = verdict_of(np.zeros((3, N, N_TOLD)))
    assert said.condition == pytest.approx(np.full((3, len(NAMES)), 0.5), abs=1e-9)
    assert not said.clear.any()


def test_a_filter_without_numbers_is_the_worst() -> None:
    told = alone(0)
    told[0, 4:] = math.nan
    told[0, 4:, COUNT] = SAMPLES
    said = verdict_of(told)
    assert np.isfinite(flat(said)).all()
    assert said.condition[0].argmax() == 0
    assert said.clear[0]


def test_one_blow_does_not_decide_for_a_second() -> None:
    told = told_of(np.ones((50, N)), np.where(OWN == 0, 0.0, 2.0)[None].repeat(50, axis=0))
    told[30, :, SQUARE] = 1e6
    told[30, :, LOG_L] = -0.5e6 - 0.5 * SAMPLES * np.where(OWN == 0, 0.0, 2.0)
    assert verdict_of(told).clear.all()


def test_a_statement_can_be_withdrawn_row_by_row() -> None:
    said = verdict_of(np.concatenate([alone(0), alone(0)])).only(np.array([True, False]))
    assert said.clear.tolist() == [True, False]
    assert said.advice.words == ("more torque possible", "no statement")


# On a motion of the wheelset -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def log(drive: object) -> Log:
    return drive("low", 40.0, 4000.0, 2000)  # type: ignore[operator, no-any-return]


def test_steps_make_the_run(log: Log) -> None:
    found = BANK.run(log).fuzzy
    assert np.mean(found.condition[100:].argmax(axis=1) == NAMES.index("low")) > 0.9
    BANK.reset()
    hypotheses = BANK.hypotheses()
    identifier = FuzzyIdentifier(BANK, hypotheses)
    said, verdict = new_judgement(1, len(hypotheses), len(NAMES)), identifier.new_verdict(1)
    assert log.traction_torque is not None
    rows = []
    for k, z in enumerate(log.measurements):
        if BANK.step(z, log.speed[k], log.traction_torque[k], said):
            identifier.step(k // BANK.block, BANK.told, log.speed[k], said, verdict)
            rows.append((*flat(verdict), verdict.clear[0], verdict.score[0]))
    whole = np.column_stack([found.region, found.condition, found.known, found.clear, found.score])
    assert np.array_equal(rows, whole, equal_nan=True)


def test_refuses_what_other_filters_have_told() -> None:
    identifier, said = FuzzyIdentifier(BANK, HYPOTHESES), new_judgement(1, N, len(NAMES))
    with pytest.raises(ValueError, match=rf"got {N + 1} filters, expected {N}"):
        identifier.run(np.zeros((1, N + 1, N_TOLD)), np.array([SPEED]), said)
    with pytest.raises(ValueError, match=rf"got {N - 1} filters, expected {N}"):
        identifier.step(0, np.zeros((N - 1, N_TOLD)), SPEED, said, identifier.new_verdict(1))


def test_a_window_must_hold_a_block() -> None:
    with pytest.raises(ValueError, match=r"got a window of 0\.001 s, expected at least a block of 0\.01 s"):
        FuzzyIdentifier(BANK, HYPOTHESES, window=1e-3)
