"""The whole bank on motions of the plant's equations, integrated independently of filters and FMU."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from estimator import SensorNoise
from estimator.adhesion import AdhesionBank, AdhesionIdentification, Hypothesis, Unknowns, new_judgement
from estimator.adhesion.evidence import new_belief
from estimator.adhesion.log_run import weigh_blocks
from estimator.log import Log
from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

T = 3000


@pytest.fixture(scope="module")
def log(drive: object) -> Log:
    return drive("low", 40.0, 4000.0, T)  # type: ignore[operator, no-any-return]


@pytest.fixture(scope="module")
def bank() -> AdhesionBank:
    return AdhesionBank()


@pytest.fixture(scope="module")
def found(bank: AdhesionBank, log: Log) -> AdhesionIdentification:
    return bank.run(log)


def test_finds_condition_and_peak(found: AdhesionIdentification) -> None:
    settled = found.time > 1.0
    assert found.conditions == ("dry", "wet", "low", "very_low")
    assert np.mean(np.argmax(found.p_condition[settled], axis=1) == 2) > 0.95
    peak = 0.0592
    assert np.median(found.mu_max[settled]) == pytest.approx(peak, rel=0.1)
    inside = (found.mu_max_low[settled] <= peak) & (peak <= found.mu_max_high[settled])
    assert np.mean(inside) > 0.8
    # Two wheels of 79.7 kN and 0.5 m.
    assert np.mean(found.mu_used[settled]) == pytest.approx(4000.0 / (2.0 * 79.7e3 * 0.5), rel=0.02)
    assert found.p_none[settled].max() < 0.01


def test_says_what_it_promises(found: AdhesionIdentification) -> None:
    n = T // 10
    assert found.time.shape == (n,)
    assert found.time[0] == pytest.approx(0.009)
    assert found.p_region.sum(axis=1) == pytest.approx(np.ones(n))
    assert found.p_condition.sum(axis=1) == pytest.approx(np.ones(n))
    assert found.p_hypothesis.sum(axis=1) + found.p_none == pytest.approx(np.ones(n))
    assert np.all(found.mu_max_low <= found.mu_max)
    assert np.all(found.mu_max <= found.mu_max_high)
    assert np.all(found.mu_max_low >= np.abs(found.mu_used))
    assert found.p_hypothesis.shape == (n, len(found.hypotheses))


def test_rows_every_tenth_of_a_second_are_the_same_rows(bank: AdhesionBank, log: Log) -> None:
    fine, coarse = bank.run(log), bank.run(log, every=0.1)
    assert np.array_equal(coarse.time, fine.time[9::10])
    assert np.array_equal(coarse.mu_max, fine.mu_max[9::10])


def test_steps_make_the_run(bank: AdhesionBank, log: Log, found: AdhesionIdentification) -> None:
    bank.reset()
    said, torque = new_judgement(1, len(found.hypotheses), 4), log.traction_torque
    assert torque is not None
    rows = []
    for k, z in enumerate(log.measurements[:500]):
        if bank.step(z, log.speed[k], torque[k], said):
            rows.append((*said.p_hypothesis[0], *said.mu[0], *said.p_region[0], said.identifiable[0]))
    expected = np.column_stack(
        [found.p_hypothesis, found.mu_used, found.mu_max, found.mu_max_low, found.mu_max_high,
         found.p_region, found.identifiable]
    )  # fmt: skip
    assert np.array_equal(rows, expected[:50])


def test_threads_change_nothing(bank: AdhesionBank, log: Log, found: AdhesionIdentification) -> None:
    assert np.array_equal(bank.run(log, workers=1).p_hypothesis, found.p_hypothesis)


def test_hypotheses_in_another_order_say_the_same(log: Log) -> None:
    names = [Hypothesis(name) for name in ("dry", "wet", "low", "very_low")]
    order = [3, 1, 0, 2]
    there = AdhesionBank(hypotheses=names).run(log)
    again = AdhesionBank(hypotheses=[names[i] for i in order]).run(log)
    assert again.p_hypothesis == pytest.approx(there.p_hypothesis[:, order], rel=1e-9, abs=1e-12)
    assert again.p_condition == pytest.approx(there.p_condition, rel=1e-9, abs=1e-12)
    assert again.mu_max == pytest.approx(there.mu_max, rel=1e-5)


def test_conditions_in_another_order_say_the_same(found: AdhesionIdentification, log: Log) -> None:
    # Probabilities, creep curves and peaks of adhesion belong to conditions by name.
    names = ("low", "very_low", "dry", "wet")
    again = AdhesionBank(conditions={name: CONDITIONS[name] for name in names}).run(log)
    order = [found.conditions.index(name) for name in names]
    assert again.conditions == names
    assert again.p_condition == pytest.approx(found.p_condition[:, order], rel=1e-9, abs=1e-12)
    assert again.p_region == pytest.approx(found.p_region, rel=1e-9, abs=1e-12)
    assert again.mu_max == pytest.approx(found.mu_max, rel=1e-5)
    assert np.array_equal(again.identifiable, found.identifiable)


def test_windowed_evidence_forgets(log: Log) -> None:
    # The same second of data after other data: the filters remember a little, the evidence nothing.
    bank = AdhesionBank(window=0.5)
    hypotheses = bank.hypotheses()
    told, whole = bank.look_at(log, hypotheses)
    rows, rules = len(told) - 100, bank.rules(hypotheses)
    late = new_judgement(rows, len(hypotheses), len(bank.conditions))
    weigh_blocks(rules, new_belief(rules), told[100:], np.empty(len(hypotheses) + 1), late, 0)
    assert late.p_hypothesis[60:] == pytest.approx(whole.p_hypothesis[160:], rel=1e-3, abs=1e-6)


def test_what_fits_nothing_is_none_of_these(bank: AdhesionBank, log: Log) -> None:
    rng = np.random.default_rng(3)
    other = replace(
        log,
        yaw_rate=log.yaw_rate + 5e-3 * rng.standard_normal(T),
        lateral_acceleration=log.lateral_acceleration + 0.3 * rng.standard_normal(T),
    )
    found = bank.run(other)
    assert found.p_none[100:].min() > 0.99
    assert not found.identifiable[100:].any()


def test_a_gap_in_the_data_is_no_evidence_and_is_survived(bank: AdhesionBank, log: Log) -> None:
    yaw_rate = log.yaw_rate.copy()
    yaw_rate[1000:2000] = math.nan
    acceleration = log.lateral_acceleration.copy()
    acceleration[1000:2000] = math.nan
    found = bank.run(replace(log, yaw_rate=yaw_rate, lateral_acceleration=acceleration, usable=None))
    assert np.isfinite(found.p_condition).all()
    assert np.isfinite(found.mu_max_high).all()
    # Nothing is learned in the gap, so what was believed only fades.
    certainty = found.p_hypothesis.max(axis=1)
    assert np.all(np.diff(certainty[100:200]) <= 1e-9)
    assert np.mean(np.argmax(found.p_condition[210:230], axis=1) == 2) > 0.9


def test_without_torque_the_creeps_are_tried(bank: AdhesionBank, log: Log) -> None:
    found = bank.run(replace(log, traction_torque=None))
    # Four creeps below the peak for three sizes of the patch, three others, on four rails.
    assert len(found.hypotheses) == 60
    assert np.isfinite(found.mu_max).all()


def test_without_torque_nothing_is_learned_of_the_friction(bank: AdhesionBank, log: Log) -> None:
    found = bank.run(replace(log, traction_torque=None))
    ratio = np.log(found.mu_max_high / found.mu_max_low)[100:]
    # 90 % of a normal distribution that is no narrower than that of the friction.
    assert ratio.min() > 2.0 * 1.64 * Unknowns.friction


def test_a_vehicle_less_well_known_widens_the_interval_and_nothing_else(log: Log) -> None:
    known, vague = (AdhesionBank(unknown=Unknowns(vehicle=deviation)).run(log) for deviation in (0.006, 0.03))
    assert np.array_equal(known.p_hypothesis, vague.p_hypothesis)
    wider = np.log(vague.mu_max_high / vague.mu_max_low) - np.log(known.mu_max_high / known.mu_max_low)
    assert wider.min() > 0.0
    # Where one filter is left, variances add up.
    sure = known.p_hypothesis.max(axis=1) > 0.999
    assert np.all(np.log(vague.mu_max_high / vague.mu_max_low)[sure] > 2.0 * 1.64 * 0.03)


def test_no_samples_leave_the_prior(bank: AdhesionBank, log: Log) -> None:
    found = bank.run(replace(log, usable=np.zeros((T, 2), dtype=np.bool_)))
    assert not found.identifiable.any()
    assert found.p_none.max() < 0.1


def test_standstill_and_creeping_are_survived(bank: AdhesionBank, log: Log) -> None:
    speed = np.clip(np.abs(np.linspace(-3.0, 3.0, T)) - 0.5, 0.0, None)
    found = bank.run(replace(log, speed=speed))
    for values in (found.p_condition, found.p_region, found.mu_max_low, found.mu_max_high):
        assert np.isfinite(values).all()


def test_refuses_logs_that_do_not_fit(bank: AdhesionBank, log: Log) -> None:
    with pytest.raises(ValueError, match=r"got a log with a step of 0.002 s, expected 0.001 s"):
        bank.run(replace(log, time=2.0 * log.time))
    few = Log(time=log.time[:5], yaw_rate=np.zeros(5), lateral_acceleration=np.zeros(5), speed=np.ones(5))
    with pytest.raises(ValueError, match=r"got 5 samples, expected at least 10"):
        bank.run(few)


def test_refuses_what_it_cannot_be_made_of() -> None:
    with pytest.raises(ValueError, match=r"got a step of 0.0 s"):
        AdhesionBank(h=0.0)
    with pytest.raises(ValueError, match=r"got dwell = 0.0 s, expected a finite value of at least a block"):
        AdhesionBank(dwell=0.0)
    with pytest.raises(ValueError, match=r"got window = 0.001 s"):
        AdhesionBank(window=0.001)
    with pytest.raises(ValueError, match=r"got window = 0.0 s"):
        AdhesionBank(window=0.0)
    with pytest.raises(ValueError, match=r"sensor noise: got yaw_rate = 0.0"):
        SensorNoise(yaw_rate=0.0)
    with pytest.raises(ValueError, match=r"got the branch 'stable', expected 'driven' or 'held'"):
        Hypothesis("dry", "stable")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"got a creep of -1.0 times"):
        Hypothesis("dry", "held", -1.0)
    with pytest.raises(ValueError, match=r"got the condition 'icy'"):
        AdhesionBank(hypotheses=[Hypothesis("icy")])


def test_one_wheel_on_another_rail_has_a_name() -> None:
    assert Hypothesis("low", right="dry").name == "low/dry driven"
    assert Hypothesis("low", right="dry").sides == ("low", "dry")
    assert set(CONDITIONS) >= set(Hypothesis("low", right="dry").sides)


def test_data_that_fit_nothing_leave_probabilities_that_sum_to_one() -> None:
    T = 600
    rng = np.random.default_rng(1)
    log = Log(
        time=1e-3 * np.arange(T),
        yaw_rate=10.0 * rng.standard_normal(T),
        lateral_acceleration=1e3 * rng.standard_normal(T),
        speed=np.full(T, 20.0),
        traction_torque=np.full(T, 2e4),
    )
    found = AdhesionBank(unknown=Unknowns(friction=0.0), window=0.5).run(log)
    assert found.p_none[-1] > 0.99
    for p in (found.p_region, found.p_condition):
        np.testing.assert_allclose(p.sum(axis=1), 1.0, atol=1e-9)
