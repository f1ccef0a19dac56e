from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg, stats

from estimator import ERRI_B176, CreepCurve, OperatingPoint
from estimator.identifiability import (
    SENSORS,
    SLOPES,
    Family,
    Process,
    Sensor,
    bound_of,
    cramer_rao,
    creep_bound,
    fisher_rate,
    fisher_window,
    peak_adhesion_bound,
    same_force,
    slope_family,
    spectrum,
    steady_covariance,
    wheelset_process,
    window_covariance,
)
from estimator.linear_models import point_at
from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

TRACK = ERRI_B176["erri_low"]
BOTH = ("yaw_rate", "lateral_acceleration")
SLOW = tuple(Sensor(s.output, s.noise / 5**0.5) for name in ("gyro", "accelerometer") for s in SENSORS[name])


def autoregression(phi: float, q: float) -> Family:
    """AR(1) with its coefficient and the variance of its noise as parameters."""
    one = np.ones((1, 1))
    process = Process(phi * one, q * one, one, 0.0 * one, 1.0, ("z",))
    zero = 0.0 * one
    return Family(
        process,
        np.array([one, zero]),
        np.array([zero, one]),
        np.array([zero, zero]),
        ("phi", "q"),
        np.ones(2),
    )


def is_psd(M: Array, slack: float = 1e-9) -> bool:
    return bool(np.all(np.linalg.eigvalsh(M) >= -slack * np.abs(M).max()))


# Fisher information ----------------------------------------------------------------------------------


@given(phi=st.floats(-0.95, 0.95), q=st.floats(1e-3, 1e3))
def test_autoregression_has_the_information_of_the_textbook(phi: float, q: float) -> None:
    # Box and Jenkins: 1/(1 - phi^2) and 1/(2 q^2) for each sample, and nothing between the two.
    expected = np.diag([1.0 / (1.0 - phi**2), 0.5 / q**2])
    assert fisher_rate(autoregression(phi, q)) == pytest.approx(expected, rel=1e-6, abs=1e-9 / q)


@given(phi=st.floats(-0.9, 0.9))
def test_a_window_of_an_autoregression(phi: float) -> None:
    # Exact likelihood of T samples: (T - 1) transitions and the first sample with variance q/(1 - phi^2).
    T, q = 12, 2.0
    first = 2.0 * phi**2 / (1.0 - phi**2) ** 2
    # Each transition carries E z^2/q.
    expected_phi = (T - 1) / (1.0 - phi**2) + first
    found = fisher_window(autoregression(phi, q), T, start="steady")
    assert found[0, 0] == pytest.approx(expected_phi, rel=1e-9)
    assert found[1, 1] == pytest.approx(0.5 * T / q**2, rel=1e-9)


def test_windows_from_rest_know_nothing_of_the_first_state() -> None:
    # z_0 = 0 for sure: with a little noise the rest are transitions alone.
    family = autoregression(0.5, 2.0)
    process = Process(family.process.F, family.process.Q, family.process.H, np.array([[1e-9]]), 1.0, ("z",))
    noisy = Family(process, family.dF, family.dQ, family.dH, family.names, family.scale)
    variance = np.cumsum([0.0, *(0.25**k for k in range(10))])  # E z_k^2/q
    assert fisher_window(noisy, 11)[0, 0] == pytest.approx(np.sum(variance[:-1]), rel=1e-6)


@pytest.mark.parametrize("i", [0, 1, 2])
def test_long_windows_gather_information_at_the_rate_of_the_spectra(family: Family, i: int) -> None:
    seen = family.select(BOTH)
    rate = fisher_rate(seen)[i]
    windows = [fisher_window(seen[i], 200 * T, start="steady") for T in (1, 3)]
    # The ends of a window weigh less and less; between 1 s and 3 s they cancel.
    assert (windows[1] - windows[0]) / 2.0 == pytest.approx(rate, rel=0.02)
    assert windows[1] / 3.0 == pytest.approx(rate, rel=0.12)


def test_faster_sampling_of_the_same_noise_density_tells_the_same(
    dry_points: tuple[OperatingPoint, ...],
) -> None:
    # The wheelset moves below 20 Hz: 200 Hz with less noise is as good as 1 kHz.
    rates = [
        fisher_rate(slope_family(dry_points, TRACK, 1e7, sensors=sensors, h=h))
        for sensors, h in ((SLOW, 5e-3), ([Sensor(s.output, s.noise * 5**0.5) for s in SLOW], 1e-3))
    ]
    assert rates[0] == pytest.approx(rates[1], rel=2e-4)


def test_more_noise_never_tells_more(family: Family) -> None:
    seen = family.select(BOTH)
    previous = fisher_rate(seen)
    for factor in (1.1, 2.0, 10.0):
        p = seen.process
        louder = Process(p.F, p.Q, p.H, p.R * factor**2, p.h, p.outputs)
        rate = fisher_rate(Family(louder, seen.dF, seen.dQ, seen.dH, seen.names, seen.scale))
        assert all(is_psd(a - b) for a, b in zip(previous, rate, strict=True))
        previous = rate


def test_one_more_sensor_never_loses_information(family: Family) -> None:
    outputs = family.process.outputs
    known = [fisher_rate(family.select(outputs[:count])) for count in range(1, len(outputs) + 1)]
    for few, many in itertools.pairwise(known):
        assert all(is_psd(b - a) for a, b in zip(few, many, strict=True))


def test_the_order_of_sensors_is_of_no_matter(family: Family) -> None:
    outputs = family.process.outputs
    assert fisher_rate(family.select(outputs[::-1])) == pytest.approx(fisher_rate(family), rel=1e-9)


def test_units_are_of_no_matter(family: Family) -> None:
    seen = family.select(BOTH)
    unit, p = np.array([180.0 / math.pi, 1e3]), seen.process
    H, R = unit[:, None] * p.H, np.diag(unit) @ p.R @ np.diag(unit)
    scaled = Family(
        Process(p.F, p.Q, H, R, p.h, p.outputs),
        seen.dF,
        seen.dQ,
        unit[:, None] * seen.dH,
        seen.names,
        seen.scale,
    )
    assert fisher_rate(scaled) == pytest.approx(fisher_rate(seen), rel=1e-9)


def test_an_estimator_reaches_the_bound_and_none_beats_it(dry: CreepCurve) -> None:
    # Maximum likelihood of the tangent with the secant known, over 2 s windows of the linear model.
    point, samples, runs = point_at(dry, "P", 0.3 * dry.peak_creep), 400, 400
    family = slope_family([point], TRACK, dry.initial_slope, sensors=SLOW, h=5e-3)[0]
    bound = 1.0 / math.sqrt(fisher_window(family, samples, start="steady")[0, 0])
    root = linalg.cholesky(window_covariance(family.process, samples, start="steady"), lower=True)
    z = root @ np.random.default_rng(3).standard_normal((root.shape[0], runs))
    slopes = point.g11 + bound * np.linspace(-4.0, 4.0, 17)
    cost = []
    for g11 in slopes:
        moved = OperatingPoint("moved", point.creep, point.force, g11, point.g22, point.v)
        covariance = window_covariance(
            wheelset_process(moved, TRACK, sensors=SLOW, h=5e-3), samples, start="steady"
        )
        L = linalg.cholesky(covariance, lower=True)
        cost.append(
            0.5 * np.sum(linalg.solve_triangular(L, z, lower=True) ** 2, axis=0) + np.sum(np.log(np.diag(L)))
        )
    best = np.argmin(cost, axis=0).clip(1, len(slopes) - 2)
    before, at, after = (np.array(cost)[best + k, np.arange(runs)] for k in (-1, 0, 1))
    estimate = slopes[best] + (slopes[1] - slopes[0]) * 0.5 * (before - after) / (before - 2.0 * at + after)
    spread = stats.chi2(runs - 1).ppf([1e-3, 1.0 - 1e-3]) / (runs - 1)
    # A finite window leaves the estimate a few per cent above the bound.
    assert spread[0] < np.var(estimate) / bound**2 < 1.2 * spread[1]
    assert abs(np.mean(estimate) - point.g11) < 0.3 * bound


# What cannot be known --------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["rest", "other"])
def test_nothing_is_known_at_the_peak(points: dict[str, OperatingPoint], start: str) -> None:
    family = slope_family([points["P2"]], TRACK, 1e7, sensors=SLOW, h=5e-3)
    assert np.isnan(fisher_rate(family)).all()
    P0 = np.zeros((9, 9))
    if start == "other":  # the track is on its way, the wheelset still at rest
        P0[7:, 7:] = steady_covariance(wheelset_process(points["P1"], TRACK, sensors=SLOW, h=5e-3))[7:, 7:]
    information = fisher_window(family[0], 200, start=P0)
    assert not information.any()
    bound = cramer_rao(information, SLOPES, family.scale)
    assert bound.std.tolist() == [math.inf, math.inf]
    assert bound.unknown == pytest.approx(np.eye(2))
    assert not bound.knowable


def test_motion_left_over_tells_the_tangent_at_the_peak(points: dict[str, OperatingPoint]) -> None:
    # The undamped yaw mode rings on, and its damping is the tangent.
    family = slope_family([points["P2"]], TRACK, 1e7, sensors=SLOW, h=5e-3)[0]
    P0 = np.zeros((9, 9))
    P0[3, 3] = 1e-4  # yaw rate, (rad/s)^2
    bound = cramer_rao(fisher_window(family, 200, start=P0), SLOPES, family.scale)
    assert bound.std[0] < 1e5


def test_past_the_peak_growth_tells_more_and_more(points: dict[str, OperatingPoint]) -> None:
    family = slope_family([points["P3"]], TRACK, 1e7, sensors=SLOW, h=5e-3)[0]
    short, long = (fisher_window(family, n) for n in (50, 150))
    assert is_psd(long - 10.0 * short)
    with pytest.raises(ValueError, match=r"^window: got an unstable process that outgrows its noise"):
        fisher_window(family, 800)


def test_a_direction_that_nothing_sees_is_told() -> None:
    # Only the sum of two parameters counts, whatever their units.
    for unit in (1.0, 1e6):
        scale = np.array([1.0, unit])
        information = 4.0 * np.outer(1.0 / scale, 1.0 / scale)
        bound = cramer_rao(information, ("a", "b"), scale)
        assert np.isinf(bound.std).all()
        assert bound.unknown == pytest.approx(np.array([[0.5, -0.5], [-0.5, 0.5]]))
        assert bound_of(information, 1.0 / scale, scale) == pytest.approx(0.5)
        assert bound_of(information, np.array([1.0, -1.0]) / scale, scale) == math.inf


@given(st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3), st.integers(0, 99))
def test_bounds_are_the_inverse_where_it_exists(values: list[float], seed: int) -> None:
    Q = stats.ortho_group(3, seed=seed).rvs()
    information = Q @ np.diag(values) @ Q.T
    bound = cramer_rao(information, ("a", "b", "c"), np.ones(3))
    assert bound.covariance == pytest.approx(np.linalg.inv(information), rel=1e-9, abs=1e-9)
    assert bound.std == pytest.approx(np.sqrt(np.diag(bound.covariance)))
    assert bound.knowable


# Creep and peak adhesion -----------------------------------------------------------------------------


def test_creep_is_bounded_as_if_it_were_the_parameter(dry: CreepCurve) -> None:
    point, step = point_at(dry, "P", 0.3 * dry.peak_creep), 1e-4
    family = slope_family([point], TRACK, dry.initial_slope, sensors=SLOW, h=5e-3)
    bound = creep_bound(dry, [point.creep], fisher_rate(family))[0]
    ahead, behind = (
        wheelset_process(point_at(dry, "P", point.creep * (1.0 + d)), TRACK, sensors=SLOW, h=5e-3)
        for d in (step, -step)
    )
    omega = np.linspace(1e-3, math.pi / 5e-3, 60_001)
    S = spectrum(family.process[0], omega)
    X = np.linalg.solve(S, (spectrum(ahead, omega) - spectrum(behind, omega)) / (2.0 * step * point.creep))
    density = np.einsum("wij,wji->w", X, X).real
    assert bound == pytest.approx(1.0 / math.sqrt(np.trapezoid(density, omega) / (2.0 * math.pi)), rel=2e-3)


def test_peak_adhesion_is_bounded_as_if_the_conditions_were_tried(dry: CreepCurve) -> None:
    # Two unknowns on the curve of constant force, by solving for the creep of each condition.
    creep, step = 0.3 * dry.peak_creep, 1e-4
    force = float(dry.force(creep))
    information = np.array([[3e-12, 1e-14], [1e-14, 4e-14]])

    def tried(d: Array) -> tuple[Array, float]:
        c = dry.condition
        changed = type(c)(
            mu_0=c.mu_0 * math.exp(d[0]), k_A=c.k_A * math.exp(d[1]), k_S=c.k_S * math.exp(d[1]), A=c.A, B=c.B
        )
        curve = CreepCurve(changed, dry.v)
        p = point_at(curve, "P", curve.creep_at(force / curve.N))
        return np.array([p.g11, p.g22]), curve.peak_adhesion

    pairs = [(tried(e), tried(-e)) for e in step * np.eye(2)]
    jacobian = np.column_stack([(a[0] - b[0]) / (2.0 * step) for a, b in pairs])
    gradient = np.array([(a[1] - b[1]) / (2.0 * step) for a, b in pairs])
    expected = math.sqrt(gradient @ np.linalg.solve(jacobian.T @ information @ jacobian, gradient))
    assert peak_adhesion_bound(dry, [creep], information[None])[0] == pytest.approx(expected, rel=1e-4)


def test_what_is_known_of_the_peak(dry: CreepCurve) -> None:
    information = np.array(3 * [[[3e-12, 1e-14], [1e-14, 4e-14]]])
    creeps = np.array([0.05, 0.1, 0.2]) * dry.peak_creep
    bounds = peak_adhesion_bound(dry, creeps, information)
    assert np.all(np.diff(bounds) < 0.0)  # the closer to the peak, the more
    assert peak_adhesion_bound(dry, creeps, 4.0 * information) == pytest.approx(bounds / 2.0)
    # Three unknowns, two slopes: nothing of the peak without knowing something of the rail beforehand.
    three = ("mu_0", "k_A", "k_S")
    assert np.all(peak_adhesion_bound(dry, creeps, information, unknown=three) == math.inf)
    sure, vague = (
        peak_adhesion_bound(dry, creeps, information, unknown=three, prior=dict.fromkeys(three, p))
        for p in (0.1, 0.5)
    )
    assert np.all((sure > 0.0) & (sure < vague) & (vague < math.inf))
    assert np.all(peak_adhesion_bound(dry, creeps, 0.0 * information, unknown=("mu_0",)) == math.inf)
    with pytest.raises(ValueError, match=r"^peak adhesion: got mu as unknown"):
        peak_adhesion_bound(dry, creeps, information, unknown=("mu",))
    with pytest.raises(ValueError, match=r"^peak adhesion: got k_A as unknown, .* priors of these only;"):
        peak_adhesion_bound(dry, creeps, information, unknown=("mu_0",), prior={"k_A": 0.1})


def test_only_rails_that_carry_the_force_are_left(low: CreepCurve, dry: CreepCurve) -> None:
    creep = 0.2 * low.peak_creep
    rivals = same_force(low, creep, CONDITIONS)
    assert set(rivals) == {"dry", "wet", "low"}
    assert rivals["low"].creep == pytest.approx(creep, rel=1e-9)
    for point in rivals.values():
        assert point.force == pytest.approx(float(low.force(creep)), rel=1e-9)
    assert set(same_force(dry, 0.5 * dry.peak_creep, CONDITIONS)) == {"dry"}


def test_bounds_of_unknown_information_are_unknown() -> None:
    information = np.array([np.eye(2), np.full((2, 2), np.nan)])
    bound = cramer_rao(information, ("a", "b"), np.ones(2))
    assert bound.std[0].tolist() == [1.0, 1.0]
    assert np.isnan(bound.std[1]).all()
    assert bound.knowable.tolist() == [True, False]
    assert np.isnan(bound_of(information, np.ones(2), np.ones(2))[1])
