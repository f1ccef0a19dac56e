"""Many instances: in several threads at once, and one after the other without a leak."""

from __future__ import annotations

import ctypes
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import TYPE_CHECKING, Any

import pytest

from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

    Extracted = dict[int, tuple[Path, ModelDescription]]

THREADS, STEPS = 4, 400
OUTPUTS = [i for i, v in enumerate(VARIABLES) if v.causality in {"output", "local"}]


@pytest.fixture(scope="module")
def library(extracted: Extracted) -> tuple[ctypes.CDLL, bytes]:
    """The library without fmpy, whose wrappers hold the interpreter; calls release it."""
    folder, description = extracted[3]
    (path,) = (folder / "binaries").rglob("wheelset.so")
    loaded = ctypes.CDLL(str(path))
    loaded.fmi3InstantiateCoSimulation.restype = ctypes.c_void_p
    return loaded, description.guid.encode()


def instantiate(library: tuple[ctypes.CDLL, bytes]) -> ctypes.c_void_p:
    loaded, token = library
    nothing = [None, ctypes.c_size_t(0), None, None, None]
    flags = [ctypes.c_bool(False)] * 4
    return ctypes.c_void_p(loaded.fmi3InstantiateCoSimulation(b"one", token, b"", *flags, *nothing))


def set_real(loaded: Any, instance: Any, name: str, value: float) -> None:
    reference, real, one = ctypes.c_uint32(REFERENCES[name]), ctypes.c_double(value), ctypes.c_size_t(1)
    assert loaded.fmi3SetFloat64(instance, ctypes.byref(reference), one, ctypes.byref(real), one) == 0


def initialise(loaded: Any, instance: Any) -> None:
    zero, no = ctypes.c_double(0.0), ctypes.c_bool(False)
    assert loaded.fmi3EnterInitializationMode(instance, no, zero, zero, no, zero) == 0
    assert loaded.fmi3ExitInitializationMode(instance) == 0


def run(library: tuple[ctypes.CDLL, bytes], number: int, start: Barrier | None = None) -> bytes:
    """The bits of all outputs over a run that depends on the number."""
    loaded, _ = library
    instance, n = instantiate(library), ctypes.c_size_t(len(OUTPUTS))
    mode = ctypes.c_int64(list(DriveMode)[number % 3].value)
    reference, one = ctypes.c_uint32(REFERENCES["drive_mode"]), ctypes.c_size_t(1)
    assert loaded.fmi3SetInt64(instance, ctypes.byref(reference), one, ctypes.byref(mode), one) == 0
    set_real(loaded, instance, "speed", 10.0 + 5.0 * number)
    set_real(loaded, instance, "lateral_displacement", 1e-3)
    initialise(loaded, instance)
    references, values = (ctypes.c_uint32 * len(OUTPUTS))(*OUTPUTS), (ctypes.c_double * len(OUTPUTS))()
    flags, reached, rows = [ctypes.byref(ctypes.c_bool()) for _ in range(3)], ctypes.c_double(), b""
    if start:
        start.wait()
    for k in range(STEPS):
        set_real(loaded, instance, "track_lateral_offset", 1e-6 * (k % 7) * (number + 1))
        t, h = ctypes.c_double(k * 1e-3), ctypes.c_double(1e-3)
        status = loaded.fmi3DoStep(instance, t, h, ctypes.c_bool(True), *flags, ctypes.byref(reached))
        assert status == loaded.fmi3GetFloat64(instance, references, n, values, n) == 0
        rows += bytes(values)
    loaded.fmi3FreeInstance(instance)
    return rows


def test_threads_compute_the_bits_of_runs_in_turn(library: tuple[ctypes.CDLL, bytes]) -> None:
    in_turn = [run(library, number) for number in range(THREADS)]
    assert len(set(in_turn)) == THREADS
    start = Barrier(THREADS)
    with ThreadPoolExecutor(THREADS) as pool:
        at_once = list(pool.map(lambda number: run(library, number, start), range(THREADS)))
    assert at_once == in_turn


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


def test_instances_leave_no_memory_behind(library: tuple[ctypes.CDLL, bytes]) -> None:
    """10 000 instances, each with a copy of its state: more than 10 MB of either if they stayed."""
    loaded, _ = library

    def live(times: int) -> None:
        for _ in range(times):
            instance, state = instantiate(library), ctypes.c_void_p()
            initialise(loaded, instance)
            assert loaded.fmi3GetFMUState(instance, ctypes.byref(state)) == 0
            assert loaded.fmi3FreeFMUState(instance, ctypes.byref(state)) == 0
            loaded.fmi3FreeInstance(instance)

    live(1000)
    before = resident_bytes()
    live(10_000)
    assert resident_bytes() - before < 1_000_000
