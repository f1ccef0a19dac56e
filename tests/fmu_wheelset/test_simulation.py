"""Runs of the FMU: accuracy, symmetry, and what the theory of wheelsets says about them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmu_wheelset import CONDITIONS, ContactPatch, WheelsetParameters
from fmu_wheelset.variables import VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    MakePlant = Callable[..., Any]

PRESCRIBED, FREE, TORQUE = DriveMode
P = WheelsetParameters()
OUTPUTS = tuple(v.name for v in VARIABLES if v.causality in {"output", "local"})
LATERAL = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")

# Accuracy --------------------------------------------------------------------------------------------


def exact(model: Any, x0: np.ndarray, u: dict[str, float], t: np.ndarray) -> np.ndarray:
    """States at the times `t` by an integrator of order 8 on the reference equations."""
    solution = solve_ivp(
        lambda _, x: model.x_dot(list(x), u),
        t[[0, -1]],
        x0,
        method="DOP853",
        rtol=1e-11,
        atol=1e-15,
        t_eval=t,
    )
    assert solution.success
    return np.asarray(solution.y.T)


#: Every option of the plant; the flange touches at 1.5 mm.
OPTIONS = {
    "delta_r": 4e-4, "k_y": 2e5, "c_y": 5e3, "c_w": 3e3, "contact_angle": 0.08, "contact_angle_rate": 6.0,
    "flange_stiffness": 1.5e7, "flange_clearance": 1.5e-3, "flange_damping": 2.0,
    "curvature": 1e-3, "cant": 0.05,
}  # fmt: skip
#: What changes sign in a mirror.
MIRRORED = ("delta_r", "curvature", "cant")

CASES = [
    (1.0, FREE, False, "dry", 0.1),
    (1.0, TORQUE, True, "low", 0.1),
    (5.0, PRESCRIBED, False, "wet", 0.3),
    (5.0, TORQUE, False, "dry", 0.2),
    (20.0, PRESCRIBED, False, "dry", 1.0),
    (20.0, FREE, True, "low", 0.5),
    (20.0, TORQUE, True, "dry", 0.5),
    (60.0, PRESCRIBED, True, "very_low", 1.0),
    (60.0, TORQUE, False, "low", 0.5),
    (100.0, FREE, False, "dry", 1.0),
    (100.0, TORQUE, True, "wet", 0.5),
    (-30.0, TORQUE, True, "dry", 0.3),
    (0.03, PRESCRIBED, False, "dry", 0.02),
]


@pytest.mark.parametrize(("speed", "mode", "forward", "condition", "duration"), CASES)
def test_states_are_accurate_to_1e_6(
    plant: MakePlant, reference: SimpleNamespace,
    speed: float, mode: DriveMode, forward: bool, condition: str, duration: float,
) -> None:  # fmt: skip
    rail = CONDITIONS[condition]
    given = {"speed": speed, "track_lateral_offset": 2e-4}
    given["prescribed_creepage"] = {"dry": 0.012, "wet": 0.03, "low": 1e-3, "very_low": 1e-3}[condition]
    given["traction_torque"] = 0.6 * rail.mu_0 * P.N * P.r0
    given["running_resistance"] = 500.0
    one = plant(drive_mode=mode, forward_dynamics=forward, lateral_displacement=1e-3, initial_creepage=1e-4)
    one.set(**given)
    one.rail(rail).initialise()
    found = one.run(round(duration / 1e-3))
    u = reference.INPUTS | reference.with_rail(rail) | given
    expected = exact(reference.Model(mode, forward), found[0], u, 1e-3 * np.arange(len(found)))
    nominal = [v.nominal for v in VARIABLES if v.is_state]
    size = np.maximum(np.abs(expected).max(axis=0), nominal)
    assert (np.abs(found - expected) / size).max() < 1e-6


@pytest.mark.parametrize(
    ("speed", "mode", "y_dot", "duration"),
    [(0.1, FREE, 0.01, 0.05), (1.0, FREE, 0.3, 0.05), (1.0, TORQUE, 0.3, 0.05), (20.0, PRESCRIBED, 0.3, 0.5),
     (20.0, TORQUE, 0.3, 0.5)],
)  # fmt: skip
def test_options_are_accurate_to_1e_6(
    plant: MakePlant, reference: SimpleNamespace, speed: float, mode: DriveMode, y_dot: float, duration: float
) -> None:
    """Onto the flange and off again, also where the creep forces are stiff."""
    inputs = {"speed": speed, "curvature": OPTIONS["curvature"], "cant": OPTIONS["cant"]}
    inputs |= {"prescribed_creepage": 0.012, "traction_torque": 2e3}
    one = plant(drive_mode=mode, forward_dynamics=True, lateral_displacement=1.6e-3, lateral_velocity=y_dot)
    one.set(**OPTIONS | inputs)
    found = one.initialise().run(round(duration / 1e-3))
    p = WheelsetParameters(**{name: x for name, x in OPTIONS.items() if name not in inputs})
    u, t = reference.INPUTS | inputs, 1e-3 * np.arange(len(found))
    expected = exact(reference.Model(mode, True, p), found[0], u, t)
    nominal = [v.nominal for v in VARIABLES if v.is_state]
    size = np.maximum(np.abs(expected).max(axis=0), nominal)
    assert (np.abs(found - expected) / size).max() < 1e-6


@pytest.mark.parametrize(
    ("speed", "mode", "steps"),
    [(1.0, FREE, 10), (1.0, TORQUE, 10), (20.0, TORQUE, 60), (60.0, FREE, 60), (100.0, PRESCRIBED, 60)],
)
def test_inputs_are_held_over_a_step(
    plant: MakePlant, reference: SimpleNamespace, speed: float, mode: DriveMode, steps: int
) -> None:
    """Each jump of the inputs starts a transient; large and small ones are followed as accurately."""
    one = plant(drive_mode=mode, forward_dynamics=True, speed=speed, fmi=2).initialise()
    x = np.array(one.get(*one.states))
    u, model = reference.INPUTS | {"speed": speed}, reference.Model(mode, True)
    rng = np.random.default_rng(3)
    found, expected = [], []
    for k in range(steps):
        jumps = {"track_lateral_offset": rng.normal(0, 2e-4) * rng.choice([0.01, 1.0])}
        jumps |= {"traction_torque": rng.uniform(0, 8e3), "prescribed_creepage": rng.uniform(0, 0.01)}
        u |= jumps
        one.set(**jumps)
        one.step(k * 1e-3, 1e-3)
        x = exact(model, x, u, np.array([0.0, 1e-3]))[-1]
        found.append(one.get(*one.states))
        expected.append(x)
    difference = np.abs(np.array(found) - expected).max(axis=0)
    nominal = [v.nominal for v in VARIABLES if v.is_state]
    assert (difference / np.maximum(np.abs(expected).max(axis=0), nominal)).max() < 1e-6


def test_setting_an_input_to_its_present_value_changes_no_bit(plant: MakePlant) -> None:
    # Masters set all inputs in each step; only a changed one makes the integrator start anew.
    start = {"drive_mode": TORQUE, "traction_torque": 2e3, "lateral_displacement": 1e-3}
    alone = plant(**start).initialise().run(20)
    one = plant(**start).initialise()
    rows = [one.get(*one.states)]
    for k in range(20):
        one.set(traction_torque=2e3, track_lateral_offset=0.0)
        one.step(k * 1e-3, 1e-3)
        rows.append(one.get(*one.states))
    assert np.array_equal(rows, alone)


def test_communication_step_does_not_change_the_motion(plant: MakePlant) -> None:
    ends = []
    for h in (1e-4, 1e-3, 7e-3, 0.07):
        one = plant(drive_mode=FREE, lateral_displacement=1e-3).initialise()
        ends.append(one.run(round(0.14 / h), *LATERAL, h=h)[-1])
    assert np.array(ends) == pytest.approx(np.tile(ends[0], (4, 1)), rel=1e-5, abs=1e-9)


# Same bits -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, OPTIONS], ids=["plain", "all options"])
@pytest.mark.parametrize("mode", list(DriveMode))
def test_both_standards_give_the_same_bits(
    plant: MakePlant, mode: DriveMode, options: dict[str, float]
) -> None:
    runs = []
    for fmi in (2, 3):
        one = plant(
            fmi=fmi, drive_mode=mode, forward_dynamics=True, lateral_displacement=1e-3, yaw_angle=1e-4
        )
        one.set(**options)
        one.rail(CONDITIONS["wet"], "right").initialise()
        rows = []
        for k in range(50):
            one.set(
                track_lateral_offset=1e-4 * math.sin(k),
                traction_torque=50.0 * k,
                prescribed_creepage=1e-4 * k,
            )
            one.step(k * 1e-3, 1e-3)
            rows.append(one.get(*OUTPUTS))
        runs.append(np.array(rows))
    assert np.isfinite(runs[0]).all()
    assert runs[0].tobytes() == runs[1].tobytes()


def swap(name: str) -> str:
    return name.replace("left", "LEFT").replace("right", "left").replace("LEFT", "right")


@pytest.mark.parametrize("options", [{}, OPTIONS], ids=["plain", "all options"])
@pytest.mark.parametrize("forward", [False, True])
@pytest.mark.parametrize("speed", [40.0, 0.0, -15.0])
def test_mirrored_wheelset_moves_in_the_mirror_to_the_bit(
    plant: MakePlant, forward: bool, speed: float, options: dict[str, float]
) -> None:
    lateral = {
        "lateral_displacement": 2e-3, "yaw_angle": 1e-3, "lateral_velocity": -0.01, "yaw_rate": 0.02,
        "track_lateral_offset": 7e-4, "curve_force": 3e3, "suspension_lateral_force": -1e3,
        "suspension_yaw_moment": 4e3,
    }  # fmt: skip
    mirrored = []
    for sign, sides in ((1.0, ("left", "right")), (-1.0, ("right", "left"))):
        one = plant(speed=speed, prescribed_creepage=0.01, forward_dynamics=forward)
        one.set(**{name: sign * value for name, value in lateral.items()})
        one.set(**{name: sign * x if name in MIRRORED else x for name, x in options.items()})
        one.set_named(f"normal_load_{sides[0]}", 6e4)
        one.rail(CONDITIONS["wet"], sides[0]).rail(CONDITIONS["low"], sides[1]).initialise()
        mirrored.append(one)
    odd = ("lateral", "yaw", "relative", "flange", "der(yaw_rate)", "left.creepage_y", "left.creep_force_y")
    odd += ("right.creepage_y", "right.creep_force_y")
    image = np.array([-1.0 if name.startswith(odd) else 1.0 for name in OUTPUTS])
    skipped = ("state.wheel", "der(state.wheel", "axle_torque")
    keep = [i for i, name in enumerate(OUTPUTS) if not name.startswith(skipped)]
    one = mirrored[0].run(200, *OUTPUTS)[:, keep]
    other = (image * mirrored[1].run(200, *map(swap, OUTPUTS)))[:, keep]
    assert np.array_equal(one, other)


@pytest.mark.parametrize("options", [{}, OPTIONS], ids=["plain", "all options"])
def test_running_backwards_is_the_mirror_image_to_the_bit(
    plant: MakePlant, options: dict[str, float]
) -> None:
    runs = []
    for sign in (1.0, -1.0):
        one = plant(speed=sign * 25.0, prescribed_creepage=sign * 0.01, lateral_displacement=1e-3)
        one.set(yaw_angle=sign * 2e-4, yaw_rate=sign * 1e-3, lateral_velocity=0.01, **options)
        runs.append(one.initialise().run(300, *LATERAL) * [1.0, sign, 1.0, sign])
    assert np.array_equal(runs[0], runs[1])


def test_reset_instance_repeats_its_run(plant: MakePlant) -> None:
    one, runs = plant(), []
    for _ in range(2):
        one.set(drive_mode=TORQUE, traction_torque=5e3, lateral_displacement=1e-3)
        runs.append(one.initialise().run(20, *OUTPUTS))
        one.slave.reset()
    assert np.array_equal(*runs)
    assert one.get("traction_torque", "lateral_displacement", "time") == [0.0, 0.0, 0.0]


def test_instances_are_independent(plant: MakePlant) -> None:
    alone = plant(lateral_displacement=1e-3).initialise().run(20)
    one, other = plant(lateral_displacement=1e-3).initialise(), plant(speed=70.0, yaw_angle=1e-3).initialise()
    rows = [one.get(*one.states)]
    for k in range(20):
        other.step(k * 1e-3, 1e-3)
        one.step(k * 1e-3, 1e-3)
        rows.append(one.get(*one.states))
    assert np.array_equal(rows, alone)


# Rest and start --------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(DriveMode))
@pytest.mark.parametrize("forward", [False, True])
def test_wheelset_at_rest_stays_at_rest(plant: MakePlant, mode: DriveMode, forward: bool) -> None:
    one = plant(speed=0.0, drive_mode=mode, forward_dynamics=forward).initialise()
    assert not one.run(20).any()


def test_displaced_wheelset_at_rest_comes_to_rest(plant: MakePlant) -> None:
    one = plant(speed=0.0, drive_mode=FREE, lateral_displacement=1e-3, lateral_velocity=0.05).initialise()
    end = one.run(200, *LATERAL)[-1]
    assert np.isfinite(end).all()
    assert abs(end[2]) < 1e-6


def test_torque_starts_the_vehicle_and_impulse_is_kept(plant: MakePlant) -> None:
    torque, resistance = 6e3, 400.0
    one = plant(speed=0.0, drive_mode=TORQUE, forward_dynamics=True, traction_torque=torque)
    one.set(running_resistance=resistance, lateral_displacement=1e-3)
    rows = one.initialise().run(400, "state.wheel_speed_left", "state.wheel_speed_right", "forward_speed")
    t = 1e-3 * np.arange(len(rows))
    angular = rows @ [P.I_L, P.I_R, P.r0 * P.M_v]
    assert angular == pytest.approx((torque - P.r0 * resistance) * t, rel=1e-7, abs=1e-6)
    assert rows[-1, 2] > 0.2


def test_forward_speed_starts_from_the_input_and_then_leaves_it(plant: MakePlant) -> None:
    one = plant(speed=12.0, forward_dynamics=True, running_resistance=1.5e4).initialise()
    one.set(speed=99.0)
    speeds = one.run(10, "forward_speed")[:, 0]
    assert speeds == pytest.approx(12.0 - 1e-3 * np.arange(11), rel=1e-9)


def test_speed_follows_the_input_without_forward_dynamics(plant: MakePlant) -> None:
    one = plant().initialise()
    one.set(speed=33.0)
    assert one.get("forward_speed", "left.wheel_speed") == [33.0, 66.0]


def test_wheels_start_at_the_initial_creepage(plant: MakePlant) -> None:
    one = plant(drive_mode=TORQUE, speed=30.0, initial_creepage=0.01).initialise()
    assert one.get("left.creepage_x", "right.creepage_x") == pytest.approx([0.01, 0.01], rel=1e-12)
    assert one.get("left.wheel_speed")[0] == pytest.approx(30.0 * 1.01 / P.r0, rel=1e-15)


def test_outputs_follow_inputs_during_initialisation_and_between_steps(plant: MakePlant) -> None:
    one = plant(drive_mode=TORQUE)
    one.slave.enterInitializationMode(startTime=0.0)
    for speed in (10.0, 30.0):
        one.set(speed=speed)
        assert one.get("left.wheel_speed", "state.forward_speed") == [speed / P.r0, speed]
    one.slave.exitInitializationMode()
    one.set(track_lateral_offset=1e-3)
    assert one.get("relative_displacement") == [-1e-3]
    one.step(0.0, 1e-3)
    one.set(track_lateral_offset=0.0)
    assert one.get("relative_displacement") == one.get("lateral_displacement")


def test_lifted_wheel_transmits_nothing(plant: MakePlant) -> None:
    one = plant(prescribed_creepage=0.01, normal_load_left=-3e4, lateral_displacement=1e-3).initialise()
    names = ("creep_force_x", "creep_force_y", "adhesion_used", "adhesion_peak", "creep_peak", "g11", "g22")
    assert one.get(*(f"left.{name}" for name in names)) == [0.0] * 7
    force, used = one.get("right.creep_force_x", "adhesion_used")
    assert used == force / P.N > 0.1
    one.set(normal_load_right=0.0)
    assert one.get("adhesion_used") == [0.0]


def test_peak_follows_rail_load_speed_and_patch(plant: MakePlant) -> None:
    one, peaks = plant(), []
    for change in ({"patch.C11": 5.0}, {"normal_load_left": 6e4}, {"speed": 40.0}, {"rail_left.mu_0": 0.3}):
        for name, value in change.items():
            peaks.append(one.get("left.creep_peak", "right.creep_peak"))
            one.set_named(name, value)
        if "patch.C11" in change:
            peaks.append(one.get("left.creep_peak", "right.creep_peak"))
            one.initialise()
    peaks.append(one.get("left.creep_peak", "right.creep_peak"))
    left, right = np.array(peaks).T
    assert list(np.flatnonzero(np.diff(left))) == [0, 2, 3, 4]
    assert list(np.flatnonzero(np.diff(right))) == [0, 3]


def test_time_is_the_end_of_the_last_step(plant: MakePlant) -> None:
    one = plant().initialise(t0=5.0)
    one.step(5.0, 0.25)
    assert one.get("time") == [5.25]


# Known numbers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("speed", "name", "creep_percent", "adhesion"),
    [
        (20.0, "dry", 2.48, 0.404), (20.0, "wet", 6.82, 0.226), (20.0, "low", 0.27, 0.0595),
        (20.0, "very_low", 0.19, 0.0299), (50.0, "dry", 1.52, 0.349), (50.0, "wet", 4.30, 0.197),
        (50.0, "low", 0.21, 0.0590), (50.0, "very_low", 0.15, 0.0298),
    ],
)  # fmt: skip
def test_peaks(plant: MakePlant, speed: float, name: str, creep_percent: float, adhesion: float) -> None:
    one = plant(speed=speed).rail(CONDITIONS[name]).initialise()
    assert one.get("left.creep_peak")[0] * 100 == pytest.approx(creep_percent, abs=0.006)
    assert one.get("right.adhesion_peak")[0] == pytest.approx(adhesion, abs=6e-4)
    one.set(prescribed_creepage=one.get("left.creep_peak")[0])
    used, of_axle, peak, g11, g22 = one.get(
        "left.adhesion_used", "adhesion_used", "left.adhesion_peak", "left.g11", "left.g22"
    )
    assert used == of_axle == pytest.approx(peak, rel=1e-14)
    assert abs(g11) < 1e-9 * g22


def test_slopes_change_sign_at_the_peak(plant: MakePlant) -> None:
    one = plant(prescribed_creepage=0.0).initialise()
    assert one.get("left.g11", "left.g22") == pytest.approx([9.11e6, 9.11e6], rel=2e-3)
    one.set(prescribed_creepage=0.049)
    g11, g22 = one.get("left.g11", "left.g22")
    assert g11 < 0.0 < g22


def eigenvalues(plant: MakePlant, creepage: float) -> np.ndarray:
    """Poles of the lateral motion from how one step of the FMU maps small disturbances."""
    h, scale = 1e-3, np.diag([1e-6, 1e-6, 1e-4, 1e-4])

    def after(x: np.ndarray) -> np.ndarray:
        one = plant(prescribed_creepage=creepage, **dict(zip(LATERAL, x, strict=True)))
        return one.initialise().run(1, *LATERAL, h=h)[-1]

    Phi = np.column_stack([(after(d) - after(-d)) / (2 * d[i]) for i, d in enumerate(scale)])
    return np.sort_complex(np.log(np.linalg.eigvals(Phi).astype(complex)) / h)


@pytest.mark.parametrize(
    ("creepage", "expected"),
    [
        (0.00248, [-590, -364, -9.45 - 8.89j, -9.45 + 8.89j]),
        (0.02484, [-103.6, 0, -84.52j, 84.52j]),
        (0.04968, [-48.6, 0.21, 4.62 - 84.4j, 4.62 + 84.4j]),
    ],
)
def test_poles_of_the_lateral_motion(plant: MakePlant, creepage: float, expected: list[complex]) -> None:
    found = eigenvalues(plant, creepage)
    for pole in expected:
        assert np.abs(found - pole).min() < 0.06 + 2e-3 * abs(pole)


@pytest.mark.parametrize(("slope", "critical"), [(1e7, 100.85), (5e6, 132.95)])
def test_hunting_begins_at_the_critical_speed(plant: MakePlant, slope: float, critical: float) -> None:
    # With C11 = C22 and equal reduction factors the law is linear at small creep: g11 = g22 = slope.
    patch = ContactPatch()
    k = slope / (patch.G * patch.a * patch.b * patch.C11)
    growth = []
    for speed in (0.99 * critical, 1.01 * critical):
        one = plant(speed=speed, drive_mode=FREE, lateral_displacement=1e-5)
        one.set_named("patch.C22", patch.C11)
        for side in ("left", "right"):
            one.set_named(f"rail_{side}.k_A", k)
            one.set_named(f"rail_{side}.k_S", k)
        y = np.abs(one.initialise().run(3000, "lateral_displacement")[:, 0])
        growth.append(y[2000:].max() / y[500:1500].max())
    assert growth[0] < 1.0 < growth[1]


def test_axle_torsion_is_self_excited_past_the_peak(plant: MakePlant) -> None:
    """Twice the peak creep on dry rail at 20 m/s: +8.86 +- 366.4j (58.3 Hz)."""
    creepage = 2 * 0.024845
    at = plant(drive_mode=PRESCRIBED, prescribed_creepage=creepage).initialise()
    force = at.get("left.creep_force_x")[0]
    runs = []
    for disturbance in (1e-6, -1e-6):
        one = plant(drive_mode=TORQUE, initial_creepage=creepage, traction_torque=2 * P.r0 * force)
        one.set(axle_twist=P.r0 * force / P.k_s + disturbance)
        runs.append(one.initialise().run(250, "axle_twist")[:, 0])
    twist = (runs[0] - runs[1]) / 2e-6
    # Prony: a sum of three exponentials obeys a linear recursion of order three.
    past = np.column_stack([twist[2:-1], twist[1:-2], twist[:-3]])
    coefficients = np.linalg.lstsq(past, twist[3:], rcond=None)[0]
    poles = np.log(np.roots([1.0, *-coefficients]).astype(complex)) / 1e-3
    torsion = poles[np.argmax(poles.imag)]
    assert torsion.real == pytest.approx(8.86, abs=0.15)
    assert torsion.imag == pytest.approx(366.4, abs=0.5)


def test_axle_torque_balances_the_left_wheel(plant: MakePlant) -> None:
    one = plant(drive_mode=TORQUE, traction_torque=4e3, initial_creepage=2e-4, c_s=500.0)
    one.initialise().run(1500)
    torque, force = one.get("axle_torque", "left.creep_force_x")
    assert torque == pytest.approx(P.r0 * force, rel=1e-5)
    assert torque == pytest.approx(2e3, rel=1e-2)
