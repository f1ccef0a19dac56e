import copy
import math
from bisect import bisect_right

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from co_sim import Constant, InputError, Master, Port, Recorder, System, TimeTable
from co_sim.component import StateError
from co_sim.texts import number_of

PORT = [Port("y", "m")]


def record(component, h, n_steps, t0=0.0):
    recorder = Recorder()
    with Master(System({"a": component}), t0, h, [recorder]) as master:
        master.run(n_steps=n_steps)
    return recorder


def test_a_constant_stays():
    recorder = record(Constant([1.5, -2.0], [Port("y"), Port("z")]), 0.1, 3)
    np.testing.assert_array_equal(recorder.table, [[1.5, -2.0]] * 4)


def test_hold_keeps_each_value_until_the_next_breakpoint():
    recorder = record(TimeTable([0.0, 0.2, 0.3], [1.0, 2.0, 3.0], PORT), 0.1, 5)
    np.testing.assert_array_equal(recorder["a.y"], [1, 1, 2, 3, 3, 3])


@pytest.mark.parametrize("h", [0.1, 0.01, 0.001, 1 / 3])
def test_a_breakpoint_on_the_time_grid_is_met_in_its_step(h):
    n = 1000
    on_grid = [k * h for k in range(n + 1)]
    recorder = record(TimeTable(on_grid, range(n + 1), PORT), h, n, t0=0.0)
    np.testing.assert_array_equal(recorder["a.y"], np.arange(n + 1))
    shifted = record(TimeTable([7.7 + t for t in on_grid], range(n + 1), PORT), h, n, t0=7.7)
    np.testing.assert_array_equal(shifted["a.y"], np.arange(n + 1))


def test_linear_joins_the_breakpoints_of_every_port():
    values = np.array([[0.0, 5.0], [1.0, 5.0], [-1.0, 6.0]])
    table = TimeTable([0.0, 1.0, 3.0], values, [Port("y"), Port("z")], interpolation="linear")
    recorder = record(table, 0.125, 32)
    for i, name in enumerate(("a.y", "a.z")):
        expected = np.interp(recorder.time, [0.0, 1.0, 3.0], values[:, i])
        np.testing.assert_allclose(recorder[name], expected, rtol=0, atol=1e-15)


@given(
    st.lists(st.integers(-50, 50), min_size=1, max_size=6, unique=True),
    st.sampled_from(["hold", "linear"]),
    st.integers(-80, 80),
)
def test_values_stay_between_their_neighbours_and_outside_at_the_ends(ticks, interpolation, t0):
    times = sorted(float(tick) for tick in ticks)
    values = [math.sin(7.0 * t) for t in times]
    table = TimeTable(times, values, PORT, interpolation)
    table.start(float(t0), 0.5)
    y = np.empty(1)
    table.exchange(np.empty(0), y)
    if t0 <= times[0]:
        assert y[0] == values[0]
    elif t0 >= times[-1]:
        assert y[0] == values[-1]
    else:
        i = np.searchsorted(times, t0)
        assert min(values[i - 1 : i + 1]) - 1e-12 <= y[0] <= max(values[i - 1 : i + 1]) + 1e-12


@pytest.mark.parametrize(
    ("times", "values", "ports", "interpolation", "expected"),
    [
        ([0.0, 0.0], [1, 2], PORT, "hold", "strictly increasing"),
        ([1.0, 0.5], [1, 2], PORT, "hold", "1 s before 0.5 s"),
        ([0.0, math.inf], [1, 2], PORT, "hold", "times: got nan or inf"),
        ([0.0, 1.0], [1, math.nan], PORT, "hold", "values: got nan or inf"),
        ([], [], PORT, "hold", "at least one breakpoint"),
        ([0.0, 1.0], [1, 2, 3], PORT, "hold", "2 times by 1 ports"),
        ([0.0], [1.0], [Port("y"), Port("z")], "hold", "1 times by 2 ports"),
        ([0.0], [1.0], PORT, "cubic", '"hold" or "linear"'),
    ],
)
def test_faulty_tables_are_refused(times, values, ports, interpolation, expected):
    with pytest.raises(InputError, match=expected):
        TimeTable(times, values, ports, interpolation)


def test_a_constant_needs_a_value_for_each_port():
    with pytest.raises(InputError, match="one value for each of 1 ports"):
        Constant([1.0, 2.0], PORT)


def first_values(component):
    y = np.full(sum(port.size for port in component.outputs), np.nan)
    component.start(0.0, 0.1)
    component.exchange(np.empty(0), y)
    return y


def test_constants_of_every_kind_are_carried_as_numbers():
    ports = [
        Port("text", kind="string"),
        Port("on", kind="boolean"),
        Port("count", kind="uint8"),
        Port("big", kind="int64"),
        Port("level", kind="enumeration"),
        Port("names", kind="string", shape=(2,)),
        Port("matrix", shape=(2, 2)),
    ]
    values = ["dry rail", True, 255, -(2**53), 3, ["a", "b"], np.array([[1.0, 2.0], [3.0, 4.0]])]
    texts = [number_of("dry rail"), number_of("a"), number_of("b")]
    expected = [texts[0], 1.0, 255.0, -(2.0**53), 3.0, *texts[1:], 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(first_values(Constant(values, ports)), expected)


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("float64", math.inf, "got inf, expected a finite number"),
        ("float64", "one", "got 'one', expected a number"),
        ("int32", 1.5, "got 1.5, expected a whole number from -2147483648"),
        ("int32", math.nan, "got nan, expected a whole number"),
        ("uint8", 256, "expected a whole number from 0 to 255"),
        ("int64", 2**53 + 1, "to 9007199254740992"),
        ("uint64", -1, "from 0 to 9007199254740992"),
        ("boolean", 2, "got 2, expected True or False"),
        ("string", 1, "got 1, expected a text"),
        ("float64", [1.0, 2.0], r"got shape \(2,\), expected shape \(\)"),
    ],
)
def test_a_constant_of_another_kind_is_refused(kind, value, expected):
    with pytest.raises(InputError, match=f'value of "y": .*{expected}'):
        Constant([value], [Port("y", kind=kind)])


def test_all_faulty_constants_are_told_together():
    with pytest.raises(InputError) as error:
        Constant([math.nan, "x"], [Port("a"), Port("b")])
    assert len(error.value.faults) == 2


@pytest.mark.parametrize(
    ("kind", "values", "interpolation", "expected"),
    [
        ("int8", [1.0, 200.0], "hold", "got 200, expected a whole number from -128 to 127"),
        ("int8", [1.0, 2.0], "linear", "int8, linear, expected a floating-point kind"),
        ("boolean", [1.0, 0.5], "hold", "got 0.5, expected True or False"),
        ("string", [1.0, 2.0], "hold", "expected a text"),
    ],
)
def test_a_table_of_another_kind_is_refused(kind, values, interpolation, expected):
    with pytest.raises(InputError, match=expected):
        TimeTable([0.0, 1.0], values, [Port("y", kind=kind)], interpolation)


def test_a_table_serves_array_ports(run_native):
    ports = [Port("a", shape=(2,)), Port("on", kind="boolean")]
    table = TimeTable([0.0, 1.0], [[1.0, 2.0, False], [3.0, 4.0, True]], ports)
    table.start(0.0, 1.0)
    np.testing.assert_array_equal(run_native(table, np.empty((1, 0)), h=1.0), [[3.0, 4.0, 1.0]])


def looked_up(times, values, interpolation, t, h):
    """The definition of a table in plain Python, in the order of operations that is promised."""
    i = max(bisect_right(times, t + 1e-6 * h) - 1, 0)
    if interpolation == "linear" and i + 1 < len(times):
        slope = (values[i + 1] - values[i]) / (times[i + 1] - times[i])
    else:
        slope = 0.0
    return slope * max(t - times[i], 0.0) + values[i]


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=40, unique=True),
    st.sampled_from(["hold", "linear"]),
    st.floats(-5.0, 5.0),
    st.sampled_from([0.1, 0.01, 1.0 / 3.0]),
)
def test_machine_code_interpreter_and_definition_agree_bit_for_bit(
    run_native, run_python, ticks, interpolation, t0, h
):
    times = sorted(ticks)
    values = [math.cos(5.0 * t) for t in times]
    table = TimeTable(times, values, PORT, interpolation)
    table.start(t0, h)
    u = np.empty((30, 0))
    native = run_native(table, u, t0=t0, h=h)
    np.testing.assert_array_equal(native, run_python(table, u, t0=t0, h=h))
    expected = [looked_up(times, values, interpolation, (t0 + k * h) + h, h) for k in range(30)]
    np.testing.assert_array_equal(native[:, 0], expected)


@pytest.mark.parametrize("source", [Constant([2.0], PORT), TimeTable([0.0, 1.0], [2.0, 3.0], PORT)])
def test_a_source_has_no_inputs_no_memory_and_independent_copies(run_native, source):
    assert source.feedthrough == {}
    twin = copy.deepcopy(source)
    with pytest.raises(StateError, match="not started"):
        source.native()
    source.start(0.0, 0.5)
    twin.start(0.0, 0.5)
    twin.restore(twin.deserialize(source.serialize(source.save())))
    source.close()
    source.close()
    del source
    assert run_native(twin, np.empty((1, 0)), h=0.5) == 2.0
