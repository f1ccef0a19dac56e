"""The check of a coupling: estimates against true errors, and verdicts on systems whose answer is known."""

import control
import numpy as np
import pytest
from scipy.linalg import expm

from co_sim import (
    Component,
    Connection,
    Coupling,
    CouplingWarning,
    FunctionComponent,
    InputError,
    LinearComponent,
    Master,
    Port,
    Recorder,
    RunError,
    System,
    TimeTable,
    check_coupling,
)


def body(mass, n_forces, z="z"):
    """A mass under forces."""
    A, B = [[0.0, 1.0], [0.0, 0.0]], np.array([[0.0] * n_forces, [1.0 / mass] * n_forces])
    return LinearComponent(
        control.ss(A, B, np.eye(2), 0),
        inputs=[Port(f"F{i + 1}", "N") for i in range(n_forces)],
        outputs=[Port(z, "m"), Port("v", "m/s")],
    )


def strut(stiffness, damping):
    """The force of a spring and a damper on what is above them."""
    return LinearComponent(
        control.ss([], [], [], [[-stiffness, -damping, stiffness, damping]]),
        inputs=[Port("z1", "m"), Port("v1", "m/s"), Port("z2", "m"), Port("v2", "m/s")],
        outputs=[Port("F", "N")],
    )


def quarter_car(step, **coupling):
    """Body, wheel, suspension and tyre of a quarter of a car that meets a kerb of 5 cm."""
    parts = {
        "body": body(300.0, 1),
        "wheel": body(40.0, 2),
        "suspension": strut(2.0e4, 1.5e3),
        "tyre": LinearComponent(
            control.ss([], [], [], [[-1.8e5, -100.0, 1.8e5]]),
            inputs=[Port("z1", "m"), Port("v1", "m/s"), Port("z2", "m")],
            outputs=[Port("F", "N")],
        ),
        "road": TimeTable([0.0, 0.5, 0.55], [0.0, 0.0, 0.05], [Port("z", "m")], "linear"),
    }
    wires = [
        Connection("suspension.F", "body.F1"),
        Connection("suspension.F", "wheel.F1", gain=-1.0),
        Connection("tyre.F", "wheel.F2"),
        *(Connection(f"body.{x}", f"suspension.{x}1") for x in "zv"),
        *(Connection(f"wheel.{x}", f"suspension.{x}2") for x in "zv"),
        *(Connection(f"wheel.{x}", f"tyre.{x}1") for x in "zv"),
        Connection("road.z", "tyre.z2"),
    ]
    return System(parts, wires, step=step, coupling=Coupling(**coupling))


def test_a_quarter_car_is_fine_at_1_ms():
    check = check_coupling(quarter_car(1e-3), 5.0)
    assert check.verdict in {"fine", "inaccurate"}
    assert check.stopped == (None, None, None)
    with Master(quarter_car(1e-3)) as master:
        master.run(5.0)
        np.testing.assert_allclose(master.values[0], 0.05, rtol=0.05)


def test_a_quarter_car_diverges_at_10_ms_and_the_run_says_so():
    with pytest.raises(RunError) as caught:
        Master(quarter_car(1e-2)).run(20.0)
    text = str(caught.value)
    for expected in ("-fold without pause since t = 0.", "the coupling is not at this step", "try 0.001 s"):
        assert expected in text
    assert caught.value.component in {"body", "wheel", "suspension", "tyre"}


def test_a_short_run_that_diverges_is_told_as_well():
    """Two windows after the kerb it warns, three windows after it stops."""
    with Master(quarter_car(1e-2)) as master, pytest.warns(CouplingWarning, match="-fold without pause"):
        master.run(1.2)
    with pytest.raises(RunError, match="-fold without pause"):
        Master(quarter_car(1e-2)).run(2.7)


@pytest.mark.parametrize("lag", [0.02, 0.2, 1.0, 5.0])
def test_a_large_signal_that_rises_out_of_rounding_errors_is_no_divergence(lag):
    """A pressure in Pa, at rest but for rounding, then filled slowly or at once, with what reacts to it."""
    vessel = LinearComponent(
        control.tf([1.0], [lag**2, 2 * lag, 1]), [Port("in", "Pa")], [Port("p", "Pa")], x0=[0, 1e-17]
    )
    valve = LinearComponent(
        control.ss([], [], [], [[-1e-3, 1.0]]), [Port("p", "Pa"), Port("supply", "Pa")], [Port("out", "Pa")]
    )
    parts = {
        "vessel": vessel,
        "valve": valve,
        "supply": TimeTable([0.0, 1.27], [0.0, 3e7], [Port("p", "Pa")]),
    }
    wires = [
        Connection("vessel.p", "valve.p"),
        Connection("valve.out", "vessel.in"),
        Connection("supply.p", "valve.supply"),
    ]
    for n_steps in (136, 192, 256, 512, 4096):
        with Master(System(parts, wires, step=1e-2)) as master:
            master.run(n_steps=n_steps)


def test_the_check_calls_it_unstable_before_it_has_diverged():
    check = check_coupling(quarter_car(1e-2), 2.0)
    assert check.verdict == "unstable"
    assert check.recommended_step is not None
    assert check_coupling(quarter_car(check.recommended_step), 2.0).verdict == "fine"
    assert str(check).startswith("The coupling is unstable at a step of 0.01 s")
    assert max(map(len, str(check).splitlines()[1:])) < 60


def test_a_quarter_car_holds_at_10_ms_when_iterated():
    coupling = {"algorithm": "iterated", "order": 1}
    assert check_coupling(quarter_car(1e-2, **coupling), 2.0).verdict != "unstable"


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "iterated"])
@pytest.mark.parametrize("order", [0, 1])
def test_the_estimate_is_near_the_true_error(algorithm, order):
    A = np.array([[0.0, 1.0, 0.0], [-5.0, -0.4, 2.0], [1.5, 0.0, -1.0]])
    one = LinearComponent(control.ss(A[:2, :2], A[:2, 2:], np.eye(2), 0), ["u"], ["x", "v"], x0=[1.0, 0.0])
    other = LinearComponent(control.ss(A[2:, 2:], [[1.5]], [[1.0]], 0), ["u"], ["x"], x0=[0.5])
    system = System(
        {"one": one, "other": other},
        [Connection("one.x", "other.u"), Connection("other.x", "one.u")],
        step=0.01,
        coupling=Coupling(algorithm, order),
    )
    check = check_coupling(system, 2.0)
    step = expm(A * 0.01)
    exact = np.array([np.linalg.matrix_power(step, k) @ [1.0, 0.0, 0.5] for k in range(201)])
    recorder = Recorder()
    with Master(system, observers=[recorder]) as master:
        master.run(2.0)
    true = dict(zip(recorder.names, np.abs(recorder.table - exact).max(axis=0), strict=True))
    for signal in check.signals:
        assert signal.error == pytest.approx(true[signal.name], rel=0.15)
        assert signal.order == pytest.approx(order + 1, abs=0.3)


def test_a_system_that_is_unstable_by_nature_is_not_blamed_on_its_coupling():
    runaway = LinearComponent(control.ss([[3.0]], [[1.0]], [[1.0]], 0), ["u"], ["x"], x0=[1.0])
    damper = LinearComponent(control.ss([[-1.0]], [[-0.1]], [[1.0]], 0), ["u"], ["x"])
    wires = [Connection("runaway.x", "damper.u"), Connection("damper.x", "runaway.u")]
    parts = {"runaway": runaway, "damper": damper}
    check = check_coupling(System(parts, wires, step=1e-3), 3.0)
    assert check.verdict == "fine"


def test_a_stop_of_all_runs_is_told_and_not_blamed_on_the_step():
    def tank(t, u):
        if t > 0.5:
            raise ValueError("the tank is empty")
        return [t]

    parts = {"tank": FunctionComponent(tank, outputs=[Port("level")])}
    check = check_coupling(System(parts, step=1e-2), 1.0)
    assert check.verdict == "fine"
    assert check.compared_until == pytest.approx(0.5)
    assert "Even with a quarter of the step the run stopped: the tank is empty.\n" in str(check)


def test_results_that_do_not_converge_are_called_so():
    class Moody(Component):
        """Depends on the step in a way that no smaller step cures."""

        def __init__(self):
            super().__init__((), [Port("y")], {})

        def start(self, t0, h):
            self.value = float(round(-np.log2(h)) % 3)

        def exchange(self, u, y):
            y[0] = 0.0

        def step(self, t, h, u, y):
            y[0] = self.value

    check = check_coupling(System({"a": Moody()}, step=1e-3), 1.0)
    assert check.verdict in {"not converging", "unstable"}


def test_a_rate_of_its_own_keeps_its_sample_time():
    periods = []

    class Sampled(FunctionComponent):
        def start(self, t0, h):
            periods.append(h)
            super().start(t0, h)

    parts = {"a": Sampled(lambda t, u: [t], outputs=[Port("y")])}
    check = check_coupling(System(parts, step=0.01, rates={"a": 5}), 1.0)
    assert periods == pytest.approx([0.05] * 3)
    assert check.verdict == "fine"
    assert check.signals[0].error == 0.0


def test_a_check_needs_a_step():
    with pytest.raises(InputError, match="at least one step"):
        check_coupling(quarter_car(1e-3), 0.0)
