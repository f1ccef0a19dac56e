"""What the hopeless take over, who sleeps, when friction may move, and that a patch outlasts its rail."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.adhesion import AdhesionBank, Hypothesis, Unknowns
from estimator.adhesion.block import FRICTION, LOOKED, LOST, N_TOLD, NOBODY, STAND_IN, VAR_FRICTION
from estimator.adhesion.creep_law import creep_force, patch_row, rail_row
from estimator.adhesion.evidence import new_belief
from estimator.adhesion.hypotheses import (
    FRICTIONS,
    rail_of,
    stand_ins,
    unlike_rails,
    with_torque,
    without_torque,
)
from estimator.adhesion.judgement import new_judgement
from estimator.adhesion.log_run import weigh_blocks
from estimator.adhesion.motion import L_L, L_R, N_X, THETA, S
from estimator.adhesion.renewal import renew, speak_for_the_sleeping
from fmu_wheelset.parameters import CONDITIONS, ContactPatch

from .conftest import TORQUE, V, bank, compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from estimator.adhesion.block import Design, Memory
    from estimator.adhesion.evidence import Belief, Rules
    from estimator.log import Log

    Array = NDArray[np.float64]

HYPOTHESES = (
    Hypothesis("dry"),
    Hypothesis("low"),
    Hypothesis("wet"),
    Hypothesis("very_low", "held", 1.7),
    Hypothesis("dry", patch=1.07),
)
DRY, LOW, WET, HELD, HOPEFUL = range(5)
PATCHES = Unknowns().patches


@pytest.fixture
def renewed(z: Array) -> tuple[Memory, Memory, Belief]:
    """Filters before and after a renewal: dry leads, wet has a chance, the last one is gaining."""
    design, rules = bank().design(HYPOTHESES), bank().rules(HYPOTHESES)
    before, after = compiled(design, z), compiled(design, z)
    belief = new_belief(rules)
    belief.p[:] = [0.98, 1e-6, 0.01, 1e-6, 1e-6, 1e-6]
    belief.gained[:] = [-1.0, -30.0, -30.0, -30.0, 0.0]
    renew(design, rules, after, belief, V, TORQUE)
    return before, after, belief


def test_the_hopeless_begin_where_the_best_filter_sees_the_wheelset(
    renewed: tuple[Memory, Memory, Belief],
) -> None:
    before, after, belief = renewed
    best_x, best_C = before.filters.x[DRY], before.filters.C[DRY]
    for i, own in ((LOW, {S}), (HELD, {S, L_L, L_R})):
        x, C = after.filters.x[i], after.filters.C[i]
        taken = [j for j in range(N_X) if j not in own]
        assert np.array_equal(x[taken], best_x[taken])
        assert np.array_equal(C[np.ix_(taken, taken)], best_C[np.ix_(taken, taken)])
        assert x[S] == 0.0
        assert C[S, S] == pytest.approx(bank().assumed.unknown.friction ** 2)
        assert not C[np.ix_(taken, sorted(own))].any()
        assert np.linalg.eigvalsh(C / np.sqrt(np.outer(np.diag(C), np.diag(C)))).min() > -1e-9
        assert np.array_equal(after.filters.x0[i], x)
        assert after.settling[i] == 0
    # A held creep is where its own hypothesis starts, past the peak, and not where dry rail has it.
    assert after.filters.x[HELD, L_L] > 2.0 * best_x[L_L]
    assert after.filters.x[HELD, THETA] == best_x[THETA]
    assert not belief.gained.any()


def test_the_best_the_likely_and_the_gaining_go_on(renewed: tuple[Memory, Memory, Belief]) -> None:
    before, after, _ = renewed
    for i in (DRY, WET, HOPEFUL):
        assert np.array_equal(after.filters.x[i], before.filters.x[i])
        assert np.array_equal(after.filters.C[i], before.filters.C[i])


def test_friction_does_not_move_before_a_filter_has_settled(drive: object) -> None:
    log: Log = drive("dry", 40.0, 4000.0, 600)  # type: ignore[operator]
    with_prior = AdhesionBank(hypotheses=[Hypothesis("dry")])
    told = with_prior.look_at(log, with_prior.hypotheses())[0][:, 0]
    lost = np.flatnonzero(told[:, LOST])
    settled = 19 if lost.size == 0 else 20 + int(lost[-1])
    assert np.abs(told[:19, FRICTION]).max() < 0.4 * with_prior.assumed.unknown.friction
    assert np.sqrt(told[:19, VAR_FRICTION]).max() < 0.7 * with_prior.assumed.unknown.friction
    assert np.sqrt(told[settled + 1, VAR_FRICTION]) > 0.7 * with_prior.assumed.unknown.friction


# Sleep -----------------------------------------------------------------------------------------------

MANY = (*with_torque(["dry", "low"], PATCHES, FRICTIONS), *unlike_rails(CONDITIONS))
PLACES = np.arange(len(MANY))
RAILS = np.array(stand_ins(MANY))
UNLIKE = np.array([i for i in PLACES if MANY[i].unlike])


@given(st.permutations(range(len(MANY))))
def test_the_usual_patch_and_friction_stand_in_whatever_the_order(order: list[int]) -> None:
    hypotheses = [MANY[i] for i in order]
    found = stand_ins(hypotheses)
    for i, chosen in enumerate(found):
        one, other = hypotheses[i], hypotheses[chosen]
        assert one.sides == other.sides
        assert (other.branch, other.patch, other.friction[0]) == ("driven", 1.0, 0.0)
        assert found[chosen] == chosen


def believing(likely: Sequence[int]) -> Belief:
    """Return a belief in some of the hypotheses alone."""
    belief = new_belief(bank().rules(MANY))
    belief.p[:] = 1e-9
    belief.p[list(likely)] = 1.0 / len(likely)
    belief.gained[:] = -10.0
    belief.gained[list(likely)] = 0.0
    return belief


@pytest.fixture
def many(z: Array) -> tuple[Design, Rules, Memory]:
    design, rules = bank().design(MANY), bank().rules(MANY)
    return design, rules, compiled(design, z[:30])


def test_who_has_no_chance_sleeps_but_for_one_of_each_rail(many: tuple[Design, Rules, Memory]) -> None:
    design, rules, memory = many
    dry = MANY.index(Hypothesis("dry", patch=PATCHES[0], friction=FRICTIONS[1]))
    renew(design, rules, memory, believing([dry]), V, TORQUE)
    asleep = memory.voice != PLACES
    always = np.setdiff1d(RAILS, UNLIKE)
    assert not asleep[[dry, *always]].any()
    # Those that are tried are of the rail that it may be, or unlike.
    tried = np.setdiff1d(PLACES[~asleep], [dry, *always])
    assert len(tried) == 3
    assert {MANY[i].condition for i in np.setdiff1d(tried, UNLIKE)} <= {"dry"}
    for i in PLACES[asleep]:
        assert memory.voice[i] == (dry if MANY[i].unlike else RAILS[i])
    told = np.random.default_rng(1).standard_normal((3, len(MANY), N_TOLD))
    before = told.copy()
    speak_for_the_sleeping(rules, memory, told)
    assert np.array_equal(told[:, ~asleep], before[:, ~asleep])
    assert np.array_equal(told[:, asleep, :LOOKED], before[:, memory.voice[asleep], :LOOKED])
    looked = np.where(np.isin(PLACES[asleep], UNLIKE), NOBODY, STAND_IN)
    assert np.array_equal(told[:, asleep, LOOKED], np.tile(looked, (3, 1)))


def test_who_wakes_begins_where_its_rail_sees_the_wheelset(many: tuple[Design, Rules, Memory]) -> None:
    design, rules, memory = many
    dry = MANY.index(Hypothesis("dry", friction=FRICTIONS[0]))
    low = MANY.index(Hypothesis("low", friction=FRICTIONS[0]))
    of_low = [i for i in PLACES if RAILS[i] == low and i != low]
    renew(design, rules, memory, believing([dry]), V, TORQUE)
    assert (memory.voice[of_low] == low).all()
    renew(design, rules, memory, believing([dry, low, *of_low]), V, TORQUE)
    others = [j for j in range(N_X) if j not in {S, L_L, L_R}]
    for i in of_low:
        x, C = memory.filters.x[i], memory.filters.C[i]
        assert memory.voice[i] == i
        assert np.array_equal(x[others], memory.filters.x[low, others])
        assert x[S] == pytest.approx(bank().assumed.unknown.friction * MANY[i].friction[0])
        assert C[S, S] == pytest.approx((bank().assumed.unknown.friction * MANY[i].friction[1]) ** 2)


def test_all_that_is_worth_it_is_tried_in_turn(many: tuple[Design, Rules, Memory]) -> None:
    design, rules, memory = many
    dry = MANY.index(Hypothesis("dry", friction=FRICTIONS[0]))
    worth = sorted({*UNLIKE, *PLACES[(dry == RAILS)]} - {dry})
    tried: list[int] = []
    for _ in range(len(worth) // 3):
        renew(design, rules, memory, believing([dry]), V, TORQUE)
        awake = [i for i in worth if memory.voice[i] == i]
        assert len(awake) == 3
        for i in awake:
            own = {S, L_L, L_R} if MANY[i].branch == "held" else {S}
            taken = [j for j in range(N_X) if j not in own]
            assert np.array_equal(memory.filters.x[i, taken], memory.filters.x[dry, taken])
        tried += awake
    assert sorted(tried) == worth
    # One that has a chance stays awake and goes its own way.
    chosen = tried[-1]
    kept = memory.filters.x[chosen].copy()
    for _ in range(3):
        renew(design, rules, memory, believing([dry, chosen]), V, TORQUE)
        assert memory.voice[chosen] == chosen
        assert np.array_equal(memory.filters.x[chosen], kept)


def test_what_nobody_looks_at_becomes_neither_likelier_nor_less_likely(
    many: tuple[Design, Rules, Memory],
) -> None:
    """But for the rail that may change at any time, which is left out here."""
    design, rules, memory = many
    dry = MANY.index(Hypothesis("dry", friction=FRICTIONS[0]))
    renew(design, rules, memory, believing([dry]), V, TORQUE)
    rules = rules._replace(change=0.0)
    belief, said = new_belief(rules), new_judgement(4, len(MANY), len(CONDITIONS))
    told = np.abs(np.random.default_rng(2).standard_normal((4, len(MANY), N_TOLD)))
    speak_for_the_sleeping(rules, memory, told)
    weigh_blocks(rules, belief, told, np.empty(len(MANY) + 1), said, 0)
    for i in UNLIKE[memory.voice[UNLIKE] == dry]:
        assert belief.p[i] / belief.p[dry] == pytest.approx(rules.prior[i] / rules.prior[dry])
        # Nor is anything learned of whether it could be told from another.
        assert not belief.information[i].any()


@given(
    st.sampled_from(sorted(CONDITIONS)), st.floats(0.8, 1.25), st.floats(1.0, 100.0), st.floats(1e-5, 0.05),
    st.floats(-0.05, 0.05),
)  # fmt: skip
def test_a_larger_patch_is_a_rail_with_larger_reductions(
    name: str, size: float, v: float, a: float, b: float
) -> None:
    nominal, load = ContactPatch(), 79.7e3
    larger = ContactPatch(a=size * nominal.a, b=size * nominal.b)
    rail = CONDITIONS[name]
    expected = creep_force(rail_row(rail), patch_row(larger, load), v, a, b, 0.0)
    found = creep_force(rail_row(rail_of(rail, size)), patch_row(nominal, load), v, a, b, 0.0)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("usual", [with_torque, without_torque])
def test_sizes_of_the_patch_share_the_prior_of_their_hypothesis(usual: object) -> None:
    few, many = usual(CONDITIONS), usual(CONDITIONS, PATCHES)  # type: ignore[operator]
    assert len({h.name for h in many}) == len(many)
    one, all_sizes = (
        AdhesionBank(unknown=Unknowns(patches=(1.0,))).rules(few).prior,
        AdhesionBank().rules(many).prior,
    )
    for h, p in zip(few, one[:-1], strict=True):
        alike = [
            q
            for g, q in zip(many, all_sizes[:-1], strict=True)
            if (g.condition, g.branch, g.creep) == (h.condition, h.branch, h.creep)
        ]
        assert len(alike) == (1 if h.branch == "held" and h.creep >= 1.0 else len(PATCHES))
        assert sum(alike) == pytest.approx(p)


def test_a_rail_changes_and_a_patch_lasts() -> None:
    hypotheses = with_torque(CONDITIONS, PATCHES)
    turn = AdhesionBank().rules(hypotheses).turn
    assert turn.sum(axis=1) == pytest.approx(1.0)
    for i, h in enumerate(hypotheses):
        for j, g in enumerate(hypotheses):
            if not h.past_peak and not g.past_peak:
                same = hypotheses.index(Hypothesis(g.condition, patch=h.patch))
                assert turn[i, j] == pytest.approx(turn[i, same] * (1.0 if g.patch == h.patch else 1e-3))


def test_refuses_a_patch_of_no_size() -> None:
    with pytest.raises(ValueError, match=r"contact patch of 0\.0 times"):
        Hypothesis("dry", patch=0.0)


def test_refuses_unknowns_that_are_none() -> None:
    with pytest.raises(ValueError, match="got no sizes of the contact patch"):
        Unknowns(patches=())
    with pytest.raises(ValueError, match=r"got -0\.1 as standard deviation of the friction, expected a"):
        Unknowns(friction=-0.1)
    with pytest.raises(ValueError, match=r"got 0.0 as what the vehicle leaves open of the peak"):
        Unknowns(vehicle=0.0)
    with pytest.raises(ValueError, match=r"got nan as standard deviation of the bias"):
        Unknowns(bias=(0.0, float("nan")))
