"""The scheme over a log is the scheme sample by sample where all can be used, and survives where not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator import CreepCurve, FilterBank, Identifier, NoiseModel, design_filter, filter_model
from estimator.fuzzy import identification_system
from estimator.linear_models import operating_points
from estimator.log import Log
from estimator.masked import identify_rows
from fmu_wheelset import CONDITIONS, WheelsetParameters

H = 1e-3


@pytest.fixture(scope="module")
def identifier() -> Identifier:
    points = operating_points(CreepCurve(CONDITIONS["dry"], 20.0))
    noise = NoiseModel(1e-5, 1e-4, 0.75, (1e-3, 0.05))
    filters = [
        design_filter(filter_model(point, WheelsetParameters()), noise.W, noise.R, H, name=point.name)
        for point in points
    ]
    return Identifier(FilterBank(filters), identification_system(3), window=200, weights=np.array([0.0, 1.0]))


@pytest.fixture
def log() -> Log:
    rng = np.random.default_rng(3)
    T = 1500
    wave = np.sin(2 * np.pi * 3.0 * H * np.arange(T))
    return Log(
        time=H * np.arange(T),
        yaw_rate=1e-3 * (3.0 * wave + rng.normal(size=T)),
        lateral_acceleration=0.05 * (3.0 * wave + rng.normal(size=T)),
        speed=np.full(T, 20.0),
    )


def test_all_usable_is_the_identifier_itself(identifier: Identifier, log: Log) -> None:
    rows = np.array([0, 7, 199, 200, 980, 1499])
    said = identify_rows(identifier, log, rows)
    whole = identifier.run(log.measurements)
    np.testing.assert_allclose(said.E, whole.E[rows], rtol=1e-12)
    np.testing.assert_allclose(said.probabilities, whole.probabilities[rows], rtol=1e-9)
    np.testing.assert_allclose(said.usable, np.minimum((rows + 1) / 200.0, 1.0), rtol=1e-12)


def test_what_is_not_usable_has_no_influence(identifier: Identifier, log: Log) -> None:
    usable = np.ones((len(log), 2), dtype=bool)
    usable[400:450, 1] = usable[700:705, 0] = False
    wild = log.lateral_acceleration.copy()
    wild[400:450] = 1e6
    masked = replace(log, usable=usable)
    rows = np.arange(0, len(log), 10)
    said = identify_rows(identifier, masked, rows)
    again = identify_rows(identifier, replace(masked, lateral_acceleration=wild), rows)
    np.testing.assert_array_equal(said.E, again.E)
    assert said.usable[45] == pytest.approx(0.75)
    assert np.isfinite(said.E).all()


def test_a_sensor_without_weight_does_not_count(identifier: Identifier, log: Log) -> None:
    usable = np.ones((len(log), 2), dtype=bool)
    usable[:, 0] = False
    said = identify_rows(identifier, replace(log, usable=usable), np.array([1000]))
    assert said.usable[0] == pytest.approx(1.0)


def test_nothing_usable_says_that_all_are_equal(identifier: Identifier, log: Log) -> None:
    said = identify_rows(
        identifier, replace(log, usable=np.zeros((len(log), 2), dtype=bool)), np.array([900])
    )
    np.testing.assert_allclose(said.E, 1.0 / np.sqrt(3.0))
    assert said.usable[0] == 0.0
