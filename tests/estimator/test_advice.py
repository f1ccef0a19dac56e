"""Advice: what it is in the clear cases, and that more danger never means more torque."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.advice import LEVELS, NO_STATEMENT, Advice, advice_system, advise

LINEAR, PEAK, UNSTABLE = np.eye(3)
PARTS = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).filter(lambda p: sum(p) > 1e-3)
USE = st.floats(0.0, 2.0)


def one(p: object, use: float = 0.3, *, identifiable: bool = True) -> Advice:
    used, available = np.array([use * 0.1]), np.array([0.1])
    return advise(np.array([p], dtype=float), np.array([identifiable]), used, available)


@pytest.mark.parametrize(
    ("p", "use", "words"),
    [
        (LINEAR, 0.1, "more torque possible"),
        (LINEAR, 0.75, "hold torque"),
        (LINEAR, 0.99, "reduce torque"),
        (PEAK, 0.1, "reduce torque"),
        (UNSTABLE, 0.1, "sand or reduce sharply"),
        ((0.5, 0.4, 0.1), 0.1, "hold torque"),
        ((0.6, 0.0, 0.4), 0.1, "reduce torque"),
        (LINEAR, -0.99, "reduce torque"),
    ],
)
def test_clear_cases(p: object, use: float, words: str) -> None:
    assert one(p, use).words == (words,)


def test_nothing_is_said_where_nothing_is_known() -> None:
    assert one(LINEAR, identifiable=False).words == (NO_STATEMENT,)
    assert np.isnan(one(LINEAR, identifiable=False).score[0])
    assert one((np.nan, 0.5, 0.5)).words == (NO_STATEMENT,)


def test_unknown_use_never_asks_for_more() -> None:
    assert advise(LINEAR[None], np.array([True])).words == ("hold torque",)
    nan = np.array([np.nan])
    assert advise(LINEAR[None], np.array([True]), nan, nan).words == ("hold torque",)


def test_no_adhesion_at_all() -> None:
    zero, some = np.zeros(1), np.array([0.01])
    assert advise(LINEAR[None], np.array([True]), zero, zero).words == ("more torque possible",)
    assert advise(LINEAR[None], np.array([True]), some, zero).words == ("reduce torque",)


@given(PARTS, USE, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_more_danger_is_never_more_torque(parts: list[float], use: float, share: float, more: float) -> None:
    p = np.array(parts) / sum(parts)
    score = one(p, use).score[0]
    rounding = 1e-9
    for source, target in ((0, 1), (0, 2), (1, 2)):
        moved = p.copy()
        moved[target] += share * p[source]
        moved[source] -= share * p[source]
        assert one(moved, use).score[0] <= score + rounding
    assert one(p, use + more).score[0] <= score + rounding


@given(PARTS, USE)
def test_braking_is_traction(parts: list[float], use: float) -> None:
    p = np.array(parts) / sum(parts)
    assert one(p, use).score[0] == one(p, -use).score[0]


def test_rows_do_not_know_of_each_other() -> None:
    rng = np.random.default_rng(1)
    p = rng.dirichlet(np.ones(3), size=50)
    use = rng.uniform(0.0, 1.2, 50)
    whole = advise(p, np.ones(50, dtype=bool), use, np.ones(50))
    order = rng.permutation(50)
    again = advise(p[order], np.ones(50, dtype=bool), use[order], np.ones(50))
    np.testing.assert_array_equal(again.score, whole.score[order])
    assert sum(whole.shares.values()) == pytest.approx(1.0)


def test_every_level_and_every_rule_can_be_reached() -> None:
    use = np.linspace(0.0, 1.2, 40)
    rows = [(p, u) for p in (LINEAR, PEAK, UNSTABLE, (0.6, 0.0, 0.4), (0.5, 0.4, 0.1)) for u in use]
    p, used = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    assert set(advise(p, np.ones(len(p), dtype=bool), used, np.ones(len(p))).words) == set(LEVELS)
    assert len(advice_system().rules) == 9


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="expected"):
        advise(np.ones((2, 4)), np.ones(2, dtype=bool))
