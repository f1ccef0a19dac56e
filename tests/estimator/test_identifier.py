from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator.bank import FilterBank
from estimator.fuzzy import identification_system
from estimator.identifier import Identifier
from estimator.residuals import duels, moving_normalised_rms

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from estimator.kalman import LinearFilter

    Array = NDArray[np.float64]
    Simulate = Callable[[LinearFilter, int, int], Array]

WINDOW = 250
WEIGHTS = np.array([40.0, 1.0])


@pytest.fixture(scope="module")
def identifier(filters: tuple[LinearFilter, ...]) -> Identifier:
    return Identifier(FilterBank(filters), identification_system(3), window=WINDOW, weights=WEIGHTS)


@pytest.fixture(scope="module")
def z(filters: tuple[LinearFilter, ...], simulate: Simulate) -> Array:
    return simulate(filters[0], 1200, 11)


def test_identifier_is_its_parts_one_after_the_other(identifier: Identifier, z: Array) -> None:
    found = identifier.run(z)
    e = identifier.bank.innovations(z)
    residuals = np.sqrt(np.sum(WEIGHTS * e**2, axis=2))
    E = moving_normalised_rms(residuals, WINDOW)
    fuzzy = identification_system(3).compile()
    assert np.array_equal(found.innovations, e)
    assert np.allclose(found.E, E, rtol=1e-12, atol=0.0)
    assert found.probabilities == pytest.approx(np.array([fuzzy(duels(row)) for row in E]), abs=1e-9)


def test_steps_make_the_run(identifier: Identifier, z: Array) -> None:
    expected = identifier.run(z)
    identifier.reset()
    e, E, p = np.empty((3, 2)), np.empty(3), np.empty(3)
    for k, sample in enumerate(z):
        identifier.step(sample, e, E, p)
        assert np.array_equal(e, expected.innovations[k])
        assert np.array_equal(E, expected.E[k])
        assert np.array_equal(p, expected.probabilities[k])


def test_run_and_reset_forget(identifier: Identifier, z: Array) -> None:
    first = identifier.run(z)
    identifier.run(100.0 * z[::-1])
    again = identifier.run(z)
    assert np.array_equal(first.probabilities, again.probabilities)


def test_finds_the_filter_that_made_the_data(identifier: Identifier, z: Array) -> None:
    # The data are of P1's own model, so P1 must win once the window is full.
    p = identifier.run(z).probabilities[WINDOW:]
    assert np.mean(np.argmax(p, axis=1) == 0) > 0.95


def test_a_weight_of_zero_blinds_to_a_measurement(filters: tuple[LinearFilter, ...], z: Array) -> None:
    bank = FilterBank(filters)
    only_acceleration = Identifier(
        bank, identification_system(3), window=WINDOW, weights=np.array([0.0, 3.0])
    )
    E = moving_normalised_rms(bank.innovations(z)[:, :, 1], WINDOW)
    assert np.allclose(only_acceleration.run(z).E, E, rtol=1e-12, atol=0.0)


def test_only_the_ratio_of_weights_counts(filters: tuple[LinearFilter, ...], z: Array) -> None:
    def E(weights: Array) -> Array:
        return (
            Identifier(FilterBank(filters), identification_system(3), window=WINDOW, weights=weights).run(z).E
        )

    assert E(1e6 * WEIGHTS) == pytest.approx(E(WEIGHTS), rel=1e-12)


@pytest.mark.parametrize("fault", [math.nan, math.inf])
def test_a_broken_sensor_leaves_it_undecided(identifier: Identifier, z: Array, fault: float) -> None:
    broken = z.copy()
    broken[600, 0] = fault
    result = identifier.run(broken)
    assert np.array_equal(result.probabilities[:600], identifier.run(z).probabilities[:600])
    assert result.probabilities[600:] == pytest.approx(0.5, abs=1e-12)


def test_needs_a_fuzzy_system_for_its_bank(filters: tuple[LinearFilter, ...]) -> None:
    with pytest.raises(ValueError, match=r"with 2 inputs and 2 outputs, expected 3 of each for 3 filters"):
        Identifier(FilterBank(filters), identification_system(2), window=10, weights=WEIGHTS)


@pytest.mark.parametrize("weights", [[1.0], [1.0, 1.0, 1.0], [1.0, -1.0], [0.0, 0.0], [1.0, math.nan]])
def test_needs_a_weight_for_each_measurement(filters: tuple[LinearFilter, ...], weights: list[float]) -> None:
    with pytest.raises(ValueError, match=r"expected window >= 1 and 2 weights >= 0, not all zero"):
        Identifier(FilterBank(filters), identification_system(3), window=10, weights=np.array(weights))


def test_needs_a_window(filters: tuple[LinearFilter, ...]) -> None:
    with pytest.raises(ValueError, match=r"got window 0 .* expected window >= 1"):
        Identifier(FilterBank(filters), identification_system(3), window=0, weights=WEIGHTS)


@pytest.mark.parametrize("shape", [(10, 3), (10,)])
def test_needs_samples_of_its_sensors(identifier: Identifier, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"got samples of shape .* expected \(T, 2\); check the sensors"):
        identifier.run(np.zeros(shape))


def test_one_filter_has_no_rival(filters: tuple[LinearFilter, ...]) -> None:
    with pytest.raises(ValueError, match=r"^identifier: got a bank of 1 filter, expected at least 2"):
        Identifier(FilterBank(filters[:1]), identification_system(2), window=10, weights=WEIGHTS)
