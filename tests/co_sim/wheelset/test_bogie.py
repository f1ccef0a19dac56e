"""The bogie: frame, coupling, track, against models that were put together here."""

import csv
import json
from dataclasses import replace

import fmpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag, expm
from scipy.signal import lsim

from co_sim import Coupling, FmuComponent, Master, Recorder, RunError, System
from co_sim.errors import InputError
from co_sim.ssp import read_ssp, schema_faults, write_ssp
from co_sim.wheelset.bogie import run as bogie_run
from co_sim.wheelset.bogie.assembly import (
    HALF_WHEELBASE,
    Ride,
    assemble,
    assemble_fmus,
    build_frame,
    build_track,
)
from co_sim.wheelset.bogie.bogie_frame import oscillate
from co_sim.wheelset.bogie.choice import choose
from co_sim.wheelset.cli import main
from co_sim.wheelset.track import TrackProfile, synthesise
from estimator import CreepCurve, wheelset_model
from estimator.linear_models import point_at
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset import CONDITIONS, WheelsetParameters

#: Manchester benchmarks, as a reader of the paper would enter them.
M, I_Z, A = 2615.0, 3067.0, 1.28
K_Y, C_Y, K_PSI, C_PSI = 7.768e6, 4e3, 6.2782e7, 3e4
K_Y2, C_Y2, K_PSI2, C_PSI2 = 3.2e5, 6.4e4, 3.2e5, 5e4
STATES = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")


@pytest.fixture(scope="module")
def frame(tmp_path_factory):
    return build_frame(tmp_path_factory.mktemp("frame") / "new")


def a_track(scale=1.0, length=60.0, seed=3):
    track = synthesise(ERRI_B176["erri_low"], length, np.random.default_rng(seed))
    return TrackProfile(track.distance, scale * track.offset)


def trajectory(system, duration, every=1):
    recorder = Recorder(every=every)
    with Master(system, observers=[recorder]) as master:
        master.run(duration)
    return recorder


def linear_bogie(ride):
    """Return A and B of both wheelsets and the frame, states in that order, inputs y_t front and rear."""
    curve = CreepCurve(CONDITIONS["dry"], v=ride.speed)
    parameters = replace(WheelsetParameters(), k_w=0.0)
    wheelset = wheelset_model(point_at(curve, "creep", ride.creepage), parameters)
    system = block_diag(wheelset.A, wheelset.A, np.zeros((4, 4)))
    system[8, 10] = system[9, 11] = 1.0
    inertia = np.diag([parameters.m_w, parameters.I_w] * 2 + [M, I_Z])
    # Springs stretch by rows @ q, with q the lateral and yaw displacements of front, rear, frame.
    stretch = np.array(
        [
            [-1, 0, 0, 0, 1, A],
            [0, 0, -1, 0, 1, -A],
            [0, -1, 0, 0, 0, 1],
            [0, 0, 0, -1, 0, 1],
            [0, 0, 0, 0, 1, 0],
            [0, 0, 0, 0, 0, 1],
        ]
    )
    stiffness = stretch.T @ np.diag([K_Y, K_Y, K_PSI, K_PSI, K_Y2, K_PSI2]) @ stretch
    damping = stretch.T @ np.diag([C_Y, C_Y, C_PSI, C_PSI, C_Y2, C_PSI2]) @ stretch
    places = [0, 1, 4, 5, 8, 9]
    rates = [place + 2 for place in places]
    system[np.ix_(rates, places)] -= np.linalg.solve(inertia, stiffness)
    system[np.ix_(rates, rates)] -= np.linalg.solve(inertia, damping)
    track = np.zeros((12, 2))
    track[:4, :1] = track[4:8, 1:] = wheelset.B
    return system, track


def motions(record):
    return np.column_stack(
        [record[f"{body}.{state}"] for body in ("front", "rear", "frame") for state in STATES]
    )


@pytest.fixture(scope="module")
def small_ride():
    return Ride(a_track(scale=1e-3))


def reference(ride, duration, dt=1e-4):
    """Return the motion of the linear bogie, with the track met in time and not in steps."""
    time = dt * np.arange(round(duration / dt) + 1)
    meets = []
    for behind in (0.0, 2 * A):
        s = np.maximum(ride.speed * time - behind, 0.0)
        z = np.minimum(s / ride.ramp, 1.0)
        fade = z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
        meets.append(fade * (ride.track.offset_at(s) - ride.track.offset[0]))
    system, inputs = linear_bogie(ride)
    _, _, states = lsim((system, inputs, np.eye(12), np.zeros((12, 2))), np.column_stack(meets), time)
    return time, states


def test_the_coupled_run_converges_to_one_linear_model_of_the_whole(frame, small_ride):
    time, expected = reference(small_ride, 1.0)
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        record = trajectory(assemble(frame, small_ride, step=step), 1.0)
        exact = expected[:: round(step / 1e-4 * 2) // 2] if step >= 5e-4 else None
        if exact is None:
            exact = np.column_stack([np.interp(record.time, time, column) for column in expected.T])
        errors.append(np.abs(motions(record) - exact).max(axis=0) / np.ptp(expected, axis=0))
    coarse, half, fine = errors
    assert fine.max() < 0.01
    # Held inputs make an error of first order, and nothing else is left of the difference.
    assert (coarse / half > 1.7).all()
    assert (half / fine > 1.7).all()


def test_the_estimated_error_of_the_chosen_coupling_is_the_true_one(frame):
    ride = Ride(a_track())

    def system(step, coupling):
        return assemble(frame, ride, step=step, coupling=coupling)

    choice = choose(system, 0.5, candidates=[Coupling("jacobi", 0), Coupling("jacobi", 1)])
    assert choice.chosen.check.verdict == "fine"
    assert choice.step < 1e-3
    run = trajectory(system(choice.step, choice.coupling), 0.5)
    fine = 1e-5
    truth = trajectory(system(fine, Coupling("gauss-seidel", 2)), 0.5, every=round(choice.step / fine))
    for signal in choice.chosen.check.signals:
        error = np.abs(run[signal.name] - truth[signal.name]).max()
        assert error <= 1.5 * signal.error + 1e-12
        assert error >= 0.5 * signal.error
    assert max(signal.relative for signal in choice.chosen.check.signals) > 1e-4


def test_the_best_candidate_goes_on_and_impossible_tolerances_are_told(frame):
    ride = Ride(a_track())

    def system(step, coupling):
        return assemble(frame, ride, step=step, coupling=coupling)

    candidates = [Coupling("gauss-seidel", 0), Coupling("jacobi", 1)]
    with pytest.raises(InputError, match="expected errors below 1 %; allow smaller steps"):
        choose(system, 0.4, candidates=candidates, steps=[4e-3])
    choice = choose(system, 0.4, candidates=candidates, steps=[1e-3, 2e-4, 1e-4])
    best = min(choice.tried, key=lambda trial: trial.error)
    assert choice.coupling == best.coupling
    assert choice.trials == (*choice.tried, choice.chosen)
    assert [trial.coupling for trial in choice.tried] == candidates


def test_the_rear_wheelset_meets_the_track_of_the_front_one_after_the_wheelbase(frame):
    ride = Ride(a_track())
    record = trajectory(assemble(frame, ride), 2.0)
    late = round(ride.delay / 1e-3)
    assert late == 128
    front, rear = record["track_front.lateral_offset"], record["track_rear.lateral_offset"]
    assert np.ptp(front) > 1e-3
    np.testing.assert_array_equal(rear[: late + 1], 0.0)
    np.testing.assert_allclose(rear[late:], front[:-late], rtol=0, atol=1e-15)


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_the_same_bogie_from_an_ssp_gives_the_same_bits(frame, tmp_path, version):
    ride = Ride(a_track(), speed=25.0, creepage=2e-3, ramp=3.0)
    coupling = Coupling("gauss-seidel", 1)
    written = assemble_fmus(frame, build_track(ride.track, tmp_path), ride, step=5e-4, coupling=coupling)
    write_ssp(written, tmp_path / "bogie.ssp", version=version)
    assert not list(schema_faults(tmp_path / "bogie.ssp"))
    read = read_ssp(tmp_path / "bogie.ssp")
    assert (read.step, read.coupling) == (5e-4, coupling)
    got = trajectory(read, 1.0)
    expected = trajectory(assemble(frame, ride, step=5e-4, coupling=coupling), 1.0)
    shared = [name for name in got.names if name in expected.names]
    assert len(shared) == 18
    for name in shared:
        np.testing.assert_array_equal(got[name], expected[name])
    np.testing.assert_array_equal(got["track.rear"], expected["track_rear.lateral_offset"])


def test_the_track_fmu_says_where_the_track_ends(tmp_path):
    track = build_track(a_track(length=10.0), tmp_path)
    with pytest.raises(RunError, match="the track ends after 10 m"):
        trajectory(System({"track": FmuComponent(track, parameters={"speed": 20.0})}, step=0.1), 1.0)
    whole = System({"track": FmuComponent(track, parameters={"speed": 20.0})}, step=0.1)
    assert len(trajectory(whole, 0.5).time) == 6


def test_only_the_frame_holds_the_wheelsets(frame):
    """Without its springs a wheelset yaws as one that nothing holds; with them it comes back."""
    ride = Ride(TrackProfile([0, 20, 40, 60], [0, 0, 0, 0]))
    kicked = {f"{name}.yaw_angle": 1e-3 for name in ("front", "rear")}
    held = trajectory(replace(assemble(frame, ride), parameters=kicked), 0.05)
    off = {f"frame.{name}": 0.0 for name in ("k_y", "c_y", "k_psi", "c_psi")}
    free = trajectory(replace(assemble(frame, ride), parameters=kicked | off), 0.05)
    assert not free["frame.front.yaw_moment"].any()
    assert not free["frame.yaw_angle"].any()
    assert np.abs(held["front.yaw_angle"][-1]) < 0.5 * np.abs(free["front.yaw_angle"][-1])


def test_the_frame_is_an_fmu_of_another_exporter_with_the_published_values(frame):
    import fmpy

    description = fmpy.read_model_description(frame)
    assert description.generationTool.startswith("PythonFMU3")
    values = {v.name: float(v.start) for v in description.modelVariables if v.causality == "parameter"}
    expected = {"m": M, "I": I_Z, "a": A, "k_y": K_Y, "c_y": C_Y, "k_psi": K_PSI, "c_psi": C_PSI}
    expected |= {"k_y2": K_Y2, "c_y2": C_Y2, "k_psi2": K_PSI2, "c_psi2": C_PSI2}
    assert values == pytest.approx(expected)
    assert values["a"] == HALF_WHEELBASE
    assert all(port.unit != "1" for port in FmuComponent(frame).outputs)


def test_the_frame_goes_back_to_a_saved_state(frame):
    with Master(assemble(frame, Ride(a_track()))) as master:
        master.run(0.2)
        state = master.save()
        master.run(0.1)
        first = master.values.copy()
        master.restore(state)
        master.run(0.1)
        np.testing.assert_array_equal(master.values, first)


@given(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    st.floats(0.1, 10),
    st.floats(0, 30),
    st.floats(0.1, 50),
    st.floats(-10, 10),
    st.floats(1e-3, 2),
)
def test_an_oscillator_moves_as_its_matrix_exponential(start, m, c, k, force, h):
    A = np.array([[0, 1, 0], [-k / m, -c / m, force / m], [0, 0, 0]])
    expected = (expm(A * h) @ [*start, 1.0])[:2]
    np.testing.assert_allclose(oscillate(start, m, c, k, force, h), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("h", [1e-9, 1.0])
def test_a_critically_damped_oscillator_is_no_exception(h):
    got = oscillate((1.0, 0.0), 1.0, 2.0, 1.0, 0.0, h)
    np.testing.assert_allclose(got, [(1 + h) * np.exp(-h), -h * np.exp(-h)], rtol=1e-8)


def test_the_command_writes_all_that_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bogie_run, "DURATION", 0.5)
    monkeypatch.setattr(bogie_run, "CHECKED", 0.3)
    with pytest.raises(SystemExit) as caught:
        main(["run", "bogie", "--out", str(tmp_path / "out"), "--seed", "4"])
    assert caught.value.code == 0
    told = capsys.readouterr().out
    assert "gauss-seidel" in told
    out = tmp_path / "out"
    files = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert files == {
        "bogie_frame.fmu",
        "recorded_track.fmu",
        "wheelset.fmu",
        "bogie.ssp",
        "results.csv",
        "summary.json",
        "report.html",
        "figures/bogie_system.png",
        "figures/bogie_motion.png",
        "figures/bogie_loads.png",
    }
    summary = json.loads((out / "summary.json").read_text())
    assert summary["seed"] == 4
    assert summary["check"]["sentence"] in told
    with (out / "results.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert len(rows) == 501
    assert "frame.front.lateral_force [N]" in header
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert summary["check"]["sentence"] in page


def test_a_platform_that_the_exporter_does_not_know_is_told_before_anything_is_written(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(fmpy, "platform_tuple", "aarch64-linux")
    with pytest.raises(SystemExit) as caught:
        main(["run", "bogie", "--out", str(tmp_path / "out")])
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "PythonFMU3" in line
    assert "got no library for this platform, aarch64-linux" in line
    assert "it has x86_64-linux, x86_64-windows" in line
    assert not list(tmp_path.iterdir())
