"""Linear models of coupled systems against what is known of them."""

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim import (
    CompiledComponent,
    Connection,
    Constant,
    Coupling,
    FunctionComponent,
    InputError,
    LinearComponent,
    Master,
    Port,
    System,
    linearize,
)
from co_sim.local_model import central_differences


def mass(m):
    return LinearComponent(
        control.ss([[0, 1], [0, 0]], [[0], [1 / m]], np.eye(2), 0, states=["z", "v"]),
        [Port("F", "N", start=0.0)],
        [Port("z", "m"), Port("v", "m/s")],
    )


def spring(k, c):
    return FunctionComponent(
        lambda t, u: [-k * u[0] - c * u[1]],
        inputs=[Port("z", "m"), Port("v", "m/s")],
        outputs=[Port("F", "N")],
    )


def test_a_mass_on_a_spring_is_an_oscillator():
    parts = {"mass": mass(2.0), "spring": spring(50.0, 0.4)}
    wires = [
        Connection("mass.z", "spring.z"),
        Connection("mass.v", "spring.v"),
        Connection("spring.F", "mass.F"),
    ]
    with Master(System(parts, wires)) as master:
        found = linearize(master, inputs=["mass.F"], outputs=["mass.z"])
    model = found.model
    np.testing.assert_allclose(model.A, [[0, 1], [-25, -0.2]], rtol=1e-8)
    np.testing.assert_allclose(model.B, [[0], [0.5]])
    np.testing.assert_allclose(model.C, [[1, 0]])
    np.testing.assert_allclose(model.D, [[0]])
    assert (found.states, found.inputs, found.outputs) == (("mass.z", "mass.v"), ("mass.F",), ("mass.z",))
    assert (model.state_labels, model.input_labels) == (["mass_z", "mass_v"], ["mass_F"])
    assert (found.input_units, found.output_units) == (("N",), ("m",))
    assert found.methods == {"mass": "exact", "spring": "central differences"}
    assert 0.0 <= found.error < 1e-8


def test_units_and_gains_of_connections_count():
    parts = {
        "one": Constant([1.0], [Port("y")]),
        "a": LinearComponent(control.ss([[-1]], [[1]], [[1]], 0), ["u"], [Port("x", "m")]),
        "b": LinearComponent(control.ss([[-2]], [[1]], [[1]], 0), [Port("u", "mm")], [Port("x", "mm")]),
    }
    wires = [Connection("one.y", "a.u"), Connection("a.x", "b.u", gain=3.0, offset=7.0)]
    with Master(System(parts, wires)) as master:
        found = linearize(master, inputs=["a.u"], outputs=["b.x"])
    np.testing.assert_allclose(found.model.A, [[-1, 0], [3000, -2]])


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_it_agrees_with_the_interconnection_of_python_control(seed, n):
    rng = np.random.default_rng(seed)
    models = [
        control.rss(int(rng.integers(1, 4)), 2, 2, strictly_proper=bool(rng.integers(2))) for _ in range(n)
    ]
    for model in models:
        model.D = 0.1 * model.D
    parts = {
        f"c{i}": LinearComponent(m, [Port("u0", start=0.0), Port("u1", start=0.0)], ["y0", "y1"])
        for i, m in enumerate(models)
    }
    pairs = [(f"c{rng.integers(n)}", f"c{i}") for i in range(n)]
    wires = [Connection(f"{a}.y{rng.integers(2)}", f"{b}.u0", gain=0.3) for a, b in pairs]
    system = System(parts, wires, coupling=Coupling(loops="solve"))
    with Master(system) as master:
        ours = linearize(master, inputs=["c*.u1"]).model
    K = np.zeros((2 * n, 2 * n))
    for w in wires:
        K[2 * int(w.target[1]), 2 * int(w.source[1]) + int(w.source[-1])] = w.gain
    theirs = control.feedback(control.append(*models), control.ss([], [], [], K), sign=1)
    for s in (0.3j, 1.0 + 2.0j):
        np.testing.assert_allclose(np.atleast_2d(ours(s)), theirs(s)[:, 1::2], rtol=1e-8, atol=1e-10)


@settings(max_examples=50)
@given(st.lists(st.floats(-100, 100), min_size=1, max_size=4))
def test_central_differences_and_their_estimate(point):
    x = np.array(point)

    def f(v):
        return np.array([np.sin(v).sum(), (v**3).sum(), v[0]])

    J, error = central_differences(f, x)
    exact = np.array([np.cos(x), 3 * x**2, np.eye(len(x))[0]])
    assert np.abs(J - exact).max() <= max(10.0 * error, 1e-8) * np.abs(exact).max()


def test_what_cannot_be_linearised_is_told():
    def step(t, h, u, y, x, p):
        y[0] = u[0]
        return 0

    parts = {"a": CompiledComponent(step, inputs=[Port("u", start=0.0)], outputs=[Port("y", start=0.0)])}
    with (
        Master(System(parts)) as master,
        pytest.raises(InputError, match="linear model of a: got it does not say"),
    ):
        linearize(master)


def test_sampled_and_continuous_do_not_mix():
    sampled = LinearComponent(control.ss([[0.5]], [[1]], [[1]], 0, 1e-3), [Port("u", "m")], ["y"])
    parts = {"mass": mass(1.0), "filter": sampled}
    with (
        Master(System(parts, [Connection("mass.z", "filter.u")])) as master,
        pytest.raises(InputError, match=r"mass continuous, filter 0.001 s"),
    ):
        linearize(master)
    parts = {
        "filter": LinearComponent(control.ss([[0.5]], [[1]], [[1]], 0, True), [Port("u", start=0.0)], ["y"])
    }
    with Master(System(parts, step=1e-3)) as master:
        assert linearize(master).model.dt == 1e-3


def test_a_loop_of_gain_one_has_no_linear_model():
    one = FunctionComponent(
        lambda t, u: [u[0]], inputs=[Port("u", start=0.0)], outputs=[Port("y")], feedthrough={}
    )
    with (
        Master(System({"a": one}, [Connection("a.y", "a.u")])) as master,
        pytest.raises(InputError, match="an algebraic loop whose gain is one"),
    ):
        linearize(master)


@pytest.mark.parametrize(("inputs", "outputs"), [(["mass.G"], ["*"]), (None, ["mass.y"])])
def test_unknown_ends_are_refused(inputs, outputs):
    with Master(System({"mass": mass(1.0)})) as master, pytest.raises(InputError, match="did you mean"):
        linearize(master, inputs, outputs)


def test_ends_are_chosen_as_signals_of_observers_are():
    """Brackets stand for themselves; what begins with an exclamation mark is taken out."""
    part = LinearComponent(
        control.ss([], [], [], np.eye(3)),
        [Port("u", start=0.0, shape=(3,))],
        [Port("y", shape=(3,))],
    )
    with Master(System({"a": part, "b": mass(1.0)})) as master:
        found = linearize(master, inputs=["a.u[2]", "a.u[?]", "!a.u[3]"], outputs=["!b.v", "!a.y[1]"])
    assert found.inputs == ("a.u[1]", "a.u[2]")
    assert found.outputs == ("a.y[2]", "a.y[3]", "b.z")
