"""Whole systems with FMUs in them: both loops, every algorithm, saved states, branches, linear models."""

import control
import numpy as np
import pytest
from scipy.linalg import expm

from co_sim import (
    Connection,
    Constant,
    Coupling,
    ExchangeFmu,
    FmuComponent,
    FunctionComponent,
    LinearComponent,
    Master,
    Port,
    Recorder,
    System,
    check_coupling,
    linearize,
)
from co_sim.layout import lay_out
from fmu_wheelset import path

#: A bogie frame that is held in the middle of the track by itself, and pulls the wheelset along.
STIFFNESS, DAMPING, FRAME = 4.0e6, 4.0e4, 3000.0


def wheelset(fmi, kind=FmuComponent):
    return kind(
        path(fmi=fmi),
        inputs=["suspension_lateral_force", "prescribed_creepage"],
        outputs=["lateral_displacement", "lateral_velocity", "yaw_rate"],
        parameters={"drive_mode": "prescribed_creep", "initial_creepage": 1e-3, "k_w": 8.0e6},
    )


def frame():
    A = [[0.0, 1.0], [-STIFFNESS / FRAME, -DAMPING / FRAME]]
    return LinearComponent(
        control.ss(A, [[0.0], [1.0 / FRAME]], np.eye(2), 0, states=["z", "v"]),
        [Port("F", "N")],
        [Port("z", "m"), Port("v", "m/s")],
        x0=[1e-4, 0.0],
    )


def suspension():
    D = [[-STIFFNESS, -DAMPING, STIFFNESS, DAMPING]]
    names = [Port("z1", "m"), Port("v1", "m/s"), Port("z2", "m"), Port("v2", "m/s")]
    return LinearComponent(control.ss([], [], [], D), names, [Port("F", "N")])


def running_gear(first=2, second=3, step=1e-4, **coupling):
    """Two wheelsets under one frame, one of each version of FMI."""
    # At no creepage at all the contact law has no linear model: its slope depends on the direction.
    parts = {"creep": Constant([1e-3], [Port("y")]), "frame": frame()}
    parts |= {"front": wheelset(first), "rear": wheelset(second)}
    parts |= {"spring_front": suspension(), "spring_rear": suspension()}
    wires = []
    for name in ("front", "rear"):
        wires += [
            Connection(f"{name}.lateral_displacement", f"spring_{name}.z1"),
            Connection(f"{name}.lateral_velocity", f"spring_{name}.v1"),
            Connection("frame.z", f"spring_{name}.z2"),
            Connection("frame.v", f"spring_{name}.v2"),
            Connection(f"spring_{name}.F", f"{name}.suspension_lateral_force"),
            Connection("creep.y", f"{name}.prescribed_creepage"),
        ]
    wires.append(Connection("spring_front.F", "frame.F", gain=-1.0))
    return System(parts, wires, step=step, coupling=Coupling(**coupling))


def trajectory(system, n_steps=100, **options):
    recorder = Recorder()
    with Master(system, observers=[recorder], **options) as master:
        master.run(n_steps=n_steps)
    return recorder


@pytest.mark.parametrize("order", [0, 2])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "iterated"])
def test_both_loops_give_the_same_bits(algorithm, order):
    compiled, interpreted = (
        trajectory(running_gear(algorithm=algorithm, order=order), 50, compiled=compiled)
        for compiled in (True, False)
    )
    np.testing.assert_array_equal(compiled.table, interpreted.table)
    assert np.ptp(compiled["rear.lateral_displacement"]) > 1e-6


@pytest.mark.parametrize("fmi", [2, 3])
def test_inputs_that_stand_in_the_row_are_those_that_would_be_copied(fmi):
    def push(outputs, gain=1.0):
        values = {"F": lambda t: 1e3 * np.sin(90.0 * t) / gain, "creep": lambda t: 1e-3, "other": np.cos}
        source = FunctionComponent(
            lambda t, u: [values[name](t) for name in outputs], outputs=[Port(name) for name in outputs]
        )
        wires = [
            Connection("source.F", "wheelset.suspension_lateral_force", gain=gain, convert_units=False),
            Connection("source.creep", "wheelset.prescribed_creepage"),
        ]
        return System({"source": source, "wheelset": wheelset(fmi)}, wires, step=1e-3)

    apart = push(["F", "other", "creep"])
    copied = trajectory(apart, compiled=False)["wheelset.yaw_rate"]
    assert np.ptp(copied) > 0.0
    systems = [
        (1, push(["other", "F", "creep"])),
        (None, apart),
        (None, push(["creep", "F"])),
        (None, push(["F", "creep"], gain=0.5)),
    ]
    for stretch, system in systems:
        layout = lay_out(system)
        assert layout.stretch(layout.parts[1]) == stretch
        np.testing.assert_array_equal(trajectory(system)["wheelset.yaw_rate"], copied)


def test_fmi_2_and_3_give_the_same_bits_in_a_coupled_run():
    runs = [trajectory(running_gear(first, 5 - first)) for first in (2, 3)]
    np.testing.assert_array_equal(runs[0].table, runs[1].table)


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "iterated"])
def test_a_resumed_run_equals_an_unbroken_one(algorithm, tmp_path):
    n = 40 if algorithm == "iterated" else 200
    whole = trajectory(running_gear(algorithm=algorithm, order=1), n)
    with Master(running_gear(algorithm=algorithm, order=1)) as master:
        master.run(n_steps=n // 4)
        master.write_state(tmp_path / "state.npz")
    recorder = Recorder()
    with Master(running_gear(algorithm=algorithm, order=1), observers=[recorder]) as master:
        master.read_state(tmp_path / "state.npz")
        master.run(n_steps=n - n // 4)
    np.testing.assert_array_equal(recorder.table, whole.table[n // 4 :])


def test_many_futures_branch_from_one_state():
    with Master(running_gear()) as master:
        master.run(n_steps=50)
        state = master.save()
        futures = []
        for _ in range(3):
            master.restore(state)
            master.run(n_steps=50)
            futures.append(master.values.copy())
    whole = trajectory(running_gear(), 100)
    np.testing.assert_array_equal(futures, [whole.table[-1]] * 3)


def test_iterated_coupling_rolls_fmus_back_and_is_nearer_to_the_truth():
    fine = trajectory(running_gear(step=1e-5, order=1), 1000)["frame.z"][::100]
    errors = {}
    for algorithm in ("jacobi", "iterated"):
        coarse = trajectory(running_gear(step=1e-3, algorithm=algorithm, order=0), 10)["frame.z"]
        errors[algorithm] = np.abs(coarse - fine).max()
    assert errors["iterated"] < 0.5 * errors["jacobi"]


def test_model_exchange_and_co_simulation_agree_in_a_coupled_run():
    def system(kind):
        parts = {"frame": frame(), "front": wheelset(2, kind), "spring": suspension()}
        wires = [
            Connection("front.lateral_displacement", "spring.z1"),
            Connection("front.lateral_velocity", "spring.v1"),
            Connection("frame.z", "spring.z2"),
            Connection("frame.v", "spring.v2"),
            Connection("spring.F", "front.suspension_lateral_force"),
            Connection("spring.F", "frame.F", gain=-1.0),
        ]
        return System(parts, wires, step=1e-4)

    one, other = trajectory(system(FmuComponent)), trajectory(system(ExchangeFmu))
    difference = np.abs(one.table - other.table).max(axis=0)
    assert (difference <= 1e-6 * np.abs(one.table).max(axis=0)).all()


def test_the_linear_model_of_the_whole_predicts_its_motion():
    with Master(running_gear(step=1e-5, order=1)) as master:
        found = linearize(master)
        start = master.values.copy()
        master.run(0.01)
        moved = master.values - start
    names = [signal.name for signal in master.signals]
    x0 = np.zeros(len(found.states))
    x0[found.states.index("frame.z")] = 1e-4
    predicted = found.model.C @ (expm(found.model.A * 0.01) @ x0 - x0)
    for name in ("frame.z", "front.lateral_displacement", "rear.yaw_rate"):
        i = names.index(name)
        assert moved[i] == pytest.approx(predicted[i], rel=2e-3)
    assert found.methods["front"] == found.methods["rear"] == "directional derivatives"


def test_the_check_runs_fmus_side_by_side():
    check = check_coupling(running_gear(), 0.02, patterns=["frame.*", "*.lateral_displacement"])
    assert check.verdict == "fine"
    assert {signal.name for signal in check.signals} == {
        "frame.z",
        "frame.v",
        "front.lateral_displacement",
        "rear.lateral_displacement",
    }
