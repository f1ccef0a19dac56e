"""FMU states: what is restored continues to the bit, and bytes of anything else are refused."""

from __future__ import annotations

import ctypes
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from fmu_wheelset.variables import VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable

    MakePlant = Callable[..., Any]

both = pytest.mark.parametrize("fmi", [2, 3])
OUTPUTS = tuple(v.name for v in VARIABLES if v.causality in {"output", "local"})


def running(plant: MakePlant, fmi: int, mode: DriveMode = DriveMode.TORQUE_DRIVEN) -> Any:
    """An instance in full motion at 20 ms."""
    one = plant(fmi, drive_mode=mode, forward_dynamics=True, lateral_displacement=1e-3, traction_torque=4e3)
    one.initialise().run(20)
    return one


def continued(one: Any, begin: int = 20) -> bytes:
    """The bits of all outputs over 30 ms with moving inputs."""
    rows = []
    for k in range(begin, begin + 30):
        one.set(track_lateral_offset=1e-4 * np.sin(k), suspension_lateral_force=50.0 * k)
        one.step(k * 1e-3, 1e-3)
        rows.append(one.get("time", *OUTPUTS))
    return np.array(rows).tobytes()


def serialised(one: Any) -> bytes:
    state = one.slave.getFMUState()
    data: bytes = one.slave.serializeFMUState(state)
    one.slave.freeFMUState(state)
    return data


def deserialise(one: Any, data: bytes) -> ctypes.c_void_p:
    s = one.slave
    state: ctypes.c_void_p = (s.deSerializeFMUstate if one.fmi == 2 else s.deserializeFMUState)(data)
    return state


@both
@pytest.mark.parametrize("mode", list(DriveMode))
def test_rollback_repeats_the_run_to_the_bit(plant: MakePlant, fmi: int, mode: DriveMode) -> None:
    one = running(plant, fmi, mode)
    state = one.slave.getFMUState()
    first = continued(one)
    for _ in range(2):
        one.slave.setFMUState(state)
        assert one.get("time") == [0.02]
        assert continued(one) == first
    one.slave.freeFMUState(state)


@both
def test_state_also_holds_inputs_parameters_and_outputs(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, speed=31.0, k_w=4e6)
    names = [v.name for v in VARIABLES if v.kind == "Float64"]
    before, state = one.get(*names), one.slave.getFMUState()
    one.set(speed=12.0, k_w=3e6, lateral_displacement=5e-3)
    one.initialise().run(5)
    assert one.get(*names) != before
    one.slave.setFMUState(state)
    assert one.get(*names) == before
    one.set(k_w=1e6)  # again instantiated, so parameters can be set
    one.slave.freeFMUState(state)


@both
def test_state_taken_again_uses_the_same_memory(plant: MakePlant, fmi: int) -> None:
    one = running(plant, fmi)
    state = one.slave.getFMUState()
    address = state.value
    one.step(0.02, 1e-3)
    get = one.slave.fmi2GetFMUstate if fmi == 2 else one.slave.fmi3GetFMUState
    get(one.slave.component, ctypes.byref(state))
    assert state.value == address
    one.slave.reset()
    one.slave.setFMUState(state)
    assert one.get("time") == [0.021]
    one.slave.freeFMUState(state)


@both
def test_bytes_continue_in_another_instance_to_the_bit(plant: MakePlant, fmi: int) -> None:
    one = running(plant, fmi)
    data, other = serialised(one), plant(fmi, speed=70.0)
    first = continued(one)
    state = deserialise(one, data)
    assert one.slave.serializeFMUState(state) == data
    one.slave.freeFMUState(state)
    state = deserialise(other, data)
    other.slave.setFMUState(state)
    assert continued(other) == first
    other.slave.freeFMUState(state)


def test_both_standards_write_the_same_bytes(plant: MakePlant) -> None:
    assert serialised(running(plant, 2)) == serialised(running(plant, 3))


def changed(data: bytes, i: int) -> bytes:
    return data[:i] + bytes([data[i] ^ 1]) + data[i + 1 :]


@both
def test_other_bytes_are_refused(plant: MakePlant, fmi: int) -> None:
    one = running(plant, fmi)
    data = serialised(one)
    wrong_size = r"FMU state: got \d+ bytes, expected \d+"
    damaged = r"FMU state: got bytes that are damaged or of another build"
    cases = [(b"", wrong_size), (data[:-1], wrong_size), (data + b"\0", wrong_size)]
    cases += [(bytes(len(data)), damaged)]
    cases += [(changed(data, i), damaged) for i in (0, 20, 50, 60, 70, 100, len(data) // 2, len(data) - 1)]
    for other, message in cases:
        one.messages.clear()
        with pytest.raises(FMICallException):
            deserialise(one, other)
        assert len(one.messages) == 1
        assert re.match(message, one.messages[0]), one.messages
    assert one.get("time") == [0.02]


@both
def test_null_pointers_are_refused(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    library, instance = ctypes.CDLL(one.slave.dll._name), ctypes.c_void_p(one.slave.component)
    word = "FMUstate" if fmi == 2 else "FMUState"
    state, size, memory = one.slave.getFMUState(), ctypes.c_size_t(), ctypes.create_string_buffer(4000)
    read = f"{'DeSerialize' if fmi == 2 else 'Deserialize'}{word}"
    calls: list[tuple[Any, ...]] = [
        (f"Get{word}", None),
        (f"Set{word}", None),
        (f"Serialized{word}Size", None, ctypes.byref(size)),
        (f"Serialized{word}Size", state, None),
        (f"Serialize{word}", None, memory, ctypes.c_size_t(len(memory))),
        (f"Serialize{word}", state, None, ctypes.c_size_t(len(memory))),
        (read, None, ctypes.c_size_t(len(memory)), ctypes.byref(state)),
        (read, memory, ctypes.c_size_t(len(memory)), None),
    ]
    for name, *arguments in calls:
        one.messages.clear()
        assert getattr(library, f"fmi{fmi}{name}")(instance, *arguments) == 3, name
        assert len(one.messages) == 1
        assert one.messages[0].startswith("FMU state: got a null pointer, expected "), name
    one.slave.freeFMUState(state)
    one.slave.freeFMUState(ctypes.c_void_p())  # nothing to free is no error
