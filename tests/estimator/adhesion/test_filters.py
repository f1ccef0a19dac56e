"""Laws that the compiled filters of the adhesion bank obey."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator.adhesion import AdhesionBank, Hypothesis, Unknowns
from estimator.adhesion.block import (
    LOST,
    N_TOLD,
    begin_filter,
    end_block,
    new_memory,
    run_filter,
    take_sample,
)
from estimator.adhesion.ekf import COUNT, LOG_L, SQUARE
from estimator.adhesion.motion import L_L, R, U, Y
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

from .conftest import BOTH, TORQUE, WHEELSET, V, bank, compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.adhesion.block import Memory

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
    # Alone and in company a filter must be the same: with anything of its neighbour, or one array for all,
    # it would not be. The rail swings, so filters are lost, each at its own time.
    hypotheses = [
        Hypothesis("dry"),
        Hypothesis("low"),
        Hypothesis("wet", right="dry"),
        Hypothesis("very_low", "held", 1.7),
        Hypothesis("very_low", "held", 1.0),
    ]
    z = np.concatenate([z, z])
    z[:, 0] += 0.02 * np.sin(6.0 * np.pi * 1e-3 * np.arange(len(z)))
    together, kept = blocks(hypotheses, z)
    assert len(np.unique(together[..., LOST].sum(axis=0))) > 2
    for i, hypothesis in enumerate(hypotheses):
        alone, own = blocks([hypothesis], z)
        assert np.array_equal(alone[:, 0], together[:, i])
        for one, all_ in zip((*own.filters, *own[1:4]), (*kept.filters, *kept[1:4]), strict=True):
            assert np.array_equal(one[0], all_[i])
    for i in range(4):
        assert not np.allclose(kept.filters.C[i], kept.filters.C[i + 1], rtol=1e-3, atol=0.0)
        assert not np.allclose(together[:, i, LOG_L], together[:, i + 1, LOG_L], rtol=1e-3, atol=0.0)


def blocks(hypotheses: list[Hypothesis], z: Array) -> tuple[Array, Memory]:
    """Return what filters tell of each block of z (T, 2), and what they have kept."""
    design, memory = bank().design(hypotheses), new_memory(len(hypotheses))
    rows, still = np.empty((len(z) // 10, len(hypotheses), N_TOLD)), np.zeros(len(z))
    usable, work = np.ones(z.shape, dtype=np.bool_), np.zeros((5, 4, 12))
    for i in range(len(hypotheses)):
        run_filter(
            design, memory, i, still + V, still, still + TORQUE, z, usable, work, rows, 0, len(rows)
        )  # fmt: skip
    return rows, memory


@pytest.mark.parametrize("count", [1, 2, 8, 20, 200])
def test_whose_model_holds_is_not_lost_however_few_samples_a_block_has(count: int) -> None:
    # At 100 Hz a block has two squares, and the mean of a few blocks is beyond any bound by chance.
    design, memory, row = bank().design([Hypothesis("dry")]), new_memory(1), np.zeros(N_TOLD)
    begin_filter(design, memory, 0, V, TORQUE)
    squares = np.random.default_rng(count).chisquare(count, size=5000)
    lost = []
    for square in (*squares, *(2.0 * squares)):
        memory.told[0, [SQUARE, COUNT]] = square, count
        end_block(design, memory, 0, V, TORQUE, row)
        lost.append(row[LOST])
    assert not any(lost[:5000])
    # Twice as loud, it is: within some hundred squares, but not before a few blocks.
    first = lost.index(1.0) - 5000
    assert 3 <= first < max(400 / count, 20)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_fast_states_keep_up_with_the_slow_ones(condition: str) -> None:
    # At 1 m/s the creep forces carry the wheelset along its yaw angle within microseconds: let alone it runs
    # through Klingel's motion, and its acceleration is v r and little more. A step whose fast states stayed
    # half a step behind would see 20 r on low rail.
    v, h, yaw_rates, accelerations = 1.0, 1e-3, [], []
    design = AdhesionBank(WheelsetParameters()).design([Hypothesis(condition)])
    memory, work = new_memory(1), np.zeros((5, 4, 12))
    begin_filter(design, memory, 0, v, 0.0)
    kept = memory.filters
    kept.x[0], kept.C[0] = 0.0, 0.0
    kept.x[0, Y] = 1e-4
    for _ in range(round(3.0 / h)):
        take_sample(design, memory, 0, False, v, 0.0, 0.0, np.zeros(2), ~BOTH, work)
        yaw_rates.append(kept.x[0, R])
        accelerations.append(kept.f[0, U])
    settled = slice(round(0.5 / h), None)
    r, a = np.array(yaw_rates[settled]), np.array(accelerations[settled])
    assert np.abs(r).max() > 1e-5
    assert np.abs(a - v * r).max() < 2.0 * np.abs(r).max()


@pytest.mark.parametrize("branch", ["driven", "held"])
def test_without_torque_a_filter_starts_without_creep(branch: str) -> None:
    design, memory = bank().design([Hypothesis("dry", branch)]), new_memory(1)  # type: ignore[arg-type]
    begin_filter(design, memory, 0, V, 0.0)
    assert abs(memory.filters.x[0, L_L]) < 1e-9


def test_braking_mirrors_driving(z: Array) -> None:
    # Creep, force and torque change sign with the direction of the torque; left and right change places.
    wheelset = replace(WHEELSET, delta_r=0.0, I_L=100.0, I_R=100.0)
    design = AdhesionBank(wheelset, unknown=Unknowns(bias=(1e-3, 1e-2))).design([Hypothesis("low")])
    sign = np.array([-1, -1, -1, -1, -1, -1, -1, -1, -1, 1, -1, -1])
    there, back = new_memory(1), new_memory(1)
    work = np.zeros((5, 4, 12))
    for k in range(len(z)):
        take_sample(design, there, 0, k == 0, V, 0.0, TORQUE, z[k], BOTH, work)
        take_sample(design, back, 0, k == 0, V, 0.0, -TORQUE, -z[k], BOTH, work)
    assert np.allclose(back.filters.x[0], sign * there.filters.x[0], rtol=1e-9, atol=1e-14)
    assert back.told[0, LOG_L] == pytest.approx(there.told[0, LOG_L], rel=1e-9)
