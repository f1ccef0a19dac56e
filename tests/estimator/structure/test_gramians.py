from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, linalg

from estimator.contact import CreepCurve
from estimator.linear_models import full_model, operating_points
from estimator.structure import controllability_rank, gramians, modes
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)
#: Lags side by side, of gains and rates.
GAINS = np.array([1.0, 2.0, 5.0])
RATES = np.array([1.0, 3.0, 10.0])


def stable(rng: np.random.Generator, n: int) -> Array:
    A = rng.standard_normal((n, n))
    return A - (0.2 + np.linalg.eigvals(A).real.max()) * np.eye(n)


def test_first_order_lag(make) -> None:
    g = gramians(make([[-4.0]], [[3.0]], [[2.0]]))
    assert g.kind == "infinite"
    assert g.controllability == pytest.approx(9.0 / 8.0)
    assert g.observability == pytest.approx(4.0 / 8.0)
    assert g.hankel == pytest.approx(3.0 * 2.0 / 8.0)


def test_lags_in_parallel_have_cauchy_gramians(make) -> None:
    g = gramians(make(-np.diag(RATES), GAINS[:, None], np.ones((1, 3))))
    assert g.controllability == pytest.approx(np.outer(GAINS, GAINS) / np.add.outer(RATES, RATES))
    assert g.observability == pytest.approx(1.0 / np.add.outer(RATES, RATES))
    # With one input and one output the sum with signs is half the static gain.
    assert g.hankel[0] <= np.sum(GAINS / RATES) / 2.0 + 1e-12
    assert np.sum(g.hankel) == pytest.approx(np.sum(GAINS / RATES) / 2.0)  # all signs alike: relaxation


def test_an_all_pass_has_hankel_values_of_one(make) -> None:
    # (s - 1)(s - 4)/((s + 1)(s + 4)) - 1 in partial fractions.
    g = gramians(make(np.diag([-1.0, -4.0]), [[10.0 / 3.0], [-40.0 / 3.0]], [[1.0, 1.0]]))
    assert g.hankel == pytest.approx([1.0, 1.0])


@settings(max_examples=15)
@given(seeds)
def test_infinite_horizon_is_the_limit_of_finite_ones(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = make(stable(rng, 4), rng.standard_normal((4, 2)), rng.standard_normal((1, 4)))
    forever, long = gramians(model), gramians(model, horizon=200.0)
    assert (forever.kind, long.kind) == ("infinite", "finite")
    for name in ("controllability", "observability", "hankel"):
        a, b = getattr(forever, name), getattr(long, name)
        assert b == pytest.approx(a, abs=1e-9 * np.abs(a).max())


@settings(max_examples=15)
@given(seeds, st.floats(0.05, 3.0))
def test_finite_horizon_is_the_integral(make, seed: int, horizon: float) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((3, 3)), rng.standard_normal((3, 1)), rng.standard_normal((2, 3))
    g = gramians(make(A, B, C), horizon=horizon)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    times, weights = horizon / 2.0 * (1.0 + nodes), horizon / 2.0 * weights
    P = np.tensordot(weights, [_square(linalg.expm(A * t) @ B) for t in times], axes=1)
    Q = np.tensordot(weights, [_square(linalg.expm(A.T * t) @ C.T) for t in times], axes=1)
    assert g.controllability == pytest.approx(P, abs=1e-8 * np.abs(P).max())
    assert g.observability == pytest.approx(Q, abs=1e-8 * np.abs(Q).max())


def _square(M: Array) -> Array:
    return np.asarray((M @ M.conj().T).real)


@pytest.mark.parametrize("seed", range(3))
def test_the_split_is_the_integral_over_all_frequencies(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = linalg.block_diag(stable(rng, 2), -stable(rng, 2)) + np.triu(rng.standard_normal((4, 4)), 2)
    B, C = rng.standard_normal((4, 1)), rng.standard_normal((1, 4))
    g = gramians(make(A, B, C))
    assert g.kind == "split"

    def density(angle: float, F: Array, G: Array) -> Array:
        w = np.tan(angle)
        return _square(np.linalg.solve(1j * w * np.eye(4) - F, G)) * (1.0 + w**2) / np.pi

    for found, F, G in ((g.controllability, A, B), (g.observability, A.T, C.T)):
        expected = integrate.quad_vec(lambda x, F=F, G=G: density(x, F, G), 0.0, np.pi / 2.0, epsrel=1e-9)[0]
        assert found == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_least_energy_reaches_a_state(make) -> None:
    # A mass at rest moved by z and at rest again after T takes 12 m^2 z^2/T^3.
    m, z, T = 3.0, 0.5, 2.0
    P = gramians(make([[0, 1], [0, 0]], [[0], [1.0 / m]]), horizon=T).controllability
    x = np.array([z, 0.0])
    assert x @ np.linalg.solve(P, x) == pytest.approx(12.0 * m**2 * z**2 / T**3)


def test_samples_sum_to_gramians_too(make) -> None:
    model = make([[0.5, 0.1], [0.0, 0.9]], [[1.0], [2.0]], [[1.0, 1.0]], dt=0.1)
    forever, long = gramians(model), gramians(model, horizon=50.0)
    assert long.controllability == pytest.approx(forever.controllability)
    grows = gramians(make([[2.0]], [[3.0]], [[1.0]], dt=0.1))
    # Backwards in time x- = x/2 - 3/2 u.
    assert grows.kind == "split"
    assert grows.controllability == pytest.approx(2.25 / (1.0 - 0.25))


@given(seeds)
def test_hankel_values_know_no_units_of_states(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = stable(rng, 3), rng.standard_normal((3, 1)), rng.standard_normal((1, 3))
    s = 10.0 ** rng.uniform(-5, 5, 3)
    here, there = gramians(make(A, B, C)), gramians(make(A / s[:, None] * s, B / s[:, None], C * s))
    assert there.hankel == pytest.approx(here.hankel, rel=1e-5, abs=1e-7 * here.hankel[0])
    assert there.controllability * np.outer(s, s) == pytest.approx(here.controllability, rel=1e-5)


@pytest.mark.parametrize(
    ("A", "horizon", "match"),
    [
        ([[0.0]], None, r"modes that neither decay nor grow: 0.*\(x\[0\]\)"),
        ([[0, 2.0], [-2.0, 0]], None, "give a finite horizon"),
        ([[-1.0]], 0.0, "expected a finite time > 0"),
        ([[-1.0]], np.inf, "leave it out for an infinite one"),
        ([[50.0]], 100.0, "a growing mode overflows"),
    ],
)
def test_what_has_no_gramian_is_told(make, A, horizon, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        gramians(make(A), horizon=horizon)


# slycot ----------------------------------------------------------------------------------------------


def test_slycot_and_scipy_agree(wheelset: WheelsetParameters) -> None:
    """Lyapunov equations and ranks on the torque-driven wheelset, stable, growing and textbook models."""
    slycot = pytest.importorskip("slycot")
    for condition in CONDITIONS:
        for point in operating_points(CreepCurve(CONDITIONS[condition], 20.0)):
            model = full_model(point, wheelset)
            if any(mode.behaviour == "undamped" for mode in modes(model)):
                continue
            a, b = (gramians(model, method=method) for method in ("slycot", "scipy"))
            assert a.kind == b.kind
            assert a.hankel == pytest.approx(b.hankel, rel=1e-6, abs=1e-9 * b.hankel[0])
            assert gramians(model).hankel == pytest.approx(a.hankel, rel=1e-6, abs=1e-9 * a.hankel[0])
    A = np.diag([-1.0, -2.0, -3.0, -4.0]) + np.eye(4, k=-1)
    for entries in ([1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]):
        B = np.array(entries, dtype=float)[:, None]
        import control

        ours = controllability_rank(control.ss(A, B, np.eye(4), 0)).rank
        assert slycot.ab01nd(4, 1, A.copy(), B.copy(), tol=1e-12)[2] == ours
