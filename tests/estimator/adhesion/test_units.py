"""The adhesion bank knows no units: kilogram, metre and second may be any, if they are so everywhere."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.adhesion import AdhesionBank, Hypothesis
from estimator.adhesion.block import CREEP, FRICTION, LOST, VAR_CREEP, VAR_FRICTION, new_memory, run_filter
from estimator.adhesion.ekf import COUNT, LOG_L, ON_WHEELS, SQUARE
from fmu_wheelset.parameters import WheelsetParameters

from .conftest import TORQUE, WHEELSET, V, bank

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from estimator.adhesion.block import Design
    from estimator.log import Log

    Array = NDArray[np.float64]

#: Exponents of mass, length and time in everything that has a unit.
VEHICLE = {
    "m": (1, 0, 0), "I_z": (1, 2, 0), "L_g": (0, 1, 0), "cone": (0, -1, 0),
    "r_L": (0, 1, 0), "r_R": (0, 1, 0), "I_L": (1, 2, 0), "I_R": (1, 2, 0),
    "k_s": (1, 2, -2), "c_s": (1, 2, -1), "k_psi": (1, 2, -2), "c_psi": (1, 2, -1),
    "k_y": (1, 0, -2), "c_y": (1, 0, -1), "k_rel": (1, 0, -2), "v_min": (0, 1, -1),
}  # fmt: skip
NOISE = {
    "R_yaw": (0, 0, -2), "R_acc": (0, 2, -4), "R_torque": (2, 4, -4), "W_u": (0, 2, -3), "W_r": (0, 0, -3),
    "W_torque": (2, 4, -3), "s_decay": (0, 0, -1), "W_bg": (0, 0, -3), "W_ba": (0, 2, -5),
}  # fmt: skip
TRACK = {"Wc": (0, -1, 0), "Wr": (0, -1, 0), "level": (0, -1, 0)}
PRIOR = {"y": (0, 1, 0), "b_g": (0, 0, -1), "b_a": (0, 1, -2)}
SPEED, FORCE, MOMENT = (0, 1, -1), (1, 1, -2), (1, 2, -2)

Units = tuple[float, float, float]


def scaled(value: Any, dimension: tuple[int, int, int], units: Units) -> Any:
    """Return a value in other units: 1 kg is `units[0]` of them, 1 m `units[1]`, 1 s `units[2]`."""
    return value * float(np.prod(np.power(units, dimension)))


def rescaled(record: Any, dimensions: dict[str, tuple[int, int, int]], units: Units) -> Any:
    """Return a named tuple in other units; what is not in `dimensions` has none."""
    return record._replace(
        **{name: scaled(getattr(record, name), d, units) for name, d in dimensions.items()}
    )


def in_units(design: Design, units: Units) -> Design:
    """Return a design in other units."""
    patch, rails = design.car.patch.copy(), design.rails.copy()
    patch[3] = scaled(patch[3], FORCE, units)
    rails[..., 4] = scaled(rails[..., 4], (0, -1, 1), units)
    shift = np.array([np.log(scaled(1.0, SPEED, units)), 0.0])
    curves = design.curves._replace(v=design.curves.v + shift)
    return design._replace(
        car=rescaled(design.car, VEHICLE, units)._replace(patch=patch),
        noise=rescaled(design.noise, NOISE, units),
        track=rescaled(design.track, TRACK, units),
        prior=rescaled(design.prior, PRIOR, units),
        curves=curves,
        rails=rails,
        W_creep=scaled(design.W_creep, (0, 0, -1), units),
        h=scaled(design.h, (0, 0, 1), units),
        far=scaled(design.far, (0, 1, 0), units),
    )


def told(design: Design, z: Array, units: Units = (1.0, 1.0, 1.0)) -> Array:
    """Return what all filters tell of the blocks of z (T, 2), which is in SI units."""
    n, T = len(design.held), len(z)
    rows, memory, work = np.empty((T // design.block, n, 14)), new_memory(n), np.zeros((5, 4, 12))
    v = scaled(np.linspace(V, 1.02 * V, T), SPEED, units)
    v_dot = np.full(T, scaled(0.1, (0, 1, -2), units))
    torque = np.full(T, scaled(TORQUE, MOMENT, units))
    z = z * [scaled(1.0, (0, 0, -1), units), scaled(1.0, (0, 1, -2), units)]
    for i in range(n):
        usable = np.ones(z.shape, dtype=np.bool_)
        run_filter(design, memory, i, v, v_dot, torque, z, usable, work, rows, 0, len(rows))
    return rows


HYPOTHESES = [
    Hypothesis("dry"),
    Hypothesis("low"),
    Hypothesis("very_low", right="wet"),
    Hypothesis("wet", "held", 1.7),
]
FACTOR = st.floats(-3.0, 3.0).map(lambda power: 10.0**power)


@settings(max_examples=15, deadline=None)
@given(st.tuples(FACTOR, FACTOR, FACTOR))
def test_filters_know_no_units(units: Units) -> None:
    # Every constant in the machine code of the filters that had a unit would be found here.
    rng = np.random.default_rng(5)
    # Some samples are so far off that filters are lost and start again.
    z = rng.standard_normal((400, 2)) * [1e-3, 0.06]
    z[200:] *= 3.0
    design = bank().design(HYPOTHESES)
    here, there = told(design, z), told(in_units(design, units), z, units)
    assert here[..., LOST].any()
    for column in (SQUARE, COUNT, CREEP, VAR_CREEP, FRICTION, VAR_FRICTION, LOST):
        assert np.allclose(there[..., column], here[..., column], rtol=1e-5, atol=1e-9), column
    # A density has the units of what it is a density of.
    per_sample = np.log(scaled(1.0, (0, 0, -1), units)) + np.log(scaled(1.0, (0, 1, -2), units))
    shift = design.block * per_sample
    assert np.allclose(there[..., LOG_L], here[..., LOG_L] - shift, rtol=1e-6, atol=1e-3)
    wheels = scaled(here[..., ON_WHEELS], MOMENT, units)
    assert np.allclose(there[..., ON_WHEELS], wheels, rtol=1e-5, atol=1e-6 * np.abs(wheels).max())


@pytest.mark.parametrize("mass", [1e-3, 7.0])
def test_bank_knows_no_unit_of_mass(drive: Callable[..., Log], mass: float) -> None:
    # Masses, stiffnesses, loads, shear modulus and torques alone, through the interface that users have.
    log = drive("low", 40.0, 4000.0, 1500)
    w = WheelsetParameters()
    names = ("m_w", "I_w", "k_w", "I_L", "I_R", "k_s", "c_s", "M_v", "N", "k_y", "c_y", "c_w")
    other = replace(
        w,
        **{name: mass * getattr(w, name) for name in names},
        patch=replace(w.patch, G=mass * w.patch.G),
    )
    assert log.traction_torque is not None
    here = AdhesionBank(w).run(log)
    there = AdhesionBank(other).run(replace(log, traction_torque=mass * log.traction_torque))
    for name in ("p_hypothesis", "p_region", "mu_used", "mu_max", "mu_max_low", "mu_max_high", "p_none"):
        assert np.allclose(getattr(there, name), getattr(here, name), rtol=1e-4, atol=1e-6), name
    assert np.array_equal(there.identifiable, here.identifiable)


def test_nothing_with_a_unit_is_left_out() -> None:
    # A field that is added to the design must be told its unit here.
    design = bank().design(HYPOTHESES)
    assert set(design.noise._fields) == set(NOISE)
    assert set(design.track._fields) == set(TRACK)
    assert set(design.car._fields) == {*VEHICLE, "patch"}
    dimensionless = {"psi", "guidance", "lateral", "creep", "theta"}
    assert set(design.prior._fields) == {*PRIOR, *dimensionless}
    assert WHEELSET.k_y > 0.0
