"""Algorithms of coupling: laws, orders of convergence, and the two loops against each other."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from co_sim import (
    Component,
    Connection,
    Coupling,
    FunctionComponent,
    InputError,
    Master,
    Port,
    Recorder,
    RunError,
    System,
)
from co_sim.dependencies import algebraic_loops, component_order

ALGORITHMS = ("jacobi", "gauss-seidel", "iterated")


class Linear(Component):
    """x' = A x + B u, exact for inputs that are held or, with `smooth`, polynomials of order 2."""

    def __init__(self, A, B, x0, *, smooth=False):
        self.A, self.B, self.x0 = (np.atleast_2d(np.asarray(m, dtype=float)) for m in (A, B, x0))
        n, m = self.B.shape
        super().__init__(
            [Port(f"u{i}") for i in range(m)],
            [Port(f"x{i}") for i in range(n)],
            {f"x{i}": [] for i in range(n)},
        )
        self.takes_derivatives = smooth

    def start(self, t0, h):
        n, m = self.B.shape
        order = 3 if self.takes_derivatives else 1
        joint = np.zeros((n + order * m,) * 2)
        joint[:n, : n + m] = np.hstack([self.A, self.B])
        joint[n : n + (order - 1) * m, n + m :] = np.eye((order - 1) * m)
        self.step_matrix = expm(joint * h)[:n]
        self.x = self.x0.ravel().copy()

    def exchange(self, u, y):
        y[:] = self.x

    def step(self, t, h, u, y):
        self.x = self.step_matrix @ np.concatenate([self.x, u])
        y[:] = self.x

    def save(self):
        return self.x.copy()

    def restore(self, state):
        self.x = state.copy()

    def serialize(self, state):
        return state.tobytes()

    def deserialize(self, data):
        return np.frombuffer(data)


def oscillator(*, smooth=False, rates=None, **coupling):
    """Two masses of different pace, coupled through springs; and its exact state matrix."""
    a = Linear([[0, 1], [-5, -0.4]], [[0], [2.0]], [1.0, 0.0], smooth=smooth)
    b = Linear([[-1.0]], [[1.5]], [0.5], smooth=smooth)
    wires = [Connection("a.x0", "b.u0"), Connection("b.x0", "a.u0")]
    A = np.array([[0, 1, 0], [-5, -0.4, 2.0], [1.5, 0, -1.0]])
    return System({"a": a, "b": b}, wires, rates=rates or {}, coupling=Coupling(**coupling)), A


def error(h, **options):
    """Error made in a time of 2, when there is a past to look back on.

    A first step has none. What is lost there is of order 2 in all, however good the later steps are.
    """
    system, A = oscillator(**options)
    with Master(system, h=h) as master:
        master.run(0.4)
        before = master.values.copy()
        master.run(2.0)
        return np.linalg.norm(master.values - expm(2.0 * A) @ before)


@pytest.mark.parametrize("rates", [{}, {"b": 3}, {"a": 2}], ids=["one rate", "b slow", "a slow"])
@pytest.mark.parametrize("smooth", [False, True], ids=["means", "derivatives"])
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_order_of_convergence(algorithm, order, smooth, rates):
    if algorithm == "iterated" and rates:
        pytest.skip("refused, as another test shows")
    # The mean of a parabola is all that a component without derivatives sees of it.
    expected = order + 1 if smooth else min(order + 1, 2)
    steps = 0.4 / (12 * 2 ** np.arange(2, 5))
    errors = [error(h, algorithm=algorithm, order=order, smooth=smooth, rates=rates) for h in steps]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[-1] == pytest.approx(expected, abs=0.3)


def test_iterated_steps_agree_with_the_implicit_equations():
    """Order 0: x_k+1 solves the step with its own outputs held."""
    system, _ = oscillator(algorithm="iterated")
    with Master(system, h=0.05) as master:
        master.start()
        before = master.values.copy()
        master.step()
        after = master.values.copy()
        a, b = (component.step_matrix for component in system.components.values())
    np.testing.assert_allclose(after[:2], a @ [*before[:2], after[2]], rtol=1e-8)
    np.testing.assert_allclose(after[2:], b @ [before[2], after[0]], rtol=1e-8)


def test_iterated_coupling_holds_where_jacobi_diverges():
    def stiff(**coupling):
        a = Linear([[-1.0]], [[-30.0]], [1.0])
        b = Linear([[-1.0]], [[30.0]], [1.0])
        wires = [Connection("a.x0", "b.u0"), Connection("b.x0", "a.u0")]
        return System({"a": a, "b": b}, wires, step=0.1, coupling=Coupling(**coupling))

    with Master(stiff(algorithm="iterated")) as master:
        master.run(20.0)
        assert np.abs(master.values).max() < 1e-3
    with pytest.raises(RunError, match=r"has grown .*-fold without pause since t = .*try 0\.01 s"):
        Master(stiff()).run(60.0)


def test_a_growing_signal_in_a_cascade_is_the_users_affair():
    parts = {"a": Linear([[5.0]], [[0.0]], [1.0]), "b": Linear([[-1.0]], [[1.0]], [0.0])}
    looped = Master(System(parts, [Connection("a.x0", "b.u0"), Connection("b.x0", "a.u0")]), h=0.01)
    with pytest.raises(RunError, match="without pause"):
        looped.run(10.0)
    parts = {"a": Linear([[5.0]], np.zeros((1, 0)), [1.0]), "b": Linear([[-1.0]], [[1.0]], [0.0])}
    with Master(System(parts, [Connection("a.x0", "b.u0")]), h=0.01) as cascade:
        cascade.run(10.0)
        assert cascade.values[0] > 1e20


def test_unfinished_growth_is_told_at_the_end():
    parts = {"a": Linear([[5.0]], [[0.0]], [1e-9])}
    with (
        Master(System(parts, [Connection("a.x0", "a.u0")]), h=0.01) as master,
        pytest.warns(UserWarning, match=r"a.x0 has grown .*\(a growth rate of 5 1/s\)"),
    ):
        master.run(5.0)


def test_iteration_that_does_not_converge_is_told():
    system, _ = oscillator(algorithm="iterated", max_iterations=2)
    with pytest.raises(RunError, match=r"after 2 repetitions of the step its output x\d still differs"):
        Master(system, h=0.1).run(1.0)


def test_iterated_coupling_needs_states():
    class Forgetful(Linear):
        save = Component.save

    system = System(
        {"a": Forgetful([[-1]], [[1]], [1.0])},
        [Connection("a.x0", "a.u0")],
        coupling=Coupling(algorithm="iterated"),
    )
    with pytest.raises(InputError, match="state of a: got it does not say how its state is saved"):
        Master(system).run(n_steps=1)


def test_iterated_coupling_refuses_several_rates():
    system, _ = oscillator(algorithm="iterated", rates={"b": 2})
    with pytest.raises(InputError, match='"iterated" with several rates'):
        system.check()


def counter(name="y"):
    return FunctionComponent(lambda t, u: [t], outputs=[Port(name)])


def follower():
    return FunctionComponent(lambda t, u: [u[0]], inputs=[Port("u")], outputs=[Port("y")])


@pytest.mark.parametrize(("algorithm", "lag"), [("jacobi", 1), ("gauss-seidel", 0)])
def test_a_cascade_is_delayed_by_jacobi_only(algorithm, lag):
    recorder = Recorder()
    # Against the flow of the signals: the order must come from the connections.
    parts = {"c": follower(), "b": follower(), "a": counter()}
    wires = [Connection("a.y", "b.u"), Connection("b.y", "c.u")]
    with Master(System(parts, wires, coupling=Coupling(algorithm)), h=1.0, observers=[recorder]) as master:
        master.run(n_steps=6)
    expected = np.maximum(recorder.time - 2 * lag, 0.0)
    np.testing.assert_array_equal(recorder["c.y"], expected)


def test_no_slow_value_is_seen_before_it_exists():
    recorder = Recorder()
    parts = {"slow": counter(), "fast": follower()}
    system = System(
        parts,
        [Connection("slow.y", "fast.u")],
        step=1.0,
        rates={"slow": 4},
        coupling=Coupling("gauss-seidel"),
    )
    with Master(system, observers=[recorder]) as master:
        master.run(n_steps=9)
    np.testing.assert_array_equal(recorder["slow.y"], [0, 0, 0, 0, 4, 4, 4, 4, 8, 8])
    assert (recorder["fast.y"] <= recorder.time).all()


def test_a_slow_component_reads_what_was_there_when_its_step_began():
    seen = []

    class Reader(FunctionComponent):
        def step(self, t, h, u, y):
            seen.append((t, h, float(u[0])))
            super().step(t, h, u, y)

    reader = Reader(lambda t, u: [0.0], inputs=[Port("u")], outputs=[Port("y")])
    parts = {"fast": counter(), "slow": reader}
    system = System(parts, [Connection("fast.y", "slow.u")], step=1.0, rates={"slow": 3})
    with Master(system) as master:
        master.run(n_steps=7)
    assert seen == [(0.0, 3.0, 0.0), (3.0, 3.0, 3.0)]


@pytest.mark.parametrize("order", [1, 2])
def test_extrapolated_inputs_are_exact_for_polynomials(order):
    """A mean over each step and a value at its end: exact as soon as the history is long enough."""

    class Mean(FunctionComponent):
        takes_end_values = False

    power = order
    source = FunctionComponent(lambda t, u: [t**power], outputs=[Port("y")])
    mean = Mean(lambda t, u: [u[0]], inputs=[Port("u")], outputs=[Port("y")])
    parts = {"source": source, "mean": mean, "end": follower()}
    recorder = Recorder()
    wires = [Connection("source.y", "mean.u"), Connection("source.y", "end.u")]
    system = System(parts, wires, step=0.5, coupling=Coupling(order=order))
    with Master(system, observers=[recorder]) as master:
        master.run(n_steps=10)
    t = recorder.time
    mean = (t[1:] ** (power + 1) - t[:-1] ** (power + 1)) / ((power + 1) * 0.5)
    np.testing.assert_allclose(recorder["mean.y"][order + 1 :], mean[order:], rtol=1e-13)
    np.testing.assert_allclose(recorder["end.y"][order + 1 :], t[order + 1 :] ** power, rtol=1e-13)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_functions_in_a_loop_keep_the_order_of_convergence(algorithm, order):
    """A spring that is a function, between two masses."""
    A = np.array([[0.0, 1.0, 0.0], [-5.0, -0.4, 2.0], [1.5, 0.0, -1.0]])

    def error(h):
        a = Linear(A[:2, :2], A[:2, 2:], [1.0, 0.0], smooth=True)
        b = Linear(A[2:, 2:], A[2:, :1], [0.5], smooth=True)
        wires = [Connection("a.x0", "f.u"), Connection("f.y", "b.u0"), Connection("b.x0", "a.u0")]
        coupling = Coupling(algorithm, order, tolerance=1e-12)
        with Master(System({"a": a, "f": follower(), "b": b}, wires, coupling=coupling), h=h) as master:
            master.run(0.4)
            before = master.values[[0, 1, 3]]
            master.run(2.0)
            return np.linalg.norm(master.values[[0, 1, 3]] - expm(2.0 * A) @ before)

    coarse, fine = error(0.4 / 32), error(0.4 / 64)
    assert np.log2(coarse / fine) == pytest.approx(order + 1, abs=0.3)


def test_signals_that_jump_are_not_extrapolated():
    source = FunctionComponent(lambda t, u: [t], outputs=[Port("y", continuous=False)])
    recorder = Recorder()
    system = System({"s": source, "f": follower()}, [Connection("s.y", "f.u")], coupling=Coupling(order=2))
    with Master(system, h=1.0, observers=[recorder]) as master:
        master.run(n_steps=4)
    np.testing.assert_array_equal(recorder["f.y"], [0, 0, 1, 2, 3])


@st.composite
def systems(draw):
    """Random networks of small linear systems with rates, gains and any algorithm."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(1, 4))
    sizes = [int(rng.integers(1, 3)) for _ in range(n)]
    coupling = Coupling(draw(st.sampled_from(ALGORITHMS)), draw(st.integers(0, 2)), divergence=math.inf)
    rates = {} if coupling.algorithm == "iterated" else {f"c{i}": int(rng.integers(1, 4)) for i in range(n)}
    seeds = rng.integers(0, 2**32, n)
    smooth = [draw(st.booleans()) for _ in range(n)]

    def part(i):
        own = np.random.default_rng(seeds[i])
        A = own.standard_normal((sizes[i],) * 2) - 2.0 * np.eye(sizes[i])
        return Linear(A, own.standard_normal((sizes[i], 2)), own.standard_normal(sizes[i]), smooth=smooth[i])

    wires = []
    for i in range(n):
        for j in range(2):
            source = int(rng.integers(0, n))
            x = int(rng.integers(0, sizes[source]))
            gain, offset = rng.uniform(-0.5, 0.5, 2) if rng.random() < 0.7 else (1.0, 0.0)
            wires.append(Connection(f"c{source}.x{x}", f"c{i}.u{j}", gain, offset))
    order = draw(st.permutations(range(n)))

    def build(*, permuted=False):
        indices = order if permuted else range(n)
        parts = {f"c{i}": part(i) for i in indices}
        return System(parts, wires, step=0.02, rates=rates, coupling=coupling)

    return build


def trajectory(system, *, compiled=True, n_steps=25):
    recorder = Recorder()
    with Master(system, observers=[recorder], compiled=compiled) as master:
        master.run(n_steps=n_steps)
    return recorder


@settings(deadline=None, max_examples=80)
@given(build=systems())
def test_compiled_and_interpreted_loops_give_the_same_bits(build):
    np.testing.assert_array_equal(trajectory(build()).table, trajectory(build(), compiled=False).table)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_value_that_passes_unchanged_keeps_the_sign_of_zero(compiled):
    source = FunctionComponent(lambda t, u: [-0.0], outputs=[Port("zero")])
    sign = FunctionComponent(lambda t, u: [math.copysign(1.0, u[0])], inputs=[Port("u")], outputs=[Port("y")])
    wires = [Connection("zero.zero", "sign.u")]
    recorder = trajectory(System({"zero": source, "sign": sign}, wires), compiled=compiled, n_steps=2)
    assert recorder["sign.y"][-1] == -1.0


@settings(deadline=None, max_examples=60)
@given(build=systems())
def test_the_order_of_components_changes_no_bit_of_jacobi(build):
    if build().coupling.algorithm != "jacobi":
        return
    one, other = trajectory(build()), trajectory(build(permuted=True))
    for name in one.names:
        np.testing.assert_array_equal(one[name], other[name])


@settings(deadline=None, max_examples=60)
@given(build=systems(), cut=st.integers(0, 20), compiled=st.booleans())
def test_a_resumed_run_equals_an_unbroken_one(build, cut, compiled, tmp_path_factory):
    whole = trajectory(build(), compiled=compiled)
    path = tmp_path_factory.mktemp("state") / "state.npz"
    with Master(build(), compiled=compiled) as master:
        master.run(n_steps=cut)
        master.write_state(str(path))
        state = master.save()
        master.run(n_steps=25 - cut)
        np.testing.assert_array_equal(master.values, whole.table[-1])
        master.restore(state)
        assert master.k == cut
        np.testing.assert_array_equal(master.values, whole.table[cut])
        master.run(n_steps=25 - cut)
        np.testing.assert_array_equal(master.values, whole.table[-1])
    recorder = Recorder()
    with Master(build(), compiled=compiled, observers=[recorder]) as other:
        other.read_state(path)
        other.run(n_steps=25 - cut)
    np.testing.assert_array_equal(recorder.table, whole.table[cut:])


@settings(deadline=None, max_examples=40)
@given(build=systems(), blocks=st.lists(st.integers(1, 9), min_size=1, max_size=10))
def test_the_cut_into_blocks_changes_nothing(build, blocks):
    whole = trajectory(build(), n_steps=sum(blocks))
    with Master(build()) as master:
        for n in blocks:
            master.run(n_steps=n)
        np.testing.assert_array_equal(master.values, whole.table[-1])


def test_the_order_of_gauss_seidel_follows_the_feedthrough_in_a_loop():
    """Of two in a loop, the one that follows its input at once comes last."""
    parts = {"spring": follower(), "mass": Linear([[-1.0]], [[1.0]], [1.0])}
    wires = [Connection("mass.x0", "spring.u"), Connection("spring.y", "mass.u0")]
    assert component_order(System(parts, wires)) == ["mass", "spring"]
    assert component_order(System(dict(reversed(parts.items())), wires)) == ["mass", "spring"]


def gain(factor):
    return FunctionComponent(
        lambda t, u: [factor * u[0] + 1.0], inputs=[Port("u", start=0.0)], outputs=[Port("y")]
    )


def test_algebraic_loops_are_refused_or_solved():
    parts = {"a": gain(-3.0), "b": gain(2.0)}
    wires = [Connection("a.y", "b.u"), Connection("b.y", "a.u")]
    assert algebraic_loops(System(parts, wires)) == [["a.y", "b.y", "a.y"]]
    with pytest.raises(InputError, match=r"algebraic loop: got a.y -> b.y -> a.y"):
        System(parts, wires).check()
    with Master(System(parts, wires, coupling=Coupling(loops="solve"))) as master:
        master.start()
        a, b = master.values
    assert a == pytest.approx(-3.0 * b + 1.0, rel=1e-9)
    assert b == pytest.approx(2.0 * a + 1.0, rel=1e-9)


def test_a_nonlinear_loop_is_solved():
    cosine = FunctionComponent(
        lambda t, u: [math.cos(3.0 * u[0])], inputs=[Port("u", start=0.4)], outputs=[Port("y")]
    )
    system = System({"a": cosine}, [Connection("a.y", "a.u")], coupling=Coupling(loops="solve"))
    with Master(system) as master:
        master.start()
        assert math.cos(3.0 * master.values[0]) == pytest.approx(master.values[0], rel=1e-9)


def test_a_loop_without_a_solution_is_told():
    shift = FunctionComponent(lambda t, u: [u[0] + 1.0], inputs=[Port("u", start=0.0)], outputs=[Port("y")])
    system = System({"a": shift}, [Connection("a.y", "a.u")], coupling=Coupling(loops="solve"))
    with pytest.raises(InputError, match=r"no solution of the algebraic loop through a.y: 1 is left over"):
        Master(system).start()


def test_all_faults_of_a_coupling_are_told():
    system = System(
        {"a": counter()},
        step=-1.0,
        rates={"a": 0, "b": 2},
        parameters={"a.x": 1.0, "c.y": 2.0},
        coupling=Coupling("jacoby", 3, "ignore", tolerance=2.0, max_iterations=0, divergence=math.nan),
    )
    with pytest.raises(InputError) as caught:
        system.check()
    for expected in (
        "step: got -1.0 s",
        'rate of "a": got 0',
        'rate of "b": got an unknown component',
        'a: parameter "x": got an unknown name',
        'parameter "c.y": got unknown component "c"',
        "coupling algorithm: got 'jacoby', expected one of 'jacobi', 'gauss-seidel', 'iterated'",
        "coupling order: got 3",
        "coupling loops: got 'ignore'",
        "coupling tolerance",
        "coupling max_iterations",
        "coupling divergence",
    ):
        assert expected in str(caught.value)


def test_a_state_of_another_system_is_refused(tmp_path):
    path = tmp_path / "state.npz"
    system, _ = oscillator()
    with Master(system) as master:
        master.write_state(path)
    other, _ = oscillator(order=1)
    with Master(other) as master, pytest.raises(InputError, match=r"state.npz: order: got 0, expected 1"):
        master.read_state(path)
    (tmp_path / "text.npz").write_text("nothing", encoding="utf-8")
    with Master(other) as master, pytest.raises(InputError, match="a file that write_state has made"):
        master.read_state(tmp_path / "text.npz")
    with Master(other) as master, pytest.raises(InputError, match="no folder"):
        master.write_state(tmp_path / "none" / "x.npz")
