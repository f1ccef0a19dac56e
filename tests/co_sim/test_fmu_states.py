"""Saved states of FMUs, and what instances share."""

import gc
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from co_sim import FmuComponent, InputError
from co_sim.component import StateError
from co_sim.fmi import FmuError
from fmu_wheelset import path as wheelset

H = 0.25


@pytest.fixture(autouse=True)
def temporary_folder(tmp_path, monkeypatch):
    """Every test must leave this folder empty."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    assert list(folder.iterdir()) == []


@pytest.fixture
def running(parrot):
    fmu = FmuComponent(parrot, inputs=["float64_in"], outputs=["sum", "states", "never_back"])
    begin(fmu)
    yield fmu
    fmu.close()


def begin(fmu):
    fmu.start(0.0, H)
    advance(fmu, 0, exchange=True)
    fmu.enter_steps()


def advance(fmu, k, *, u=1.0, exchange=False):
    y = np.zeros(sum(port.size for port in fmu.outputs))
    inputs = np.array([u, 0.0, 0.0])
    if exchange:
        fmu.exchange(inputs[:1], y)
    else:
        fmu.step(k * H, H, inputs, y)
    return y


def test_a_restored_run_equals_an_unbroken_one(running):
    unbroken = [advance(running, k, u=k + 0.1)[0] for k in range(2)]
    state = running.save()
    unbroken += [advance(running, k, u=k + 0.1)[0] for k in range(2, 5)]
    for _ in range(2):
        running.restore(state)
        assert [advance(running, k, u=k + 0.1)[0] for k in range(2, 5)] == unbroken[2:]


def test_a_state_goes_to_another_run_as_bytes(running, parrot):
    advance(running, 0)
    data = running.serialize(running.save())
    expected = advance(running, 1, u=0.3)[0]
    other = FmuComponent(parrot, inputs=["float64_in"], outputs=["sum", "states", "never_back"])
    other.start(0.0, H)  # not yet in steps: the state says that it is
    other.restore(other.deserialize(data))
    assert advance(other, 1, u=0.3)[0] == expected
    other.close()


def test_a_state_of_the_initialisation_returns_to_it(parrot):
    fmu = FmuComponent(parrot, inputs=["float64_in"], outputs=["sum"])
    fmu.start(0.0, H)
    state = fmu.save()
    fmu.enter_steps()
    first = advance(fmu, 0)
    fmu.restore(state)
    with pytest.raises(FmuError, match="doStep returned the status error"):
        advance(fmu, 0)
    fmu.restore(state)
    fmu.enter_steps()
    assert advance(fmu, 0) == first
    fmu.close()


def test_an_fmu_knows_whether_earlier_states_may_return(running):
    assert advance(running, 0)[2] == 1.0
    running.save()
    assert advance(running, 1)[2] == 0.0


def test_states_that_nobody_knows_are_freed(running):
    kept = running.save()
    for k in range(100):
        running.save()
        assert advance(running, k)[1] <= 2.0
    gc.collect()
    running.restore(kept)
    assert advance(running, 0)[1] == 1.0


def test_a_run_continues_after_a_rejected_step(parrot):
    parameters = {"trouble": 2, "trouble_in": 2}
    fmu = FmuComponent(parrot, inputs=["float64_in"], outputs=["sum"], parameters=parameters)
    begin(fmu)
    state = fmu.save()
    first = advance(fmu, 0)
    with pytest.raises(FmuError, match="discard"):
        advance(fmu, 1)
    fmu.restore(state)
    assert advance(fmu, 0) == first
    fmu.close()


def test_derivatives_of_inputs_belong_to_the_state(parrots):
    fmu = FmuComponent(parrots[2], inputs=["float64_in"], outputs=["sum", "order"])
    fmu.start(0.0, H)
    fmu.enter_steps()
    y = np.zeros(2)
    fmu.step(0.0, H, np.array([1.0, 2.0, 0.0]), y)
    state = fmu.save()
    results = []
    for _ in range(2):
        fmu.step(H, H, np.array([1.0, 0.0, 0.0]), y)  # takes the derivative back
        results.append(y.tolist())
        fmu.step(2 * H, H, np.array([1.0, 0.0, 0.0]), y)
        fmu.restore(state)
    assert results[0] == results[1]
    fmu.close()


def test_states_of_other_runs_and_fmus_are_refused(running, parrot):
    other = FmuComponent(parrot, inputs=[], outputs=[])
    begin_without_ports(other)
    state = other.save()
    data = other.serialize(state)
    with pytest.raises(StateError, match="not one of this run"):
        running.restore(state)
    for bad in (b"", b"123", data.replace(b"parrot", b"carrot")):
        with pytest.raises(StateError, match="no state of parrot"):
            running.deserialize(bad)
    with pytest.raises(StateError, match="error"):
        running.deserialize(data[:-1])
    other.close()
    with pytest.raises(StateError, match="not one of this run"):
        other.restore(state)


def begin_without_ports(fmu):
    fmu.start(0.0, H)
    fmu.exchange(np.empty(0), np.empty(0))
    fmu.enter_steps()


def test_an_fmu_without_the_flag_says_which(lag_fmu):
    fmu = FmuComponent(lag_fmu)
    fmu.start(0.0, H)
    with pytest.raises(StateError, match=r"does not declare canGetAndSetFMUstate"):
        fmu.save()
    with pytest.raises(StateError, match=r"does not declare"):
        fmu.deserialize(b"")
    fmu.close()


@pytest.fixture(params=[2, 3])
def plant(request):
    fmu = FmuComponent(wheelset(fmi=request.param))
    yield fmu
    fmu.close()


def begin_plant(fmu):
    fmu.start(0.0, 1e-3)
    fmu.exchange(np.array([port.start for port in fmu.inputs]), np.zeros(len(fmu.outputs)))
    fmu.enter_steps()


def drive(fmu, steps, step=None):
    """Return the outputs of steps of the wheelset under inputs that shake."""
    table = np.zeros((len(steps), len(fmu.outputs)))
    u = np.array([port.start for port in fmu.inputs])
    for row, k in zip(table, steps, strict=True):
        (step or fmu.step)(k * 1e-3, 1e-3, u + 1e-3 * np.sin(k + np.arange(u.size)), row)
    return table


def test_the_wheelset_returns_bit_for_bit(plant):
    begin_plant(plant)
    assert plant.native() is not None
    drive(plant, range(20))
    state = plant.save()
    data = plant.serialize(state)
    expected = drive(plant, range(20, 40))
    assert (expected[-1] != expected[0]).any()
    plant.restore(state)
    np.testing.assert_array_equal(drive(plant, range(20, 40)), expected)
    plant.restore(plant.deserialize(data))
    np.testing.assert_array_equal(drive(plant, range(20, 40)), expected)


def test_the_wheelset_takes_the_same_steps_in_the_interpreter(plant):
    begin_plant(plant)
    expected = drive(plant, range(50))
    plant.close()
    begin_plant(plant)
    np.testing.assert_array_equal(drive(plant, range(50), plant._bound.step), expected)


@pytest.mark.parametrize("version", [2, 3])
def test_the_linear_model_of_the_wheelset_is_that_of_differences(version):
    path = wheelset(fmi=version)
    states = FmuComponent(path).states
    moving = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")

    def derivatives(name, value):
        fmu = FmuComponent(path, outputs=[s.derivative for s in states], parameters={name: value})
        fmu.start(0.0, 1e-3)
        y = np.zeros(len(states))
        fmu.exchange(np.array([port.start for port in fmu.inputs]), y)
        fmu.close()
        return y

    fmu = FmuComponent(path, outputs=[state.name for state in states])
    begin_plant(fmu)
    model = fmu.linearize(0.0, np.array([port.start for port in fmu.inputs]))
    fmu.close()
    np.testing.assert_array_equal(model.C, np.eye(len(states)))
    for name in moving:
        found = (derivatives(name, 1e-6) - derivatives(name, -1e-6)) / 2e-6
        np.testing.assert_allclose(model.A[:, model.states.index(name)], found, rtol=1e-6, atol=1e-9)


def test_instances_share_a_folder_while_they_live(lag_fmu, temporary_folder):
    first, second = FmuComponent(lag_fmu), FmuComponent(lag_fmu)
    first.start(0.0, H)
    second.start(0.0, H)
    (folder,) = temporary_folder.iterdir()
    first.close()
    assert list(temporary_folder.iterdir()) == [folder]
    second.close()


def copied(path, folder, old, new):
    copy = folder / "copy.fmu"
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(copy, "w") as target:
        for item in source.infolist():
            content = source.read(item)
            if item.filename == "modelDescription.xml":
                content = content.replace(old, new)
            target.writestr(item, content)
    return copy


def test_an_archive_that_was_written_anew_is_unpacked_anew(lag_fmu, tmp_path, temporary_folder):
    path = copied(lag_fmu, tmp_path, b'start="0.5"', b'start="0.5"')
    first = FmuComponent(path)
    first.start(0.0, H)
    copied(lag_fmu, tmp_path, b'start="0.5"', b'start="1.5"')
    second = FmuComponent(path)
    second.start(0.0, H)
    texts = [Path(folder, "modelDescription.xml").read_text() for folder in temporary_folder.iterdir()]
    assert sorted('start="1.5"' in text for text in texts) == [False, True]
    first.close()
    second.close()


def test_an_fmu_that_allows_one_instance_has_a_folder_for_each(lag_fmu, tmp_path, temporary_folder):
    flag = b'canBeInstantiatedOnlyOncePerProcess="true" canHandle'
    path = copied(lag_fmu, tmp_path, b"canHandle", flag)
    parts = [FmuComponent(path), FmuComponent(path)]
    for part in parts:
        part.start(0.0, H)
    assert len(list(temporary_folder.iterdir())) == 2
    for part in parts:
        part.close()


def test_nothing_can_be_restored_after_a_fatal_error(parrot):
    parameters = {"trouble": 4, "trouble_in": 2}
    fmu = FmuComponent(parrot, inputs=["float64_in"], outputs=["sum"], parameters=parameters)
    begin(fmu)
    state = fmu.save()
    advance(fmu, 0)
    with pytest.raises(FmuError, match="fatal"):
        advance(fmu, 1)
    for call in (lambda: fmu.restore(state), fmu.save, lambda: fmu.serialize(state)):
        with pytest.raises(StateError, match="after a fatal error no call is allowed"):
            call()
    fmu.close()


def test_a_damaged_archive_leaves_nothing_behind(lag_fmu, tmp_path):
    path = copied(lag_fmu, tmp_path, b"", b"")
    with zipfile.ZipFile(path) as archive:
        library = next(item for item in archive.infolist() if item.filename.startswith("binaries"))
    data = bytearray(path.read_bytes())
    data[library.header_offset + 1000] ^= 0xFF
    path.write_bytes(data)
    fmu = FmuComponent(path)
    with pytest.raises(InputError, match=r"binaries/.*: got .*, expected an entry that can be unpacked"):
        fmu.start(0.0, H)
    fmu.close()
