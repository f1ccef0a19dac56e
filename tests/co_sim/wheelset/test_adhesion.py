"""The adhesion bank as a component says what the bank alone says, goes back, and sits behind the plant."""

import numpy as np
import pytest

from co_sim import Connection, Master, Recorder, System
from co_sim.component import Port
from co_sim.errors import InputError
from co_sim.signals import TimeTable
from co_sim.wheelset.adhesion import AdhesionComponent
from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from estimator.adhesion import AdhesionBank
from estimator.log import Log
from fmu_wheelset import CONDITIONS

NAMES = ("yaw_rate", "lateral_acceleration", "speed", "traction_torque")


@pytest.fixture(scope="module")
def recording():
    journey = Journey(
        duration=1.5,
        speed=30.0,
        torque=Profile((0.0, 0.3), (0.0, 2000.0)),
        rails=(Stretch(0.0, CONDITIONS["wet"]),),
    )
    return record(journey)


@pytest.fixture(scope="module")
def alone(recording):
    log = Log(time=recording.time, **{name: getattr(recording, name) for name in NAMES})
    return AdhesionBank().run(log)


def system(recording, bank=None):
    samples = np.column_stack([getattr(recording, name) for name in NAMES])
    units = ("rad/s", "m/s2", "m/s", "N.m")
    source = TimeTable(
        recording.time, samples, [Port(n, u) for n, u in zip(NAMES, units, strict=True)], interpolation="hold"
    )
    return System(
        {"log": source, "adhesion": AdhesionComponent(bank or AdhesionBank())},
        [Connection(f"log.{name}", f"adhesion.{name}") for name in NAMES],
        step=1e-3,
    )


def ran(master, recorder, n):
    master.run(n_steps=n)
    return recorder.table.copy()


def test_component_is_the_bank(recording, alone):
    recorder = Recorder("adhesion.*")
    with Master(system(recording), observers=[recorder]) as master:
        master.run(n_steps=1500)
    # Row k + 1 is what is said after sample k: a block of 10 samples ends with sample 9.
    rows = np.arange(10, 1501, 10)
    for i, name in enumerate(alone.conditions):
        assert np.allclose(
            recorder[f"adhesion.p_condition.{name}"][rows], alone.p_condition[:150, i], atol=1e-9
        )
    for name in ("mu_used", "mu_max", "mu_max_low", "mu_max_high"):
        assert np.allclose(recorder[f"adhesion.{name}"][rows], getattr(alone, name)[:150], rtol=1e-9)
    assert np.array_equal(recorder["adhesion.identifiable"][rows] == 1.0, alone.identifiable[:150])
    fuzzy = alone.fuzzy
    for what, names in (("region", alone.regions), ("condition", alone.conditions)):
        for i, name in enumerate(names):
            assert np.array_equal(
                recorder[f"adhesion.fuzzy_{what}.{name}"][rows], getattr(fuzzy, what)[:150, i]
            )
    assert np.array_equal(recorder["adhesion.fuzzy_known"][rows], fuzzy.known[:150])
    advised = np.isfinite(fuzzy.score[:150])
    assert np.array_equal(recorder["adhesion.advised"][rows] == 1.0, advised)
    assert np.array_equal(recorder["adhesion.advice"][rows], np.where(advised, fuzzy.score[:150], 0.0))


def test_the_fuzzy_identifier_finds_the_rail_and_advises(alone):
    """Wet rail at a seventh of its peak, after the second that its window holds."""
    fuzzy = alone.fuzzy.at(slice(100, 150))
    assert alone.conditions[fuzzy.condition.mean(axis=0).argmax()] == "wet"
    assert alone.regions[fuzzy.region.mean(axis=0).argmax()] == "linear"
    assert fuzzy.known.min() > 0.8
    assert set(fuzzy.advice.words) <= {"more torque possible", "no statement"}


def test_a_resumed_run_is_the_unbroken_one(recording, tmp_path):
    recorder = Recorder("adhesion.*")
    with Master(system(recording), observers=[recorder]) as master:
        ran(master, recorder, 707)
        master.write_state(tmp_path / "state")
        unbroken = ran(master, recorder, 500)
    with Master(system(recording), observers=[recorder]) as master:
        master.read_state(tmp_path / "state")
        assert np.array_equal(ran(master, recorder, 500), unbroken)


def test_the_sampling_time_must_be_that_of_the_bank(recording):
    with (
        pytest.raises(InputError, match="0\\.002 s, for which the bank is made"),
        Master(system(recording, AdhesionBank(h=2e-3))) as master,
    ):
        master.run(n_steps=1)
