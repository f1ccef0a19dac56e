from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import stats

from estimator.bank import FilterBank
from estimator.kalman import LinearFilter, design_filter
from estimator.linear_models import OperatingPoint, filter_model
from estimator.tuning import NoiseModel, Tuning, negative_log_likelihood, tune

if TYPE_CHECKING:
    from collections.abc import Callable

    import control
    from numpy.typing import NDArray

    from fmu_wheelset.parameters import WheelsetParameters

    Array = NDArray[np.float64]
    Simulate = Callable[[LinearFilter, int, int], Array]

H = 1e-3
SAMPLES = 10_000
TRUTH = NoiseModel(track_rate=1.3e-5, acceleration=3e-2, lever=0.75, sensors=(1e-3, 0.05))
# Wrong by factors that a track class or a forgotten disturbance would bring.
PRIOR = replace(TRUTH, track_rate=8.0 * TRUTH.track_rate, acceleration=1e-4)


def design(model: control.StateSpace, noise: NoiseModel) -> LinearFilter:
    return design_filter(model, noise.W, noise.R, H, name="P1")


@pytest.fixture(scope="module")
def model(points: dict[str, OperatingPoint], wheelset: WheelsetParameters) -> control.StateSpace:
    return filter_model(points["P1"], wheelset)


@pytest.fixture(scope="module")
def best(model: control.StateSpace) -> LinearFilter:
    return design(model, TRUTH)


@pytest.fixture(scope="module")
def z(best: LinearFilter, simulate: Simulate) -> Array:
    return simulate(best, SAMPLES, 5)


@pytest.fixture(scope="module")
def tuned(model: control.StateSpace, z: Array) -> Tuning:
    return tune(model, PRIOR, z, H, name="P1")


def test_noise_model_gives_the_matrices_of_the_filter_model() -> None:
    assert pytest.approx(np.diag([1.3e-5, 3e-2, 3e-2 / 0.75**2])) == TRUTH.W
    assert pytest.approx(np.diag([1e-6, 2.5e-3])) == TRUTH.R


def test_likelihood_is_that_of_the_normal_distribution(best: LinearFilter, z: Array) -> None:
    e = FilterBank([best]).innovations(z)[300:, 0]
    reference = -np.mean(stats.multivariate_normal(np.zeros(2), best.S).logpdf(e))
    assert negative_log_likelihood(best, z, skip=300) == pytest.approx(reference, rel=1e-12)


def test_likelihood_of_the_innovations_is_that_of_the_whole_record(best: LinearFilter, z: Array) -> None:
    # The joint density of the first samples, from the state's covariance without any filter: the prediction
    # error decomposition holds only if F, H, P, S and K belong together.
    T = 40
    blocks = [[np.zeros((2, 2)) for _ in range(T)] for _ in range(T)]
    state = best.P
    for t in range(T):
        blocks[t][t] = best.H @ state @ best.H.T + best.R
        ahead = state
        for later in range(t + 1, T):
            ahead = best.F @ ahead
            blocks[later][t] = best.H @ ahead @ best.H.T
            blocks[t][later] = blocks[later][t].T
        state = best.F @ state @ best.F.T + best.Q
    joint = stats.multivariate_normal(np.zeros(2 * T), np.block(blocks))
    assert T * negative_log_likelihood(best, z[:T]) == pytest.approx(-joint.logpdf(z[:T].ravel()), rel=1e-7)


def test_tuned_filter_is_as_likely_as_the_true_one(tuned: Tuning, best: LinearFilter, z: Array) -> None:
    # Wilks: twice the gain in log-likelihood over the truth is chi-square with two degrees of freedom.
    gain = 2.0 * SAMPLES * (negative_log_likelihood(best, z) - tuned.cost)
    assert -0.1 < gain < stats.chi2(2).isf(1e-4)


def test_innovation_variance_is_the_optimum(tuned: Tuning, best: LinearFilter, z: Array) -> None:
    optimum = np.diag(best.S)
    assert np.diag(tuned.filter.S) == pytest.approx(optimum, rel=0.03)
    found = np.mean(FilterBank([tuned.filter]).innovations(z)[:, 0] ** 2, axis=0)
    assert found == pytest.approx(optimum, rel=5.0 * math.sqrt(2.0 / SAMPLES))


def test_track_intensity_is_recovered(
    tuned: Tuning, model: control.StateSpace, best: LinearFilter, z: Array
) -> None:
    # Standard error of ln(track_rate) from the curvature of the likelihood at the truth.
    step = 0.2
    costs = [
        negative_log_likelihood(design(model, replace(TRUTH, track_rate=TRUTH.track_rate * math.exp(x))), z)
        for x in (-step, 0.0, step)
    ]
    curvature = (costs[0] - 2.0 * costs[1] + costs[2]) / step**2
    deviation = 1.0 / math.sqrt(SAMPLES * curvature)
    assert deviation < 0.2
    # The acceleration is estimated beside it, which widens the marginal error.
    assert abs(math.log(tuned.noise.track_rate / TRUTH.track_rate)) < 8.0 * deviation


def test_tuning_is_never_worse_than_the_prior(tuned: Tuning, model: control.StateSpace, z: Array) -> None:
    assert tuned.cost < negative_log_likelihood(design(model, PRIOR), z)
    one = tune(model, PRIOR, z, H, name="P1", evaluations=1)
    assert one.cost <= negative_log_likelihood(design(model, PRIOR), z)


def test_tuning_reports_what_it_found(tuned: Tuning, model: control.StateSpace, z: Array) -> None:
    again = design(model, tuned.noise)
    assert np.array_equal(tuned.filter.K, again.K)
    assert tuned.cost == pytest.approx(negative_log_likelihood(again, z), rel=1e-12)
    assert tuned.noise.sensors == PRIOR.sensors
    assert tuned.noise.lever == PRIOR.lever
    assert 10 < tuned.evaluations <= 120


def test_the_maximum_gets_a_filter_too(
    points: dict[str, OperatingPoint], wheelset: WheelsetParameters, simulate: Simulate
) -> None:
    model = filter_model(points["P2"], wheelset)
    z = simulate(design(model, TRUTH), 2000, 6)
    tuned = tune(model, PRIOR, z, H, name="P1")
    assert tuned.filter.dropped == ("y_t", "y_rel")
    assert tuned.noise.acceleration == pytest.approx(TRUTH.acceleration, rel=0.5)


def test_the_search_turns_back_where_no_filter_exists(
    model: control.StateSpace, z: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit, refused = 2e-3, []  # below the true acceleration, so that the search runs into it

    def reluctant(model: control.StateSpace, W: Array, R: Array, h: float, *, name: str) -> LinearFilter:
        if W[1, 1] > limit:
            refused.append(W[1, 1])
            raise ValueError
        return design_filter(model, W, R, h, name=name)

    monkeypatch.setattr("estimator.tuning.design_filter", reluctant)
    tuned = tune(model, PRIOR, z, H, name="P1")
    assert refused
    assert limit / 2.0 < tuned.noise.acceleration <= limit
    assert tuned.cost < negative_log_likelihood(design(model, PRIOR), z)


# Mistakes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("samples", "skip"), [(99, 0), (500, 401), (0, 0)])
def test_a_short_record_is_refused(model: control.StateSpace, samples: int, skip: int) -> None:
    with pytest.raises(
        ValueError, match=f"got a training record of {samples} samples, .* least {skip + 100};"
    ):
        tune(model, PRIOR, np.zeros((samples, 2)), H, name="P1", skip=skip)


@pytest.mark.parametrize("fault", [math.nan, math.inf])
def test_a_broken_record_is_refused(model: control.StateSpace, z: Array, fault: float) -> None:
    broken = z[:500].copy()
    broken[200, 1] = fault
    with pytest.raises(ValueError, match=r"^P1: got a training record with NaN or infinity"):
        tune(model, PRIOR, broken, H, name="P1")


def test_a_record_of_other_sensors_is_refused(model: control.StateSpace) -> None:
    with pytest.raises(ValueError, match=r"expected \(T, 2\); check the sensors"):
        tune(model, PRIOR, np.zeros((500, 3)), H, name="P1")


def test_says_why_no_filter_can_be_designed() -> None:
    import control

    unseen = control.ss(np.diag([-1.0, -1.0]), np.ones((2, 3)), np.ones((2, 2)), np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"^twins: got an unobservable part that is a mixture"):
        tune(unseen, PRIOR, np.zeros((500, 2)), H, name="twins")
