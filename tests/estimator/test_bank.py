from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.bank import FilterBank

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.kalman import LinearFilter

    Array = NDArray[np.float64]


@pytest.fixture(scope="session")
def z() -> Array:
    """Samples of no model in particular, in the range of the sensors."""
    return np.random.default_rng(3).standard_normal((400, 2)).cumsum(axis=0) * [1e-3, 5e-2]


def textbook_innovations(f: LinearFilter, z: Array) -> Array:
    """Predict, compare, update: one filter, one sample after the other."""
    x, e = np.zeros(len(f.F)), np.empty_like(z)
    for k in range(len(z)):
        prediction = f.F @ x
        e[k] = z[k] - f.H @ prediction
        x = prediction + f.K @ e[k]
    return e


def test_bank_is_the_textbook_filter_many_times(filters: tuple[LinearFilter, ...], z: Array) -> None:
    e = FilterBank(filters).innovations(z)
    assert e.shape == (400, 3, 2)
    for i, f in enumerate(filters):
        reference = textbook_innovations(f, z)
        assert e[:, i] == pytest.approx(reference, abs=1e-12 * np.abs(reference).max())


def test_filters_differ(filters: tuple[LinearFilter, ...], z: Array) -> None:
    rms = np.sqrt(np.mean(FilterBank(filters).innovations(z)[:, :, 1] ** 2, axis=0))
    assert np.all(np.abs(np.diff(rms)) > 1e-4 * rms[:-1])


@given(st.permutations(range(3)))
def test_order_of_filters_does_not_matter(
    filters: tuple[LinearFilter, ...], z: Array, order: list[int]
) -> None:
    permuted = FilterBank([filters[i] for i in order])
    assert np.array_equal(permuted.innovations(z), FilterBank(filters).innovations(z)[:, order])
    assert permuted.names == tuple(f"P{i + 1}" for i in order)


@pytest.mark.parametrize("i", range(3))
def test_company_does_not_matter(i: int, filters: tuple[LinearFilter, ...], z: Array) -> None:
    # The filter of P2 has three states: alone it is not padded, among the others it is.
    alone = FilterBank([filters[i]])
    assert alone.F.shape == (1, *filters[i].F.shape)
    assert np.array_equal(alone.innovations(z)[:, 0], FilterBank(filters).innovations(z)[:, i])


@given(st.integers(-20, 20), st.integers(-20, 20))
def test_innovations_are_in_the_units_of_the_measurements(
    filters: tuple[LinearFilter, ...], z: Array, a: int, b: int
) -> None:
    unit = 2.0 ** np.array([a, b])  # powers of two: rounding is the same in every unit
    scaled = [replace(f, H=unit[:, None] * f.H, K=f.K / unit) for f in filters]
    e = FilterBank(scaled).innovations(z * unit)
    assert np.array_equal(e, FilterBank(filters).innovations(z) * unit)


@given(st.floats(-10.0, 10.0), st.integers(1, 399))
def test_bank_is_linear_and_causal(
    filters: tuple[LinearFilter, ...], z: Array, factor: float, now: int
) -> None:
    bank = FilterBank(filters)
    e = bank.innovations(z)
    assert bank.innovations(factor * z) == pytest.approx(factor * e, abs=1e-12)
    assert np.array_equal(bank.innovations(z[:now]), e[:now])


def test_every_run_starts_at_rest(filters: tuple[LinearFilter, ...], z: Array) -> None:
    bank = FilterBank(filters)
    first, second = bank.innovations(z), bank.innovations(z)
    assert np.array_equal(first, second)
    assert np.array_equal(first[0], np.broadcast_to(z[0], (3, 2)))


def test_any_memory_layout_will_do(filters: tuple[LinearFilter, ...], z: Array) -> None:
    bank = FilterBank(filters)
    assert np.array_equal(bank.innovations(np.asfortranarray(z)), bank.innovations(z))
    assert bank.innovations(z[:0]).shape == (0, 3, 2)


def test_needs_a_filter() -> None:
    with pytest.raises(ValueError, match=r"got no filters, expected at least one; design one first"):
        FilterBank([])


def test_needs_filters_of_the_same_sensors(filters: tuple[LinearFilter, ...]) -> None:
    f = filters[0]
    yaw_rate_only = replace(f, H=f.H[:1], K=f.K[:, :1])
    with pytest.raises(ValueError, match=r"got filters with \[1, 2\] measurements, expected one number"):
        FilterBank([f, yaw_rate_only])


@pytest.mark.parametrize("shape", [(10, 3), (10,), (10, 2, 1)])
def test_needs_samples_of_its_sensors(filters: tuple[LinearFilter, ...], shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"got samples of shape .* expected \(T, 2\); check the sensors"):
        FilterBank(filters).innovations(np.zeros(shape))
