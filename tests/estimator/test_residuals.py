from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.residuals import duels, equal_level, moving_mean_square, moving_normalised_rms

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

windows = st.integers(1, 25)
counts = st.integers(1, 6)
lengths = st.integers(0, 90)
seeds = st.integers(0, 2**32 - 1)


def noise(seed: int, *shape: int) -> Array:
    return np.random.default_rng(seed).standard_normal(shape)


def naive_moving_mean(values: Array, window: int) -> Array:
    rows = [values[max(0, k + 1 - window) : k + 1].mean(axis=0) for k in range(len(values))]
    return np.array(rows).reshape(values.shape)


@given(seeds, lengths, counts, windows)
def test_moving_mean_is_the_mean_of_the_window(seed: int, T: int, n: int, window: int) -> None:
    squares = noise(seed, T, n) ** 2
    assert moving_mean_square(squares, window) == pytest.approx(naive_moving_mean(squares, window), rel=1e-13)


@given(seeds, windows, st.sampled_from([1e300, math.inf, math.nan]), st.integers(0, 40))
def test_an_outlier_leaves_no_trace_after_the_window(seed: int, window: int, outlier: float, at: int) -> None:
    squares = noise(seed, 100, 2) ** 2
    disturbed = squares.copy()
    disturbed[at, 0] = outlier
    found, expected = moving_mean_square(disturbed, window), moving_mean_square(squares, window)
    assert np.array_equal(found[at + window :], expected[at + window :])
    assert np.array_equal(found[:at], expected[:at])
    assert np.array_equal(found[:, 1], expected[:, 1])
    assert not np.any(found[at : at + window, 0] < 1e290)


@given(seeds, lengths, counts, windows)
def test_squares_of_the_normalised_residuals_sum_to_one(seed: int, T: int, n: int, window: int) -> None:
    E = moving_normalised_rms(noise(seed, T, n), window)
    assert np.sum(E**2, axis=1) == pytest.approx(np.ones(T), rel=1e-14)
    assert np.all((E >= 0.0) & (E <= 1.0))


@given(seeds, windows, st.floats(1e-60, 1e60))
def test_normalised_residuals_have_no_unit(seed: int, window: int, unit: float) -> None:
    e = noise(seed, 60, 3)
    assert moving_normalised_rms(unit * e, window) == pytest.approx(
        moving_normalised_rms(e, window), rel=1e-13
    )


@given(seeds, st.permutations(range(4)))
def test_order_does_not_matter(seed: int, order: list[int]) -> None:
    e = noise(seed, 60, 4)
    found = moving_normalised_rms(e[:, order], 10)
    assert found == pytest.approx(moving_normalised_rms(e, 10)[:, order], rel=1e-14)


@given(seeds, counts)
def test_equal_filters_share_equally(seed: int, n: int) -> None:
    e = np.repeat(noise(seed, 40, 1), n, axis=1)
    assert moving_normalised_rms(e, 7) == pytest.approx(np.full((40, n), 1.0 / math.sqrt(n)), rel=1e-14)
    assert equal_level(n) == 1.0 / math.sqrt(n)


def test_three_equal_filters_give_the_known_level() -> None:
    assert equal_level(3) == pytest.approx(0.577, abs=5e-4)


def test_ratio_of_the_residuals_is_kept() -> None:
    e = np.array([[3.0, -4.0]] * 5)
    assert moving_normalised_rms(e, 2) == pytest.approx(np.tile([0.6, 0.8], (5, 1)), rel=1e-15)


def test_silence_decides_nothing() -> None:
    assert moving_normalised_rms(np.zeros((3, 4)), 2) == pytest.approx(np.full((3, 4), 0.5))


def test_window_of_one_sample_has_no_memory() -> None:
    squares = noise(0, 30, 2) ** 2
    assert np.array_equal(moving_mean_square(squares, 1), squares)


@pytest.mark.parametrize("window", [0, -5])
def test_window_needs_a_sample(window: int) -> None:
    with pytest.raises(ValueError, match=f"window: got {window} samples, expected at least 1"):
        moving_normalised_rms(np.ones((3, 2)), window)


# A residual against its best rival -------------------------------------------------------------------

positive = st.floats(1e-6, 1e6)


@given(st.lists(positive, min_size=2, max_size=12))
def test_a_duel_is_15_for_a_filter_and_the_best_of_the_others(values: list[float]) -> None:
    E = np.array(values)
    expected = [e / np.hypot(e, np.delete(E, i).min()) for i, e in enumerate(E)]
    np.testing.assert_allclose(duels(E), expected, rtol=1e-14)


@given(st.lists(positive, min_size=2, max_size=12), st.floats(1e-3, 1e3))
def test_duels_know_no_scale(values: list[float], scale: float) -> None:
    np.testing.assert_allclose(duels(scale * np.array(values)), duels(np.array(values)), rtol=1e-12)


@pytest.mark.parametrize(
    ("E", "D"),
    [([0.0, 1.0], [0.0, 1.0]), ([0.0, 0.0], [0.5**0.5] * 2), ([0.0, 0.0, 1.0], [0.5**0.5] * 2 + [1.0])],
)
def test_duels_of_perfect_filters(E: list[float], D: list[float]) -> None:
    np.testing.assert_allclose(duels(np.array(E)), D, rtol=1e-15)
