import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim import (
    Component,
    Connection,
    Constant,
    FunctionComponent,
    InputError,
    Master,
    Port,
    Recorder,
    RunError,
    System,
)
from co_sim.master import step_count


class Lag(Component):
    """T*dx/dt + x = u, exact for a held input."""

    def __init__(self, x0=0.0, T=1.0):
        super().__init__([Port("u", start=0.0)], [Port("x")])
        self.x0, self.T = x0, T

    def start(self, t0, h):
        self.x = self.x0

    def exchange(self, u, y):
        y[0] = self.x

    def step(self, t, h, u, y):
        self.x += (u[0] - self.x) * -math.expm1(-h / self.T)
        y[0] = self.x


class ScaledLag(Lag):
    """A lag with a gain at its input."""

    def __init__(self, x0, factor):
        super().__init__(x0)
        self.factor = factor

    def step(self, t, h, u, y):
        super().step(t, h, self.factor * u, y)


class Diary(Component):
    """Counts its steps and writes every call of the master into a shared log."""

    def __init__(self, log, name, fails=None):
        super().__init__([Port("u", start=-1.0)], [Port("y")])
        self.log, self.name, self.fails = log, name, fails or {}

    def note(self, call, *details):
        self.log.append((self.name, call, *details))
        error = self.fails.get(call) or self.fails.get((call, *details[:1]))
        if error is not None:
            raise error

    def start(self, t0, h):
        self.n = 0
        self.note("start", t0, h)

    def exchange(self, u, y):
        self.note("exchange", u[0])
        y[0] = 0.0

    def step(self, t, h, u, y):
        self.note("step", t, u[0])
        self.n += 1
        y[0] = self.n

    def close(self):
        self.note("close")


class Watch:
    """An observer that writes every call into a log, and wants to see each step before the next."""

    max_block = 1

    def __init__(self, log, fails_at=None):
        self.log, self.fails_at = log, fails_at

    def begin(self, signals, t0, h, n_steps):
        self.log.append(("begin", [signal.name for signal in signals], t0, h, n_steps))

    def observe(self, k, time, values):
        for i, (t, row) in enumerate(zip(time, values, strict=True)):
            self.log.append(("observe", k + i, float(t), row.tolist()))
            if k + i == self.fails_at:
                raise OSError("disk full")

    def end(self, error):
        self.log.append(("end", error))


def gain(factor, start=None):
    """A component that multiplies its input and passes it on at once."""
    ports = {"inputs": [Port("u", start=start)], "outputs": [Port("y")]}
    return FunctionComponent(lambda t, u: [factor * u[0]], **ports)


def inverse(start=None):
    """A component that cannot bear a zero."""
    ports = {"inputs": [Port("u", start=start)], "outputs": [Port("y")]}
    return FunctionComponent(lambda t, u: [1.0 / float(u[0])], **ports)


def run(system, n_steps=10, h=1.0, t0=0.0, **options):
    recorder = Recorder(**options)
    with Master(system, t0, h, [recorder]) as master:
        master.run(n_steps=n_steps)
    return recorder


def test_the_whole_life_of_a_run_in_order():
    log = []
    system = System({"a": Diary(log, "a"), "b": Diary(log, "b")}, [Connection("a.y", "b.u")])
    with Master(system, t0=10.0, h=0.5, observers=[Watch(log)]) as master:
        master.run(1.0)
    assert log == [
        ("begin", ["a.y", "b.y"], 10.0, 0.5, 2),
        ("a", "start", 10.0, 0.5),
        ("b", "start", 10.0, 0.5),
        *[("a", "exchange", -1.0), ("b", "exchange", 0.0)] * 2,
        ("observe", 0, 10.0, [0.0, 0.0]),
        ("a", "step", 10.0, -1.0),
        ("b", "step", 10.0, 0.0),
        ("observe", 1, 10.5, [1.0, 1.0]),
        ("a", "step", 10.5, -1.0),
        ("b", "step", 10.5, 1.0),
        ("observe", 2, 11.0, [2.0, 2.0]),
        ("end", None),
        ("b", "close"),
        ("a", "close"),
    ]


def test_each_connection_delays_by_one_step():
    source = FunctionComponent(lambda t, u: [t], outputs=[Port("y")])
    chain = {"source": source, "a": gain(10.0), "b": gain(10.0)}
    recorder = run(System(chain, [Connection("source.y", "a.u"), Connection("a.y", "b.u")]), n_steps=4)
    assert recorder.table.tolist() == [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [2.0, 10.0, 0.0],
        [3.0, 20.0, 100.0],
        [4.0, 30.0, 200.0],
    ]


def test_initial_values_pass_through_a_chain_in_any_order():
    parts = {f"g{i}": gain(2.0) for i in range(6)}
    wires = [Connection(f"g{i}.y", f"g{i + 1}.u") for i in range(5)] + [Connection("one.y", "g0.u")]
    components = {**dict(reversed(parts.items())), "one": Constant([1.0], [Port("y")])}
    recorder = run(System(components, wires), n_steps=0)
    assert [recorder[f"g{i}.y"][0] for i in range(6)] == [2.0 ** (i + 1) for i in range(6)]


def test_initial_values_pass_through_a_component_more_than_once():
    weave = FunctionComponent(
        lambda t, u: [5.0, *(u + 1.0)],
        inputs=[Port("u1"), Port("u2"), Port("u3")],
        outputs=[Port("y0"), Port("y1"), Port("y2"), Port("y3")],
        feedthrough={f"y{i}": [f"u{i}"] for i in range(1, 4)},
    )
    system = System({"a": weave}, [Connection(f"a.y{i}", f"a.u{i + 1}") for i in range(3)])
    assert run(system, n_steps=0).table.tolist() == [[5.0, 6.0, 7.0, 8.0]]


def test_an_algebraic_loop_is_refused_by_its_signals_only():
    parts = {"b": gain(-2.0), "after": gain(1.0), "one": Constant([1.0], [Port("y")])}
    parts["a"] = FunctionComponent(
        lambda t, u: [u[0] + u[1], 3.0], inputs=[Port("u"), Port("w")], outputs=[Port("y"), Port("calm")]
    )
    wires = [
        Connection("b.y", "a.u"),
        Connection("one.y", "a.w"),
        Connection("a.y", "b.u"),
        Connection("b.y", "after.u"),
    ]
    with pytest.raises(InputError, match=r"algebraic loop: got a.y -> b.y -> a.y,") as caught:
        run(System(parts, wires))
    assert "after.y" not in str(caught.value)


def test_outputs_that_never_repeat_are_refused_too():
    counter = itertools.count(1)
    restless = FunctionComponent(lambda t, u: [next(counter)], outputs=[Port("y")])
    with pytest.raises(InputError, match=r"got a.y still changing"):
        run(System({"a": restless}))


def test_unconnected_inputs_read_their_start_values():
    system = System({"a": gain(2.0, start=3.0), "b": gain(2.0)}, [Connection("a.y", "b.u")])
    np.testing.assert_array_equal(run(system, n_steps=2).table, [[6.0, 12.0]] * 3)


@settings(deadline=None, max_examples=60)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
def test_the_order_of_components_changes_no_bit(data, seed):
    rng = np.random.default_rng(seed)
    n = data.draw(st.integers(2, 6))
    x0, T = rng.standard_normal(n), rng.uniform(0.1, 3.0, n)
    wires = [
        Connection(f"c{source}.x", f"c{target}.u")
        for target, source in enumerate(rng.integers(-1, n, n))
        if source >= 0
    ]
    order = data.draw(st.permutations(range(n)))
    names = [f"c{i}.x" for i in range(n)]

    def result(indices, connections):
        recorder = run(System({f"c{i}": Lag(x0[i], T[i]) for i in indices}, connections), n_steps=20, h=0.1)
        return np.column_stack([recorder[name] for name in names])

    np.testing.assert_array_equal(result(order, wires[::-1]), result(range(n), wires))


def coupled_lags_error(h):
    """Error at t = 2 of x1' = 0.5 x2 - x1, x2' = -x1 - x2 against the exact solution."""
    x0 = np.array([1.0, -0.5])
    A = np.array([[-1.0, 0.5], [-1.0, -1.0]])
    parts = {"a": ScaledLag(x0[0], 0.5), "b": ScaledLag(x0[1], -1.0)}
    recorder = run(
        System(parts, [Connection("a.x", "b.u"), Connection("b.x", "a.u")]), n_steps=round(2.0 / h), h=h
    )
    eigenvalues, V = np.linalg.eig(A)
    exact = (V * np.exp(2.0 * eigenvalues)) @ np.linalg.solve(V, x0)
    return np.linalg.norm(recorder.table[-1] - exact.real)


def test_coupled_lags_converge_with_order_one():
    errors = np.array([coupled_lags_error(h) for h in (0.02, 0.01, 0.005, 0.0025)])
    assert errors[-1] > 0.0
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.02)


def test_time_does_not_drift_over_a_million_steps():
    steps = []
    clock = FunctionComponent(lambda t, u: [0.0], outputs=[Port("y")])
    master = Master(System({"a": clock}), t0=0.1, h=1e-4)
    master.start()
    for _ in range(3):
        master.step()
        steps.append(master.time)
    assert steps == [0.1 + 1 * 1e-4, 0.1 + 2 * 1e-4, 0.1 + 3 * 1e-4]
    master.run(n_steps=1_000_000 - 3)
    assert master.k == 1_000_000
    assert master.time == 0.1 + 1_000_000 * 1e-4
    assert sum([1e-4] * 1_000_000) != 100.0  # what a running sum would have made of it


def test_a_second_run_continues():
    whole = run(System({"a": Lag(1.0)}), n_steps=7, h=0.1)
    recorder = Recorder()
    with Master(System({"a": Lag(1.0)}), h=0.1, observers=[recorder]) as master:
        master.run(n_steps=3)
        first = recorder.table
        master.run(n_steps=4)
    np.testing.assert_array_equal(np.vstack([first, recorder.table[1:]]), whole.table)
    np.testing.assert_array_equal(recorder.time, whole.time[3:])


def test_single_steps_make_the_same_values():
    whole = run(System({"a": Lag(1.0)}), n_steps=3, h=0.1)
    with Master(System({"a": Lag(1.0)}), h=0.1) as master:
        master.start()
        values = [master.values.copy()]
        for _ in range(3):
            master.step()
            values.append(master.values.copy())
    np.testing.assert_array_equal(values, whole.table)


def test_observers_cannot_change_the_signals():
    class Vandal(Watch):
        def observe(self, k, time, values):
            values[0] = 1.0

    with (
        pytest.raises(ValueError, match="read-only"),
        Master(System({"a": Lag()}), observers=[Vandal([])]) as master,
    ):
        master.run(n_steps=1)


def diaries(log, **fails):
    """Three components without connections; `fails` gives the calls of each that raise."""
    return System({name: Diary(log, name, fails.get(name)) for name in "abc"})


def calls(log, call):
    return [entry[0] for entry in log if entry[1] == call]


def test_a_failing_step_keeps_the_results_and_closes_everything():
    log, recorder = [], Recorder()
    system = diaries(log, b={("step", 2.0): ValueError("no solution")})
    watch = Watch(log)
    with pytest.raises(RunError) as caught, Master(system, h=1.0, observers=[recorder, watch]) as master:
        master.run(n_steps=5)
    error = caught.value
    assert (error.component, error.time, error.step) == ("b", 2.0, 2)
    assert str(error) == "b stopped at t = 2 s (step 2): no solution"
    assert isinstance(error.__cause__, ValueError)
    np.testing.assert_array_equal(recorder.time, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(recorder["c.y"], [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(master.values, [2.0, 2.0, 2.0])
    assert calls(log, "close") == ["c", "b", "a"]
    assert ("end", error) in log


@pytest.mark.parametrize("call", ["start", "exchange"])
def test_a_failure_before_the_first_step_closes_everything(call):
    log = []
    with pytest.raises(RunError, match=r"b stopped at t = 7 s \(step 0\): no"):
        Master(diaries(log, b={call: ValueError("no")}), t0=7.0).start()
    assert calls(log, "close") == ["c", "b", "a"]
    assert calls(log, "step") == []


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit])
def test_an_interrupted_run_keeps_the_results_and_closes_everything(interruption):
    log, recorder = [], Recorder()
    system = diaries(log, b={("step", 2.0): interruption()})
    master = Master(system, h=1.0, observers=[recorder, Watch(log)])
    with pytest.raises(interruption) as caught:
        master.run(n_steps=5)
    assert len(recorder.time) == 3
    assert calls(log, "close") == ["c", "b", "a"]
    assert ("end", caught.value) in log


def test_a_failing_close_does_not_keep_the_others_open():
    log = []
    master = Master(diaries(log, b={"close": OSError("busy")}))
    with pytest.raises(RunError, match=r"b stopped at .* OSError: busy"):
        master.close()
    assert calls(log, "close") == ["c", "b", "a"]
    master.close()
    assert len(calls(log, "close")) == 3


def test_a_failing_close_does_not_hide_what_stopped_the_run():
    log = []
    system = diaries(log, a={"close": OSError("busy")}, b={("step", 0.0): ValueError("no solution")})
    with pytest.raises(RunError, match="no solution") as caught, Master(system) as master:
        master.run(n_steps=1)
    (note,) = caught.value.__notes__
    assert "OSError: busy" in note


def test_a_failing_close_at_the_end_is_told():
    with pytest.raises(RunError, match="busy"), Master(diaries([], a={"close": OSError("busy")})) as master:
        master.run(n_steps=1)


def test_a_failing_observer_ends_the_run_and_the_other_observers():
    log = []
    system = diaries(log)
    with pytest.raises(OSError, match="disk full") as caught:
        Master(system, observers=[Watch(log), Watch(log, fails_at=2)]).run(n_steps=5)
    assert log.count(("end", caught.value)) == 2
    assert calls(log, "close") == ["c", "b", "a"]


def test_a_refusing_observer_prevents_the_start():
    log = []
    with pytest.raises(InputError, match="no match"):
        Master(diaries(log), observers=[Watch(log), Recorder(["none"])]).run(n_steps=5)
    assert calls(log, "start") == []
    assert log[1][0] == "end"
    assert calls(log, "close") == ["c", "b", "a"]


def test_a_closed_master_cannot_be_used():
    master = Master(diaries([]))
    master.close()
    for use in (master.start, master.step, lambda: master.run(n_steps=1)):
        with pytest.raises(RuntimeError, match="build a new one"):
            use()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_stops_the_run_by_name(value):
    burst = FunctionComponent(
        lambda t, u: [1.0, value if t > 2.5 else 0.0], outputs=[Port("fine"), Port("bad")]
    )
    recorder = Recorder()
    master = Master(System({"a": Lag(), "b": burst}), h=1.0, observers=[recorder])
    with pytest.raises(RunError, match=rf"b stopped at t = 2 s \(step 2\): b.bad became {value} at t = 3 s"):
        master.run(n_steps=5)
    assert len(recorder.time) == 3


def test_an_initial_value_that_is_not_finite_stops_the_run_by_name():
    with pytest.raises(RunError, match=r"a stopped at t = 0 s \(step 0\): a.x became nan at t = 0 s"):
        run(System({"a": Lag(math.nan)}))


def test_an_intermediate_value_that_is_not_finite_does_no_harm():
    careful = FunctionComponent(
        lambda t, u: [1.0 / u[0] if u[0] else math.nan], inputs=[Port("u")], outputs=[Port("y")]
    )
    # In the loop through its second output, "a" is swept before "b" has told its value.
    b = FunctionComponent(lambda t, u: [4.0], inputs=[Port("u")], outputs=[Port("y")], feedthrough={"y": []})
    system = System({"b": b, "a": careful}, [Connection("b.y", "a.u"), Connection("a.y", "b.u")])
    assert run(system, n_steps=0)["a.y"].tolist() == [0.25]


def test_what_feeds_a_component_is_known_before_it_is_asked():
    components = {"a": inverse(), "b": inverse(), "c": Constant([4.0], [Port("y")])}
    recorder = run(System(components, [Connection("b.y", "a.u"), Connection("c.y", "b.u")]), n_steps=0)
    assert recorder.table.tolist() == [[4.0, 0.25, 4.0]]


def test_in_a_loop_an_input_first_sees_its_start_value():
    components = {"a": Lag(x0=4.0), "b": inverse(start=1.0)}
    recorder = run(System(components, [Connection("a.x", "b.u"), Connection("b.y", "a.u")]), n_steps=0)
    assert recorder.table.tolist() == [[4.0, 0.25]]


def test_very_large_values_are_finite():
    huge = System({"a": Constant([1.7e308, 1.7e308], [Port("x"), Port("y")])})
    assert run(huge, n_steps=1).table.max() == 1.7e308


def test_faults_of_the_system_are_told_before_anything_starts():
    log = []
    with pytest.raises(InputError, match="unknown component"):
        Master(System({"a": Diary(log, "a")}, [Connection("b.y", "a.u")]))
    assert log == []


@pytest.mark.parametrize(
    ("duration", "h", "n"),
    [(1.0, 0.1, 10), (30.0, 1e-3, 30_000), (0.3, 0.1, 3), (1e4, 1e-3, 10_000_000), (0.0, 1.0, 0)],
)
def test_a_duration_is_a_number_of_steps(duration, h, n):
    assert step_count(duration, h) == n


@pytest.mark.parametrize(
    ("duration", "expected"),
    [
        (0.25, "a multiple of the step of 0.1 s; use 0.2 s"),
        (-1.0, ">= 0 s"),
        (math.nan, "finite"),
        (math.inf, "finite"),
    ],
)
def test_other_durations_are_refused(duration, expected):
    with pytest.raises(InputError, match=expected):
        Master(diaries([]), h=0.1).run(duration)


@pytest.mark.parametrize("n_steps", [-1, 2.0])
def test_steps_are_whole_numbers(n_steps):
    with pytest.raises(InputError, match="n_steps"):
        Master(diaries([])).run(n_steps=n_steps)


@pytest.mark.parametrize("arguments", [{}, {"duration": 1.0, "n_steps": 1}])
def test_a_run_has_one_length(arguments):
    with pytest.raises(TypeError, match="either"):
        Master(diaries([])).run(**arguments)


@pytest.mark.parametrize(
    ("t0", "h"), [(math.nan, 1.0), (math.inf, 1.0), (0.0, 0.0), (0.0, -1.0), (0.0, math.nan)]
)
def test_a_clock_must_tick(t0, h):
    with pytest.raises(InputError, match=r"^(start time|step): got"):
        Master(diaries([]), t0, h)
