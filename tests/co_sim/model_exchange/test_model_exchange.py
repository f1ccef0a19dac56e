import contextlib
import copy
import tempfile
from pathlib import Path

import numba
import numpy as np
import pytest

from co_sim import Master, Recorder, System
from co_sim.component import StateError
from co_sim.errors import InputError
from co_sim.fmi import FmuError
from co_sim.model_exchange import ExchangeFmu
from co_sim.native import STEP, caller
from co_sim.texts import number_of, text_of

call_step = caller(STEP)
G = 9.81


@pytest.fixture(autouse=True)
def temporary_folder(tmp_path, monkeypatch):
    """Every test must leave this folder as empty as it was."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    before = Path.cwd()
    yield folder
    assert list(folder.iterdir()) == []
    assert Path.cwd() == before


@contextlib.contextmanager
def started(fmu, t0=0.0, h=0.1, u=None):
    """Start an FMU with inputs that are zero, exchange, and close it."""
    u = np.zeros(len(fmu.inputs)) if u is None else np.asarray(u, dtype=float)
    try:
        fmu.start(t0, h)
        fmu.exchange(u, np.zeros(len(fmu.outputs)))
        fmu.enter_steps()
        yield fmu
    finally:
        fmu.close()


def steps(fmu, ks, h=0.1, t0=0.0, u=None):
    """Do the steps of these numbers; return the outputs after each. `u` gives 3 values for each input."""
    rows = np.zeros((len(ks), len(fmu.outputs)))
    for k, row in zip(ks, rows, strict=True):
        t = t0 + k * h
        values = np.zeros((3, len(fmu.inputs))) if u is None else np.array(u(t), dtype=float)
        fmu.step(t, h, np.ascontiguousarray(values).ravel(), row)
    return rows


def run(fmu, n, h=0.1, **options):
    with started(fmu, t0=options.get("t0", 0.0), h=h):
        return steps(fmu, range(n), h, **options)


def oscillator(path, w=2.0, x0=1.0, v0=0.0, **options):
    options = {"inputs": ["u"], "outputs": ["x", "v"], **options}
    return ExchangeFmu(path, parameters={"p1": w, "p2": x0, "p3": v0}, **options)


def ball(path, e=0.8, h0=1.0, **options):
    parameters = {"p1": e, "p2": h0}
    return ExchangeFmu(path, inputs=[], outputs=["x", "v", "count"], parameters=parameters, **options)


def order(errors, ratios):
    return np.polyfit(np.log(ratios), np.log(errors), 1)[0]


@pytest.mark.parametrize(("method", "expected"), [("rk4", 4), ("midpoint", 2), ("euler", 1)])
def test_the_order_of_convergence_of_the_substep(fmu, method, expected):
    substeps = [0.02, 0.01, 0.005]
    exact = [np.cos(2.0), -2.0 * np.sin(2.0)]
    errors = [
        np.abs(run(oscillator(fmu("oscillator"), substep=s, method=method), 10)[-1] - exact).max()
        for s in substeps
    ]
    assert order(errors, substeps) == pytest.approx(expected, abs=0.1)


def test_inputs_follow_their_polynomial(fmu):
    # x'' = -x + u with u = 2 + t^2: the solution from rest at zero is x = t^2.
    def u(t):
        return [[2.0 + t**2], [2.0 * t], [2.0]]

    substeps = [0.1, 0.05, 0.025]
    errors = []
    for substep in substeps:
        part = oscillator(fmu("oscillator"), w=1.0, x0=0.0, substep=substep)
        (row,) = run(part, 1, h=0.5, u=u)
        errors.append(np.abs(row - [0.25, 1.0]).max())
    assert order(errors, substeps) == pytest.approx(4, abs=0.2)
    assert errors[-1] < 1e-7


def test_without_a_substep_a_step_is_one_step_of_the_method(fmu):
    (row,) = run(oscillator(fmu("oscillator"), w=1.0), 1, h=0.5)
    h = 0.5
    np.testing.assert_allclose(row, [1 - h**2 / 2 + h**4 / 24, -h + h**3 / 6], rtol=1e-15)


def test_outputs_are_those_at_the_end_with_the_input_there(fmu):
    part = oscillator(fmu("oscillator"), outputs=["x", "total"])
    rows = run(part, 3, u=lambda t: [[t], [1.0], [0.0]])
    np.testing.assert_allclose(rows[:, 1] - rows[:, 0], [0.1, 0.2, 0.3], rtol=1e-14)


def bounce_times(e, h0, n):
    first = np.sqrt(2 * h0 / G)
    flights = 2 * first * e ** np.arange(1, n)
    return first + np.concatenate([[0.0], np.cumsum(flights)])


@pytest.mark.parametrize("substep", [0.003, 0.02, None])
def test_the_ball_bounces_where_and_as_it_must(fmu, substep):
    e, h0, h, n = 0.8, 1.0, 0.05, 50
    times = bounce_times(e, h0, 20)
    t = h * np.arange(1, n + 1)
    count = np.searchsorted(times, t)
    rows = run(ball(fmu("ball"), e, h0, substep=substep), n, h)
    np.testing.assert_array_equal(rows[:, 2], count)
    assert count[-1] >= 4
    # A parabola is integrated exactly: what remains is the error of the event times.
    v0 = np.sqrt(2 * G * h0) * e**count
    flight = np.where(count > 0, t - np.concatenate([[0.0], times])[count], t)
    height = np.where(count > 0, v0 * flight - G / 2 * flight**2, h0 - G / 2 * t**2)
    np.testing.assert_allclose(rows[:, 0], height, rtol=0, atol=1e-11)
    np.testing.assert_allclose(rows[:, 1], np.where(count > 0, v0, 0.0) - G * flight, rtol=0, atol=1e-11)


def test_bounces_that_follow_ever_faster_are_told(fmu):
    part = ball(fmu("ball"), 0.5, 1.0)
    end = bounce_times(0.5, 1.0, 60)[-1]
    with started(part), pytest.raises(FmuError, match="more than 1000 events in one step") as caught:
        steps(part, range(30))
    assert f"the last at t = {end:.8f}" in str(caught.value)


def test_chattering_about_a_line_is_told(fmu):
    part = ExchangeFmu(fmu("relay"), inputs=["u"], outputs=["x"], parameters={"p2": 0.25})
    with started(part), pytest.raises(FmuError, match=r"more than 1000 events .* t = 0\.25"):
        steps(part, range(5))


def test_a_jump_of_an_input_across_an_indicator_is_an_event(fmu):
    part = ExchangeFmu(fmu("relay"), inputs=["u"], outputs=["x", "count"], parameters={"p2": 0.5})
    rows = run(part, 2, u=lambda t: [[0.0 if t == 0.0 else 1.0], [0.0], [0.0]])
    np.testing.assert_allclose(rows, [[0.4, 0.0], [0.5, 1.0]], atol=1e-15)


def counter(path, period, limit=0.0, **options):
    parameters = {"p1": period, "p3": limit, **options}
    outputs = ["count", "sample", "settings"]
    return ExchangeFmu(path, inputs=["d"], outputs=outputs, parameters=parameters)


@pytest.mark.parametrize("period", [0.1, 0.025, 0.17, 0.3])
def test_time_events_are_met(fmu, period):
    t = 0.1 * np.arange(1, 41)
    rows = run(counter(fmu("counter"), period), 40)
    # An event that falls on a communication point up to rounding has happened there.
    np.testing.assert_array_equal(rows[:, 0], np.floor(t / period + 1e-9))


def test_discrete_inputs_are_set_at_events_and_only_when_they_are_new(fmu):
    def u(t):
        return [[np.floor(t / 0.3 + 1e-9)], [7.0], [7.0]]  # derivatives mean nothing here

    rows = run(counter(fmu("counter"), 0.5), 10, u=u)
    # Sampled at 0.5 and at 1.0, the end of the last step; set in initialisation (twice) and at 0.3, 0.6, 0.9.
    np.testing.assert_array_equal(rows[:, 1], [0, 0, 0, 0, 1, 1, 1, 1, 1, 3])
    np.testing.assert_array_equal(rows[:, 2] - rows[0, 2], [0, 0, 0, 1, 1, 1, 2, 2, 2, 3])


def test_booleans_and_integers_pass_through_machine_code(fmu):
    options = {"inputs": ["d", "flag"], "outputs": ["level", "count"], "parameters": {"p1": 0.25}}
    part = ExchangeFmu(fmu("counter"), **options)
    rows = run(part, 10, u=lambda t: [[0.0, float(t > 0.55)], [0.0, 0.0], [0.0, 0.0]])
    t = 0.1 * np.arange(1, 11)
    count = np.floor(t / 0.25 + 1e-9)
    np.testing.assert_array_equal(rows[:, 1], count)
    # The step that begins at 0.6 is the first with the flag, which is an event.
    np.testing.assert_array_equal(rows[:, 0], np.where(t > 0.65, 3 * count, count))
    with started(part):
        assert part.native() is not None
        with pytest.raises(FmuError, match=r'input "flag" is 0\.5, expected 0 or 1'):
            steps(part, [0], u=lambda t: [[0.0, 0.5], [0.0, 0.0], [0.0, 0.0]])


def test_texts_pass_through_the_interpreter(fmu):
    options = {"inputs": ["word"], "outputs": ["echo", "level"], "parameters": {"p1": 0.25}}
    part = ExchangeFmu(fmu("counter"), **options)
    words = [float(number_of(text)) for text in ("", "one", "two")]
    rows = run(part, 6, u=lambda t: [[words[int(t / 0.2 + 1e-9)]], [0.0], [0.0]])
    assert [text_of(number) for number in rows[:, 0]] == ["", "", "one", "one", "two", "two"]
    np.testing.assert_array_equal(rows[:, 1], [0, 0, 1, 1, 2, 2])
    with started(part):
        assert part.native() is None
        with pytest.raises(IndexError):  # no text has this number, and the error comes through the C code
            steps(part, [0], u=lambda t: [[1e9], [0.0], [0.0]])


def test_the_end_of_the_simulation_is_a_failure_that_tells_when(fmu):
    part = counter(fmu("counter"), 0.17, limit=3.0)
    with started(part):
        steps(part, range(5))
        with pytest.raises(FmuError, match=r"the FMU ended the simulation at t = 0\.51 s"):
            steps(part, [5])


def test_an_event_that_never_settles_is_told(fmu):
    part = counter(fmu("counter"), 0.17, endless=1.0)
    with pytest.raises(FmuError, match=r"the event at t = 0 s did not settle in 100 it"), started(part):
        pass


def test_step_events_follow_the_substep(fmu):
    part = ExchangeFmu(fmu("saw"), inputs=[], outputs=["x", "count"], substep=0.3)
    rows = run(part, 4, h=0.6)
    np.testing.assert_allclose(rows, [[0.6, 0], [0.2, 1], [0.8, 1], [0.4, 2]], atol=1e-14)


def test_a_refused_call_is_told_with_its_name_its_time_and_the_log(fmu):
    part = oscillator(fmu("oscillator"))
    part.set_parameters({"trouble": 0.33})
    with started(part):
        steps(part, range(3))
        with pytest.raises(FmuError) as caught:
            steps(part, [3])
        with pytest.raises(FmuError):
            steps(part, [4])  # and nothing more is called
    text = str(caught.value)
    assert "returned the status error" in text
    assert "Derivatives" in text
    assert "from t = 0.3 s" in text
    assert text.endswith('its log says "the model is in trouble"')


def everything(path):
    if "ball" in path.name:
        return ball(path, 0.7, substep=0.013)
    return counter(path, 0.13) if "counter" in path.name else oscillator(path, outputs=["x", "v", "total"])


def inputs_of(part):
    return lambda t: [
        [np.floor(4 * t)] * len(part.inputs),
        [1.0] * len(part.inputs),
        [0.5] * len(part.inputs),
    ]


@pytest.mark.parametrize("model", ["oscillator", "ball", "counter"])
@pytest.mark.parametrize("way", ["memory", "bytes", "fresh"])
def test_a_restored_state_goes_on_bit_for_bit(fmu, model, way):
    part = everything(fmu(model))
    u = inputs_of(part)
    whole = run(part, 20, u=u)
    with started(part):
        steps(part, range(7), u=u)
        state = part.save()
        if way == "bytes":
            state = part.deserialize(part.serialize(state))
        elif way == "fresh":
            data = part.serialize(state)
            part.close()
            part.start(0.0, 0.1)
            state = part.deserialize(data)
        if way != "fresh":
            steps(part, range(7, 12), u=u)
        for _ in range(2):
            part.restore(state)
            np.testing.assert_array_equal(steps(part, range(7, 20), u=u), whole[7:])


def test_the_side_of_an_indicator_belongs_to_the_state(fmu):
    part = ExchangeFmu(fmu("relay"), inputs=["u"], outputs=["x", "count"], parameters={"p2": 0.5})

    def u(t):
        return [[0.0 if t == 0.0 else 1.0], [0.0], [0.0]]

    with started(part):
        steps(part, [0], u=u)
        state = part.save()
        after = steps(part, [1, 2], u=u)
        part.restore(state)
        np.testing.assert_array_equal(steps(part, [1, 2], u=u), after)


def test_after_a_failure_a_sound_state_can_be_restored(fmu):
    part = counter(fmu("counter"), 0.17, limit=3.0)
    with started(part):
        steps(part, range(4))
        state = part.save()
        with pytest.raises(FmuError):
            steps(part, range(4, 8))
        part.restore(state)
        np.testing.assert_array_equal(steps(part, [4])[:, 0], [2])


def test_a_state_saved_before_the_first_step(fmu):
    part = everything(fmu("ball"))
    with started(part):
        state = part.save()
        first = steps(part, range(10))
        part.restore(state)
        np.testing.assert_array_equal(steps(part, range(10)), first)


def test_states_that_cannot_be_saved_or_are_of_another_run(fmu):
    plain = everything(fmu("ball", saves=False))
    with started(plain), pytest.raises(StateError, match="does not declare canGetAndSetFMUstate"):
        plain.save()
    part = everything(fmu("ball"))
    with started(part):
        state = part.save()
        with pytest.raises(StateError, match="no state of"):
            part.deserialize(b"1234")
    with started(part), pytest.raises(StateError, match="not one of this run"):
        part.restore(state)


def test_runs_can_be_repeated_and_copied_and_stand_side_by_side(fmu):
    part = everything(fmu("ball"))
    twin = copy.deepcopy(part)
    first = run(part, 20)
    np.testing.assert_array_equal(run(part, 20), first)
    with started(part), started(twin):
        for k in range(20):
            steps(part, [k])
            np.testing.assert_array_equal(steps(twin, [k])[0], first[k])


def test_both_versions_of_fmi_agree_bit_for_bit(build):
    for model in ("oscillator", "ball", "counter"):
        tables = []
        for version in (2, 3):
            part = everything(build(model, version))
            tables.append(run(part, 20, u=inputs_of(part)))
        np.testing.assert_array_equal(*tables)


def test_ports_states_and_dependencies_come_from_the_description(fmu):
    part = ExchangeFmu(fmu("oscillator"), outputs=["x", "total", "der(v)", "p1", "sample"])
    assert [(port.name, port.continuous) for port in part.inputs] == [("u", True), ("d", False)]
    assert [port.continuous for port in part.outputs] == [True, True, True, False, False]
    assert part.feedthrough == {
        "x": frozenset(),
        "total": {"u"},
        "der(v)": {"u", "d"},
        "p1": frozenset(),
        "sample": frozenset(),
    }
    assert [(state.name, state.unit) for state in part.states] == [("x", "m"), ("v", "m/s")]
    assert ExchangeFmu(fmu("counter")).states == ()


def test_the_present_point_can_be_moved_and_read(fmu):
    part = oscillator(fmu("oscillator"), w=3.0, x0=0.5, v0=0.25, outputs=["total"])
    with started(part, t0=2.0, u=[1.5]):
        assert part.directional_derivative(["total"], ["u"], np.ones(1)) is None
        point = part.point()
        assert point.time == 2.0
        np.testing.assert_array_equal(point.states(), [0.5, 0.25])
        np.testing.assert_array_equal(point.derivatives(), [0.25, -9.0 * 0.5 + 1.5])
        point.set_states([1.0, -1.0])
        point.set_inputs([2.0])
        np.testing.assert_array_equal(point.derivatives(), [-1.0, -7.0])
        np.testing.assert_array_equal(point.outputs(), [3.0])
        np.testing.assert_array_equal(point.nominals(), [2.0, 2.0])
        x, v = 1.0, -1.0
        (row,) = steps(part, [0], h=1e-3, t0=2.0)
        np.testing.assert_allclose(row, [x + 1e-3 * v], atol=1e-5)


def test_the_linear_model_of_the_oscillator(fmu):
    part = oscillator(fmu("oscillator"), w=3.0, inputs=["d", "u"], outputs=["v", "total"])
    part.start(0.0, 0.1)
    try:
        part.exchange(np.array([0.0, 1.5]), np.zeros(2))
        model = part.linearize(0.0, np.array([0.0, 1.5]))
        part.enter_steps()
    finally:
        part.close()
    assert model.states == ("x", "v")
    assert model.state_units == ("m", "m/s")
    for matrix, expected in (
        (model.A, [[0, 1], [-9, 0]]),
        (model.B, [[0, 0], [0, 1]]),
        (model.C, [[0, 1], [1, 0]]),
        (model.D, [[0, 0], [0, 1]]),
    ):
        np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-8)


def test_a_master_runs_saves_and_restores_it(build):
    rows = []
    for version in (2, 3):
        part = oscillator(build("oscillator", version), w=1.0, x0=0.0, substep=0.02)
        recorder = Recorder()
        with Master(System({"part": part}), h=0.1, observers=[recorder]) as master:
            master.run(n_steps=20)
            state = master.save()
            master.run(n_steps=20)
            end = recorder.table[-1].copy()
            master.restore(state)
            master.run(n_steps=20)
            np.testing.assert_array_equal(recorder.table[-1], end)
        rows.append(end)
    np.testing.assert_array_equal(*rows)


def test_faults_are_told_together(fmu):
    with pytest.raises(InputError) as caught:
        ExchangeFmu(fmu("ball"), inputs=["x"], parameters={"q": 1.0}, substep=0.0, method="rk5")
    text = str(caught.value)
    for part in ('input "x"', 'parameter "q"', "substep", "'rk5', expected one of euler, midpoint, rk4"):
        assert part in text


@numba.njit(nogil=True)
def compiled_loop(address, data, t0, h, u, rows):
    for k in range(len(rows)):
        status = call_step(address, (t0 + k * h, h, u.ctypes.data, rows[k:].ctypes.data, data))
        if status != 0:
            return status
    return 0


def test_the_step_runs_in_a_compiled_loop_and_gives_the_same_bits(fmu):
    part = ball(fmu("ball"), 0.7, substep=0.013)
    python = run(part, 20)
    with started(part):
        rows = np.zeros_like(python)
        assert compiled_loop(*part.native()[:2], 0.0, 0.1, np.zeros(0), rows) == 0
        np.testing.assert_array_equal(rows, python)
        more = compiled_loop(*part.native()[:2], 2.0, 0.1, np.zeros(0), rows)
        assert "more than 1000 events" in str(part.failure(more))
