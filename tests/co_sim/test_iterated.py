"""Iterated coupling: both loops against each other, the quasi-Newton method, states kept by machine code."""

import numpy as np
import pytest

from co_sim import (
    CompiledComponent,
    Connection,
    Coupling,
    ExchangeFmu,
    FmuComponent,
    FunctionComponent,
    Master,
    Port,
    Recorder,
    RunError,
    System,
)
from co_sim.array_functions import compiled
from co_sim.fmi import Slave
from co_sim.native_state import native_state_of
from co_sim.quasi_newton import agrees, new_iteration, next_guess
from fmu_wheelset import path

LOOPS = [pytest.param(True, id="compiled"), pytest.param(False, id="interpreted")]


@compiled
def lag(t, h, u, y, x, p):
    x[0] += h * p[0] * (u[0] - x[0])
    y[0] = x[0]
    return 0


class Lag(CompiledComponent):
    def __init__(self, start=1.0, rate=3.0):
        super().__init__(
            lag,
            inputs=[Port("u")],
            outputs=[Port("y", start=start)],
            state=[start],
            parameters={"rate": rate},
            feedthrough={},
        )


class Counting(Lag):
    """Its state is more than that of its parent: how many steps led to it."""

    count = 0
    failing = ""

    def native(self):
        return None

    def step(self, t, h, u, y):
        self._x += h * (u - self._x)
        y[:] = self._x
        self.count += 1

    def save(self):
        if self.failing == "save" and self.count == 3:
            raise ValueError("no room for a state")
        return self._x.copy(), self.count

    def restore(self, state):
        if self.failing == "restore":
            raise ValueError("the state is lost")
        self._x[:], self.count = state


def ring(*parts, gain=-4.0, **coupling):
    """Parts in a ring, so stiff that a plain repetition of a step diverges."""
    names = [f"p{i}" for i in range(len(parts))]
    (y,), (u,) = (
        {port.name for part in parts for port in getattr(part, side)} for side in ("outputs", "inputs")
    )
    wires = [
        Connection(f"{name}.{y}", f"{names[i - len(parts) + 1]}.{u}", gain=gain, offset=0.1)
        for i, name in enumerate(names)
    ]
    options = {"algorithm": "iterated", "order": 1, **coupling}
    return System(dict(zip(names, parts, strict=True)), wires, step=0.1, coupling=Coupling(**options))


def gear(fmi, kind=FmuComponent):
    """A wheelset on a spring."""
    wheelset = kind(
        path(fmi=fmi),
        inputs=["suspension_lateral_force"],
        outputs=["lateral_displacement", "lateral_velocity"],
        parameters={"drive_mode": "free_rolling", "speed": 20.0},
    )
    spring = FunctionComponent(
        lambda t, u: [-1e6 * (u[0] - 1e-3) - 1e4 * u[1]],
        inputs=[Port("y", "m"), Port("v", "m/s")],
        outputs=[Port("F", "N")],
    )
    wires = [
        Connection("wheelset.lateral_displacement", "spring.y"),
        Connection("wheelset.lateral_velocity", "spring.v"),
        Connection("spring.F", "wheelset.suspension_lateral_force"),
    ]
    return System({"wheelset": wheelset, "spring": spring}, wires, step=1e-3, coupling=Coupling("iterated"))


def run(system, n_steps=30, **options):
    """Return the record, and the repetitions of the last step."""
    recorder = Recorder()
    with Master(system, observers=[recorder], quiet=True, **options) as master:
        master.run(n_steps=n_steps)
        return recorder.table.copy(), master._loop.repetitions


@pytest.mark.parametrize(
    "system",
    [
        lambda: gear(2),
        lambda: gear(3),
        lambda: gear(2, ExchangeFmu),
        lambda: gear(3, ExchangeFmu),
        lambda: ring(Lag(), Lag(0.5, 30.0), Counting(0.2)),
        lambda: ring(Lag(), Lag(-0.5), Lag(0.2), order=2, gain=-1.9),
    ],
    ids=["fmi2", "fmi3", "exchange fmi2", "exchange fmi3", "stiff ring", "swinging ring"],
)
def test_both_loops_make_the_same_repetitions(system):
    table, repetitions = run(system())
    interpreted, same = run(system(), compiled=False)
    np.testing.assert_array_equal(table, interpreted)
    assert repetitions == same > 2


def test_a_subclass_with_a_state_of_its_own_is_asked_for_it():
    parts = Lag(), Counting()
    for part in parts:
        part.start(0.0, 0.1)
    assert native_state_of(parts[0]) is not None
    assert native_state_of(parts[1]) is None
    counting = Counting(0.2)
    run(ring(Lag(), counting), n_steps=12)
    assert counting.count == 12  # repetitions are taken back


@pytest.mark.parametrize("compiled", LOOPS)
@pytest.mark.parametrize(
    ("failing", "expected"),
    [
        ("save", r"p1 stopped at t = 0.3 s \(step 3\): no room"),
        ("restore", r"p1 stopped .*\(step 0\): the state"),
    ],
)
def test_a_state_that_is_lost_stops_the_run_by_name(failing, expected, compiled):
    part = Counting(0.2)
    part.failing = failing
    with pytest.raises(RunError, match=expected):
        run(ring(Lag(), part), compiled=compiled)


@pytest.mark.parametrize("compiled", LOOPS)
def test_a_run_goes_on_from_a_state_in_the_midst_of_it(compiled):
    whole, _ = run(gear(2), compiled=compiled)
    with Master(gear(2), compiled=compiled) as master:
        master.run(n_steps=10)
        state = master.save()
        for _ in range(2):
            master.restore(state)
            master.run(n_steps=20)
            np.testing.assert_array_equal(master.values, whole[-1])


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_state_that_an_fmu_keeps_is_freed(fmi, monkeypatch):
    calls = []
    call = Slave._call

    def counted(self, name, *arguments):
        calls.append(name)
        return call(self, name, *arguments)

    with Master(gear(fmi)) as master:
        master.run(n_steps=5)
        monkeypatch.setattr(Slave, "_call", counted)
    # The state that the machine code has kept last, and the one that was tried at the start.
    assert sum(name.startswith("Free") and "tate" in name for name in calls) == 2


def fixed_point(function, n, m=50, tolerance=1e-10):
    """Return a solution and how many repetitions it took."""
    iteration = new_iteration(n, m)
    fed = np.arange(n)
    for repetition in range(m):
        if agrees(function(iteration.guess), fed, repetition, np.ones(n), tolerance, iteration):
            return iteration.guess, repetition + 1
        next_guess(repetition, iteration)
    raise AssertionError("no fixed point found")


@pytest.mark.parametrize("n", [1, 3, 10])
def test_a_linear_problem_takes_as_many_repetitions_as_it_has_unknowns_and_two(n):
    rng = np.random.default_rng(n)
    A, b = 5.0 * rng.standard_normal((n, n)), rng.standard_normal(n)
    y, repetitions = fixed_point(lambda y: A @ y + b, n)
    np.testing.assert_allclose(y, np.linalg.solve(np.eye(n) - A, b), rtol=1e-8)
    assert repetitions <= n + 2


def test_the_next_guess_solves_the_least_squares():
    rng = np.random.default_rng(1)
    n, count = 6, 4
    iteration = new_iteration(n, 20)
    iteration.results[:count], iteration.residuals[:count] = rng.standard_normal((2, count, n))
    iteration.scale[:] = rng.uniform(0.1, 10.0, n)
    next_guess(count - 1, iteration)
    V = np.diff(iteration.residuals[:count], axis=0).T / iteration.scale[:, None]
    W = np.diff(iteration.results[:count], axis=0).T
    c, *_ = np.linalg.lstsq(V, -iteration.residuals[count - 1] / iteration.scale)
    np.testing.assert_allclose(iteration.guess, iteration.results[count - 1] + W @ c, rtol=1e-10)


def test_differences_that_say_nothing_new_are_left_out():
    """More repetitions than unknowns, on a curve: the oldest must not spoil the newest."""
    y, repetitions = fixed_point(lambda y: 2.0 * np.cos(y) + 1.0, 1)
    np.testing.assert_allclose(y, 2.0 * np.cos(y) + 1.0, rtol=1e-9)
    assert repetitions <= 9
