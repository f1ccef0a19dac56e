"""Recordings: what they say must be what was asked for, and what the physics of the journey demands."""

import numpy as np
import pytest

from co_sim.errors import InputError
from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from co_sim.wheelset.sensors import SensorSpec
from estimator import CreepCurve
from fmu_wheelset import CONDITIONS, WheelsetParameters


def test_torque_is_what_the_rails_carry():
    curve = CreepCurve(CONDITIONS["wet"], 30.0)
    torque = 2.0 * 0.5 * 0.5 * curve.peak_adhesion * curve.N
    made = record(
        Journey(
            duration=3.0,
            speed=30.0,
            torque=Profile((0.0, 1.0), (0.0, torque)),
            rails=(Stretch(0.0, CONDITIONS["wet"]),),
        )
    )
    settled = made.time > 2.0
    assert made.stopped is None
    assert np.allclose(made.traction_torque[settled], torque)
    assert made.truth["adhesion_used"][settled].mean() == pytest.approx(0.5 * curve.peak_adhesion, rel=0.01)
    assert np.allclose(made.peak_adhesion, curve.peak_adhesion, rtol=1e-6)
    # The sideways motion takes its share of the adhesion: the same force needs more creep, never less.
    assert made.creep[settled].mean() >= curve.creep_at(0.5 * curve.peak_adhesion) * 0.999


def test_sensors_write_the_truth_and_their_noise():
    made = record(Journey(duration=4.0, creep=1e-3, gyro=SensorSpec(noise_rms=2e-3, bias=0.1)))
    error = made.yaw_rate - made.truth["yaw_rate"]
    assert error.mean() == pytest.approx(0.1, abs=5 * 2e-3 / np.sqrt(len(error)))
    assert error.std() == pytest.approx(2e-3, rel=0.1)
    assert (made.lateral_acceleration - made.truth["lateral_acceleration"]).std() == pytest.approx(
        0.05, rel=0.1
    )


def test_speed_follows_its_profile_and_rails_change_in_time():
    journey = Journey(
        duration=2.0,
        speed=Profile((0.0, 2.0), (10.0, 30.0)),
        creep=1e-3,
        rails=(Stretch(0.0, CONDITIONS["dry"]), Stretch(1.0, CONDITIONS["low"], CONDITIONS["wet"])),
    )
    assert journey.length == pytest.approx(40.0)
    made = record(journey)
    # The plant holds what the drive said at the start of a step.
    assert np.allclose(made.speed, 10.0 + 10.0 * made.time, atol=1.01 * 10.0 * journey.step)
    late = CreepCurve(CONDITIONS["low"], float(made.speed[-1])).peak_adhesion
    assert made.truth["left.adhesion_peak"][-1] == pytest.approx(late, rel=1e-6)
    assert made.truth["right.adhesion_peak"][-1] > 2.0 * late


def test_braking_to_a_stop_stays_on_the_track():
    made = record(Journey(duration=1.0, speed=Profile((0.1, 0.9), (5.0, 0.0)), creep=1e-3))
    assert made.stopped is None
    assert made.speed[-1] == 0.0


def test_same_seed_same_bits_and_another_seed_another_journey():
    first, again, other = (record(Journey(duration=0.5, creep=1e-3, seed=s)) for s in (1, 1, 2))
    assert np.array_equal(first.yaw_rate, again.yaw_rate)
    assert not np.array_equal(first.truth["yaw_rate"], other.truth["yaw_rate"])


def test_flanges_keep_an_unstable_wheelset_on_the_track():
    curve = CreepCurve(CONDITIONS["dry"], 20.0)
    flanges = WheelsetParameters(flange_stiffness=1e7)
    journey = {"duration": 5.0, "creep": 1.7 * curve.peak_creep}
    without, with_flanges = record(Journey(**journey)), record(Journey(**journey, wheelset=flanges))
    assert not without.within(8e-3)[-1]
    assert np.abs(with_flanges.truth["relative_displacement"]).max() < 0.012


@pytest.mark.parametrize("drive", [{}, {"torque": 1.0, "creep": 0.1}])
def test_a_journey_has_one_drive(drive):
    with pytest.raises(InputError, match="exactly one"):
        Journey(duration=1.0, **drive)


@pytest.mark.parametrize(
    ("times", "values"),
    [((), ()), ((0.0,), (1.0, 2.0)), ((1.0, 1.0), (0.0, 0.0)), ((0.0,), (np.nan,))],
)
def test_profiles_are_checked(times, values):
    with pytest.raises(InputError, match="rising times"):
        Profile(times, values)
