"""What the paper's wheelset does not have: flanges, gravity, unequal radii, curves and a suspension."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import brentq

from fmu_wheelset import CONDITIONS, ContactPatch, WheelsetParameters
from fmu_wheelset.variables import VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable

    MakePlant = Callable[..., Any]

PRESCRIBED, FREE, TORQUE = DriveMode
P = WheelsetParameters()
OUTPUTS = tuple(v.name for v in VARIABLES if v.causality in {"output", "local"})
LATERAL = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")
#: All of them at once, as parameters and as inputs; the flange touches at 2 mm.
OPTIONS = {
    "delta_r": 4e-4, "k_y": 2e5, "c_y": 5e3, "c_w": 3e3, "contact_angle": 0.08, "contact_angle_rate": 6.0,
    "flange_stiffness": 1.5e7, "flange_clearance": 2e-3, "flange_transition": 4e-4, "flange_damping": 2.0,
}  # fmt: skip
CURVE = {"curvature": 1e-3, "cant": 0.05}


def frictionless(plant: MakePlant, **start: float) -> Any:
    """A wheelset on rails too slippery for creep forces."""
    one = plant(**start)
    for side in ("left", "right"):
        one.set_named(f"rail_{side}.mu_0", 1e-15)
    return one.initialise()


# Off -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(DriveMode))
def test_zero_turns_an_option_off_to_the_bit(plant: MakePlant, mode: DriveMode) -> None:
    # Beyond any clearance, with damping and gravity that would count if their stiffness or cant did.
    start = {"lateral_displacement": 0.02, "lateral_velocity": 0.3, "yaw_angle": 1e-3}
    idle = {"flange_clearance": 1e-3, "flange_transition": 1e-4, "flange_damping": 9.0, "g": 3.0}
    zeros = dict.fromkeys(
        ("delta_r", "k_y", "c_y", "c_w", "contact_angle", "contact_angle_rate", "flange_stiffness"), 0.0
    ) | {"curvature": 0.0, "cant": 0.0}
    runs = [
        plant(drive_mode=mode, forward_dynamics=True, traction_torque=3e3, **start, **options)
        .initialise()
        .run(100, *OUTPUTS)
        for options in ({}, zeros | idle)
    ]
    assert runs[0].tobytes() == runs[1].tobytes()


def test_the_paper_s_wheelset_is_the_default() -> None:
    used = {f.name for f in fields(P) if f.metadata.get("source", "").startswith("off")}
    assert used == {*OPTIONS} - {"flange_clearance", "flange_transition", "flange_damping"}
    assert all(getattr(P, name) == 0.0 for name in used)


# Flange ----------------------------------------------------------------------------------------------


def test_flange_keeps_the_unstable_wheelset_on_the_track(plant: MakePlant) -> None:
    farthest = []
    for stiffness in (0.0, 1.5e7):
        one = plant(prescribed_creepage=2 * 0.024845, lateral_displacement=1e-3, flange_stiffness=stiffness)
        y, psi = one.initialise().run(10_000, "relative_displacement", "yaw_angle").T
        farthest.append(np.abs(y).max())
        assert np.abs(psi).max() < 0.02
    assert farthest[0] > 0.1
    assert P.flange_clearance < farthest[1] < P.flange_clearance + 1e-3


def test_flange_follows_the_track(plant: MakePlant) -> None:
    one = plant(flange_stiffness=1.5e7, lateral_displacement=0.020, track_lateral_offset=0.013)
    assert one.initialise().get("flange_force") == [0.0]
    one.set(track_lateral_offset=0.010)
    depth = 0.010 - P.flange_clearance
    assert one.get("flange_force")[0] == pytest.approx(-1.5e7 * (depth - P.flange_transition / 2))
    one.set(track_lateral_offset=0.030)
    assert one.get("flange_force")[0] == pytest.approx(1.5e7 * (depth - P.flange_transition / 2))


@pytest.mark.parametrize("y_dot", [-0.5, 0.0, 0.4])
def test_flange_force_rises_without_steps_in_its_slope(plant: MakePlant, y_dot: float) -> None:
    one = plant(flange_stiffness=1.5e7, lateral_velocity=y_dot).initialise()
    step = P.flange_transition / 1000
    offsets = P.flange_clearance + step * np.arange(-1000, 3000)
    force = []
    for y in offsets:
        one.set(track_lateral_offset=-y)
        force.append(one.get("flange_force")[0])
    slope = np.diff(force) / step
    full = 1.5e7 * (1 + 0.5 * y_dot if y_dot > 0 else 1 / (1 - 0.5 * y_dot))
    assert slope[0] == 0.0
    assert slope[-1] == pytest.approx(-full)
    assert np.abs(np.diff(slope)).max() < 1.01e-3 * full


def test_flange_force_has_no_step_in_its_slope_by_speed(plant: MakePlant) -> None:
    force = []
    for y_dot in np.linspace(-0.01, 0.01, 81):
        one = plant(flange_stiffness=1.5e7, lateral_displacement=0.009, lateral_velocity=y_dot)
        force += one.initialise().get("flange_force")
    slope = np.diff(force)
    assert np.abs(np.diff(slope)).max() < 1e-2 * np.abs(slope).max()


@pytest.mark.parametrize("damping", [0.0, 0.5, 5.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_bounce_off_the_rail_gives_no_energy_and_never_pulls(
    plant: MakePlant, damping: float, side: float
) -> None:
    one = frictionless(
        plant, flange_stiffness=1.5e7, flange_damping=damping, lateral_velocity=0.6 * side, k_w=0.0
    )
    y, y_dot, force = one.run(600, "lateral_displacement", "lateral_velocity", "flange_force", h=1e-4).T
    assert (force * side <= 0.0).all()
    assert np.abs(force).max() > 5e4
    assert abs(y[-1]) < P.flange_clearance
    assert -side * y_dot[-1] == pytest.approx(rebound(0.6, damping), rel=1e-6)


def rebound(v: float, d: float) -> float:
    """Speed after a bounce: u u'/(1 + d u) going in and u u' (1 + d u) coming out give the same work."""
    if d == 0.0:
        return v
    work = (d * v - math.log1p(d * v)) / d**2
    return float(brentq(lambda u: u**2 / 2 + d * u**3 / 3 - work, 0.0, v, xtol=1e-14))


@pytest.mark.parametrize("speed", [0.0, 0.1, 1.0, -1.0])
@pytest.mark.parametrize("mode", list(DriveMode))
def test_everything_at_once_runs_slowly_and_at_rest(plant: MakePlant, mode: DriveMode, speed: float) -> None:
    one = plant(drive_mode=mode, speed=speed, lateral_displacement=2.2e-3, lateral_velocity=0.02)
    one.set(**OPTIONS, **CURVE, yaw_angle=1e-3, traction_torque=200.0, prescribed_creepage=1e-3)
    rows = one.initialise().run(300, *OUTPUTS)
    assert np.isfinite(rows).all()
    y = rows[:, OUTPUTS.index("relative_displacement")]
    assert np.abs(y).max() < 3e-3


# Gravity, suspension and curve, without creep forces -------------------------------------------------


def test_gravitational_stiffness_is_a_spring_to_the_track(plant: MakePlant) -> None:
    one = frictionless(plant, contact_angle_rate=33.0, lateral_displacement=3e-3, track_lateral_offset=1e-3)
    t = 1e-3 * np.arange(501)
    omega = math.sqrt(2 * P.N * 33.0 / P.m_w)
    y = one.run(500, "relative_displacement")[:, 0]
    assert y == pytest.approx(2e-3 * np.cos(omega * t), abs=1e-8)


def test_gravity_turns_the_wheelset_out_of_its_central_position(plant: MakePlant) -> None:
    one = frictionless(plant, contact_angle=0.15, k_w=0.0, yaw_angle=1e-5)
    t = 1e-3 * np.arange(301)
    growth = math.sqrt(2 * P.N * P.L_g * 0.15 / P.I_w)
    assert one.run(300, "yaw_angle")[:, 0] == pytest.approx(1e-5 * np.cosh(growth * t), rel=1e-6)


def test_unequal_loads_push_towards_the_lighter_wheel(plant: MakePlant) -> None:
    one = frictionless(plant, contact_angle=0.15, normal_load_left=9e4, normal_load_right=6e4)
    assert one.get("lateral_acceleration")[0] == pytest.approx(-0.15 * 3e4 / P.m_w)
    one.set(normal_load_right=-6e4)
    assert one.get("lateral_acceleration")[0] == pytest.approx(-0.15 * 9e4 / P.m_w)


def test_suspension_is_a_damped_oscillator_to_the_ground(plant: MakePlant) -> None:
    one = frictionless(plant, k_y=2e6, c_y=1e4, c_w=2e4, lateral_displacement=1e-3, yaw_angle=1e-3)
    one.set(track_lateral_offset=5e-3)  # of no concern to the suspension
    y, psi = one.run(400, "lateral_displacement", "yaw_angle").T
    t = 1e-3 * np.arange(401)
    for motion, mass, stiffness, damping in ((y, P.m_w, 2e6, 1e4), (psi, P.I_w, P.k_w, 2e4)):
        pole = np.roots([mass, damping, stiffness])[0]
        expected = (np.exp(pole * t) * (1j * pole.imag - pole.real) / (1j * pole.imag)).real
        assert motion == pytest.approx(1e-3 * expected, abs=1e-9)


def test_cant_balances_the_centrifugal_force(plant: MakePlant) -> None:
    one = frictionless(plant, speed=30.0, curvature=1 / 600, g=9.81)
    assert one.get("lateral_acceleration")[0] == pytest.approx(-(30.0**2) / 600)
    one.set(cant=2 * P.L_g * 30.0**2 / 600 / 9.81)
    assert one.get("lateral_acceleration")[0] == pytest.approx(0.0, abs=1e-12)


# Kinematics ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(DriveMode))
@pytest.mark.parametrize("speed", [20.0, -20.0])
def test_unequal_radii_shift_the_wheelset_to_where_it_rolls_on_equal_ones(
    plant: MakePlant, mode: DriveMode, speed: float
) -> None:
    one = plant(drive_mode=mode, speed=speed, delta_r=6e-4, c_s=5e3, track_lateral_offset=1e-3).initialise()
    end = one.run(8000, *LATERAL, "left.creepage_x", "right.creepage_x")[-1]
    assert end == pytest.approx([1e-3 - 6e-4 / (2 * P.gamma), 0, 0, 0, 0, 0], abs=2e-8)


def test_torque_acts_through_the_radius_of_each_wheel(plant: MakePlant) -> None:
    one = plant(drive_mode=TORQUE, speed=20.0, delta_r=0.05, traction_torque=4e3, c_s=5e3)
    one.initialise()
    assert one.get("left.wheel_speed", "right.wheel_speed") == pytest.approx([20 / 0.525, 20 / 0.475])
    names = ("left.creep_force_x", "right.creep_force_x", "axle_torque")
    accelerations = ("der(state.wheel_speed_left)", "der(state.wheel_speed_right)")
    one.run(5)
    left, right, torque = one.get(*names)
    assert one.get(*accelerations) == pytest.approx(
        [(torque - 0.525 * left) / P.I_L, (4e3 - torque - 0.475 * right) / P.I_R], rel=1e-12
    )


@pytest.mark.parametrize("radius", [300.0, -500.0])
def test_wheelset_steers_itself_onto_the_rolling_line_of_a_curve(plant: MakePlant, radius: float) -> None:
    """Redtenbacher: y = r0 L_g/(gamma R) towards the outer rail, where the cant balances the curve."""
    one = plant(drive_mode=FREE, speed=10.0, curvature=1 / radius)
    one.set(cant=2 * P.L_g * 10.0**2 / radius / P.g)
    end = one.initialise().run(6000, *LATERAL)[-1]
    assert end == pytest.approx([-P.r0 * P.L_g / (P.gamma * radius), 0, 0, 0], abs=2e-8)


def free_of_yaw_spring(plant: MakePlant, speed: float, **start: float) -> Any:
    return plant(drive_mode=FREE, speed=speed, k_w=0.0, **start).initialise()


def test_free_wheelset_rolls_in_a_curve_about_the_rolling_line(plant: MakePlant) -> None:
    y_0 = -P.r0 * P.L_g / (P.gamma * 2000.0)
    resting = free_of_yaw_spring(plant, 1.0, curvature=1 / 2000.0, lateral_displacement=y_0)
    resting.set(cant=2 * P.L_g / 2000.0 / P.g)
    assert resting.run(200, *LATERAL, h=0.01)[-1] == pytest.approx([y_0, 0, 0, 0], abs=1e-12)

    wavelength = 2 * math.pi * math.sqrt(P.r0 * P.L_g / P.gamma)
    moving = free_of_yaw_spring(plant, 1.0, curvature=1 / 2000.0)
    moving.set(cant=2 * P.L_g / 2000.0 / P.g)
    t = 0.01 * np.arange(1001)
    y = moving.run(1000, "lateral_displacement", h=0.01)[:, 0]
    assert y == pytest.approx(y_0 * (1 - np.cos(2 * math.pi * t / wavelength)), abs=0.01 * abs(y_0))


@pytest.mark.parametrize(("speed", "tolerance"), [(0.5, 2e-5), (2.0, 2e-5), (20.0, 3e-3)])
def test_slow_free_motion_has_klingel_s_wavelength(plant: MakePlant, speed: float, tolerance: float) -> None:
    wavelength = 2 * math.pi * math.sqrt(P.r0 * P.L_g / P.gamma)
    one = free_of_yaw_spring(plant, speed, lateral_displacement=1e-5)
    h = 0.01 / speed
    y = one.run(3000, "lateral_displacement", h=h)[:, 0]
    s = 0.01 * np.arange(3001)
    k = np.flatnonzero(np.diff(np.sign(y)))
    zeros = s[k] - y[k] * 0.01 / (y[k + 1] - y[k])
    assert 2 * (zeros[-1] - zeros[1]) / (len(zeros) - 2) == pytest.approx(wavelength, rel=tolerance)


# Energy ----------------------------------------------------------------------------------------------


def potential(y: np.ndarray, psi: np.ndarray, v: float, options: dict[str, float]) -> np.ndarray:
    """Energy in springs, flange, gravity and the constant forces of the curve."""
    p = WheelsetParameters(**{n: x for n, x in options.items() if n not in CURVE})
    depth = np.maximum(np.abs(y) - p.flange_clearance, 0.0)
    s = p.flange_transition
    line = depth**2 / 2 - s * depth / 2 + s**2 / 6
    flange = p.flange_stiffness * np.where(depth < s, depth**3 / (6 * s), line)
    lateral = p.k_y + 2 * p.N * p.contact_angle_rate
    yaw = p.k_w - 2 * p.N * p.L_g * p.contact_angle
    curve = p.g * options.get("cant", 0.0) / (2 * p.L_g) - v**2 * options.get("curvature", 0.0)
    return (lateral * y**2 + yaw * psi**2) / 2 + flange - p.m_w * curve * y


@pytest.mark.parametrize("options", [{}, OPTIONS | CURVE], ids=["plain", "all options"])
@pytest.mark.parametrize("name", ["dry", "low"])
def test_energy_of_the_free_rolling_wheelset_balances(
    plant: MakePlant, name: str, options: dict[str, float]
) -> None:
    """Drawn over the rails, the wheelset gets what it stores and what creep, dampers and flange lose."""
    v, h = 20.0, 1e-4
    one = plant(drive_mode=FREE, speed=v, lateral_displacement=1.5e-3, lateral_velocity=0.3, **options)
    one.rail(CONDITIONS[name]).initialise()
    creep = [f"{s}.{q}" for s in ("left", "right") for q in ("creepage_x", "creep_force_x")]
    names = (*LATERAL, "left.creepage_y", "left.creep_force_y", "right.creep_force_y", "flange_force", *creep)
    rows = one.run(5000, *names, h=h).T
    y, psi, y_dot, psi_dot, ly, f_yL, f_yR, flange, lx_L, f_xL, lx_R, f_xR = rows

    p = WheelsetParameters(**{n: x for n, x in options.items() if n not in CURVE})
    friction = v * (f_xL * lx_L + f_xR * lx_R + (f_yL + f_yR) * ly)
    dampers = p.c_y * y_dot**2 + p.c_w * psi_dot**2
    depth = np.maximum(np.abs(y) - p.flange_clearance, 0.0)
    s = p.flange_transition
    elastic = p.flange_stiffness * np.where(depth < s, depth**2 / (2 * s), depth - s / 2)
    flange_loss = -(flange + np.sign(y) * elastic) * y_dot
    steering = p.gamma * y / p.r0 + p.delta_r / (2 * p.r0) + p.L_g * options.get("curvature", 0.0)
    drawn = v * ((f_xL - f_xR) * steering - (f_yL + f_yR) * psi)

    assert (friction >= 0.0).all()
    assert (flange_loss >= -1e-9).all()
    assert np.abs(flange).max() > 1e3 if options else not flange.any()
    energy = (p.m_w * y_dot**2 + p.I_w * psi_dot**2) / 2 + potential(y, psi, v, options)
    lost = simpson(friction + dampers + flange_loss, dx=h)
    assert energy[-1] - energy[0] + lost == pytest.approx(simpson(drawn, dx=h), abs=2e-6 * lost)


# Critical speed of another source --------------------------------------------------------------------


def test_wheelset_of_another_source_hunts_from_its_known_speed_on(plant: MakePlant) -> None:
    """University of California, Davis, EME 134, lab 1: 48.55 m/s, from motions within 1 % of it."""
    m, d, R, R_rail, k, patch = 1000.0, 0.72, 0.23, 0.20, 13e3, ContactPatch()
    start = {
        "m_w": m, "I_w": m * d**2, "r0": 0.46, "gamma": R * math.radians(1.0) / (R - R_rail), "L_g": d,
        "k_w": k * d**2 / 2, "k_y": 2 * k, "contact_angle_rate": 1 / (R - R_rail),
        "normal_load_left": 2e4, "normal_load_right": 2e4, "patch.C22": patch.C11,
    }  # fmt: skip
    # With C11 = C22 and equal reduction factors the law is linear at small creep.
    reduction = 1e6 / (patch.G * patch.a * patch.b * patch.C11)
    growth = []
    for speed in (0.99 * 48.55, 1.01 * 48.55):
        one = plant(drive_mode=FREE, speed=speed, lateral_displacement=1e-6)
        for name, value in start.items():
            one.set_named(name, value)
        for name in ("rail_left.k_A", "rail_left.k_S", "rail_right.k_A", "rail_right.k_S"):
            one.set_named(name, reduction)
        y = np.abs(one.initialise().run(6000, "lateral_displacement")[:, 0])
        growth.append(y[4000:].max() / y[1000:3000].max())
    assert growth[0] < 1.0 < growth[1]
