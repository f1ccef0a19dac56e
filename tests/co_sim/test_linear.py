import copy
import math

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from co_sim import Connection, InputError, Master, Port, Recorder, System, TimeTable
from co_sim.coupling import Coupling
from co_sim.linear import LinearComponent

STATES = ["s", "v"]
#: A mass on a spring and a damper, measured with and without feedthrough; two inputs.
MODEL = control.ss(
    [[0.0, 1.0], [-40.0, -1.5]],
    [[0.0, 0.2], [1.0, 0.0]],
    [[1.0, 0.0], [-40.0, -1.5]],
    [[0.0, 0.0], [1.0, 0.0]],
    states=STATES,
    inputs=["force", "speed"],
    outputs=["position", "acceleration"],
)


def started(model=MODEL, h=0.1, **options):
    component = LinearComponent(model, **options)
    component.start(0.0, h)
    return component


def stack(values, first=0.0, second=0.0):
    """Inputs with their derivatives."""
    values = np.asarray(values, dtype=np.float64)
    return np.hstack([values, np.broadcast_to(first, values.shape), np.broadcast_to(second, values.shape)])


def random_inputs(n, n_u=2, seed=1):
    return np.random.default_rng(seed).normal(size=(n, n_u))


def test_one_step_is_the_exact_solution_for_a_quadratic_input(run_native):
    u0, u1, u2 = np.array([1.0, -2.0]), np.array([3.0, 0.5]), np.array([-20.0, 7.0])
    h, x0 = 0.3, [0.1, -0.4]

    def rate(t, x):
        return MODEL.A @ x + MODEL.B @ (u0 + u1 * t + 0.5 * u2 * t * t)

    end = solve_ivp(rate, (0.0, h), x0, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    expected = MODEL.C @ end + MODEL.D @ (u0 + u1 * h + 0.5 * u2 * h * h)
    got = run_native(started(h=h, x0=x0), [np.concatenate([u0, u1, u2])], h=h)
    np.testing.assert_allclose(got[0], expected, rtol=0, atol=1e-11)


@given(st.integers(1, 64), st.integers(0, 100))
def test_many_small_steps_equal_a_large_one(run_native, n, seed):
    u0, u1, u2 = random_inputs(3, seed=seed)
    t = np.arange(n)[:, np.newaxis] * 0.2 / n
    inputs = np.hstack([u0 + u1 * t + 0.5 * u2 * t * t, u1 + u2 * t, np.tile(u2, (n, 1))])
    small = run_native(started(h=0.2 / n, x0=[1.0, 0.0]), inputs, h=0.2 / n)
    large = run_native(started(h=0.2, x0=[1.0, 0.0]), [np.concatenate([u0, u1, u2])], h=0.2)
    np.testing.assert_allclose(small[-1], large[0], rtol=0, atol=1e-12)


def test_held_inputs_give_the_response_of_python_control(run_native):
    u = random_inputs(200)
    h = 0.05
    sampled = control.sample_system(MODEL, h, "zoh")
    # That response has each input at the start of its step, also in y: compare states by a C without D.
    states = control.ss(sampled.A, sampled.B, np.eye(2), np.zeros((2, 2)), h)
    response = control.forced_response(states, np.arange(201) * h, np.vstack([u, u[-1:]]).T, [0.5, 0.0])
    expected = response.outputs.T[1:] @ MODEL.C.T + u @ MODEL.D.T
    got = run_native(started(h=h, x0=[0.5, 0.0]), stack(u), h=h)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_superposition(run_native, a, b):
    u, v = stack(random_inputs(40), 0.3, -1.0), stack(random_inputs(40, seed=2), -2.0, 5.0)
    x, z = np.array([1.0, 2.0]), np.array([-3.0, 0.5])
    sum_of_both = run_native(started(x0=a * x + b * z), a * u + b * v)
    both = a * run_native(started(x0=x), u) + b * run_native(started(x0=z), v)
    np.testing.assert_allclose(sum_of_both, both, rtol=0, atol=1e-11)


def test_the_first_outputs_belong_to_the_first_state():
    y = np.empty(2)
    started(x0=[0.5, -2.0]).exchange(np.array([3.0, 100.0]), y)
    np.testing.assert_allclose(y, [0.5, -40.0 * 0.5 + 1.5 * 2.0 + 3.0], rtol=1e-15)


def test_interpreter_and_machine_code_give_the_same_bits(run_native, run_python):
    u = stack(random_inputs(100), 0.1, 0.2)
    np.testing.assert_array_equal(run_native(started(), u), run_python(started(), u))


@pytest.mark.parametrize("compiled", [True, False])
def test_an_extrapolated_ramp_is_followed_exactly(compiled):
    ramp = TimeTable([0.0, 100.0], [0.0, 100.0], [Port("r")], interpolation="linear")
    lag = LinearComponent(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]], inputs=["u"], outputs=["y"]))
    connections = [Connection("ramp.r", "lag.u")]
    system = System({"ramp": ramp, "lag": lag}, connections, step=0.5, coupling=Coupling(order=1))
    recorder = Recorder()
    with Master(system, observers=[recorder], compiled=compiled) as master:
        master.run(10.0)
    # In the first step the master knows no slope yet: what that leaves behind dies out by exp(-t).
    t = recorder.time
    left = (recorder["lag.y"] - (t - 1.0 + np.exp(-t))) * np.exp(t)
    np.testing.assert_allclose(left[1:], -(0.5 - 1.0 + math.exp(-0.5)) * math.exp(0.5), rtol=1e-9)


@pytest.mark.parametrize("dt", [0.1, True])
def test_a_discrete_model_takes_its_inputs_at_the_start_of_the_step(run_native, dt):
    A, B, C, D = [[0.9, 0.1], [-0.2, 0.7]], [[1.0], [0.5]], [[1.0, 2.0]], [[3.0]]
    u = random_inputs(50, 1)
    x, expected = np.array([1.0, -1.0]), []
    for k in range(50):
        x = np.array(A) @ x + np.array(B) @ u[k]
        end = u[k] + 0.1 * 0.5 + 0.5 * 0.1**2 * -4.0
        expected.append(np.array(C) @ x + np.array(D) @ end)
    got = run_native(started(control.ss(A, B, C, D, dt), x0=[1.0, -1.0]), stack(u, 0.5, -4.0))
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


def test_a_discrete_model_needs_its_own_step():
    model = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.01)
    started(model, h=0.1 / 10 * (1 + 1e-15))
    with pytest.raises(InputError, match=r"a step of 0\.1 s, expected its sampling time, 0\.01 s"):
        started(model, h=0.1)


def test_a_transfer_function_has_its_step_response(run_native):
    lag = control.tf([2.0, 1.0], [0.5, 1.0])
    component = started(lag, h=0.1)
    got = run_native(component, stack(np.ones((50, 1))))[:, 0]
    t = 0.1 * np.arange(1, 51)
    np.testing.assert_allclose(got, 1.0 + 3.0 * np.exp(-2.0 * t), rtol=0, atol=1e-13)
    assert component.feedthrough == {"y[0]": {"u[0]"}}


def test_a_model_without_states_runs(run_native):
    gain = control.ss([], [], [], [[2.0, -1.0]])
    np.testing.assert_array_equal(run_native(started(gain), stack([[3.0, 1.0]])), [[5.0]])


def test_a_free_motion_is_exact(run_native):
    decay = control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    got = run_native(started(decay, x0=[1.0], h=0.5), np.zeros((2, 3)), h=0.5)
    np.testing.assert_allclose(got[:, 0], [math.exp(-0.5), math.exp(-1.0)], rtol=1e-15)


def test_ports_have_the_labels_of_the_model_or_those_given():
    component = LinearComponent(MODEL)
    assert [port.name for port in component.inputs] == ["force", "speed"]
    assert component.feedthrough == {"position": set(), "acceleration": {"force"}}
    named = LinearComponent(MODEL, [Port("in", "N", shape=(2,))], ["s", Port("a", "m/s2")])
    assert [port.unit for port in named.outputs] == ["1", "m/s2"]
    assert named.feedthrough == {"s": set(), "a": {"in"}}
    assert named.linear_model.inputs == ("in[1]", "in[2]")


def test_the_linear_model_can_be_read_but_not_changed():
    model = LinearComponent(MODEL).linear_model
    assert (model.states, model.dt) == (("s", "v"), 0.0)
    for mine, theirs in zip(
        (model.A, model.B, model.C, model.D), (MODEL.A, MODEL.B, MODEL.C, MODEL.D), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
    with pytest.raises(ValueError, match="read-only"):
        model.A[0, 0] = 1.0


@given(st.integers(0, 20), st.integers(0, 20))
def test_a_restored_run_repeats_bit_for_bit(run_native, before, after):
    u = stack(random_inputs(40), 0.3)
    component = started()
    run_native(component, u[:before])
    state = component.save()
    first = run_native(component, u[before : before + after])
    component.restore(component.deserialize(component.serialize(state)))
    np.testing.assert_array_equal(run_native(component, u[before : before + after]), first)


def test_a_copy_is_independent(run_native):
    component = LinearComponent(MODEL, x0=[1.0, 0.0])
    twin = copy.deepcopy(component)
    component.start(0.0, 0.1)
    twin.start(0.0, 0.2)
    u = stack(random_inputs(2))
    expected = run_native(started(h=0.2, x0=[1.0, 0.0]), u)
    run_native(component, u)
    np.testing.assert_array_equal(run_native(twin, u), expected)


ROW = control.tf([[[1.0], [1.0]]], [[[1.0, 1.0], [1.0, 2.0]]])


@pytest.mark.parametrize(
    ("model", "options", "expected"),
    [
        (MODEL, {"inputs": ["a"], "x0": [1.0]}, r"inputs.*got 1, expected 2(.|\n)*x0.*got 1, expected 2"),
        (MODEL, {"outputs": ["a", "b", "c"]}, "outputs of a linear model: got 3"),
        (MODEL, {"x0": [1.0, math.nan]}, "finite"),
        (control.tf([1.0, 0.0], [1.0]), {}, "non-proper"),
        (3, {}, "got int"),
    ],
)
def test_faulty_models_are_refused(model, options, expected):
    with pytest.raises(InputError, match=expected):
        LinearComponent(model, **options)


def test_a_wide_transfer_function_needs_slycot(monkeypatch):
    monkeypatch.setattr("control.statesp.td04ad", None, raising=False)
    monkeypatch.setitem(__import__("sys").modules, "slycot", None)
    with pytest.raises(InputError, match="install slycot"):
        LinearComponent(ROW)


def test_an_explosion_within_one_step_is_told():
    fast = control.ss([[1e6]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(InputError, match="overflows within one step of 1 s"):
        started(fast, h=1.0)
