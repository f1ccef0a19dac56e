"""The adhesion bank over the range of speeds and manoeuvres, on recordings of the plant FMU."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest

from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from estimator import CreepCurve
from estimator.adhesion import AdhesionBank, Unknowns
from estimator.adhesion.ekf import COUNT, LOG_L, SQUARE
from estimator.log import Log
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.adhesion import AdhesionIdentification
    from fmu_wheelset.parameters import RailCondition

NAMES = list(CONDITIONS)
W = WheelsetParameters()
DRY, WET, LOW = (CONDITIONS[name] for name in ("dry", "wet", "low"))


class Drive(NamedTuple):
    """What the bank said over a drive, and the log itself."""

    log: Log
    found: AdhesionIdentification
    told: NDArray[np.float64]


def torque_for(condition: str, v: float, share: float) -> float:
    """Return the torque that uses a share of the peak, N m."""
    return 2.0 * W.r0 * W.N * share * CreepCurve(CONDITIONS[condition], v).peak_adhesion


def drive(bias: tuple[float, float] = Unknowns.bias, **journey: Any) -> Drive:
    said = record(Journey(**journey))
    assert said.stopped is None
    assert np.abs(said.truth["relative_displacement"]).max() < 8e-3
    names = ("time", "yaw_rate", "lateral_acceleration", "speed", "traction_torque")
    log = Log(**{name: getattr(said, name) for name in names})
    bank = AdhesionBank(unknown=Unknowns(bias=bias))
    found = bank.run(log)
    for values in (found.p_hypothesis, found.p_region, found.mu_max_low, found.mu_max_high, found.mu_used):
        assert np.isfinite(values).all()
    return Drive(log, found, bank.look_at(log, bank.hypotheses())[0])


def right(found: AdhesionIdentification, condition: str, since: float, until: float) -> tuple[float, float]:
    """Return the share of a time in which a condition is found, and in which another one is trusted."""
    inside = (found.time > since) & (found.time <= until)
    true = np.argmax(found.p_condition[inside], axis=1) == NAMES.index(condition)
    return float(true.mean()), float((found.identifiable[inside] & ~true).mean())


@pytest.mark.parametrize("v", [1.0, 2.0, 5.0, 10.0])
@pytest.mark.parametrize("condition", ["dry", "low"])
def test_at_walking_pace_no_filter_is_better_than_the_right_one(v: float, condition: str) -> None:
    # The poles of the creep are as fast as 1.6e4 1/s here: an error of the step looks like another rail.
    torque = Profile((0.0, 0.3), (0.0, torque_for(condition, v, 0.4)))
    rails = (Stretch(0.0, CONDITIONS[condition]),)
    _, found, told = drive(bias=(0.0, 0.0), duration=4.0, speed=v, torque=torque, rails=rails)
    own = told[100:, found.hypotheses.index(f"{condition} driven")]
    assert own[:, SQUARE].sum() / own[:, COUNT].sum() == pytest.approx(1.0, abs=0.08)
    # Three seconds with a handful of nats by chance; half a step of lag made it hundreds.
    assert (told[100:, :, LOG_L].sum(axis=0) - own[:, LOG_L].sum()).max() < 15.0
    assert right(found, condition, 1.0, 4.0)[1] < 0.02


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("v", [80.0, 100.0])
def test_full_speed(v: float, direction: float) -> None:
    torque = Profile((0.0, 0.3), (0.0, direction * torque_for("low", v, 0.6)))
    found = drive(duration=3.0, speed=v, torque=torque, rails=(Stretch(0.0, LOW),)).found
    assert right(found, "low", 1.0, 3.0)[0] > 0.95
    assert np.sign(found.mu_used[-1]) == direction


def test_gaining_speed() -> None:
    speed = Profile((0.0, 6.0), (20.0, 50.0))
    found = drive(duration=6.0, speed=speed, torque=Profile((0.0, 0.5), (0.0, 1.5e4))).found
    assert right(found, "dry", 1.0, 6.0) == (1.0, 0.0)
    # The peak falls as the speed rises, and the estimate with it.
    for t, peak in ((2.0, 0.372), (6.0, 0.349)):
        at = np.searchsorted(found.time, t - 0.02)
        v = 20.0 + 5.0 * t
        assert peak == pytest.approx(CreepCurve(DRY, v).peak_adhesion, rel=0.03)
        assert found.mu_max[at] == pytest.approx(CreepCurve(DRY, v).peak_adhesion, rel=0.08)


def test_braking_to_a_stop_and_standing() -> None:
    torque = Profile((0.0, 0.3, 4.0, 4.2), (0.0, -8e3, -8e3, 0.0))
    speed = Profile((0.0, 4.0), (12.0, 0.0))
    found = drive(duration=6.0, speed=speed, torque=torque, rails=(Stretch(0.0, WET),)).found
    assert right(found, "wet", 2.0, 4.0)[0] > 0.95
    assert right(found, "wet", 1.0, 6.0)[1] < 0.02
    # A wheelset that stands says nothing: what was believed fades.
    standing = found.p_condition[found.time > 4.0].max(axis=1)
    assert np.all(np.diff(standing) <= 1e-9)


@pytest.mark.parametrize("ramp", [0.01, 0.3])
def test_steps_of_torque_are_not_taken_for_another_rail(ramp: float) -> None:
    corners = (0.0, 0.1, 1.5, 1.5 + ramp, 2.5, 2.5 + ramp, 3.5, 3.5 + ramp)
    torque = Profile(corners, (0.0, 5e3, 5e3, 2e4, 2e4, -2e4, -2e4, 5e3))
    found = drive(duration=5.0, speed=40.0, torque=torque).found
    share, trusted_wrongly = right(found, "dry", 1.0, 5.0)
    assert share > 0.98
    assert trusted_wrongly < 0.01


def test_rails_that_change_in_mid_run() -> None:
    rails = (Stretch(0.0, DRY), Stretch(3.0, WET), Stretch(5.0, LOW), Stretch(8.0, DRY))
    torque = Profile((0.0, 0.5), (0.0, torque_for("low", 60.0, 0.7)))
    found = drive(duration=10.0, speed=60.0, torque=torque, rails=rails).found
    expected = (("dry", 1.0, 3.0), ("wet", 3.8, 5.0), ("low", 6.0, 8.0), ("dry", 9.0, 10.0))
    for condition, since, until in expected:
        assert right(found, condition, since, until)[0] > 0.9, (condition, since)


@pytest.mark.parametrize(("left", "right"), [(DRY, LOW), (LOW, DRY)])
def test_one_wheel_on_another_rail(left: RailCondition, right: RailCondition) -> None:
    """Tried in turn, the right pair is found, and the peak is the mean of both wheels."""
    torque = Profile((0.0, 0.5), (0.0, torque_for("low", 40.0, 0.5)))
    run = drive(duration=10.0, speed=60.0, torque=torque, rails=(Stretch(0.0, left, right),))
    found, late = run.found, run.found.time > 3.0
    name = "dry/low driven" if left is DRY else "low/dry driven"
    best = np.argmax(found.p_hypothesis[late], axis=1)
    assert np.mean(best == found.hypotheses.index(name)) > 0.9
    # What is said of the condition is that of the weaker rail.
    assert np.mean(found.p_condition[late].argmax(axis=1) == found.conditions.index("low")) > 0.9
    peaks = [CreepCurve(rail, 60.0).peak_adhesion for rail in (left, right)]
    assert np.median(found.mu_max[late]) == pytest.approx(np.mean(peaks), rel=0.05)


@pytest.mark.parametrize(
    ("condition", "v", "creep", "told"),
    [("wet", 40.0, 0.1, True), ("dry", 60.0, 1.0, False), ("low", 40.0, 1.0, False)],
)
def test_without_torque_only_what_can_be_known_is_trusted(
    condition: str, v: float, creep: float, told: bool
) -> None:
    # At the peak the slope is zero on every rail: what is left cannot be told apart.
    peak = CreepCurve(CONDITIONS[condition], v).peak_creep
    said = record(
        Journey(duration=4.0, speed=v, creep=creep * peak, rails=(Stretch(0.0, CONDITIONS[condition]),))
    )
    on_track = said.within(8e-3)
    names = ("time", "yaw_rate", "lateral_acceleration", "speed")
    found = AdhesionBank().run(Log(**{name: getattr(said, name)[on_track] for name in names}))
    _, wrong = right(found, condition, 0.0, 4.0)
    assert wrong == 0.0
    if told:
        assert found.identifiable[100:].mean() > 0.5
