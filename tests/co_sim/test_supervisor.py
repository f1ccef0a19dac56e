"""Whatever an FMU does, the caller lives, is told who did it, and has all results up to there."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest

from co_sim import Connection, FmuComponent, Master, Recorder, RunError, System
from co_sim.supervisor import Supervised, run
from co_sim.supervisor.tail import Tail

H, N, AT = 0.1, 12, 5


def faulty_system(fmu, name):
    """A healthy instance that feeds another one, which does what its name says in its step number 5."""
    components = {"healthy": FmuComponent(fmu), name: FmuComponent(fmu, parameters={"at": AT})}
    return System(components, [Connection("healthy.y", f"{name}.u")], step=H)


def healthy_record(fmu):
    recorder = Recorder()
    with Master(faulty_system(fmu, "other"), observers=[recorder]) as master:
        master.run(n_steps=N)
    return recorder


def fault_of(fmu, name, **options):
    """Run it; return its error and its record."""
    with pytest.raises(RunError) as caught:
        run(faulty_system(fmu, name), N * H, **options)
    error = caught.value
    assert error.component == name
    assert error.instance == f"{fmu.name}, FMI {fmu.stem[-1]}.0"
    assert error.time == pytest.approx(error.step * H)
    return error


DEATHS = {
    "segfault": "SIGSEGV",
    "abort": "SIGABRT",
    "exit": "the exit code 3",
    "exit0": "the exit code 0",
    "hang": r"nothing happened for 0\.5 s",
}
#: For those that hang; what is slow because the machine is busy must not be taken for one.
FAST = {"timeout": 0.5, "start_timeout": 0.5}


def limits(fault):
    return FAST if fault == "hang" else {}


@pytest.mark.parametrize("fault", DEATHS)
def test_death_in_a_step(faulty_fmu, fault):
    error = fault_of(faulty_fmu, f"{fault}_in_step", **limits(fault))
    assert error.step == AT
    assert_told(error, fault, "step", "in its step")
    assert_results(error, healthy_record(faulty_fmu), AT)


@pytest.mark.parametrize("fault", DEATHS)
@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("instantiate", "in fmi.Instantiate"),
        ("enter", "in fmi.EnterInitializationMode"),
        ("get", "in its initialisation"),
        ("initialise", "in fmi.ExitInitializationMode"),
    ],
)
def test_death_before_the_steps(faulty_fmu, fault, place, words):
    error = fault_of(faulty_fmu, f"{fault}_in_{place}", **limits(fault))
    assert (error.step, error.time) == (0, 0.0)
    assert_told(error, fault, place, words)
    assert len(error.record.time) <= 1


@pytest.mark.parametrize("fault", DEATHS)
@pytest.mark.parametrize(
    ("place", "words"), [("terminate", "in fmi.Terminate"), ("free", "in fmi.FreeInstance")]
)
def test_death_after_the_steps(faulty_fmu, fault, place, words):
    error = fault_of(faulty_fmu, f"{fault}_in_{place}", **limits(fault))
    assert error.step == N
    assert_told(error, fault, place, words)
    assert_results(error, healthy_record(faulty_fmu), N)


def assert_told(error, fault, place, words):
    assert_that(error.reason, DEATHS[fault])
    assert_that(error.reason, words)
    logged, printed = f"now comes {fault} in {place}", f"printed: now comes {fault} in {place}"
    assert any(line.endswith(logged) and error.component in line for line in error.log), error.log
    assert printed in error.log
    assert logged in str(error)


def assert_that(text, pattern):
    assert re.search(pattern, text), text


def assert_results(error, reference, step):
    """The record is that of the healthy run up to the step, to the bit."""
    n = step + 1
    assert np.array_equal(error.record.time, reference.time[:n])
    assert np.array_equal(error.record.table, reference.table[:n])


@pytest.mark.parametrize("fault", ["discard", "error", "fatal", "pending"])
def test_refused_step(faulty_fmu, fault):
    error = fault_of(faulty_fmu, f"{fault}_in_step")
    assert error.step == AT
    assert f"the status {fault}" in error.reason
    assert f"now comes {fault} in step" in error.reason
    assert_results(error, healthy_record(faulty_fmu), AT)


@pytest.mark.parametrize("fault", ["nan", "inf"])
def test_output_that_is_not_finite(faulty_fmu, fault):
    error = fault_of(faulty_fmu, f"{fault}_in_step")
    assert error.step == AT
    assert f"y became {fault}" in error.reason
    assert_results(error, healthy_record(faulty_fmu), AT)


@pytest.mark.parametrize("place", ["instantiate", "enter", "initialise", "terminate"])
@pytest.mark.parametrize("fault", ["discard", "error", "fatal", "pending"])
def test_refusal_outside_of_the_steps(faulty_fmu, fault, place):
    error = fault_of(faulty_fmu, f"{fault}_in_{place}")
    assert f"now comes {fault} in {place}" in error.reason
    if place == "terminate":
        assert_results(error, healthy_record(faulty_fmu), N)


@pytest.mark.parametrize("fault", ["nan", "inf"])
def test_start_value_that_is_not_finite(faulty_fmu, fault):
    error = fault_of(faulty_fmu, f"{fault}_in_enter")
    assert (error.step, len(error.record.time)) == (0, 0)
    assert f"y became {fault} at t = 0 s" in error.reason


@pytest.mark.parametrize("place", ["instantiate", "enter", "initialise", "step", "terminate", "free"])
@pytest.mark.parametrize("trouble", ["warning", "flood", "logs"])
def test_what_stops_no_run(faulty_fmu, trouble, place):
    record = run(faulty_system(faulty_fmu, f"{trouble}_in_{place}"), N * H)
    assert np.array_equal(record.table, healthy_record(faulty_fmu).table)


def test_endless_printing_is_a_hang(faulty_fmu):
    error = fault_of(faulty_fmu, "endless_in_step", **FAST)
    assert error.step == AT
    assert "nothing happened for 0.5 s" in error.reason
    assert sum(map(len, error.log)) < 100_000
    assert_results(error, healthy_record(faulty_fmu), AT)


@pytest.mark.parametrize("place", ["instantiate", "initialise", "step", "terminate", "free"])
@pytest.mark.parametrize("fault", ["allocate", "insist"])
def test_endless_allocation(faulty_fmu, fault, place):
    # One that goes on asking hangs, but not before it has all that there is.
    given = {"timeout": 1.0, "start_timeout": 1.0} if fault == "insist" else {}
    error = fault_of(faulty_fmu, f"{fault}_in_{place}", memory_limit=100_000_000, **given)
    assert "MB of the 100 MB that it may" in error.reason
    assert any("no memory left" in line for line in error.log)
    if place in {"step", "terminate", "free"}:
        assert_results(error, healthy_record(faulty_fmu), {"step": AT}.get(place, N))


def test_supervised_and_unsupervised_runs_are_the_same(faulty_fmu):
    recorder = Recorder()
    with Supervised(faulty_system(faulty_fmu, "other"), observers=[recorder]) as supervised:
        supervised.run(n_steps=N)
        assert supervised.k == N
        assert np.array_equal(supervised.values, recorder.table[-1])
    reference = healthy_record(faulty_fmu)
    assert np.array_equal(recorder.table, reference.table)
    assert np.array_equal(recorder.time, reference.time)


def test_the_tail_is_short_whatever_was_printed():
    reading, writing = os.pipe()
    tail = Tail(reading, echo=False)
    assert tail.read()
    assert tail.lines == ()
    for text in ("first\n", "\n", 3 * "again\n", "x" * 5000 + "\n", "caf\xe9"):
        os.write(writing, text.encode("latin-1"))
        assert tail.read()
    assert tail.lines == (
        "first",
        "again (3 times)",
        f"{'x' * 1000} ... (5000 characters)",
        "caf\N{REPLACEMENT CHARACTER}",
    )
    for i in range(20000):
        os.write(writing, b"%d\n" % i)
        tail.read()
    assert tail.lines == tuple(map(str, range(19950, 20000)))
    os.close(writing)
    assert not tail.read()
