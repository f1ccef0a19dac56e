"""Two independent ways agree: the C creep law inside the FMU, and the numpy one of the estimator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim import FmuComponent
from estimator import CreepCurve
from fmu_wheelset import CONDITIONS, ContactPatch, RailCondition, path

if TYPE_CHECKING:
    from collections.abc import Mapping

FORCES = ("left.creep_force_x", "left.creep_force_y", "right.creep_force_x", "right.creep_force_y")
SLOPES = ("left.g11", "left.g22", "left.adhesion_peak", "left.creep_peak")
#: Friction without decay and full stiffness: Coulomb's law, as the exact theory has it.
COULOMB = {"k_A": 1.0, "k_S": 1.0, "A": 1.0, "B": 0.0}


def through_the_fmu(
    curve: CreepCurve, creep: tuple[float, float], outputs: tuple[str, ...], fmi: Literal[2, 3] = 3
) -> np.ndarray:
    """Outputs of the FMU with both wheels at the same creepages."""
    lx, ly = creep
    patch = {f"patch.{name}": getattr(curve.patch, name) for name in ("G", "a", "b", "C11", "C22")}
    parameters: Mapping[str, float] = {"lateral_velocity": ly * curve.v, **patch}
    plant = FmuComponent(path(fmi=fmi), outputs=outputs, parameters=parameters)
    values = {port.name: port.start for port in plant.inputs}
    values |= {"speed": curve.v, "prescribed_creepage": lx}
    for side in ("left", "right"):
        values[f"normal_load_{side}"] = curve.N
        for name in ("k_A", "k_S", "mu_0", "A", "B"):
            values[f"rail_{side}.{name}"] = getattr(curve.condition, name)
    y = np.empty(len(outputs))
    try:
        plant.start(0.0, 1e-3)
        plant.exchange(np.array(list(values.values())), y)
    finally:
        plant.close()
    return y


rails = st.builds(
    RailCondition,
    k_A=st.floats(0.1, 1.0),
    k_S=st.floats(0.1, 1.0),
    mu_0=st.floats(0.01, 0.6),
    A=st.floats(0.1, 1.0),
    B=st.floats(0.0, 1.0),
)
#: Creepages whose squares do not underflow.
creepages = st.floats(-0.3, 0.3).map(lambda creep: creep if abs(creep) > 1e-12 else 0.0)
curves = st.builds(CreepCurve, rails, st.floats(0.5, 100.0), st.floats(1e3, 2e5))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(curves, creepages, creepages)
def test_creep_forces_are_those_of_the_numpy_law(curve: CreepCurve, lx: float, ly: float) -> None:
    expected = np.array(curve.forces(lx, ly))
    found = through_the_fmu(curve, (lx, ly), FORCES)
    np.testing.assert_array_equal(found[:2], found[2:])
    size = np.hypot(*expected)
    np.testing.assert_allclose(found[:2], expected, rtol=1e-12, atol=1e-12 * size)


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("v", [5.0, 20.0, 50.0])
@pytest.mark.parametrize("share", [0.1, 0.9, 1.7])
def test_slopes_and_peak_are_those_of_the_numpy_law(condition: str, v: float, share: float) -> None:
    curve = CreepCurve(CONDITIONS[condition], v)
    creep = share * curve.peak_creep
    expected = [curve.tangent(creep), curve.secant(creep), curve.peak_adhesion, curve.peak_creep]
    found = through_the_fmu(curve, (creep, 0.0), SLOPES)
    np.testing.assert_allclose(found[1:3], expected[1:3], rtol=1e-12)
    np.testing.assert_allclose(found[0], expected[0], rtol=0.0, atol=1e-12 * curve.initial_slope)
    # A maximum is flat: its place is known to half the digits of its height, less by its root finding.
    np.testing.assert_allclose(found[3], expected[3], rtol=1e-9)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("creep", "adhesion"), [(4e-4, 0.0854), (1.2e-3, 0.2139), (2e-3, 0.2909), (2.8e-3, 0.3245), (1e-2, 0.33)]
)
def test_fmu_follows_contact_in_longitudinal_creep(fmi: Literal[2, 3], creep: float, adhesion: float) -> None:
    patch = ContactPatch(a=6.304e-3, b=12.61e-3, C11=3.62)  # Kalker's C11 for a/b = 1/2
    curve = CreepCurve(RailCondition(mu_0=0.33, **COULOMB), 10.0, 106.7e3, patch)
    found = through_the_fmu(curve, (creep, 0.0), FORCES, fmi)
    assert found[0] / curve.N == pytest.approx(adhesion, rel=0.07)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("creep", "force"),
    [((0.002, 0.003), (14350.0, 22320.0)), ((0.03, 0.02), (22270.0, 15110.0))],
)
def test_fmu_follows_contact_in_combined_creep(
    fmi: Literal[2, 3], creep: tuple[float, float], force: tuple[float, float]
) -> None:
    patch = ContactPatch(a=7.257e-3, b=5.155e-3)
    curve = CreepCurve(RailCondition(mu_0=0.3, **COULOMB), 10.0, 90e3, patch)
    assert through_the_fmu(curve, creep, FORCES, fmi)[:2] == pytest.approx(force, rel=0.10)
