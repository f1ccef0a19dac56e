"""Track, sensors and identifier in the compiled loop: the same bits, saved states, independent copies."""

from __future__ import annotations

import copy
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from co_sim.component import Port, StateError
from co_sim.errors import RunError
from co_sim.master import Master
from co_sim.native import NativeStep
from co_sim.signals import TimeTable
from co_sim.system import Connection, System
from co_sim.wheelset.assembly import assemble
from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.identification import MEASUREMENTS, IdentifierComponent
from co_sim.wheelset.scenario_file import load_scenario
from co_sim.wheelset.sensors import Channel, Sensors, SensorSpec
from co_sim.wheelset.track import TrackInput, synthesise
from estimator import (
    ERRI_B176,
    CreepCurve,
    FilterBank,
    Identifier,
    NoiseModel,
    design_filter,
    filter_model,
    identification_system,
    operating_points,
)
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

H = 1e-3
WINDOW = 30
STEPS = 150
NOISE = NoiseModel(track_rate=1e-6, acceleration=1e-6, lever=0.75, sensors=(1e-3, 0.05))


@pytest.fixture(scope="module")
def identifier() -> Identifier:
    filters = [
        design_filter(filter_model(point, WheelsetParameters()), NOISE.W, NOISE.R, 2 * H, name=point.name)
        for point in operating_points(CreepCurve(CONDITIONS["dry"], 20.0))
    ]
    return Identifier(
        FilterBank(filters), identification_system(3), window=WINDOW, weights=np.array([400.0, 1.0])
    )


@pytest.fixture(params=[1, 2], ids=["every step", "every second step"])
def system(identifier: Identifier, request: pytest.FixtureRequest) -> System:
    """A scheme whose plant is a table of motions; sampled at 1 kHz or at 500 Hz."""
    period: int = request.param
    times = np.arange(0.0, 0.2, 5e-3)
    motion = np.column_stack([1e-3 * np.sin(90.0 * times), 0.2 * np.cos(70.0 * times), 20.0 + 5.0 * times])
    ports = [*(Port(name, unit) for name, unit in MEASUREMENTS), Port("speed", "m/s")]
    specs = (
        SensorSpec(noise_rms=1e-3, bias=1e-4, bandwidth_hz=80.0, rate_hz=1.0 / (period * H)),
        SensorSpec(noise_rms=0.05, rate_hz=1.0 / (period * H)),
    )
    channels = [Channel(*measured, spec) for measured, spec in zip(MEASUREMENTS, specs, strict=True)]
    track = synthesise(ERRI_B176["erri_low"], 10.0, np.random.default_rng(4))
    components = {
        "plant": TimeTable(times.tolist(), motion, ports, interpolation="linear"),
        "track": TrackInput(track, ramp=1.5),
        "sensors": Sensors(channels, seed=5),
        "identifier": IdentifierComponent(identifier, period=period),
    }
    wires = [Connection("plant.speed", "track.speed")]
    for name, _ in MEASUREMENTS:
        wires += [
            Connection(f"plant.{name}", f"sensors.{name}"),
            Connection(f"sensors.{name}", f"identifier.{name}"),
        ]
    return System(components, wires, step=H)


def rows_of(master: Master, n: int) -> NDArray[np.float64]:
    rows = []
    for _ in range(n):
        master.step()
        rows.append(master.values.copy())
    return np.array(rows)


def copy_of(system: System) -> System:
    components = {name: copy.deepcopy(component) for name, component in system.components.items()}
    return replace(system, components=components)


def run(system: System, *, compiled: bool = True, n: int = STEPS) -> NDArray[np.float64]:
    with Master(system, compiled=compiled) as master:
        return rows_of(master, n)


def test_every_part_is_machine_code_while_it_runs(system: System) -> None:
    with Master(system) as master:
        master.start()
        for component in system.components.values():
            assert isinstance(component.native(), NativeStep)
    for component in system.components.values():
        with pytest.raises(StateError, match="not started"):
            component.native()


def test_the_interpreter_makes_the_same_bits(system: System) -> None:
    values = run(system)
    assert np.isfinite(values).all()
    assert (np.ptp(values, axis=0)[: len(MEASUREMENTS)] > 0.0).all()
    np.testing.assert_array_equal(run(system, compiled=False), values)


def test_a_run_is_repeated_by_the_next_one(system: System) -> None:
    np.testing.assert_array_equal(run(system), run(system))


# Within the first window of samples and after it, and between two samples.
@pytest.mark.parametrize("at", [0, 7, 101])
def test_a_resumed_run_is_the_unbroken_one(system: System, at: int, tmp_path: Path) -> None:
    whole = run(system)
    with Master(system) as master:
        rows_of(master, at)
        state = master.save()
        master.write_state(tmp_path / "state")
        for _ in range(2):  # as often as wanted
            np.testing.assert_array_equal(rows_of(master, STEPS - at), whole[at:])
            master.restore(state)
    with Master(copy_of(system)) as master:
        master.read_state(tmp_path / "state")
        np.testing.assert_array_equal(rows_of(master, STEPS - at), whole[at:])


def test_copies_are_independent_also_at_the_same_time(system: System) -> None:
    whole = run(system)
    copies = [copy_of(system) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        for values in pool.map(run, copies):
            np.testing.assert_array_equal(values, whole)


def test_states_are_of_started_components_of_the_same_size(system: System, identifier: Identifier) -> None:
    narrow = Identifier(identifier.bank, identifier.fuzzy.system, window=7, weights=identifier.weights)
    others = {
        "track": None,
        "sensors": Sensors([Channel("yaw_rate", "rad/s", SensorSpec())], seed=1),
        "identifier": IdentifierComponent(narrow),
    }
    with Master(system) as master:
        states = master.save().states
    for name, other in others.items():
        component = system.components[name]
        data = component.serialize(states[name])
        if other is not None:
            with pytest.raises(StateError, match=r"channels, and the state is of 2|values of 8 bytes, and"):
                other.deserialize(data)
        for use in (component.save, lambda c=component, n=name: c.restore(states[n])):
            with pytest.raises(StateError, match="not started"):
                use()


def test_one_identifier_serves_two_components(identifier: Identifier) -> None:
    samples = np.random.default_rng(1).normal(size=(2, 60, 2)) * [1e-3, 0.05]
    both = [IdentifierComponent(identifier) for _ in range(2)]
    y = np.empty((2, 60, len(both[0].outputs)))
    for component in both:
        component.start(0.0, H)
    for k in range(60):
        for i, component in enumerate(both):
            component.step(k * H, H, samples[i, k], y[i, k])
    for i in range(2):
        np.testing.assert_array_equal(y[i, :, :3], identifier.run(samples[i]).E)


def test_noise_is_that_of_numpy_s_generator() -> None:
    sensors = Sensors([Channel("yaw_rate", "rad/s", SensorSpec(noise_rms=0.3, bias=2.0))], seed=11)
    source = TimeTable([0.0], [1.0], [Port("yaw_rate", "rad/s")])
    system = System({"a": source, "s": sensors}, [Connection("a.yaw_rate", "s.yaw_rate")], step=H)
    seed = np.random.SeedSequence(11, spawn_key=tuple(b"yaw_rate"))
    # The first of all normal numbers is that of the start; 40 000 reach the tail of the ziggurat.
    noise = 0.3 * np.random.default_rng(seed).standard_normal(40_001)[1:]
    np.testing.assert_array_equal(run(system, n=40_000)[:, 1], 1.0 + 2.0 + noise)


@pytest.mark.parametrize("name", ["default", "adhesion-drop"])
def test_the_packaged_schemes_need_no_interpreter_and_resume(
    name: str, identifier: Identifier, tmp_path: Path
) -> None:
    scenario, folder = load_scenario(name)
    case = Laboratory(scenario, name, folder).cases[0]
    systems = [assemble(scenario, case, identifier) for _ in range(2)]
    whole = run(systems[0])
    np.testing.assert_array_equal(run(systems[0], compiled=False), whole)
    with Master(systems[0]) as master:
        rows_of(master, 60)
        assert all(isinstance(c.native(), NativeStep) for c in systems[0].components.values())
        master.write_state(tmp_path / "state")
    with Master(systems[1]) as master:
        master.read_state(tmp_path / "state")
        np.testing.assert_array_equal(rows_of(master, STEPS - 60), whole[60:])


@pytest.mark.parametrize("compiled", [True, False])
def test_a_track_that_ends_ends_the_run(compiled: bool) -> None:
    track = TrackInput(synthesise(ERRI_B176["erri_low"], 1.0, np.random.default_rng(1)), speed=20.0)
    with Master(System({"track": track}, step=0.01), compiled=compiled) as master:
        with pytest.raises(RunError) as caught:
            master.run(n_steps=10)
        assert (caught.value.component, caught.value.step) == ("track", 5)
        assert str(caught.value).endswith(
            "track: got a distance of 1.2 m, expected at most 1 m;"
            " shorten the run, lower the speed or give a longer track"
        )
