"""Ranks, margins and distances: what inputs reach and outputs see."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import linalg

from estimator.structure import (
    LinearSystem,
    Scales,
    analyse,
    controllability_margins,
    controllability_rank,
    distance_to_uncontrollable,
    distance_to_unobservable,
    observability_margins,
    observability_rank,
    scaled,
)
from estimator.structure.distance import _floors, local_minimum, nearest_loss, smallest_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

logs = st.floats(-5.0, 5.0)
seeds = st.integers(0, 2**32 - 1)

#: Two pendulums on one cart: where they are equal, no push on the cart makes them swing apart.
EQUAL, UNEQUAL = (
    np.array([[0, 1, 0, 0], [-a, 0, 0, 0], [0, 0, 0, 1], [0, 0, -b, 0]]) for a, b in ((9.0, 9.0), (9.0, 4.0))
)
PUSH = np.array([[0.0], [1.0], [0.0], [1.0]])


# Ranks and margins -----------------------------------------------------------------------------------


def test_two_pendulums_on_one_cart(make) -> None:
    assert controllability_rank(make(UNEQUAL, PUSH)).full
    equal = controllability_rank(make(EQUAL, PUSH))
    assert (equal.rank, equal.full) == (2, False)
    assert equal.singular_values[2:] == pytest.approx(0.0, abs=equal.tolerance)
    # What cannot be reached is that they swing against each other.
    assert pytest.approx(0.0, abs=1e-12) == equal.hidden.T @ [1, 0, 1, 0]
    assert equal.hidden.T @ PUSH[:, 0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("A", "B", "rank", "hidden"),
    [
        ([[-1, 0], [0, -2]], [[1], [0]], 1, ("x[1]",)),
        ([[-1, 0], [1, -2]], [[1], [0]], 2, ()),
        ([[-1, 1], [0, -2]], [[1], [0]], 1, ("x[1]",)),
        ([[0, 1], [0, 0]], [[0], [1]], 2, ()),
        ([[0, 1], [0, 0]], [[0], [0]], 0, ("x[0]", "x[1]")),
        ([[0, 0], [0, 0]], [[1, 0], [0, 1]], 2, ()),
    ],
)
def test_textbook_ranks(make, A, B, rank: int, hidden: tuple[str, ...]) -> None:
    model = make(A, B)
    found = controllability_rank(model)
    assert (found.rank, found.hidden_states) == (rank, hidden)
    lost = [m.lost for m in controllability_margins(model)]
    assert any(lost) == (rank < 2)
    assert (distance_to_uncontrollable(model).value < 1e-14) == (rank < 2)
    # The dual model, seen by outputs.
    dual = make(np.transpose(A), None, np.transpose(B))
    assert observability_rank(dual).rank == rank
    assert [m.lost for m in observability_margins(dual)] == lost


def test_only_the_inputs_asked_for_count(make) -> None:
    model = make(np.diag([-1.0, -2.0, -3.0]), np.eye(3))
    assert [m.lost for m in controllability_margins(model, ["u[1]"])] == [True, False, True]
    assert controllability_rank(model, ["u[0]", "u[2]"]).hidden_states == ("x[1]",)
    assert controllability_rank(model, []).rank == 0
    assert distance_to_uncontrollable(model, []).value == 0.0


def test_measures_are_cosines(make) -> None:
    model = make(np.diag([-1.0, -2.0]), [[3.0, 0.0], [4.0, 1.0]])
    ones = Scales(np.ones(2), np.ones(2), np.ones(1))
    first, second = controllability_margins(model, scales=ones)
    assert first.measures == pytest.approx([0.6, 0.0])
    assert second.measures == pytest.approx([0.8, 1.0])


def test_outputs_are_the_inputs_of_the_dual_model(make) -> None:
    A, B = np.array([[-1.0, 4.0], [0.0, -2.0]]), np.array([[1.0, 0.0], [2.0, 1.0]])
    scales = Scales(np.ones(2), np.ones(2), np.ones(1)), Scales(np.ones(2), np.ones(1), np.ones(2))
    reached = controllability_margins(make(A, B), scales=scales[0])
    seen = observability_margins(make(A.T, None, B.T), scales=scales[1])
    for a, b in zip(reached, seen, strict=True):
        assert b.measures == pytest.approx(a.measures)
    # The left eigenvectors of A are (1, 4)/17^(1/2) and (0, 1).
    assert reached[0].measures == pytest.approx(np.array([9.0 / np.sqrt(5.0), 4.0]) / np.sqrt(17.0))
    assert reached[1].measures == pytest.approx([2.0 / np.sqrt(5.0), 1.0])


def test_modes_lost_at_ill_conditioned_eigenvalues_are_found(make) -> None:
    # Three equal modes in a chain that the input does not touch: rounding throws them 1e-5 apart.
    rng = np.random.default_rng(0)
    A = linalg.block_diag(-np.eye(3) + np.eye(3, k=1), [[-4.0]])
    T = rng.standard_normal((4, 4))
    model = make(T @ A @ np.linalg.inv(T), T @ [[0.0], [0.0], [0.0], [1.0]])
    lost = [m.lost for m in controllability_margins(model)]
    assert lost == [True, True, True, False]
    assert controllability_rank(model, tolerance=1e-11).rank == 1


def test_margin_at_an_eigenvalue_is_above_the_distance(make) -> None:
    model = make(WICKS, WICKS_INPUT)
    distance = distance_to_uncontrollable(model)
    assert all(m.margin >= distance.value for m in controllability_margins(model))


# Distances -------------------------------------------------------------------------------------------

#: Example of Wicks & DeCarlo 1991.
WICKS = np.array([[1, 1, 1], [0.1, 3, 5], [0, -1, -1]])
WICKS_INPUT = np.array([[1], [0.1], [0]])


def test_published_distance() -> None:
    value, lower, s = nearest_loss(WICKS, WICKS_INPUT, within=1e-3)
    assert value == pytest.approx(0.039238, abs=5e-7)
    assert lower == pytest.approx(value, rel=2e-3)
    assert smallest_at(WICKS, WICKS_INPUT, s) == pytest.approx(value, rel=1e-9)


@given(
    arrays(np.float64, 4, elements=st.floats(-3.0, 3.0)),
    arrays(np.float64, 4, elements=st.floats(-12.0, 0.5).map(lambda x: 10.0**x)),
    seeds,
)
def test_decoupled_parts_lose_their_weakest_input(a: Array, b: Array, seed: int) -> None:
    # [diag(a) - s I, diag(b)] has the singular values |(a_i - s, b_i)|; rotations change none of them.
    rng = np.random.default_rng(seed)
    U, V = (linalg.qr(rng.standard_normal((4, 4)))[0] for _ in range(2))
    value, lower, _ = nearest_loss(U @ np.diag(a) @ U.T, U @ np.diag(b) @ V)
    assert value == pytest.approx(b.min(), rel=1e-3, abs=1e-13)
    assert lower <= b.min() * (1.0 + 1e-9) + 1e-13
    assert lower >= 0.94 * b.min() - 1e-13


def test_the_nearest_loss_is_found_where_no_descent_from_an_eigenvalue_leads() -> None:
    A = np.array([[3.0, 0.0, -1.0], [3.0, 2.0, 2.0], [0.0, 0.0, 2.0]])
    B = np.array([[2.0], [3.0], [-2.0]])
    nearby, _ = local_minimum(A, B, np.linalg.eigvals(A).astype(complex))
    value, lower, _ = nearest_loss(A, B, within=0.01)
    x, y = np.meshgrid(np.linspace(-1, 5, 121), np.linspace(0, 3, 61))
    assert min(smallest_at(A, B, z) for z in (x + 1j * y).ravel()) == pytest.approx(value, rel=5e-3)
    assert value < 0.6 * nearby
    assert lower > 0.98 * value


@settings(max_examples=20)
@given(seeds, st.integers(1, 5), st.integers(1, 2))
def test_nothing_undercuts_the_lower_bound(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, n)), 0.3 * rng.standard_normal((n, m))
    value, lower, s = nearest_loss(A, B)
    assert smallest_at(A, B, s) == pytest.approx(value, rel=1e-9)
    assert lower <= value <= lower / 0.94
    x, y = np.meshgrid(np.linspace(-4, 4, 41), np.linspace(0, 4, 21))
    assert min(smallest_at(A, B, z) for z in (x + 1j * y).ravel()) >= lower


@given(seeds, st.floats(-4.0, 0.0))
def test_no_point_of_a_disc_undercuts_its_floor(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((4, 4)), rng.standard_normal((4, 1)) * 10.0 ** rng.uniform(-4, 0)
    # At an eigenvalue, where the floor has to follow a dip.
    s, radius = np.linalg.eigvals(A)[:1].astype(complex) + 1e-3, 10.0**size
    floor = _floors(A, B, s, radius)[0]
    around = s + radius * np.exp(2j * np.pi * np.arange(16) / 16) * rng.uniform(0, 1, 16)
    assert min(smallest_at(A, B, z) for z in [*around, s[0]]) >= floor - 1e-14


def test_the_floor_follows_where_only_the_coupling_moves_the_value() -> None:
    # [[-s, 4], [1, -s]] has the slope 0 at s = 0, and falls as 1 - |s|^2/4 towards its eigenvalues.
    A, B, radius = np.array([[0.0, 4.0], [1.0, 0.0]]), np.zeros((2, 1)), 0.3
    floor = _floors(A, B, np.zeros(1, dtype=complex), radius)[0]
    lowest = smallest_at(A, B, radius)
    assert lowest == pytest.approx(1.0 - radius**2 / 4.0, rel=0.01)
    assert lowest - 0.02 < floor <= lowest


def test_the_change_that_the_distance_tells_loses_a_mode(make) -> None:
    model = make(WICKS, WICKS_INPUT)
    ones = Scales(np.ones(3), np.ones(1), np.ones(1))
    d = distance_to_uncontrollable(model, scales=ones)
    U, sizes, Vh = np.linalg.svd(np.hstack([WICKS - d.at * np.eye(3), WICKS_INPUT]), full_matrices=False)
    change = -sizes[-1] * np.outer(U[:, -1], Vh[-1])
    A, B = WICKS + change[:, :3], WICKS_INPUT + change[:, 3:]
    reach = np.hstack([B, A @ B, A @ A @ B])
    assert np.linalg.svd(reach, compute_uv=False)[-1] < 1e-12


def test_only_modes_that_do_not_decay_count_for_the_critical_distance(make) -> None:
    model = make(np.diag([-5.0, 1.0]), np.diag([1e-6, 1e-2]))
    ones = Scales(np.ones(2), np.ones(2), np.ones(1))
    far, near = (
        distance_to_uncontrollable(model, scales=ones, region=region)
        for region in ("not decaying", "everywhere")
    )
    assert far.value / near.value == pytest.approx(1e4, rel=1e-3)
    assert (far.at, near.at) == (pytest.approx(1.0, abs=1e-3), pytest.approx(-5.0, abs=1e-3))
    assert far.lower > near.value


def test_critical_distance_of_a_sampled_model(make) -> None:
    model = make(np.diag([0.5, 1.2]), np.diag([1e-6, 1e-2]), dt=0.1)
    ones = Scales(np.ones(2), np.ones(2), np.ones(1))
    far = distance_to_uncontrollable(model, scales=ones, region="not decaying")
    assert far.at == pytest.approx(1.2, abs=1e-3)
    # A decaying model that loses its undamped limit: the nearest lost mode lies on the unit circle.
    decaying = distance_to_uncontrollable(
        make([[0.5]], [[0.0]], dt=0.1),
        scales=Scales(np.ones(1), np.ones(1), np.ones(1)),
        region="not decaying",
    )
    assert abs(decaying.at) == pytest.approx(1.0)


@settings(max_examples=25)
@given(
    arrays(np.float64, 4, elements=logs),
    arrays(np.float64, 3, elements=logs),
    st.permutations(range(4)),
    seeds,
)
def test_units_and_order_do_not_count(
    make, states: Array, signals: Array, order: list[int], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = (rng.standard_normal(shape) for shape in ((4, 4), (4, 2), (1, 4)))
    A[:3, 3] = B[3] = 0.0  # x3 is not reached
    A[3, 0] = 0.0
    A[3, 1] = A[3, 2] = 0.0
    s, u, y = 10.0**states, 10.0 ** signals[:2], 10.0 ** signals[2:]
    here = make(A, B, C)
    there = make(
        (A / s[:, None] * s)[np.ix_(order, order)],
        (B / s[:, None] * u)[order],
        (C / y[:, None] * s)[:, order],
    )
    for measure in (controllability_rank, observability_rank):
        a, b = measure(here), measure(there)
        assert a.rank == b.rank
        assert b.singular_values == pytest.approx(a.singular_values, rel=1e-5, abs=1e-12)
        assert a.hidden_states == tuple(f"x[{order[int(name[2])]}]" for name in b.hidden_states)
    assert controllability_rank(here).hidden_states == ("x[3]",)
    for margins in (controllability_margins, observability_margins):
        for a, b in zip(margins(here), margins(there), strict=True):
            assert b.margin == pytest.approx(a.margin, rel=1e-4, abs=1e-12)
            assert b.measures == pytest.approx(a.measures, rel=1e-4, abs=1e-9)
            assert b.lost == a.lost
    a, b = distance_to_unobservable(here), distance_to_unobservable(there)
    assert b.value == pytest.approx(a.value, rel=1e-3, abs=1e-13)
    assert abs(b.at.real - a.at.real) < 0.05 * (1.0 + abs(a.at))


@settings(max_examples=20)
@given(seeds)
def test_more_sensors_never_see_less(make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = make(rng.standard_normal((4, 4)), None, rng.standard_normal((3, 4)))
    few, more = (distance_to_unobservable(model, names) for names in (["y[0]"], ["y[0]", "y[2]"]))
    assert more.value >= few.lower
    for a, b in zip(*(observability_margins(model, d.signals) for d in (few, more)), strict=True):
        assert b.margin >= a.margin * (1.0 - 1e-9)


# All at once -----------------------------------------------------------------------------------------


def test_analysis_is_the_parts_together(make) -> None:
    import json

    model = make(UNEQUAL, PUSH, [[1, 0, 0, 0], [0, 0, 1, 0]])
    found = analyse(model, output_sets={"first": ["y[0]"], "both": ["y[0]", "y[1]"]})
    assert list(found.reached) == ["u[0]"]
    assert list(found.seen) == ["first", "both"]
    assert found.seen["first"].rank.hidden_states == ("x[2]", "x[3]")
    assert not found.seen["first"].verdict
    assert found.seen["both"].verdict
    assert found.seen["both"].distance.value == distance_to_unobservable(model).value
    numbers = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert [m["frequency_hz"] for m in numbers["modes"]] == pytest.approx([1 / np.pi] * 2 + [1.5 / np.pi] * 2)
    assert numbers["seen"]["first"]["lost"] == [True, True, False, False]
    assert numbers["states"][0]["name"] == "x[0]"


def test_given_scales_are_the_yardstick(make) -> None:
    system = LinearSystem.of(make([[-1.0, 2.0], [0.0, -3.0]], [[0.0], [1.0]], [[1.0, 0.0]]))
    scales = Scales(np.array([1e-3, 10.0]), np.array([5.0]), np.array([1e-3]), time=0.5)
    inner = scaled(system, scales)
    assert pytest.approx(np.array([[-0.5, 0.5 * 2.0 * 1e4], [0.0, -1.5]])) == inner.A
    assert pytest.approx(np.array([[0.0], [0.25]])) == inner.B
    assert pytest.approx(np.array([[1.0, 0.0]])) == inner.C
