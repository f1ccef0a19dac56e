import copy
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from co_sim import InputError, Port
from co_sim.array_functions import ARRAY_STEP, EXCHANGE, address_of
from co_sim.compiled_component import CompiledComponent, compiled
from co_sim.component import StateError

NO_INPUT = np.empty(0)


@compiled
def lag(t, h, u, y, x, p):
    if abs(u[0]) > p[1]:
        raise ValueError("the input is beyond its limit")
    if t < 0.0:
        return 7
    x[0] += h * p[0] * (u[0] - x[0])
    y[0] = x[0]
    return 0


@compiled
def lag_output(t, u, y, x, p):
    y[0] = x[0]
    return 0


@compiled(boundscheck=True)
def beyond(t, h, u, y, x, p):
    y[0] = x[1]
    return 0


@compiled
def computed_text(t, h, u, y, x, p):
    if u[0] > -2.0:
        raise ValueError(u[0])
    return 0


@compiled
def extrapolate(t, h, u, y, x, p):
    y[0] = u[0] + h * u[2] + 0.5 * h * h * u[4]
    y[1] = u[1] + h * u[3] + 0.5 * h * h * u[5]
    return 0


def lag_component(step=lag, **options):
    options = {"state": [0.25], "parameters": {"rate": 3.0, "limit": 10.0}, **options}
    return CompiledComponent(
        step, exchange=lag_output, inputs=[Port("u")], outputs=[Port("y")], feedthrough={}, **options
    )


def started(component, t0=0.0, h=0.1):
    component.start(t0, h)
    return component


def wave(n, n_u=1):
    return np.sin(np.arange(n * n_u, dtype=np.float64)).reshape(n, n_u)


def test_interpreter_machine_code_and_the_plain_function_give_the_same_bits(run_native, run_python):
    u = wave(500)
    native = run_native(started(lag_component()), u)
    np.testing.assert_array_equal(native, run_python(started(lag_component()), u))
    x, y, plain = np.array([0.25]), np.empty(1), []
    for k, row in enumerate(u):
        assert lag.py_func(k * 0.1, 0.1, row, y, x, np.array([3.0, 10.0])) == 0
        plain.append(y.copy())
    np.testing.assert_array_equal(native, plain)


def test_a_plain_function_and_one_typed_into_a_prompt_are_compiled(run_native):
    def plain(t, h, u, y, x, p):
        x[0] += h * p[0] * (u[0] - x[0])
        y[0] = x[0]
        return 0

    names = {}
    exec("def typed(t, h, u, y, x, p):\n    y[0] = 2.0 * u[0]\n    return 0", names)
    u = wave(50)
    np.testing.assert_array_equal(
        run_native(started(lag_component(plain)), u), run_native(started(lag_component()), u)
    )
    np.testing.assert_array_equal(run_native(started(lag_component(names["typed"])), u), 2.0 * u)


def test_a_function_that_numba_compiled_otherwise_is_compiled_anew(run_native):
    @numba.njit
    def lazy(t, h, u, y, x, p):
        y[0] = u[0]
        return 0

    u = wave(3)
    np.testing.assert_array_equal(run_native(started(lag_component(lazy)), u), u)


def test_the_first_values_are_those_of_exchange_or_the_start_values():
    y = np.empty(1)
    started(lag_component()).exchange(np.ones(1), y)
    assert y == 0.25
    outputs = [Port("a", start=(1.0, 2.0), shape=(2,)), Port("b", start=3.0)]
    values = np.empty(3)
    started(CompiledComponent(extrapolate, outputs=outputs)).exchange(NO_INPUT, values)
    np.testing.assert_array_equal(values, [1.0, 2.0, 3.0])


def test_exchange_takes_arrays_of_any_layout():
    frozen, row = np.ones(1), np.zeros((3, 2))
    frozen.setflags(write=False)
    started(lag_component()).exchange(frozen, row[1:2, 1])
    assert row[1, 1] == 0.25


def test_arrays_and_derivatives_reach_the_step(run_native):
    component = CompiledComponent(
        extrapolate,
        inputs=[Port("u", shape=(2,))],
        outputs=[Port("y", shape=(2,), start=0.0)],
        takes_derivatives=True,
    )
    y = run_native(started(component), [[1.0, 2.0, 30.0, 40.0, 500.0, 600.0]])
    np.testing.assert_allclose(y, [[1.0 + 3.0 + 2.5, 2.0 + 4.0 + 3.0]], rtol=1e-15)


def test_each_start_begins_anew(run_native):
    component = lag_component()
    first = run_native(started(component), wave(20))
    component.close()
    component.close()
    np.testing.assert_array_equal(run_native(started(component), wave(20)), first)


def test_parameters_are_checked_and_set():
    component = lag_component()
    faults = list(component.parameter_faults({"rte": 1.0, "limit": "big", "rate": float("nan")}))
    assert [fault.remedy for fault in faults] == ['did you mean "rate"?', "give a number", "give a number"]
    assert not list(component.parameter_faults({"rate": 1, "limit": np.float64(2)}))
    component.set_parameters({"rate": 5.0})
    y = np.empty(1)
    started(component).step(0.0, 0.1, np.ones(1), y)
    assert y[0] == 0.25 + 0.1 * 5.0 * 0.75


def test_prepare_makes_the_parameters_from_the_step(run_native):
    seen = []

    def prepare(h, values):
        seen.append((h, dict(values)))
        return [1.0 / h, values["limit"]]

    u = wave(5)
    np.testing.assert_allclose(run_native(started(lag_component(prepare=prepare)), u), u, atol=1e-15)
    assert seen == [(0.1, {"rate": 3.0, "limit": 10.0})]


@given(st.integers(0, 30), st.integers(0, 30))
def test_a_restored_run_repeats_bit_for_bit(run_native, before, after):
    component = started(lag_component())
    run_native(component, wave(before))
    state = component.save()
    data = component.serialize(state)
    first = run_native(component, wave(after))
    component.restore(state)
    np.testing.assert_array_equal(run_native(component, wave(after)), first)
    other = started(lag_component())
    other.restore(other.deserialize(data))
    np.testing.assert_array_equal(run_native(other, wave(after)), first)


def test_a_state_is_refused_where_there_is_none():
    with pytest.raises(StateError, match="not started"):
        lag_component().save()
    with pytest.raises(StateError, match="1 values of 8 bytes, and 5 bytes"):
        lag_component().deserialize(b"12345")


@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_is_independent(run_native, again):
    component = lag_component()
    twin = again(component)
    twin.set_parameters({"rate": 0.0})
    started(component), started(twin)
    moved = run_native(component, wave(10))
    assert not np.any(moved == 0.25)
    np.testing.assert_array_equal(run_native(twin, wave(10)), np.full((10, 1), 0.25))


def test_many_run_in_threads_at_once(run_native):
    components = [started(lag_component(state=[float(i)])) for i in range(8)]
    u = wave(20_000)
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda each: run_native(each, u), components))
    for i, rows in enumerate(together):
        np.testing.assert_array_equal(rows, run_native(started(lag_component(state=[float(i)])), u))


@pytest.mark.parametrize("path", ["run_native", "run_python"])
def test_failures_are_told(request, path):
    run = request.getfixturevalue(path)
    with pytest.raises(RuntimeError, match="status 7"):
        run(started(lag_component()), wave(1), t0=-1.0)
    with pytest.raises(ValueError, match="beyond its limit"):
        run(started(lag_component()), [[1.0], [11.0]])
    with pytest.raises(IndexError, match="out of bounds"):
        run(started(lag_component(beyond)), wave(1))
    with pytest.raises(RuntimeError, match="its text is lost"):
        run(started(lag_component(computed_text)), wave(1))


def test_a_failure_of_exchange_is_told():
    def fails(t, u, y, x, p):
        return 3

    component = CompiledComponent(lag, exchange=fails, inputs=[Port("u")], outputs=[Port("y")], state=[0.0])
    with pytest.raises(RuntimeError, match="exchange returned the status 3"):
        started(component).exchange(np.ones(1), np.empty(1))


def text_step(t, h, u, y, x, p):
    y[0] = "one"
    return 0


def no_return(t, h, u, y, x, p):
    y[0] = 1.0


def only_raises(t, h, u, y, x, p):
    raise ValueError("always")


def one_argument(t):
    return 0


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"step": text_step}, "nopython mode"),
        ({"step": no_return}, "returning a whole number"),
        ({"step": only_raises}, "returning a whole number"),
        ({"step": one_argument}, r"got the arguments \(t\), expected step\(t, h, u, y, x, p\)"),
        ({"step": lag_output}, r"expected step\(t, h, u, y, x, p\)"),
        ({"exchange": lag}, r"expected exchange\(t, u, y, x, p\)"),
        ({"step": 3}, "no function"),
        ({"exchange": None}, 'output "y": got no value at the start time'),
        ({"state": [np.nan]}, "state: got .*nan"),
        ({"state": [[1.0]]}, "finite numbers in one row"),
        ({"parameters": {"rate": "fast"}}, "parameter \"rate\": got 'fast'"),
    ],
)
def test_faulty_components_are_refused(options, expected):
    options = {"step": lag, "exchange": lag_output, "outputs": [Port("y")], **options}
    with pytest.raises(InputError, match=expected):
        CompiledComponent(**options)


def test_the_address_is_that_of_the_function_compiled_for_these_types():
    assert address_of(lag, ARRAY_STEP) != address_of(beyond, ARRAY_STEP)
    assert address_of(lag_output, EXCHANGE) == address_of(lag_output, EXCHANGE)


def test_a_second_process_compiles_nothing(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from co_sim.compiled_component import compiled\n\n"
        "@compiled\ndef double(t, h, u, y, x, p):\n    y[0] = 2.0 * u[0]\n    return 0\n"
    )
    script = (
        "import sys; sys.path[:0] = ['.', sys.argv[1]]\n"
        "import numpy as np, mine\n"
        "from co_sim import CompiledComponent, Port, steps\n"
        "part = CompiledComponent(mine.double, inputs=[Port('u')], outputs=[Port('y', start=0.0)])\n"
        "part.start(0.0, 1.0); y = np.empty(1); part.step(0.0, 1.0, np.ones(1), y)\n"
        "hits = mine.double.stats.cache_hits, steps.linear_step.stats.cache_hits\n"
        "print(y[0], *(sum(each.values()) for each in hits), steps.array_step.cache_hits)"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    runs = [subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(2)]
    assert runs[0].startswith("2.0 0 ")
    assert runs[1] == "2.0 1 1 1\n"
