from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg, stats

from estimator import ERRI_B176
from estimator.identifiability import (
    Family,
    Process,
    Rates,
    divergence_rates,
    error_of_many,
    error_probability,
    innovation_rates,
    innovation_sums,
    limit,
    ranking,
    stack,
    steady_covariance,
    wheelset_process,
    window_covariance,
    window_needed,
    window_rates,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from estimator import OperatingPoint

    Array = NDArray[np.float64]
    Autoregression = Callable[[float, float], Process]

BOTH = ("yaw_rate", "lateral_acceleration")
coefficients, variances = st.floats(-0.9, 0.9), st.floats(0.1, 10.0)


# Distances -------------------------------------------------------------------------------------------


@given(coefficients, variances, coefficients, variances)
def test_autoregressions_diverge_as_in_the_textbook(
    autoregression: Autoregression, phi_p: float, q_p: float, phi_q: float, q_q: float
) -> None:
    # The prediction error of q's coefficient under p has variance q_p + (phi_p - phi_q)^2 var z.
    error = q_p + (phi_p - phi_q) ** 2 * q_p / (1.0 - phi_p**2)
    expected = 0.5 * (math.log(q_q / q_p) + error / q_q - 1.0)
    rates = divergence_rates(autoregression(phi_p, q_p), autoregression(phi_q, q_q))
    assert rates.forward == pytest.approx(expected, rel=1e-6, abs=1e-9)


@given(variances, variances)
def test_chernoff_of_white_noise(autoregression: Autoregression, q_p: float, q_q: float) -> None:
    p, q = autoregression(0.0, q_p), autoregression(0.0, q_q)
    rates = divergence_rates(p, q)
    s = np.linspace(0.0, 1.0, 2001)
    distance = 0.5 * (np.log((1.0 - s) * q_q + s * q_p) - (1.0 - s) * math.log(q_q) - s * math.log(q_p))
    assert rates.chernoff == pytest.approx(distance.max(), rel=1e-5, abs=1e-12)
    assert rates.bhattacharyya == pytest.approx(distance[1000], rel=1e-9, abs=1e-12)


def test_spectra_and_filters_give_the_same_rates(pair: tuple[Process, Process]) -> None:
    rates = divergence_rates(*pair)
    filters = innovation_rates(*pair, s=float(rates.exponent))
    assert filters.forward == pytest.approx(rates.forward, rel=1e-6)
    assert filters.backward == pytest.approx(rates.backward, rel=1e-6)
    assert filters.chernoff == pytest.approx(rates.chernoff, rel=1e-6)
    assert innovation_rates(*pair).chernoff == pytest.approx(rates.bhattacharyya, rel=1e-6)


def test_windows_and_filters_give_the_same_distances(pair: tuple[Process, Process]) -> None:
    p, q = pair
    n = 60
    window = window_rates(p, q, n, starts=("steady", "rest"))
    sums = innovation_sums(p, q, n, s=float(window.exponent), starts=(steady_covariance(p), None))
    for name in ("forward", "backward", "chernoff"):
        assert getattr(sums, name)[-1] == pytest.approx(n * p.h * getattr(window, name), rel=1e-8)
    assert np.all(np.diff(sums.forward) > 0.0)


def test_windows_past_the_peak_by_filters(points: dict[str, OperatingPoint]) -> None:
    p2, p3 = (wheelset_process(points[name], ERRI_B176["erri_low"], h=5e-3) for name in ("P2", "P3"))
    window, sums = window_rates(p2, p3, 100), innovation_sums(p2, p3, 100)
    assert sums.forward[-1] == pytest.approx(0.5 * window.forward, rel=1e-6)
    assert sums.backward[-1] == pytest.approx(0.5 * window.backward, rel=1e-6)
    assert np.isnan(divergence_rates(p2, p3).chernoff)
    with pytest.raises(ValueError, match=r"^innovation rates: got a process with modes that do not decay"):
        innovation_rates(p2, p3)


def test_rates_are_what_long_windows_gain(pair: tuple[Process, Process]) -> None:
    rates = divergence_rates(*pair)
    totals = [
        n * pair[0].h * np.hstack([w.forward, w.bhattacharyya])
        for n in (200, 600)
        for w in [window_rates(*pair, n, starts=("steady", "steady"))]
    ]
    assert (totals[1] - totals[0]) / 2.0 == pytest.approx(
        np.hstack([rates.forward, rates.bhattacharyya]), rel=0.02
    )


def test_mean_log_likelihood_ratio_is_the_divergence(pair: tuple[Process, Process]) -> None:
    n, runs = 200, 2000
    a, b = (window_covariance(x, n, start="steady") for x in pair)
    roots = [linalg.cholesky(x, lower=True) for x in (a, b)]
    z = roots[0] @ np.random.default_rng(1).standard_normal((2 * n, runs))
    cost = [
        0.5 * np.sum(linalg.solve_triangular(L, z, lower=True) ** 2, axis=0) + np.sum(np.log(np.diag(L)))
        for L in roots
    ]
    ratio = cost[1] - cost[0]
    expected = n * pair[0].h * window_rates(*pair, n, starts=("steady", "steady")).forward
    assert np.mean(ratio) == pytest.approx(expected, abs=5.0 * np.std(ratio) / math.sqrt(runs))


def test_distances_do_not_care_who_is_first(pair: tuple[Process, Process]) -> None:
    ahead, back = divergence_rates(*pair), divergence_rates(*pair[::-1])
    assert ahead.forward == pytest.approx(back.backward, rel=1e-9)
    assert ahead.chernoff == pytest.approx(back.chernoff, rel=1e-9)
    assert ahead.exponent == pytest.approx(1.0 - back.exponent, abs=1e-6)
    assert 0.0 < ahead.bhattacharyya <= ahead.chernoff < min(ahead.forward, ahead.backward)
    same = divergence_rates(pair[0], pair[0])
    assert (same.forward, same.chernoff) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.0, abs=1e-12))


def test_more_noise_tells_less_and_more_sensors_tell_more(family: Family) -> None:
    p, q = family.process[0], family.process[1]
    seen = [divergence_rates(p.select(p.outputs[:n]), q.select(p.outputs[:n])) for n in (1, 2, 3, 4, 5)]
    assert np.all(np.diff([r.chernoff for r in seen]) >= -1e-9)
    louder = [divergence_rates(replace(p, R=k * p.R), replace(q, R=k * q.R)) for k in (1.0, 2.0, 9.0)]
    assert np.all(np.diff([r.forward for r in louder]) < 0.0)
    turned = divergence_rates(p.select(p.outputs[::-1]), q.select(p.outputs[::-1]))
    assert turned.chernoff == pytest.approx(seen[-1].chernoff, rel=1e-9)


def test_a_batch_of_pairs_at_once(family: Family) -> None:
    seen = family.select(BOTH).process
    order = stack([seen[i] for i in (1, 2, 0)])
    together = divergence_rates(seen, order)
    for i, j in enumerate((1, 2, 0)):
        assert together[i].chernoff == pytest.approx(divergence_rates(seen[i], seen[j]).chernoff, rel=1e-6)


@pytest.mark.parametrize("function", [divergence_rates, innovation_rates])
def test_pairs_must_be_alike(function: Callable[..., object], pair: tuple[Process, Process]) -> None:
    with pytest.raises(ValueError, match=r"^pair of processes: got .* every 0.005 s and .* every 0.01 s"):
        function(pair[0], replace(pair[1], h=0.01))


# Decisions -------------------------------------------------------------------------------------------


def test_estimated_error_is_that_of_the_likelihood_ratio(pair: tuple[Process, Process]) -> None:
    # The log-likelihood ratio is a sum of chi-squares with the eigenvalues of S_q^-1 S_p.
    rng, runs = np.random.default_rng(2), 60_000
    for n in (6, 20, 60):
        a, b = (window_covariance(x, n, start="steady") for x in pair)
        ratio = linalg.eigh(a, b, eigvals_only=True)
        chi = rng.standard_normal((runs, ratio.size)) ** 2
        under_p = 0.5 * chi @ (ratio - 1.0) - 0.5 * np.sum(np.log(ratio))
        under_q = 0.5 * chi @ (1.0 - 1.0 / ratio) - 0.5 * np.sum(np.log(ratio))
        share = 0.5 * (np.mean(under_p < 0.0) + np.mean(under_q > 0.0))
        found = error_probability(window_rates(*pair, n, starts=("steady", "steady")), n * pair[0].h)
        assert found.lower < share < found.upper
        assert found.estimate == pytest.approx(share, rel=0.05, abs=4.0 * math.sqrt(share / runs))


def gaussian(d: float) -> Rates:
    """Two normal distributions a distance d apart, after T samples: all is known in closed form."""
    values = {"forward": d * d / 2.0, "backward": d * d / 2.0, "chernoff": d * d / 8.0, "exponent": 0.5}
    return Rates(
        **{k: np.asarray(v) for k, v in {**values, "curvature": d * d, "bhattacharyya": d * d / 8.0}.items()}
    )


@given(d=st.floats(1e-3, 3.0), T=st.floats(0.01, 100.0))
def test_error_of_shifted_normals_is_exact(d: float, T: float) -> None:
    found = error_probability(gaussian(d), T)
    assert found.estimate == pytest.approx(stats.norm.sf(d * math.sqrt(T) / 2.0), rel=1e-9)
    assert found.lower <= found.estimate <= found.upper


@given(d=st.floats(0.01, 10.0), error=st.floats(1e-9, 0.49))
def test_the_window_needed_brings_the_error_wanted(d: float, error: float) -> None:
    window = float(window_needed(gaussian(d), error))
    assert error_probability(gaussian(d), window).estimate == pytest.approx(error, rel=1e-6)


def test_no_window_is_enough_for_twins() -> None:
    assert window_needed(gaussian(0.0), 0.05) == math.inf
    unknown = Rates(**dict.fromkeys(Rates.__dataclass_fields__, np.array(math.nan)))
    assert np.isnan(window_needed(unknown, 0.05))
    assert np.isnan(error_probability(unknown, 1.0).estimate)
    with pytest.raises(ValueError, match="guessing errs in one of two"):
        window_needed(gaussian(1.0), 0.5)


def test_many_hypotheses_err_more_than_two() -> None:
    # Three normals in a row, one apart: errors of the best decision in closed form.
    T = 9.0
    pairs = error_probability(
        Rates(
            **{
                n: np.array([getattr(gaussian(d), n) for d in (1.0, 1.0, 2.0)])
                for n in Rates.__dataclass_fields__
            }
        ),
        T,
    )
    exact = (4.0 / 3.0) * stats.norm.sf(1.5)
    found = error_of_many(pairs, 3)
    assert found.lower < exact < found.upper
    assert found.estimate == pytest.approx(exact, rel=0.05)
    assert error_of_many(error_probability(gaussian(0.0), T * np.ones(3)), 3).upper == pytest.approx(
        2.0 / 3.0
    )
    alone = error_probability(gaussian(1.0), T * np.ones(1))
    assert error_of_many(alone, 2).estimate == pytest.approx(alone.estimate[0])
    with pytest.raises(ValueError, match=r"^pairs: got \(3,\) of 4 hypotheses, expected \(6,\);"):
        error_of_many(pairs, 4)


# Sensor design ---------------------------------------------------------------------------------------


def test_the_limit_of_the_noise() -> None:
    # Samples a distance d apart in noise: d/noise is what counts, and the error sets it.
    error, window = 0.01, 4.0
    expected = math.sqrt(window) / (2.0 * stats.norm.isf(error))
    found = limit(
        lambda noise: gaussian(1.0 / noise), error=error, window=window, bounds=(1e-3, 1e3), better="less"
    )
    assert found == pytest.approx(expected, rel=2e-3)
    assert found <= expected  # what is allowed is allowed
    rate = limit(
        lambda n: gaussian(math.sqrt(n)), error=error, window=window, bounds=(1e-3, 1e3), better="more"
    )
    assert rate == pytest.approx(1.0 / expected**2, rel=2e-3)
    assert rate >= 1.0 / expected**2


def test_limits_outside_of_the_range() -> None:
    far, near = (lambda noise: gaussian(1.0 / noise)), {"error": 0.01, "window": 4.0}
    assert limit(far, **near, bounds=(1e-3, 1e-2), better="less") == 1e-2
    assert math.isnan(limit(far, **near, bounds=(1e2, 1e3), better="less"))
    with pytest.raises(ValueError, match=r"^sensor design: got bounds \(2, 1\)"):
        limit(far, **near, bounds=(2, 1), better="less")


def test_the_set_that_tells_most_comes_first() -> None:
    found = ranking({"deaf": gaussian(0.1), "sharp": gaussian(2.0), "fair": gaussian(1.0)})
    assert [name for name, _ in found] == ["sharp", "fair", "deaf"]
    assert found[0][1] == pytest.approx(0.5)
