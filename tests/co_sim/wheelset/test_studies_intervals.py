"""Intervals must hold what they promise."""

import numpy as np
import pytest
from scipy import stats

from co_sim.wheelset.studies.intervals import paired_difference, rate_of, share_of


def test_independent_windows_give_wilson():
    right = np.arange(200) % 5 > 0
    found = share_of(right, np.arange(200))
    exact = stats.binomtest(160, 200).proportion_ci(method="wilson")
    assert found.value == pytest.approx(0.8)
    assert (found.low, found.high) == (
        pytest.approx(exact.low, abs=2e-3),
        pytest.approx(exact.high, abs=2e-3),
    )


def test_windows_that_repeat_their_case_add_nothing():
    right = np.arange(40) % 4 > 0
    once = share_of(right, np.arange(40))
    repeated = share_of(np.repeat(right, 10), np.repeat(np.arange(40), 10))
    assert (repeated.low, repeated.high) == (pytest.approx(once.low), pytest.approx(once.high))


def test_all_right_is_no_proof():
    found = share_of(np.ones(100, dtype=bool), np.repeat(np.arange(10), 10))
    assert found.high == pytest.approx(1.0)
    assert found.low == pytest.approx(stats.binomtest(10, 10).proportion_ci(method="wilson").low)


def test_intervals_of_shares_hold_their_promise():
    rng, held = np.random.default_rng(1), 0
    for _ in range(400):
        p = rng.beta(8, 2, size=60)
        right = rng.random((60, 8)) < p[:, None]
        found = share_of(right.ravel(), np.repeat(np.arange(60), 8))
        held += found.low <= 0.8 <= found.high
    assert 0.91 <= held / 400 <= 0.985


def test_rates():
    assert rate_of(0, 1000.0).high == pytest.approx(3.0, abs=0.01)
    found = rate_of(5, 500.0)
    assert (found.value, found.low, found.high) == tuple(
        pytest.approx(x, rel=1e-3) for x in (10.0, 3.247, 23.337)
    )
    assert np.isnan(rate_of(0, 0.0).value)


def test_paired_differences_do_not_see_what_is_common():
    rng = np.random.default_rng(2)
    common = 10.0 * rng.standard_normal(50)
    mean, low, high = paired_difference(common, common - 0.1 + 0.01 * rng.standard_normal(50))
    assert low < -0.1 < high or mean == pytest.approx(-0.1, abs=0.01)
    assert high - low < 0.02


def test_without_windows():
    assert np.isnan(share_of(np.empty(0, dtype=bool), np.empty(0, dtype=np.int64)).value)
