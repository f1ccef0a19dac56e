"""The identifier as a component says what the identifier alone says, sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from co_sim.wheelset.identification import IdentifierComponent
from estimator import (
    CreepCurve,
    FilterBank,
    Identifier,
    NoiseModel,
    design_filter,
    filter_model,
    identification_system,
    operating_points,
)
from fmu_wheelset import CONDITIONS, WheelsetParameters

H = 1e-3
NOISE = NoiseModel(track_rate=1e-6, acceleration=1e-6, lever=0.75, sensors=(1e-3, 0.05))


@pytest.fixture(scope="module")
def identifier() -> Identifier:
    filters = [
        design_filter(filter_model(point, WheelsetParameters()), NOISE.W, NOISE.R, H, name=point.name)
        for point in operating_points(CreepCurve(CONDITIONS["dry"], 20.0))
    ]
    return Identifier(FilterBank(filters), identification_system(3), window=50, weights=np.array([0.0, 1.0]))


def outputs(component: IdentifierComponent, samples: np.ndarray) -> np.ndarray:
    component.start(0.0, H)
    y = np.empty((len(samples), len(component.outputs)))
    for k, z in enumerate(samples):
        component.step(k * H, H, z, y[k])
    return y


def test_component_equals_identifier(identifier: Identifier) -> None:
    samples = np.random.default_rng(1).normal(size=(200, 2)) * [1e-3, 0.05]
    y = outputs(IdentifierComponent(identifier), samples)
    alone = identifier.run(samples)
    np.testing.assert_array_equal(y[:, :3], alone.E)
    np.testing.assert_array_equal(y[:, 3:6], alone.probabilities)
    np.testing.assert_array_equal(y[:, 6:], alone.innovations.reshape(200, 6))


def test_ports_name_quantity_and_filter(identifier: Identifier) -> None:
    component = IdentifierComponent(identifier)
    names = [port.name for port in component.outputs]
    assert names[0] == "E.P1"
    assert names[3] == "p.P1"
    assert names[6:8] == ["e_yaw_rate.P1", "e_lateral_acceleration.P1"]
    assert [port.unit for port in component.outputs[6:8]] == ["rad/s", "m/s2"]


def test_slower_sampling_takes_every_nth_sample_and_holds(identifier: Identifier) -> None:
    samples = np.random.default_rng(2).normal(size=(30, 2)) * [1e-3, 0.05]
    y = outputs(IdentifierComponent(identifier, period=3), samples)
    alone = identifier.run(samples[::3])
    np.testing.assert_array_equal(y[:, :3], np.repeat(alone.E, 3, axis=0))


def test_before_the_first_sample_all_filters_are_equal(identifier: Identifier) -> None:
    component = IdentifierComponent(identifier)
    component.start(0.0, H)
    y = np.full(len(component.outputs), np.nan)
    for _ in range(3):  # initialisation may ask any number of times
        component.exchange(np.ones(2), y)
    np.testing.assert_allclose(y[:3], 3**-0.5)
    np.testing.assert_allclose(y[3:6], 0.5, atol=1e-12)
    np.testing.assert_array_equal(y[6:], 0.0)


def test_restart_repeats(identifier: Identifier) -> None:
    samples = np.random.default_rng(3).normal(size=(20, 2))
    component = IdentifierComponent(identifier)
    np.testing.assert_array_equal(outputs(component, samples), outputs(component, samples))
