from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, stats

from estimator.coloured import Disturbances, SensorBias, coloured_filter
from estimator.contact import CreepCurve
from estimator.likelihood import LikelihoodBank
from estimator.likelihood_kernel import likelihood_run
from estimator.linear_models import point_at
from estimator.recursive import RecursiveFilter, design_recursive
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]

LOW = ERRI_B176["erri_low"]
H = 1e-3
#: Creep as a multiple of that of the maximum: linear, knee, maximum, beyond.
CREEPS = {"linear": 0.1, "knee": 0.25, "peak": 1.0, "beyond": 1.7}


def designs(v: float, wheelset: WheelsetParameters) -> tuple[RecursiveFilter, ...]:
    """Filters of six states, of eight with biases, of three without a steady state, and an unstable one."""
    curve = CreepCurve(CONDITIONS["dry"], v)
    trusting, biased = Disturbances(LOW), Disturbances(LOW, bias=SensorBias(1e-3, 0.05, time=20.0))
    filters = []
    for name, multiple in CREEPS.items():
        point = point_at(curve, name, multiple * curve.peak_creep)
        if name == "peak":
            point = replace(point, g11=0.0)
        filters.append(coloured_filter(point, wheelset, biased if name == "knee" else trusting, H))
    return tuple(filters)


@pytest.fixture(scope="module")
def four(wheelset: WheelsetParameters) -> tuple[RecursiveFilter, ...]:
    return designs(20.0, wheelset)


@pytest.fixture(scope="module")
def faster(wheelset: WheelsetParameters) -> tuple[RecursiveFilter, ...]:
    return designs(21.0, wheelset)


def samples(T: int, seed: int = 3) -> Array:
    """Of no model in particular, in the range of the sensors."""
    return np.random.default_rng(seed).standard_normal((T, 2)).cumsum(axis=0) * [1e-3, 5e-2]


def holes(T: int, seed: int, share: float = 0.2) -> Mask:
    return np.random.default_rng(seed).random((T, 2)) > share


def simulate(f: RecursiveFilter, T: int, seed: int) -> Array:
    """Samples of the filter's own model, started as unknown as the filter takes it."""
    rng = np.random.default_rng(seed)
    U, d, _ = np.linalg.svd(f.Q)
    w = rng.standard_normal((T, len(f.F))) @ (U * np.sqrt(d)).T
    z = rng.standard_normal((T, 2)) * np.sqrt(np.diag(f.R))
    x = np.sqrt(f.start) * rng.standard_normal(len(f.F))
    for t in range(T):
        z[t] += f.H @ x
        x = f.F @ x + w[t]
    return z


def log_normal(e: Array, S: Array) -> float:
    """Logarithm of the density of a normal distribution."""
    white = np.linalg.solve(np.linalg.cholesky(S), e)
    return float(-0.5 * (white @ white + np.linalg.slogdet(S)[1] + len(e) * math.log(2.0 * math.pi)))


def textbook(cells: list[RecursiveFilter], z: Array, usable: Mask, which: Array) -> tuple[Array, Array]:
    """Predict, compare, update with the matrices written out; log-likelihood and NIS of each sample."""
    x, P = np.zeros(len(cells[0].F)), np.diag(cells[which[0]].start)
    log_p, nis = np.zeros(len(z)), np.zeros(len(z))
    for t, (sample, use) in enumerate(zip(z, usable, strict=True)):
        f = cells[which[t]]
        C, R = f.H[use], f.R[np.ix_(use, use)]
        if use.any():
            e, S = sample[use] - C @ x, C @ P @ C.T + R
            log_p[t] = log_normal(e, S)
            nis[t] = e @ np.linalg.inv(S) @ e
            K = P @ C.T @ np.linalg.inv(S)
            x, P = x + K @ e, P - K @ S @ K.T
        x, P = f.F @ x, f.F @ P @ f.F.T + f.Q
    return log_p, nis


# Against other ways to say the same ----------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.9))
@settings(max_examples=5)
def test_bank_is_the_textbook_filter_many_times(
    four: tuple[RecursiveFilter, ...], faster: tuple[RecursiveFilter, ...], seed: int, share: float
) -> None:
    T = 60
    z, usable = samples(T, seed), holes(T, seed, share)
    which = np.random.default_rng(seed).integers(0, 2, T // 10).repeat(10)
    found = LikelihoodBank(four, faster, tolerance=0.0).run(z, usable=usable, cells=which)
    for i, cells in enumerate(zip(four, faster, strict=True)):
        log_p, nis = textbook(list(cells), z, usable, which)
        assert found.log_likelihood[:, i] == pytest.approx(log_p, abs=1e-7 * np.abs(log_p).max())
        assert found.nis[:, i] == pytest.approx(nis, rel=1e-6, abs=1e-7)
    assert np.array_equal(found.measurements, usable.sum(axis=1))


def test_likelihoods_are_those_of_one_great_normal_distribution(four: tuple[RecursiveFilter, ...]) -> None:
    T = 40
    z, usable = samples(T), holes(T, 1)
    found = LikelihoodBank(four, tolerance=0.0).run(z, usable=usable, every=T)
    for i, f in enumerate(four):
        # Covariance of all samples at once: cov(x_s, x_t) = F^(s-t) var(x_t).
        var, column = np.diag(f.start), []
        for _ in range(T):
            column.append(var)
            var = f.F @ var @ f.F.T + f.Q
        powers = [np.linalg.matrix_power(f.F, k) for k in range(T)]
        cov = np.zeros((T, 2, T, 2))
        for t in range(T):
            for s in range(t, T):
                cov[s, :, t] = f.H @ powers[s - t] @ column[t] @ f.H.T
                cov[t, :, s] = cov[s, :, t].T
            cov[t, :, t] += f.R
        seen = usable.ravel()
        expected = log_normal(z.ravel()[seen], cov.reshape(2 * T, 2 * T)[np.ix_(seen, seen)])
        assert found.log_likelihood[0, i] == pytest.approx(expected, rel=1e-7)


def test_bank_is_that_of_filterpy(four: tuple[RecursiveFilter, ...]) -> None:
    kalman = pytest.importorskip("filterpy.kalman", reason="filterpy is not a dependency")
    z = samples(200)
    found = LikelihoodBank(four, tolerance=0.0).run(z)
    for i, f in enumerate(four):
        reference = kalman.KalmanFilter(dim_x=len(f.F), dim_z=2)
        reference.F, reference.H, reference.Q, reference.R, reference.P = f.F, f.H, f.Q, f.R, np.diag(f.start)
        for t, sample in enumerate(z):
            reference.update(sample)
            assert found.log_likelihood[t, i] == pytest.approx(reference.log_likelihood, rel=1e-6, abs=1e-5)
            reference.predict()


# Steady state --------------------------------------------------------------------------------------------


def test_steady_gains_are_the_moving_ones(four: tuple[RecursiveFilter, ...]) -> None:
    for i, f in enumerate(four):
        T = 2_000 if i == 3 else 20_000
        z = simulate(f, T, i)
        exact = LikelihoodBank(four, tolerance=0.0).run(z, every=1000)
        close = LikelihoodBank(four).run(z, every=1000)
        off = np.abs(close.log_likelihood - exact.log_likelihood)[:, i]
        assert off.max() < 0.1  # nats in a second


def test_covariance_stands_still_where_it_can(four: tuple[RecursiveFilter, ...]) -> None:
    bank = LikelihoodBank(four)
    memory = bank.new_memory()
    z, usable = samples(40_000), np.ones((40_000, 2), dtype=bool)
    run(bank, memory, z, usable)
    assert memory.moving.tolist() == [False, False, True, False]
    usable[-1, 0] = False
    run(bank, memory, z[-2:], usable[-2:])
    assert memory.moving.all()


def run(bank: LikelihoodBank, memory: object, z: Array, usable: Mask) -> Array:
    """Feed samples to a memory; sums of all of them."""
    n = len(bank.names)
    sums, history = np.empty((1, 2 * n + 1)), np.zeros((1, 2 * n + 1))
    cells = np.zeros(len(z), dtype=np.int64)
    likelihood_run(bank.design, memory, bank.new_work(), z, usable, cells, len(z), history, sums)
    return sums


def test_next_speed_takes_its_own_steady_gain(
    four: tuple[RecursiveFilter, ...], faster: tuple[RecursiveFilter, ...]
) -> None:
    bank = LikelihoodBank(four, faster)
    z = samples(40_100)
    which = np.zeros(len(z), dtype=np.int64)
    which[40_000:] = 1
    found = bank.run(z, cells=which, every=100).log_likelihood
    assert np.array_equal(found[:-1], bank.run(z, every=100).log_likelihood[:-1])
    # From its state before, with the steady gain of the new speed.
    f = faster[0]
    assert f.P is not None
    S = f.H @ f.P @ f.H.T + f.R
    memory = bank.new_memory()
    run(bank, memory, z[:40_000], np.ones((40_000, 2), dtype=bool))
    x, expected = memory.x[0, : len(f.F)], 0.0
    for sample in z[40_000:]:
        e = sample - f.H @ x
        expected += log_normal(e, S)
        x = f.F @ (x + f.P @ f.H.T @ np.linalg.solve(S, e))
    assert found[-1, 0] == pytest.approx(expected, rel=1e-9)


# Consistency -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("i", range(4), ids=CREEPS)
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_nis_of_the_own_model_is_chi_square(i: int, share: float, four: tuple[RecursiveFilter, ...]) -> None:
    T = 5000
    usable = holes(T, 5, share)
    found = LikelihoodBank(four).run(simulate(four[i], T, 11 + i), usable=usable, every=T)
    low, high = stats.chi2(usable.sum()).ppf([1e-4, 1.0 - 1e-4])
    assert low < found.nis[0, i] < high


def test_each_filter_wins_on_its_own_model(four: tuple[RecursiveFilter, ...]) -> None:
    # Fails if a filter is paired with the state, covariance or gain of another one.
    for i, f in enumerate(four):
        found = LikelihoodBank(four).run(simulate(f, 5000, 20 + i), every=5000)
        assert int(np.argmax(found.log_likelihood[0])) == i


# Laws ------------------------------------------------------------------------------------------------


@given(st.permutations(range(4)), st.integers(0, 100))
def test_order_of_filters_does_not_matter(
    four: tuple[RecursiveFilter, ...], order: list[int], seed: int
) -> None:
    z, usable = samples(300, seed), holes(300, seed, 0.05)
    expected = LikelihoodBank(four).run(z, usable=usable, every=10, window=5)
    permuted = LikelihoodBank([four[i] for i in order]).run(z, usable=usable, every=10, window=5)
    assert np.array_equal(permuted.log_likelihood, expected.log_likelihood[:, order])
    assert np.array_equal(permuted.nis, expected.nis[:, order])


@pytest.mark.parametrize("i", range(4), ids=CREEPS)
def test_company_does_not_matter(i: int, four: tuple[RecursiveFilter, ...]) -> None:
    # Alone a filter is not padded; among others it may be, and the others' missing steady state is theirs.
    z, usable = samples(300), holes(300, 2, 0.05)
    alone = LikelihoodBank([four[i]]).run(z, usable=usable, every=10)
    among = LikelihoodBank(four).run(z, usable=usable, every=10)
    assert among.log_likelihood[:, i] == pytest.approx(alone.log_likelihood[:, 0], rel=1e-11)


@given(st.integers(-20, 20), st.integers(-20, 20))
def test_units_of_the_measurements_shift_all_likelihoods_alike(
    four: tuple[RecursiveFilter, ...], a: int, b: int
) -> None:
    unit = 2.0 ** np.array([a, b])  # powers of two: rounding is the same in every unit
    scaled = [replace(f, H=unit[:, None] * f.H, R=f.R * np.outer(unit, unit)) for f in four]
    z = samples(300)
    expected, found = LikelihoodBank(four).run(z, every=10), LikelihoodBank(scaled).run(z * unit, every=10)
    assert found.nis == pytest.approx(expected.nis, rel=1e-9)
    shift = 10 * math.log(2.0) * (a + b)
    assert found.log_likelihood == pytest.approx(expected.log_likelihood - shift, rel=1e-9, abs=1e-6)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e9]))
def test_units_of_the_states_do_not_matter(
    four: tuple[RecursiveFilter, ...], seed: int, tolerance: float
) -> None:
    # All covariances moving, and all steady at once.
    rng = np.random.default_rng(seed)
    scaled = []
    for f in four:
        u = 10.0 ** rng.uniform(-3.0, 3.0, len(f.F))
        square = np.outer(u, u)
        scaled.append(
            replace(
                f,
                F=f.F * u[:, None] / u,
                H=f.H / u,
                Q=f.Q * square,
                start=f.start * u**2,
                P=None if f.P is None else f.P * square,
            )
        )
    z, usable = samples(300), holes(300, seed, 0.05)
    banks = (LikelihoodBank(filters, tolerance=tolerance) for filters in (scaled, four))
    found, expected = (bank.run(z, usable=usable, every=10).log_likelihood for bank in banks)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-3)


@given(st.integers(1, 20), st.integers(1, 8))
def test_rows_are_moving_sums(four: tuple[RecursiveFilter, ...], every: int, window: int) -> None:
    z, usable = samples(90), holes(90, 4)
    bank = LikelihoodBank(four)
    single, found = bank.run(z, usable=usable), bank.run(z, usable=usable, every=every, window=window)
    rows = 90 // every
    for name in ("log_likelihood", "nis", "measurements"):
        values, sums = getattr(single, name), getattr(found, name)
        assert len(sums) == rows
        for row in range(rows):
            first = max(0, row + 1 - window) * every
            assert sums[row] == pytest.approx(values[first : (row + 1) * every].sum(axis=0), rel=1e-11)


@given(st.integers(0, 299), st.sampled_from([math.nan, math.inf, 1e300]))
def test_what_is_not_usable_has_no_value(four: tuple[RecursiveFilter, ...], at: int, value: float) -> None:
    z, usable = samples(300), np.ones((300, 2), dtype=bool)
    usable[at, 1] = False
    broken = z.copy()
    broken[at, 1] = value
    bank = LikelihoodBank(four)
    found, expected = (bank.run(values, usable=usable, every=10) for values in (broken, z))
    assert np.array_equal(found.log_likelihood, expected.log_likelihood)
    assert not np.array_equal(found.log_likelihood, bank.run(z, every=10).log_likelihood)


def test_without_samples_nothing_is_learnt(four: tuple[RecursiveFilter, ...]) -> None:
    found = LikelihoodBank(four).run(samples(50), usable=np.zeros((50, 2), dtype=bool), every=10)
    assert not found.log_likelihood.any()
    assert not found.nis.any()


# Long runs -------------------------------------------------------------------------------------------


def test_a_long_gap_does_not_carry_an_unstable_filter_away(four: tuple[RecursiveFilter, ...]) -> None:
    # Through 200 s without samples the unstable model's covariance would grow by exp(1800).
    T, gap = 202_000, 200_000
    z, usable = samples(T), np.ones((T, 2), dtype=bool)
    z[gap:] = simulate(four[3], T - gap, 1)
    usable[1000:gap] = False
    found = LikelihoodBank(four).run(z, usable=usable, every=200)
    assert np.isfinite(found.log_likelihood).all()
    low, high = stats.chi2(3_600).ppf([1e-6, 1.0 - 1e-6])
    assert low < found.nis[-9:, 3].sum() < high


def test_covariances_stay_covariances(four: tuple[RecursiveFilter, ...]) -> None:
    # Undamped and unstable, moving all the time, with one sensor missing in turns.
    bank = LikelihoodBank([four[2], four[3]], tolerance=0.0)
    memory, T = bank.new_memory(), 100_000
    usable = np.ones((T, 2), dtype=bool)
    usable[::3, 0] = usable[1::7, 1] = False
    run(bank, memory, simulate(four[3], T, 8), usable)
    for P, f in zip(memory.P, bank.cells[0], strict=True):
        used = P[: len(f.F), : len(f.F)]
        scale = np.sqrt(np.diag(used))
        assert np.array_equal(P, P.T)
        assert linalg.eigvalsh(used / np.outer(scale, scale)).min() > -1e-9


# Mistakes --------------------------------------------------------------------------------------------


def other_sensors(f: RecursiveFilter) -> RecursiveFilter:
    return replace(f, R=2.0 * f.R)


def test_faulty_banks_are_refused(four: tuple[RecursiveFilter, ...]) -> None:
    with pytest.raises(ValueError, match=r"got no filters, expected at least one; design one first"):
        LikelihoodBank()
    with pytest.raises(ValueError, match=r"got no filters"):
        LikelihoodBank([])
    with pytest.raises(ValueError, match=r"got filters of different sensors, expected one set"):
        LikelihoodBank([four[0], other_sensors(four[1])])
    with pytest.raises(ValueError, match=r"other names or states in speed cell 1 than in the first"):
        LikelihoodBank(four, four[::-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"z": np.zeros((5, 3))}, r"got samples of shape \(5, 3\), expected \(T, 2\); check the sensors"),
        ({"z": np.zeros((5, 2)), "usable": np.ones((4, 2), bool)}, r"got usable of shape \(4, 2\)"),
        ({"z": np.zeros((5, 2)), "cells": np.zeros(4, int)}, r"cells of shape \(4,\) for samples"),
        ({"z": np.zeros((5, 2)), "cells": np.full(5, 1)}, r"got speed cells 1 to 1, expected 0 to 0"),
        ({"z": np.zeros((5, 2)), "every": 0}, r"got every = 0 and window = 1, expected both >= 1"),
        ({"z": np.zeros((5, 2)), "window": 0}, r"got every = 1 and window = 0, expected both >= 1"),
        ({"z": np.full((5, 2), math.nan)}, r"got a usable sample that is not finite"),
    ],
)
def test_faulty_samples_are_refused(
    arguments: dict[str, object], message: str, four: tuple[RecursiveFilter, ...]
) -> None:
    with pytest.raises(ValueError, match=message):
        LikelihoodBank(four).run(**arguments)  # type: ignore[arg-type]


def test_an_empty_record_has_no_rows(four: tuple[RecursiveFilter, ...]) -> None:
    assert LikelihoodBank(four).run(np.zeros((0, 2))).nis.shape == (0, 4)


def test_design_follows_the_steady_filter() -> None:
    import control

    model = control.ss([[-1.0]], [[1.0]], [[1.0], [2.0]], np.zeros((2, 1)))
    f = design_recursive(model, np.eye(1), np.eye(2), 0.1, start=np.array([3.0]), name="first order")
    assert f.P is not None
    assert f.start.tolist() == [3.0]
    bank = LikelihoodBank([f])
    S = f.H @ f.P @ f.H.T + f.R
    assert bank.design.K[0, 0] == pytest.approx(np.linalg.solve(S, f.H @ f.P).T)
    whitener = bank.design.whitener[0, 0]
    assert whitener @ S @ whitener.T == pytest.approx(np.eye(2), abs=1e-14)
