"""The creep law in C: published numbers, limits, symmetry, and exact derivatives."""

from __future__ import annotations

import ctypes
import math
from dataclasses import astuple
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmu_wheelset import CONDITIONS, ContactPatch, RailCondition, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    Law = Callable[..., ctypes.Structure]

PATCH = ContactPatch()
N = WheelsetParameters().N
FIELDS = ("creepage_x", "creepage_y", "speed", "normal_load", "k_A", "k_S", "mu_0", "A", "B")
STEP = 1e-30

names = st.sampled_from(sorted(CONDITIONS))
magnitudes = st.one_of(st.just(0.0), st.floats(-9.0, 0.0).map(lambda e: 10.0**e))
creepages = st.tuples(magnitudes, st.sampled_from([-1.0, 1.0])).map(math.prod)
speeds = st.floats(0.05, 100.0)
directions = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9)


def state(core: SimpleNamespace, lx: float, ly: float, v_r: float, N: float, rail: RailCondition) -> Any:
    return core.filled(core.State, np.array([lx, ly, v_r, N, *astuple(rail)]))


def c_patch(core: SimpleNamespace, patch: ContactPatch = PATCH) -> Any:
    return core.filled(core.Patch, np.array(astuple(patch)))


@pytest.fixture(scope="module")
def law(core: SimpleNamespace) -> Law:
    def evaluate(
        lx: float,
        ly: float,
        v_r: float,
        rail: RailCondition,
        N: float = N,
        patch: ContactPatch = PATCH,
    ) -> ctypes.Structure:
        contact = core.Contact()
        at = state(core, lx, ly, v_r, N, rail)
        core.library.contact_evaluate(
            ctypes.byref(c_patch(core, patch)), ctypes.byref(at), ctypes.byref(contact)
        )
        return contact

    return evaluate


@pytest.fixture(scope="module")
def peak(core: SimpleNamespace) -> Callable[..., Any]:
    def find(v_r: float, rail: RailCondition, N: float = N) -> Any:
        at = state(core, 0.0, 0.0, v_r, N, rail)
        return core.library.contact_peak(ctypes.byref(c_patch(core)), ctypes.byref(at))

    return find


# Values ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "slope"), [("dry", 9.11e6), ("wet", 2.60e6), ("low", 1.30e7), ("very_low", 1.30e7)]
)
def test_initial_slopes(law: Law, name: str, slope: float) -> None:
    contact = law(0.0, 0.0, 20.0, CONDITIONS[name])
    assert contact.secant == pytest.approx(slope, rel=2e-3)
    assert contact.tangent == contact.secant
    c = CONDITIONS[name]
    kalker = PATCH.G * PATCH.a * PATCH.b * (c.k_A + c.k_S) / 2
    assert contact.jacobian[0][0] == pytest.approx(kalker * PATCH.C11, rel=1e-14)
    assert contact.jacobian[1][1] == pytest.approx(kalker * PATCH.C22, rel=1e-14)


@pytest.mark.parametrize(
    ("creep", "adhesion"),
    [(0.0004, 0.0854), (0.0012, 0.2139), (0.002, 0.2909), (0.0028, 0.3245), (0.01, 0.33)],
)
def test_stays_near_the_exact_theory(law: Law, creep: float, adhesion: float) -> None:
    # CONTACT, 106.7 kN; C11 after Kalker for an ellipse with a/b = 1/2.
    coulomb = RailCondition(k_A=1.0, k_S=1.0, mu_0=0.33, A=1.0, B=0.0)
    patch = ContactPatch(a=6.304e-3, b=12.61e-3, C11=3.62)
    contact = law(creep, 0.0, 10.0, coulomb, 106.7e3, patch)
    assert contact.force_x / 106.7e3 == pytest.approx(adhesion, rel=0.07)


# Laws ------------------------------------------------------------------------------------------------


@given(creepages, creepages, speeds, names)
def test_is_the_published_law(
    law: Law, reference: SimpleNamespace, lx: float, ly: float, v_r: float, name: str
) -> None:
    contact = law(lx, ly, v_r, CONDITIONS[name])
    rail = dict(zip(FIELDS[4:], astuple(CONDITIONS[name]), strict=True))
    expected = reference.polach(lx, ly, v_r, N, rail, PATCH)
    size = math.hypot(*expected)
    assert (contact.force_x, contact.force_y) == pytest.approx(expected, rel=1e-12, abs=1e-14 * size)
    assert contact.creep == pytest.approx(math.hypot(lx, ly), rel=1e-15)
    assert contact.secant * contact.creep == pytest.approx(size, rel=1e-12)


@given(creepages, creepages, speeds, names)
def test_cheap_and_full_evaluation_give_the_same_bits(
    core: SimpleNamespace, law: Law, lx: float, ly: float, v_r: float, name: str
) -> None:
    full, cheap = law(lx, ly, v_r, CONDITIONS[name]), core.Contact()
    at = state(core, lx, ly, v_r, N, CONDITIONS[name])
    core.library.contact_force(ctypes.byref(c_patch(core)), ctypes.byref(at), ctypes.byref(cheap))
    assert (cheap.force_x, cheap.force_y) == (full.force_x, full.force_y)


@given(creepages, creepages, speeds, names)
def test_force_is_odd_to_the_bit(law: Law, lx: float, ly: float, v_r: float, name: str) -> None:
    one, other = law(lx, ly, v_r, CONDITIONS[name]), law(-lx, -ly, v_r, CONDITIONS[name])
    assert (other.force_x, other.force_y) == (-one.force_x, -one.force_y)


def complex_step(
    reference: SimpleNamespace, at: list[float], direction: list[float]
) -> tuple[complex, complex]:
    """Forces of the independent law at ``at + i STEP direction``."""
    z = [complex(a, STEP * d) for a, d in zip(at, direction, strict=True)]
    force = reference.polach(*z[:4], dict(zip(FIELDS[4:], z[4:], strict=True)), PATCH)
    return complex(force[0]), complex(force[1])


@given(creepages, creepages, speeds, names, directions)
def test_tangent_of_the_force_is_exact(
    core: SimpleNamespace,
    reference: SimpleNamespace,
    law: Law,
    lx: float,
    ly: float,
    v_r: float,
    name: str,
    d: list[float],
) -> None:
    at = [lx, ly, v_r, N, *astuple(CONDITIONS[name])]
    direction = [x * max(abs(a), 1e-6) for x, a in zip(d, at, strict=True)]
    contact = law(lx, ly, v_r, CONDITIONS[name])
    tangent = (ctypes.c_double(), ctypes.c_double())
    core.library.contact_force_tangent(
        ctypes.byref(contact),
        ctypes.byref(core.filled(core.State, np.array(at))),
        ctypes.byref(core.filled(core.State, np.array(direction))),
        *map(ctypes.byref, tangent),
    )
    if lx == ly == 0.0:  # the slope depends on the direction there: the axes give the matrix
        expected = [contact.jacobian[0][0] * direction[0], contact.jacobian[1][1] * direction[1]]
    else:
        expected = [force.imag / STEP for force in complex_step(reference, at, direction)]
    size = contact.secant * (contact.creep + math.hypot(*direction[:2]))
    assert [t.value for t in tangent] == pytest.approx(expected, rel=1e-9, abs=1e-11 * size)


@given(st.floats(-7.0, 0.0), st.floats(-math.pi, math.pi), speeds, names, directions)
def test_tangent_of_the_slopes_is_exact(
    core: SimpleNamespace, law: Law, exponent: float, angle: float, v_r: float, name: str, d: list[float]
) -> None:
    creep = 10.0**exponent
    at = np.array([creep * math.cos(angle), creep * math.sin(angle), v_r, N, *astuple(CONDITIONS[name])])
    direction = np.array(d) * np.maximum(np.abs(at), 0.1 * creep * (np.arange(9) < 2))

    def slopes(x: np.ndarray) -> np.ndarray:
        contact = law(*x[:3], RailCondition(**dict(zip(FIELDS[4:], map(float, x[4:]), strict=True))), N=x[3])
        return np.array([contact.secant, contact.tangent])

    tangent = (ctypes.c_double(), ctypes.c_double())
    core.library.contact_slope_tangent(
        ctypes.byref(c_patch(core)),
        ctypes.byref(core.filled(core.State, at)),
        ctypes.byref(core.filled(core.State, direction)),
        *map(ctypes.byref, tangent),
    )
    assert [t.value for t in tangent] == pytest.approx(
        difference(slopes, at, direction), rel=1e-6, abs=1e-7 * slopes(at)[0]
    )


def difference(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Directional derivative by central differences of sixth order."""
    h = 1e-3
    pairs = [f(x + k * h * d) - f(x - k * h * d) for k in (1, 2, 3)]
    return (45 * pairs[0] - 9 * pairs[1] + pairs[2]) / (60 * h)


@given(st.floats(1e-8, 1e-3), st.floats(-math.pi, math.pi))
def test_small_creep_follows_kalkers_linear_theory(law: Law, relative: float, angle: float) -> None:
    dry = CONDITIONS["dry"]
    creep = relative * 1e-3
    lx, ly = creep * math.cos(angle), creep * math.sin(angle)
    contact = law(lx, ly, 20.0, dry)
    c_jj = math.hypot(PATCH.C11 * math.cos(angle), PATCH.C22 * math.sin(angle))
    K = PATCH.G * PATCH.a * PATCH.b * (dry.k_A + dry.k_S) / 2 * c_jj
    assert (contact.force_x, contact.force_y) == pytest.approx((K * lx, K * ly), rel=1e-5, abs=1e-14)


@given(creepages, creepages, speeds, names, st.sampled_from([0.0, -1.0, -5e4]))
def test_lifted_wheel_carries_no_force(
    core: SimpleNamespace, law: Law, lx: float, ly: float, v_r: float, name: str, load: float
) -> None:
    assert not core.flat(law(lx, ly, v_r, CONDITIONS[name], N=load)).any()


@given(creepages, creepages, speeds, names, st.floats(-310.0, 0.0))
def test_vanishing_load_is_no_trouble(
    core: SimpleNamespace, law: Law, lx: float, ly: float, v_r: float, name: str, exponent: float
) -> None:
    load = 10.0**exponent
    contact = law(lx, ly, v_r, CONDITIONS[name], N=load)
    forces = [contact.force_x, contact.force_y, contact.secant, contact.tangent, *contact.jacobian[0]]
    assert np.isfinite(forces).all()
    assert math.hypot(contact.force_x, contact.force_y) <= CONDITIONS[name].mu_0 * load * (1 + 1e-9) + 1e-300


# Peak ------------------------------------------------------------------------------------------------


@given(st.floats(0.05, 100.0), names, st.floats(1e2, 2e5))
def test_nothing_is_higher_than_the_peak(
    law: Law, peak: Callable[..., Any], v_r: float, name: str, load: float
) -> None:
    found = peak(v_r, CONDITIONS[name], load)
    grid = np.geomspace(1e-6, 1.0, 400)
    forces = [law(creep, 0.0, v_r, CONDITIONS[name], N=load).force_x for creep in grid]
    assert 0.0 < found.creep_peak <= 1.0
    assert max(forces) <= found.adhesion_peak * load * (1 + 1e-12)
    at_peak = law(found.creep_peak, 0.0, v_r, CONDITIONS[name], N=load)
    assert at_peak.force_x == pytest.approx(found.adhesion_peak * load, rel=1e-14)
    if found.creep_peak < 1.0:
        assert abs(at_peak.tangent) * found.creep_peak <= 1e-11 * at_peak.force_x


@given(st.floats(-320.0, 300.0), names)
def test_peak_is_found_at_any_load(peak: Callable[..., Any], exponent: float, name: str) -> None:
    found = peak(20.0, CONDITIONS[name], 10.0**exponent)
    assert 0.0 < found.creep_peak <= 1.0
    assert 0.0 <= found.adhesion_peak <= CONDITIONS[name].mu_0 * (1 + 1e-9)


def test_rising_law_has_its_peak_at_full_slip(core: SimpleNamespace, peak: Callable[..., Any]) -> None:
    rising = RailCondition(k_A=0.01, k_S=0.01, mu_0=0.5, A=1.0, B=0.0)
    found = peak(20.0, rising)
    assert found.creep_peak == 1.0
    d = core.filled(core.State, np.array([0.0, 0.0, 1.0, 1e4, *[0.1] * 5]))
    at = state(core, 0.0, 0.0, 20.0, N, rising)
    arguments = map(ctypes.byref, (c_patch(core), at, found, d))
    tangent = core.library.contact_peak_tangent(*arguments)
    assert tangent.creep_peak == 0.0
    assert tangent.adhesion_peak != 0.0


def test_lifted_wheel_has_no_peak(peak: Callable[..., Any]) -> None:
    found = peak(20.0, CONDITIONS["dry"], 0.0)
    assert (found.creep_peak, found.adhesion_peak) == (0.0, 0.0)


@pytest.mark.parametrize("name", sorted(CONDITIONS))
@pytest.mark.parametrize("column", range(2, 9))
def test_tangent_of_the_peak_is_exact(core: SimpleNamespace, name: str, column: int) -> None:
    at = np.array([0.0, 0.0, 20.0, N, *astuple(CONDITIONS[name])])
    direction = np.zeros(9)
    direction[column] = at[column]
    patch = c_patch(core)

    def find(x: np.ndarray) -> np.ndarray:
        at = core.filled(core.State, x)
        return core.flat(core.library.contact_peak(ctypes.byref(patch), ctypes.byref(at)))

    peak = core.library.contact_peak(ctypes.byref(patch), ctypes.byref(core.filled(core.State, at)))
    tangent = core.library.contact_peak_tangent(
        ctypes.byref(patch),
        ctypes.byref(core.filled(core.State, at)),
        ctypes.byref(peak),
        ctypes.byref(core.filled(core.State, direction)),
    )
    assert core.flat(tangent) == pytest.approx(
        difference(find, at, direction), rel=1e-7, abs=1e-9 * peak.creep_peak
    )
