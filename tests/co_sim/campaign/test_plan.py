"""Plans: which cases there are, and that their random numbers depend on nothing but the plan."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from co_sim.campaign import Plan


def test_grid_times_repetitions():
    plan = Plan(grid={"a": (1, 2, 3), "b": ("x", "y")}, repeat=4, fixed={"c": 0.5})
    cases = list(plan.cases())
    assert [case.number for case in cases] == list(range(24))
    assert plan.size == 24
    assert {(case.values["a"], case.values["b"]) for case in cases} == {
        (a, b) for a in (1, 2, 3) for b in "xy"
    }
    assert all(case.values["c"] == 0.5 for case in cases)
    assert len({case.seed for case in cases}) == 24


def test_a_further_draw_or_value_changes_no_other_draw():
    draw = {"m": {"uniform": (0.9, 1.1)}}
    few = list(Plan(grid={"a": (1, 2)}, repeat=3, draw=draw).cases())
    more = list(Plan(grid={"a": (1, 2, 3)}, repeat=3, draw={"k": {"normal": (0, 1)}, **draw}).cases())
    assert [case.values["m"] for case in few] == [case.values["m"] for case in more[:6]]
    assert [case.seed for case in few] == [case.seed for case in more[:6]]


def test_common_quantities_share_random_numbers():
    plan = Plan(
        grid={"bank": ("paper", "adhesion"), "v": (20, 40)},
        repeat=2,
        draw={"m": {"normal": (1.0, 0.1)}},
        common=("bank",),
    )
    cases = list(plan.cases())
    for one, other in zip(cases[:4], cases[4:], strict=True):
        assert (one.seed, one.values["m"], one.values["v"]) == (
            other.seed,
            other.values["m"],
            other.values["v"],
        )
    assert len({case.seed for case in cases}) == 4


@given(seed=st.integers(0, 2**40))
def test_another_seed_is_another_campaign(seed):
    first, second = (
        next(iter(Plan(seed=s, draw={"m": {"normal": (0, 1)}}).cases())) for s in (seed, seed + 1)
    )
    assert (first.values["m"], first.seed) != (second.values["m"], second.seed)


def test_draws_have_their_distributions():
    draw = {"u": {"uniform": (2, 4)}, "n": {"normal": (1, 0.5)}, "c": {"choice": ("x", "y")}}
    cases = list(Plan(repeat=4000, draw=draw).cases())
    u, n = (np.array([case.values[name] for case in cases]) for name in "un")
    x = np.mean([case.values["c"] == "x" for case in cases])
    assert 2 <= u.min() < u.max() <= 4
    assert u.mean() == pytest.approx(3.0, abs=0.05)
    assert (n.mean(), n.std()) == (pytest.approx(1.0, abs=0.05), pytest.approx(0.5, rel=0.06))
    assert x == pytest.approx(0.5, abs=0.05)
    assert abs(np.corrcoef(u, n)[0, 1]) < 0.08


def test_the_key_is_of_what_decides_the_cases():
    assert Plan(grid={"a": (1,)}).key == Plan(grid={"a": (1,)}).key
    assert Plan(grid={"a": (1,)}).key != Plan(grid={"a": (1,)}, repeat=2).key


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"grid": {"a": ()}}, "at least one"),
        ({"grid": {"a": (1, 1)}}, "distinct"),
        ({"grid": {"a": (1,)}, "fixed": {"a": 2}}, "more than one of grid, draw and fixed"),
        ({"grid": {"a": (1,)}, "common": ("b",)}, "quantities of the grid"),
        ({"grid": {"a": (1,)}, "variant": {"x": {"a": 2}}}, "in grid and in a variant"),
        ({"draw": {"a": {}}}, "no distribution"),
        ({"draw": {"a": {"uniform": (0, 1), "normal": (0, 1)}}}, "keep one"),
        ({"draw": {"a": {"uniform": (1, 1)}}}, "swap"),
        ({"draw": {"a": {"normal": (1, 0)}}}, "fixed value"),
        ({"fixed": {"a": float("nan")}}, "finite"),
    ],
)
def test_faults_are_told(fields, told):
    with pytest.raises(ValidationError, match=told):
        Plan(**fields)


def test_variants_share_random_numbers_and_have_values_of_their_own():
    plan = Plan(
        grid={"v": (20, 40)},
        repeat=2,
        draw={"m": {"normal": (1.0, 0.1)}},
        fixed={"k": 1.0},
        variant={"as it is": {}, "soft": {"k": 0.9}, "heavy": {"m": 1.1}},
    )
    cases = list(plan.cases())
    assert len(cases) == plan.size == 12
    for plain, soft, heavy in zip(cases[::3], cases[1::3], cases[2::3], strict=True):
        assert (plain.variant, soft.variant, heavy.variant) == ("as it is", "soft", "heavy")
        assert plain.seed == soft.seed == heavy.seed
        assert soft.values == plain.values | {"k": 0.9}
        assert heavy.values == plain.values | {"m": 1.1}
