"""Laws that the compiled filters of the adhesion bank obey."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator.adhesion import AdhesionBank, Hypothesis
from estimator.adhesion.block import new_memory, take_sample
from estimator.adhesion.ekf import COUNT, LOG_L

from .conftest import BOTH, TORQUE, WHEELSET, V, bank, compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def test_samples_that_are_not_usable_are_not_used(z: Array) -> None:
    design = bank().design([Hypothesis("wet")])
    usable = np.random.default_rng(2).random(z.shape) < 0.7
    broken = np.where(usable, z, 1e6)
    plain, masked = compiled(design, np.where(usable, z, 0.0), usable), compiled(design, broken, usable)
    assert np.array_equal(plain.filters.x, masked.filters.x)
    assert np.array_equal(plain.told, masked.told)
    assert masked.told[0, COUNT] == usable.sum()


def test_filters_in_another_order_say_the_same(z: Array) -> None:
    hypotheses = [
        Hypothesis("dry"),
        Hypothesis("low"),
        Hypothesis("wet", "held", 1.7),
        Hypothesis("very_low"),
    ]
    order = [2, 0, 3, 1]
    there = compiled(bank().design(hypotheses), z)
    again = compiled(bank().design([hypotheses[i] for i in order]), z)
    for a, b in zip(there.filters, again.filters, strict=True):
        assert np.array_equal(a[order], b)
    assert np.array_equal(there.told[order], again.told)


def test_each_filter_has_its_own_state_and_covariance(z: Array) -> None:
    # Alone and in company a filter must be the same: with the state or the covariance of its neighbour,
    # or one array for all, it would not be.
    hypotheses = [
        Hypothesis("dry"),
        Hypothesis("low"),
        Hypothesis("wet"),
        Hypothesis("very_low", "held", 1.0),
    ]
    together = compiled(bank().design(hypotheses), z)
    for i, hypothesis in enumerate(hypotheses):
        alone = compiled(bank().design([hypothesis]), z)
        assert np.array_equal(alone.filters.x[0], together.filters.x[i])
        assert np.array_equal(alone.filters.C[0], together.filters.C[i])
    for i in range(3):
        assert not np.allclose(together.filters.C[i], together.filters.C[i + 1], rtol=1e-3, atol=0.0)


def test_braking_mirrors_driving(z: Array) -> None:
    # Creep, force and torque change sign with the direction of the torque; left and right change places.
    wheelset = replace(WHEELSET, delta_r=0.0, I_L=100.0, I_R=100.0)
    design = AdhesionBank(wheelset, bias=(1e-3, 1e-2)).design([Hypothesis("low")])
    sign = np.array([-1, -1, -1, -1, -1, -1, -1, -1, -1, 1, -1, -1])
    there, back = new_memory(1), new_memory(1)
    work = np.zeros((5, 4, 12))
    for k in range(len(z)):
        take_sample(design, there, 0, k == 0, V, 0.0, TORQUE, z[k], BOTH, work)
        take_sample(design, back, 0, k == 0, V, 0.0, -TORQUE, -z[k], BOTH, work)
    assert np.allclose(back.filters.x[0], sign * there.filters.x[0], rtol=1e-9, atol=1e-14)
    assert back.told[0, LOG_L] == pytest.approx(there.told[0, LOG_L], rel=1e-9)
