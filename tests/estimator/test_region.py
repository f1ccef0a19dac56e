from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.coloured import Disturbances, coloured_filter
from estimator.contact import KNEE_SLOPE, CreepCurve
from estimator.finite_amplitude import averaged_point
from estimator.linear_models import point_at
from estimator.log import Log
from estimator.region import HYPOTHESES, REGIONS, RegionBank, RegionHypothesis
from estimator.sensor_noise import SensorNoise
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LOW = ERRI_B176["erri_low"]
H = 1e-3
THREE = (
    RegionHypothesis("P1", "linear", 1.0, 0.1),
    RegionHypothesis("P2", "peak", 1.0),
    RegionHypothesis("P3", "unstable", 1.0, 2.0),
)


# Slopes averaged over the motion ---------------------------------------------------------------------


@given(st.sampled_from([0.05, 0.3, 0.9, 1.5]), st.floats(5.0, 80.0))
def test_small_swings_see_tangent_and_secant(multiple: float, v: float) -> None:
    curve = CreepCurve(CONDITIONS["dry"], v)
    creep = multiple * curve.peak_creep
    exact = point_at(curve, "P", creep)
    found = averaged_point(curve, "P", creep, 1e-4 * creep, WheelsetParameters())
    assert found.force == pytest.approx(exact.force, rel=1e-5)
    assert found.g11 == pytest.approx(exact.g11, rel=1e-4, abs=1e-5 * curve.initial_slope)
    assert found.g22 == pytest.approx(exact.g22, rel=1e-4)
    assert averaged_point(curve, "P", creep, 0.0, WheelsetParameters()) == exact


def test_averaged_slopes_are_the_first_harmonic_of_the_forces(dry: CreepCurve) -> None:
    # By another quadrature over one period.
    creep, a, p = 0.03, 0.012, WheelsetParameters()
    found = averaged_point(dry, "P", creep, a, p)
    phi = np.linspace(0.0, 2.0 * math.pi, 20001)
    b = a * dry.v / (p.L_g * math.sqrt(p.k_w / p.I_w))
    f_x, f_y = dry.forces(creep + a * np.sin(phi), b * np.cos(phi))
    assert found.g11 == pytest.approx(np.trapezoid(f_x * np.sin(phi), phi) / (math.pi * a), rel=1e-9)
    assert found.g22 == pytest.approx(np.trapezoid(f_y * np.cos(phi), phi) / (math.pi * b), rel=1e-9)


def test_without_a_yaw_spring_there_is_no_swing_across(dry: CreepCurve) -> None:
    found = averaged_point(dry, "P", 0.01, 1e-6, WheelsetParameters(k_w=0.0))
    assert found.g22 == pytest.approx(float(dry.secant(0.01)), rel=1e-6)


def test_growth_past_the_peak_ends_in_a_limit_cycle(dry: CreepCurve) -> None:
    creep = 1.7 * dry.peak_creep
    slopes = [
        averaged_point(dry, "P", creep, x * dry.peak_creep, WheelsetParameters()).g11
        for x in np.linspace(0.0, 1.5, 30)
    ]
    assert slopes[0] < 0.0 < slopes[-1]
    assert np.sum(np.diff(np.sign(slopes)) != 0) == 1


# The bank --------------------------------------------------------------------------------------------


def bank(dry: CreepCurve, **options: object) -> RegionBank:
    return RegionBank(dry, WheelsetParameters(), SensorNoise(), LOW, H, **options)  # type: ignore[arg-type]


def log_of(z: Array, v: float = 20.0, usable: NDArray[np.bool_] | None = None) -> Log:
    return Log(
        time=H * np.arange(len(z)),
        yaw_rate=z[:, 0],
        lateral_acceleration=z[:, 1],
        speed=np.full(len(z), v),
        usable=usable,
    )


def samples_at(curve: CreepCurve, creep: float, T: int, seed: int) -> Array:
    """Samples of the linear model, started at rest in the middle of the track."""
    point = averaged_point(curve, "truth", creep, 0.015 * curve.peak_creep, WheelsetParameters())
    f = coloured_filter(point, WheelsetParameters(), Disturbances(LOW), H)
    rng = np.random.default_rng(seed)
    U, d, _ = np.linalg.svd(f.Q)
    w = rng.standard_normal((T, len(f.F))) @ (U * np.sqrt(d)).T
    z = rng.standard_normal((T, 2)) * np.sqrt(np.diag(f.R))
    x = np.zeros(len(f.F))
    for t in range(T):
        z[t] += f.H @ x
        x = f.F @ x + w[t]
    return z


@pytest.mark.parametrize("v", [20.0, 60.0])
def test_region_is_found_on_samples_of_the_model(v: float, dry: CreepCurve) -> None:
    curve = replace(dry, v=v)
    creeps = {0.3 * curve.knee_creep: 0, curve.knee_creep: 1, curve.peak_creep: 1, 1.7 * curve.peak_creep: 2}
    all_regions = bank(dry, every=0.1)
    for seed, (creep, region) in enumerate(creeps.items()):
        said = all_regions.run(log_of(samples_at(curve, creep, 2000, seed), v))
        assert np.all(said.region[10:] == region)
        assert said.p_region.sum(axis=1) == pytest.approx(np.ones(20), rel=1e-12)
        if region < 2:  # an unstable linear model soon swings further than the curve allows
            assert said.nis[10:] == pytest.approx(np.ones(10), abs=0.15)


def test_rows_end_where_their_window_ends(dry: CreepCurve) -> None:
    said = bank(dry, window=0.5, every=0.05, hypotheses=THREE).run(log_of(np.zeros((1025, 2))))
    assert said.time == pytest.approx(0.05 * np.arange(1, 21) - H)
    assert said.log_likelihood.shape == (20, 3)
    assert said.hypotheses == THREE


@settings(max_examples=5)
@given(st.permutations(range(len(HYPOTHESES))))
def test_order_of_hypotheses_does_not_matter(dry: CreepCurve, order: list[int]) -> None:
    log = log_of(samples_at(dry, dry.knee_creep, 300, 5))
    expected = bank(dry, window=0.1, every=0.1).run(log)
    shuffled = [HYPOTHESES[i] for i in order]
    found = bank(dry, window=0.1, every=0.1, hypotheses=shuffled).run(log)
    assert np.array_equal(found.log_likelihood, expected.log_likelihood[:, order])
    assert found.p_region == pytest.approx(expected.p_region, rel=1e-9, abs=1e-300)


def test_a_hypothesis_said_twice_counts_once(dry: CreepCurve) -> None:
    log = log_of(samples_at(dry, dry.knee_creep, 300, 5))
    once = bank(dry, window=0.1, every=0.1, hypotheses=THREE).run(log)
    twice = bank(dry, window=0.1, every=0.1, hypotheses=[*THREE, THREE[1]]).run(log)
    assert twice.p_region == pytest.approx(once.p_region, rel=1e-9)


def test_filters_follow_the_speed(dry: CreepCurve) -> None:
    # A log in which the speed changes is that of its parts, but for the start of the second one.
    z = np.vstack([samples_at(dry, 0.3 * dry.knee_creep, 1000, 1), np.zeros((1000, 2))])
    fast = replace(dry, v=40.0)
    z[1000:] = samples_at(fast, 0.3 * fast.knee_creep, 1000, 2)
    log = replace(log_of(z), speed=np.repeat([20.0, 40.0], 1000))
    said = bank(dry, window=0.2, every=0.1).run(log)
    alone = bank(dry, window=0.2, every=0.1).run(log_of(z[:1000]))
    assert np.array_equal(said.p_region[:10], alone.p_region)
    assert said.nis[-5:] == pytest.approx(np.ones(5), abs=0.25)
    wrong = bank(dry, window=0.2, every=0.1).run(log_of(z))
    assert said.log_likelihood[-1].max() > wrong.log_likelihood[-1].max()


def test_nothing_measured_says_nothing(dry: CreepCurve) -> None:
    log = log_of(np.full((200, 2), math.nan))
    said = bank(dry, window=0.1, every=0.1, hypotheses=THREE).run(log)
    assert said.p_region == pytest.approx(np.full((2, 3), 1.0 / 3.0))
    assert np.isnan(said.nis).all()


def test_hypotheses_lie_in_their_regions() -> None:
    for condition in CONDITIONS.values():
        for v in (10.0, 40.0, 80.0):
            curve = CreepCurve(condition, v)
            for x in HYPOTHESES:
                slope = float(curve.tangent(x.creep(curve))) / curve.initial_slope
                if x.region == "linear":
                    assert slope > KNEE_SLOPE
                elif x.region == "peak":
                    assert -1e-9 < slope <= KNEE_SLOPE * (1.0 + 1e-9)
                else:
                    assert slope < 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hypotheses": THREE[:2]}, r"got no hypothesis for unstable, expected one of each region"),
        ({"every": 0.0015}, r"every: got 0.0015 s, expected a whole number of samples of 0.001 s"),
        ({"every": 0.3}, r"window: got 1 s, expected a whole number of rows of 0.3 s"),
    ],
)
def test_faulty_banks_are_refused(options: dict[str, object], message: str, dry: CreepCurve) -> None:
    with pytest.raises(ValueError, match=message):
        bank(dry, **options)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("P", "steep", 0.0), r"^hypothesis P: got region 'steep'"),
        (("P", "peak", 1.5), r"towards_peak = 1.5 and multiple = 1, expected one of linear, peak, unstable"),
        (("P", "peak", 1.0, 0.0), r"multiple = 0, expected"),
    ],
)
def test_faulty_hypotheses_are_refused(values: tuple[str, str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RegionHypothesis(*values)


def test_logs_of_other_steps_and_standing_wheelsets_are_refused(dry: CreepCurve) -> None:
    log = log_of(np.zeros((100, 2)))
    with pytest.raises(ValueError, match=r"got a log with a step of 0.002 s, expected 0.001 s"):
        bank(dry).run(replace(log, time=2.0 * log.time))
    with pytest.raises(ValueError, match=r"got a speed of 0 m/s, expected more than 0"):
        bank(dry).run(replace(log, speed=np.zeros(100)))
    assert REGIONS == ("linear", "peak", "unstable")
