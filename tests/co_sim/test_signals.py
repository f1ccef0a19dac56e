import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from co_sim import Constant, InputError, Master, Port, Recorder, System, TimeTable

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
