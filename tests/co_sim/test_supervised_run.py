"""Supervised runs of healthy systems: same rows, same use; and nothing is left behind by the others."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from co_sim import (
    CompiledComponent,
    Component,
    Connection,
    Constant,
    Coupling,
    CouplingWarning,
    FmuComponent,
    FunctionComponent,
    InputError,
    Master,
    Port,
    Recorder,
    RunError,
    System,
    run,
)
from co_sim.compiled_component import compiled
from co_sim.supervisor import Supervised
from co_sim.texts import number_of

ROOT = Path(__file__).parents[2]


def oscillator(order=1, algorithm="jacobi", rate=1, n=1):
    """Two integrators that feed each other, one of them slow, and `n` more signals for larger rows."""
    return System(
        {
            "a": _integrator(1.0),
            "b": _integrator(-1.0),
            "many": Constant([list(range(n))], [Port("x", shape=(n,))]),
        },
        [Connection("a.y", "b.u"), Connection("b.y", "a.u")],
        step=1e-3,
        rates={"b": rate},
        coupling=Coupling(algorithm, order=order),
    )


@compiled
def integrate(t, h, u, y, x, p):
    x[0] += p[0] * h * u[0]
    y[0] = x[0]
    return 0


@compiled
def integral(t, u, y, x, p):
    y[0] = x[0]
    return 0


def _integrator(gain):
    ports = {"inputs": [Port("u")], "outputs": [Port("y")]}
    return CompiledComponent(
        integrate, exchange=integral, state=[1.0], parameters={"gain": gain}, feedthrough={}, **ports
    )


class Slow(Recorder):
    """A recorder that now and then takes its time."""

    def observe(self, k, time_, values):
        if k % 7 == 0:
            time.sleep(0.02)
        super().observe(k, time_, values)


class Prompt(Recorder):
    max_block = 3


def recorded(make, system, runs, recorder=None, **options):
    recorders = []
    with make(system, t0=2.0, **options) as master:
        for n in runs:
            recorders.append(Recorder() if recorder is None else recorder())
            master.observers = recorders[-1:]
            master.run(n_steps=n)
        return [(r.time.copy(), r.table.copy()) for r in recorders], master.k, np.array(master.values)


def assert_same(first, second):
    (rows, k, values), (others, other_k, other_values) = first, second
    assert k == other_k
    assert np.array_equal(values, other_values)
    for (t, table), (other_t, other_table) in zip(rows, others, strict=True):
        assert np.array_equal(t, other_t)
        assert np.array_equal(table, other_table)


@pytest.mark.parametrize(
    "system",
    [oscillator(), oscillator(order=2, rate=4), oscillator(order=0, algorithm="gauss-seidel", n=3000)],
    ids=["jacobi", "rates", "wide"],
)
def test_same_rows_over_several_runs(system):
    runs = [1, 0, 100, 7001]
    assert_same(recorded(Supervised, system, runs), recorded(Master, system, runs))


def test_same_rows_over_many_segments():
    system = oscillator(n=997)  # a hundred steps a segment
    assert_same(recorded(Supervised, system, [3, 4321]), recorded(Master, system, [3, 4321]))


def test_iterated_and_interpreted_runs():
    for options in ({"compiled": False}, {}):
        system = oscillator(algorithm="iterated") if not options else oscillator()
        assert_same(
            recorded(Supervised, system, [40, 2], **options), recorded(Master, system, [40, 2], **options)
        )


def test_a_slow_observer_loses_no_row():
    system = oscillator(n=9997)  # ten steps a segment
    assert_same(recorded(Supervised, system, [700], Slow), recorded(Master, system, [700]))


def test_observers_may_ask_for_short_blocks():
    seen = []

    class Watching(Prompt):
        def observe(self, k, time_, values):
            seen.append(len(time_))
            super().observe(k, time_, values)

    recorder = Watching()
    with Supervised(oscillator(), observers=[recorder]) as supervised:
        supervised.run(n_steps=100)
    assert seen[0] == 1, "the initial values are no step"
    assert max(seen) <= Prompt.max_block
    assert len(recorder.time) == 101


def test_state_travels_through_a_file(tmp_path):
    system = oscillator(order=2)
    with Supervised(system) as first:
        first.run(n_steps=50)
        first.write_state(tmp_path / "state")
        first.run(n_steps=50)
        wanted = first.values
    recorder = Recorder()
    with Supervised(system, observers=[recorder]) as second:
        second.read_state(tmp_path / "state")
        assert second.k == 50
        second.run(n_steps=50)
    assert np.array_equal(second.values, wanted)
    assert recorder.time[0] == 50 * system.step


def test_warnings_arrive():
    system = System(
        {"a": _integrator(12.0), "b": _integrator(12.0)},
        [Connection("a.y", "b.u"), Connection("b.y", "a.u")],
        step=1e-3,
    )
    with pytest.warns(CouplingWarning, match="without pause"):
        run(system, 1.0)
    run(system, 1.0, quiet=True)


class Failing(Component):
    """Does in its step what it was told."""

    def __init__(self, action, at=5):
        super().__init__([], [Port("y")])
        self.action, self.at, self.count = action, at, 0

    def exchange(self, u, y):
        y[:] = 0.0

    def step(self, t, h, u, y):
        self.count += 1
        if self.count == self.at + 1:
            self.action()
        y[:] = self.count


def failing(action, **options):
    return System({"failing": Failing(action, **options)}, step=0.1)


def test_exceptions_arrive_with_their_traceback():
    def give_up():
        raise ValueError("no solution")

    with pytest.raises(RunError, match=r"failing stopped at t = 0.5 s \(step 5\): no solution") as caught:
        run(failing(give_up), 1.0)
    assert "give_up" in str(caught.value.__cause__)
    assert list(caught.value.record["failing.y"]) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_sys_exit_is_a_failure():
    with pytest.raises(
        RunError, match=r"failing stopped at t = 0.5 s \(step 5\): SystemExit: 4 in its step"
    ) as caught:
        run(failing(lambda: sys.exit(4)), 1.0)
    assert len(caught.value.record.time) == 6


@pytest.mark.parametrize("options", [{"compiled": False}, {"algorithm": "iterated"}], ids=str)
def test_death_in_other_loops(options):
    class Saved(Failing):
        def save(self):
            return self.count

        def restore(self, state):
            self.count = state

    system = System(
        {"failing": Saved(os.abort)},
        step=0.1,
        coupling=Coupling(options.pop("algorithm", "jacobi"), order=0),
    )
    with pytest.raises(RunError, match=r"failing stopped at t = 0.5 s \(step 5\): .*SIGABRT") as caught:
        run(system, 1.0, **options)
    assert len(caught.value.record.time) == 6


def test_death_in_the_middle_of_a_long_block():
    """A block of thousands of steps is under way; the rows before its end are not lost."""
    with pytest.raises(RunError, match="SIGABRT") as caught:
        run(failing(os.abort, at=9000), 1000.0)
    assert caught.value.step == 9000
    assert np.array_equal(caught.value.record["failing.y"], np.arange(9001.0))


def test_killed_from_outside():
    with pytest.raises(RunError, match=r"SIGKILL .* from outside"):
        run(failing(lambda: os.kill(os.getpid(), signal.SIGKILL)), 1.0)


def test_after_a_death_the_run_is_closed():
    supervised = Supervised(failing(os.abort))
    with pytest.raises(RunError):
        supervised.run(1.0)
    with pytest.raises(RuntimeError, match="closed"):
        supervised.run(1.0)
    supervised.close()


def test_a_slow_component_may_get_more_time():
    system = failing(lambda: time.sleep(0.6))
    with pytest.raises(RunError, match=r"nothing happened for 0\.2 s"):
        run(system, 1.0, timeout=0.2)
    run(system, 1.0, timeout=0.2, timeouts={"failing": 5.0})


def test_a_slow_observer_is_no_hang():
    class Sleeping(Recorder):
        def observe(self, k, time_, values):
            if k <= 1:
                time.sleep(0.5)
            super().observe(k, time_, values)

    recorder = Sleeping()
    with Supervised(oscillator(n=9997), observers=[recorder], timeout=0.2) as supervised:
        supervised.run(n_steps=200)
    assert len(recorder.time) == 201


def test_an_observer_that_fails_ends_the_run():
    class Broken(Recorder):
        error = None

        def observe(self, k, time_, values):
            if k > 20:
                raise OSError("disk full")
            super().observe(k, time_, values)

        def end(self, error):
            self.error = error

    recorder = Broken()
    with (
        Supervised(oscillator(n=9997), observers=[recorder]) as supervised,
        pytest.raises(OSError, match="disk full"),
    ):
        supervised.run(n_steps=10_000)
    assert isinstance(recorder.error, OSError)
    assert len(recorder.time) >= 1


def test_python_prints_are_kept_and_can_be_seen(capfd):
    system = System(
        {"f": FunctionComponent(lambda t, u: print(f"at {t:.1f}") or [t], outputs=[Port("y")])}, step=0.1
    )
    with Supervised(system) as supervised:
        supervised.run(1.0)
    assert supervised.output[-1] == "at 1.0"
    assert "at 1.0" not in capfd.readouterr().err
    run(system, 1.0, echo=True)
    assert "at 1.0" in capfd.readouterr().err


def test_what_cannot_be_sent_is_told():
    lock = threading.Lock()
    system = failing(lock.acquire)
    with pytest.raises(InputError, match=r"cannot be sent to another process .*lock"):
        run(system, 1.0)


def test_limits_are_checked():
    with pytest.raises(InputError) as caught:
        Supervised(oscillator(), timeout=0.0, timeouts={"aa": 1.0}, memory_limit=-1)
    assert len(caught.value.faults) == 3


def test_runs_in_several_threads():
    results = {}

    def work(i):
        results[i] = recorded(Supervised, oscillator(), [500])

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(4):
        assert_same(results[i], recorded(Master, oscillator(), [500]))


def test_nothing_is_left_behind(faulty_fmu):
    def folders():
        return set(Path(tempfile.gettempdir()).glob("co_sim_*"))

    def handles():
        gc.collect()
        return len(list(Path("/proc/self/fd").iterdir()))

    def cycle(name):
        system = System({name: FmuComponent(faulty_fmu)}, step=0.1)
        try:
            run(system, 1.0, timeout=0.2)
        except RunError:
            return
        assert name == "healthy"

    names = ["segfault_in_step", "hang_in_step", "healthy", "exit_in_instantiate"]
    cycle("healthy")
    before, handles_before = folders(), handles()
    for name in names * 2:
        cycle(name)
    assert folders() <= before
    assert handles() == handles_before


SCRIPT = """
    import os, sys, time
    from co_sim import FmuComponent, FunctionComponent, Port, Recorder, RunError, System
    from co_sim.supervisor import Supervised

    def slow(t, u):
        time.sleep(0.01)
        return [t]

    class Telling(Recorder):
        def observe(self, k, time_, values):
            super().observe(k, time_, values)
            if k == 1:
                print("running", supervised._attention.process.pid, flush=True)

    recorder = Telling()
    parts = {{"slow": FunctionComponent(slow, outputs=[Port("y")]), "fmu": FmuComponent({fmu!r})}}
    with Supervised(System(parts, step=0.01), observers=[recorder]) as supervised:
        try:
            supervised.run(100.0)
        except KeyboardInterrupt as interrupt:
            n = len(recorder.time)
            assert abs(recorder["slow.y"][1:] - recorder.time[1:]).max() < 1e-9
            print("interrupted", n, recorder.time[-1], supervised.k, flush=True)
"""


def script(fmu, **environment):
    """Start a script that runs for long, without the usual guard of the main module; its process."""
    code = textwrap.dedent(SCRIPT).format(fmu=str(fmu))
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
    )
    line = process.stdout.readline().split()
    if not line:
        raise AssertionError(process.stderr.read())
    return process, int(line[1])


def gone(pid, seconds=5.0):
    deadline = time.monotonic() + seconds
    while Path(f"/proc/{pid}").exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def test_interrupt_keeps_the_results(faulty_fmus):
    process, pid = script(faulty_fmus[2])
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    words = out.split()
    assert words[:1] == ["interrupted"], err
    rows, last, k = int(words[1]), float(words[2]), int(words[3])
    assert rows > 20
    assert last == pytest.approx(0.01 * (rows - 1))
    assert k == rows - 1
    assert process.returncode == 0, err
    assert gone(pid)


def test_nothing_outlives_the_caller(faulty_fmus, tmp_path):
    process, pid = script(faulty_fmus[3], TMPDIR=str(tmp_path))
    assert list(tmp_path.glob("co_sim_*"))
    parents = [int(Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")")[1].split()[1])]
    process.kill()
    process.communicate(timeout=20)
    assert gone(pid)
    assert all(gone(parent) for parent in parents)
    deadline = time.monotonic() + 5.0
    while list(tmp_path.glob("co_sim_*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not list(tmp_path.glob("co_sim_*"))


def test_a_server_that_was_killed_is_replaced(tmp_path):
    code = """
        import os, signal, time
        from pathlib import Path
        from co_sim import FunctionComponent, Port, RunError, Supervised, System, run

        def ask(t, u):
            return [os.getppid()]

        def kill(t, u):
            if t > 0.5:
                os.kill(os.getppid(), signal.SIGKILL)
                time.sleep(60.0)
            return [t]

        def system(function):
            return System({"part": FunctionComponent(function, outputs=[Port("y")])}, step=0.1)

        first = run(system(ask), 1.0)["part.y"][-1]
        try:
            run(system(kill), 1.0)
        except RunError as error:
            assert "vanished in its step" in str(error), error
            assert error.step == 5
        assert run(system(ask), 1.0)["part.y"][-1] != first
    """
    file = tmp_path / "script.py"
    file.write_text(textwrap.dedent(code), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-X", "dev", "-W", "error::ResourceWarning", str(file)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "ResourceWarning" not in done.stderr


def test_texts_arrive_though_their_numbers_differ():
    """Each process numbers texts as it meets them; here one meets others first."""

    def talk(t, u):
        return [number_of(f"said at {t:.1f} s"), number_of("always")]

    for i in range(50):
        number_of(f"only the supervisor knows this, {i}")
    ports = [Port("now", kind="string"), Port("always", kind="string")]
    record = run(System({"a": FunctionComponent(talk, outputs=ports)}, step=0.1), 0.4)
    assert list(record["a.now"]) == [f"said at {t:.1f} s" for t in (0.0, 0.1, 0.2, 0.3, 0.4)]
    assert set(record["a.always"]) == {"always"}


def test_too_many_different_texts_are_told():
    def talk(t, u):
        return [number_of(f"{t}" * 100_000)]

    port = Port("now", kind="string")
    with pytest.raises(RunError, match="bytes of different texts in one supervised run"):
        run(System({"a": FunctionComponent(talk, outputs=[port])}, step=0.125), 100.0)
