from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from estimator.contact import CreepCurve
from fmu_wheelset.parameters import CONDITIONS, ContactPatch, RailCondition

speeds = st.floats(0.5, 90.0)
creeps = st.floats(-0.3, 0.3)
positive_creeps = st.floats(1e-6, 0.5)
curves = st.builds(CreepCurve, st.sampled_from(list(CONDITIONS.values())), speeds)


def polach(creep: complex, curve: CreepCurve, c_jj: float | None = None) -> complex:
    """The creep law as printed, for one positive and possibly complex creepage."""
    c, p, N = curve.condition, curve.patch, curve.N
    c_jj = p.C11 if c_jj is None else c_jj
    mu = c.mu_0 * ((1 - c.A) * np.exp(-c.B * creep * curve.v) + c.A)
    eps = p.G * math.pi * p.a * p.b * c_jj * creep / (4 * N * mu)
    return complex(2 * N * mu / math.pi * (c.k_A * eps / (1 + (c.k_A * eps) ** 2) + np.arctan(c.k_S * eps)))


# Values ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("v", "condition", "creep_percent", "mu"),
    [
        (20.0, "dry", 2.48, 0.404),
        (20.0, "wet", 6.82, 0.226),
        (20.0, "low", 0.27, 0.0595),
        (20.0, "very_low", 0.19, 0.0299),
        (50.0, "dry", 1.52, 0.349),
        (50.0, "wet", 4.30, 0.197),
        (50.0, "low", 0.21, 0.0590),
        (50.0, "very_low", 0.15, 0.0298),
    ],
)
def test_peak_has_the_known_creep_and_adhesion(
    v: float, condition: str, creep_percent: float, mu: float
) -> None:
    curve = CreepCurve(CONDITIONS[condition], v)
    assert 100 * curve.peak_creep == pytest.approx(creep_percent, abs=0.0051)
    assert curve.peak_adhesion == pytest.approx(mu, abs=0.5001 * 10.0 ** -len(f"{mu:g}".split(".")[1]))


@pytest.mark.parametrize(
    ("condition", "slope"), [("dry", 9.11e6), ("wet", 2.60e6), ("low", 1.30e7), ("very_low", 1.30e7)]
)
def test_initial_slope_has_the_known_value(condition: str, slope: float) -> None:
    assert CreepCurve(CONDITIONS[condition], 20.0).initial_slope == pytest.approx(slope, rel=1e-3)


def coulomb(mu: float) -> RailCondition:
    return RailCondition(k_A=1.0, k_S=1.0, mu_0=mu, A=1.0, B=0.0)


@pytest.mark.parametrize(
    ("creep", "adhesion"),
    [(4e-4, 0.0854), (1.2e-3, 0.2139), (2.0e-3, 0.2909), (2.8e-3, 0.3245), (1e-2, 0.3300)],
)
def test_follows_the_exact_theory_of_rolling_contact(creep: float, adhesion: float) -> None:
    # Results of CONTACT. The data leave G and C11 open: assumed are G = 82 GPa and C11 = 3.62, Kalker's
    # value for a/b = 1/2 (a along the rail) and Poisson's ratio 1/4. The bound holds for C11 of 3.6 to 3.8.
    patch = ContactPatch(a=6.304e-3, b=12.61e-3, C11=3.62)
    curve = CreepCurve(coulomb(0.33), v=10.0, N=106.7e3, patch=patch)
    assert curve.force(creep) / curve.N == pytest.approx(adhesion, rel=0.07)


@pytest.mark.parametrize(
    ("creep", "force"),
    [((0.002, 0.003), (14350.0, 22320.0)), ((0.03, 0.02), (22270.0, 15110.0))],
)
def test_follows_the_exact_theory_in_combined_creep(
    creep: tuple[float, float], force: tuple[float, float]
) -> None:
    # The ellipse has the axis ratio of the default patch (1.41), so the default Kalker coefficients hold.
    # The reference has a little spin, which the law leaves out.
    patch = ContactPatch(a=7.257e-3, b=5.155e-3)
    curve = CreepCurve(coulomb(0.3), v=10.0, N=90e3, patch=patch)
    assert np.array(curve.forces(*creep)) == pytest.approx(force, rel=0.10)


# Against the law as printed --------------------------------------------------------------------------


@given(curves, positive_creeps)
def test_force_is_the_printed_law(curve: CreepCurve, creep: float) -> None:
    assert curve.force(creep) == pytest.approx(polach(creep, curve).real, rel=1e-13)


@given(curves, positive_creeps)
def test_tangent_is_the_derivative_of_the_printed_law(curve: CreepCurve, creep: float) -> None:
    step = 1e-30  # complex step: exact to rounding
    derivative = polach(creep + 1j * step, curve).imag / step
    assert curve.tangent(creep) == pytest.approx(derivative, rel=1e-11, abs=1e-11 * curve.initial_slope)
    assert curve.tangent(-creep) == curve.tangent(creep)


@given(curves, positive_creeps, st.floats(0.0, 2.0 * math.pi))
def test_combined_creep_is_the_printed_law_with_the_printed_coefficient(
    curve: CreepCurve, creep: float, angle: float
) -> None:
    lx, ly = creep * math.cos(angle), creep * math.sin(angle)
    c_jj = math.sqrt((curve.patch.C11 * lx / creep) ** 2 + (curve.patch.C22 * ly / creep) ** 2)
    F = polach(creep, curve, c_jj).real
    f_x, f_y = curve.forces(lx, ly)
    assert (f_x, f_y) == pytest.approx((F * lx / creep, F * ly / creep), rel=1e-12, abs=1e-12 * F)


# Laws ------------------------------------------------------------------------------------------------


@given(curves, creeps, creeps)
def test_forces_are_odd_and_mirror_symmetric(curve: CreepCurve, lx: float, ly: float) -> None:
    f_x, f_y = curve.forces(lx, ly)
    assert curve.forces(-lx, -ly) == (-f_x, -f_y)
    assert curve.forces(lx, -ly) == (f_x, -f_y)
    assert curve.forces(-lx, ly) == (-f_x, f_y)


@given(curves, positive_creeps, st.floats(0.0, 2.0 * math.pi))
def test_equal_kalker_coefficients_make_the_law_isotropic(
    curve: CreepCurve, creep: float, angle: float
) -> None:
    isotropic = replace(curve, patch=ContactPatch(C11=4.4, C22=4.4))
    f_x, f_y = isotropic.forces(creep * math.cos(angle), creep * math.sin(angle))
    assert math.hypot(f_x, f_y) == pytest.approx(float(isotropic.force(creep)), rel=1e-12)


@given(curves, creeps, creeps)
def test_force_opposes_creep_and_never_exceeds_friction(curve: CreepCurve, lx: float, ly: float) -> None:
    f_x, f_y = curve.forces(lx, ly)
    c, creep = curve.condition, math.hypot(lx, ly)
    mu = c.mu_0 * ((1 - c.A) * math.exp(-c.B * creep * curve.v) + c.A)
    assert f_x * lx >= 0.0
    assert f_y * ly >= 0.0
    assert math.hypot(f_x, f_y) <= mu * curve.N


@given(curves, creeps)
def test_pure_longitudinal_creep_is_the_longitudinal_law(curve: CreepCurve, lx: float) -> None:
    f_x, f_y = curve.forces(lx, 0.0)
    assert f_x == pytest.approx(float(curve.force(lx)), rel=1e-15)
    assert f_y == 0.0


@pytest.mark.parametrize("condition", CONDITIONS)
def test_secant_tends_to_the_initial_slope_with_second_order(condition: str) -> None:
    curve = CreepCurve(CONDITIONS[condition], 20.0)
    creep = 1e-3 * curve.peak_creep * np.array([1.0, 0.5, 0.25])
    error = 1.0 - curve.secant(creep) / curve.initial_slope
    assert error[:-1] / error[1:] == pytest.approx([4.0, 4.0], rel=0.01)
    assert curve.secant(0.0) == curve.initial_slope
    assert curve.tangent(0.0) == pytest.approx(curve.initial_slope, rel=1e-14)
    assert curve.secant(-creep) == pytest.approx(curve.force(creep) / creep, rel=1e-15)


@given(curves)
def test_peak_is_the_greatest_force(curve: CreepCurve) -> None:
    reference = minimize_scalar(
        lambda log: -polach(math.exp(log), curve).real,
        bounds=(math.log(1e-4), 0.0),
        options={"xatol": 1e-9},
        method="bounded",
    )
    assert curve.peak_adhesion * curve.N == pytest.approx(-reference.fun, rel=1e-12)
    assert curve.peak_creep == pytest.approx(math.exp(reference.x), rel=1e-4)
    assert abs(curve.tangent(curve.peak_creep)) < 1e-9 * curve.initial_slope


@given(curves, st.floats(1e-3, 0.999))
def test_creep_at_an_adhesion_is_the_one_below_the_peak(curve: CreepCurve, share: float) -> None:
    adhesion = share * curve.peak_adhesion
    creep = curve.creep_at(adhesion)
    assert 0.0 < creep < curve.peak_creep
    assert curve.force(creep) / curve.N == pytest.approx(adhesion, rel=1e-9)


def test_creepages_broadcast() -> None:
    curve = CreepCurve(CONDITIONS["wet"], 30.0)
    lx, ly = np.linspace(-0.01, 0.01, 4)[:, None], np.linspace(0.0, 0.02, 3)
    f_x, f_y = curve.forces(lx, ly)
    assert f_x.shape == f_y.shape == (4, 3)
    assert (f_x[2, 1], f_y[2, 1]) == curve.forces(lx[2, 0], ly[1])
    assert curve.force(lx).shape == curve.tangent(lx).shape == curve.secant(lx).shape == (4, 1)


# Mistakes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "curve", [CreepCurve(CONDITIONS["dry"], 1e-3), CreepCurve(coulomb(0.3), 20.0)], ids=["slow", "coulomb"]
)
def test_says_when_the_force_never_falls(curve: CreepCurve) -> None:
    with pytest.raises(ValueError, match=r"no maximum below 100% creep at .* choose a higher speed"):
        _ = curve.peak_creep


@pytest.mark.parametrize("share", [-0.1, 0.0, 1.0, 1.1, math.nan])
def test_says_when_an_adhesion_is_out_of_reach(share: float) -> None:
    curve = CreepCurve(CONDITIONS["dry"], 20.0)
    with pytest.raises(ValueError, match=r"expected between 0 and the maximum 0\.4036 at 20 m/s"):
        curve.creep_at(share * curve.peak_adhesion)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["v", "N"])
def test_needs_a_rolling_loaded_wheel(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"^{name}: got .* expected a finite value > 0"):
        CreepCurve(**{"condition": CONDITIONS["dry"], "v": 20.0, name: value})  # type: ignore[arg-type]
