from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.adhesion.creep_law import creep_force, creep_scale, patch_row, rail_row
from estimator.contact import CreepCurve
from fmu_wheelset.parameters import CONDITIONS, ContactPatch, RailCondition

PATCH, N = ContactPatch(), 79.7e3
creeps = st.floats(-0.1, 0.1).filter(lambda creep: creep == 0.0 or abs(creep) > 1e-9)
names = st.sampled_from(sorted(CONDITIONS))


def force(name: str, v: float, a: float, b: float, s: float = 0.0) -> tuple[float, ...]:
    return tuple(creep_force(rail_row(CONDITIONS[name]), patch_row(PATCH, N), v, a, b, s))


@given(names, st.floats(0.5, 100.0), creeps, creeps, st.floats(-1.0, 1.0))
def test_forces_are_those_of_the_other_implementation(
    name: str, v: float, a: float, b: float, s: float
) -> None:
    c = CONDITIONS[name]
    scaled = RailCondition(k_A=c.k_A, k_S=c.k_S, mu_0=c.mu_0 * math.exp(s), A=c.A, B=c.B)
    expected = np.array(CreepCurve(scaled, v).forces(a, b))
    assert np.allclose(force(name, v, a, b, s)[:2], expected, rtol=1e-9, atol=1e-4)


@given(
    names,
    st.floats(0.5, 100.0),
    st.floats(1e-5, 0.1),
    st.floats(-math.pi, math.pi),
    st.floats(-1.0, 1.0),
)
def test_partials_are_those_of_differences(name: str, v: float, creep: float, angle: float, s: float) -> None:
    a, b = creep * math.cos(angle), creep * math.sin(angle)
    _, _, *partials = force(name, v, a, b, s)

    def slope(da: float, db: float, ds: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        f = [np.array(force(name, v, a + n * da, b + n * db, s + n * ds)[:2]) for n in (-2, -1, 1, 2)]
        return np.asarray((f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * max(da, db, ds)))

    d = 1e-3 * min(creep, 1e-3)
    assert np.allclose(slope(d, 0.0, 0.0), partials[0:3:2], rtol=1e-6, atol=10.0)
    assert np.allclose(slope(0.0, d, 0.0), partials[1:4:2], rtol=1e-6, atol=10.0)
    assert np.allclose(slope(0.0, 0.0, 1e-3), partials[4:], rtol=1e-6, atol=1e-3)


def test_no_creepage_has_the_initial_slope() -> None:
    curve = CreepCurve(CONDITIONS["dry"], 20.0)
    values = force("dry", 20.0, 0.0, 0.0)
    assert values[:2] == (0.0, 0.0)
    assert values[2] == pytest.approx(curve.initial_slope, rel=1e-9)
    assert values[5] == pytest.approx(curve.initial_slope, rel=1e-9)


@given(names, st.floats(0.5, 100.0), creeps, creeps)
def test_is_odd(name: str, v: float, a: float, b: float) -> None:
    there, back = np.array(force(name, v, a, b)), np.array(force(name, v, -a, -b))
    assert np.array_equal(back[[0, 1, 6, 7]], -there[[0, 1, 6, 7]])
    assert np.array_equal(back[2:6], there[2:6])


def test_bends_where_the_initial_slope_meets_the_friction() -> None:
    for name, condition in CONDITIONS.items():
        scale = creep_scale(rail_row(condition), patch_row(PATCH, N))
        slope = CreepCurve(condition, 20.0).initial_slope
        # (2 N mu/pi) (k_A + k_S) eps with (k_A + k_S) eps = 1.
        assert scale * slope == pytest.approx(2.0 / math.pi * condition.mu_0 * N, rel=1e-9), name
