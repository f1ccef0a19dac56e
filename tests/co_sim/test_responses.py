"""Linear models of components that can only be stepped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.linalg import expm

from co_sim import Connection, FmuComponent, FunctionComponent, InputError, Master, Port, System, linearize
from co_sim.local_model import NotLinearizableError
from co_sim.responses import model_from_responses
from co_sim.wheelset.bogie.assembly import build_frame, build_track
from co_sim.wheelset.bogie.bogie_frame import _PARAMETERS
from co_sim.wheelset.track import synthesise
from estimator import ERRI_B176

if TYPE_CHECKING:
    from pathlib import Path

H = 1e-2


class Stepped:
    """A continuous model as a component that steps it exactly with held inputs."""

    def __init__(self, A, B, C, D, outputs=None, inputs=None):
        self.A, self.B, self.C, self.D = (np.atleast_2d(np.array(M, dtype=float)) for M in (A, B, C, D))
        n, m = self.B.shape
        joined = expm(np.block([[self.A, self.B], [np.zeros((m, n + m))]]) * H)
        self.step_A, self.step_B = joined[:n, :n], joined[:n, n:]
        self.inputs = inputs or tuple(Port(f"u{j}") for j in range(m))
        self.outputs = outputs or tuple(Port(f"y{i}") for i in range(len(self.C)))
        self.x = np.linspace(0.3, 0.7, n)

    def step(self, t, h, u, y):
        assert h == H
        self.x = self.step_A @ self.x + self.step_B @ u
        y[:] = self.C @ self.x + self.D @ u

    def save(self):
        return self.x

    def restore(self, state):
        self.x = state


OSCILLATOR = ([[0.0, 1.0], [-40.0, -0.8]], [[0.0], [2.0]])


def found_of(component, u=None):
    before = component.x
    found = model_from_responses(component, 1.0, H, np.zeros(len(component.inputs)) if u is None else u)
    assert component.x is before
    return found


def test_outputs_that_tell_the_state_are_the_states():
    ports = (Port("force", "N"), Port("z", "m"), Port("v", "m/s"))
    C, D = [[40.0, 0.8], [1.0, 0.0], [0.0, 1.0]], [[3.0], [0.0], [0.0]]
    found = found_of(Stepped(*OSCILLATOR, C, D, ports), u=np.array([5.0]))
    assert (found.states, found.state_units) == (("z", "v"), ("m", "m/s"))
    np.testing.assert_allclose(found.A, OSCILLATOR[0], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.B, OSCILLATOR[1], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.C, C, rtol=1e-6)
    np.testing.assert_allclose(found.D, D, rtol=1e-6)
    assert found.method == "responses"
    assert 0.0 <= found.error < 1e-8
    # What is zero is zero, and no rounding.
    assert found.A[0, 0] == found.B[0, 0] == 0.0


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_single_output_gives_the_same_transfer_function(scale):
    C, D = [[scale, 0.2 * scale]], [[0.0]]
    found = found_of(Stepped(*OSCILLATOR, C, D))
    assert found.states == ("x1", "x2")
    s = 3.0j
    A, B = (np.array(M) for M in OSCILLATOR)
    expected = np.array(C) @ np.linalg.solve(s * np.eye(2) - A, B) + D
    np.testing.assert_allclose(
        found.C @ np.linalg.solve(s * np.eye(2) - found.A, found.B) + found.D, expected, rtol=1e-6
    )


def test_growing_and_integrating_modes():
    A = np.diag([0.4, 0.0, -3.0])
    found = found_of(Stepped(A, np.ones((3, 1)), np.eye(3), np.zeros((3, 1))))
    np.testing.assert_allclose(found.A, A, atol=1e-6)


def test_states_out_of_reach_or_out_of_sight_are_not_there():
    A, C = np.diag([-1.0, -2.0, -3.0]), [[1.0, 0.0, 1.0]]
    found = found_of(Stepped(A, [[1.0], [1.0], [0.0]], C, [[0.0]]))
    np.testing.assert_allclose(found.A, [[-1.0]], rtol=1e-6)


def test_without_memory_there_is_only_a_gain():
    component = Stepped(np.zeros((1, 1)), np.zeros((1, 2)), np.zeros((2, 1)), [[1.0, 2.0], [3.0, 0.0]])
    found = found_of(component)
    assert found.A.shape == (0, 0)
    np.testing.assert_allclose(found.D, component.D, rtol=1e-9)


def test_what_is_no_continuous_number_has_zeros():
    inputs = (Port("gear", kind="int32"), Port("u"), Port("mode", continuous=False))
    outputs = (Port("y", shape=(2,)), Port("flag", kind="boolean"))
    A, C = np.diag([-1.0, -2.0]), [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    found = found_of(Stepped(A, np.ones((2, 3)), C, np.zeros((3, 3)), outputs, inputs))
    assert found.states == ("y[1]", "y[2]")
    np.testing.assert_allclose(found.B, [[0, 1, 0], [0, 1, 0]], atol=1e-6)
    np.testing.assert_array_equal(found.C[2], 0.0)


class Delay(Stepped):
    """An input that comes out two steps later."""

    def __init__(self):
        super().__init__(np.zeros((2, 2)), np.zeros((2, 1)), np.zeros((1, 2)), np.zeros((1, 1)))

    def step(self, t, h, u, y):
        y[0], self.x = self.x[0], np.array([self.x[1], u[0]])


class Switching(Stepped):
    """A state that changes its sign in each step."""

    def step(self, t, h, u, y):
        self.x = -0.9 * self.x + u
        y[:] = self.x


def test_what_has_no_continuous_model_is_told():
    with pytest.raises(NotLinearizableError, match="differ from those of a linear model"):
        found_of(Delay())
    with pytest.raises(NotLinearizableError, match="changes its sign"):
        found_of(Switching([[0.0]], [[1.0]], [[1.0]], [[0.0]]))


def test_more_states_than_can_be_told():
    rng = np.random.default_rng(1)
    decay = np.diag(-np.linspace(1.0, 60.0, 40))
    component = Stepped(decay, rng.normal(size=(40, 1)), rng.normal(size=(1, 40)), [[0.0]])
    try:
        found = found_of(component)
    except NotLinearizableError:
        return
    # Modes that are so near each other that fewer do the same.
    assert len(found.A) < 20
    assert found.error < 1e-6


@pytest.fixture(scope="module")
def frame(tmp_path_factory) -> Path:
    return build_frame(tmp_path_factory.mktemp("frame"))


def test_an_fmu_of_another_exporter_without_derivatives(frame):
    parts = {"frame": FmuComponent(frame)}
    with Master(System(parts, step=1e-3)) as master:
        master.run(0.01)
        found = linearize(master)
        again = linearize(master)
    p = {name: value for name, (value, _, _) in _PARAMETERS.items()}
    k, c = 2 * p["k_y"] + p["k_y2"], 2 * p["c_y"] + p["c_y2"]
    k_psi = 2 * (p["k_psi"] + p["a"] ** 2 * p["k_y"]) + p["k_psi2"]
    c_psi = 2 * (p["c_psi"] + p["a"] ** 2 * p["c_y"]) + p["c_psi2"]
    expected = np.zeros((4, 4))
    expected[:2, 2:] = np.eye(2)
    expected[2, [0, 2]] = -k / p["m"], -c / p["m"]
    expected[3, [1, 3]] = -k_psi / p["I"], -c_psi / p["I"]
    assert found.states == tuple(
        f"frame.{name}" for name in ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")
    )
    assert found.state_units == ("m", "rad", "m/s", "rad/s")
    assert found.methods == {"frame": "responses"}
    np.testing.assert_allclose(found.model.A, expected, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(again.model.A, found.model.A, rtol=1e-9, atol=1e-6)
    force = found.outputs.index("frame.front.lateral_force")
    np.testing.assert_allclose(found.model.D[force, 0], -p["k_y"], rtol=1e-6)


def test_an_fmu_without_inputs_takes_no_part(tmp_path):
    track = synthesise(ERRI_B176["erri_low"], 200.0, np.random.default_rng(1))
    parts = {
        "track": FmuComponent(build_track(track, tmp_path), parameters={"speed": 20.0}),
        "double": FunctionComponent(
            lambda t, u: [2.0 * u[0]], inputs=[Port("u", "m")], outputs=[Port("y", "m")]
        ),
    }
    with Master(System(parts, [Connection("track.front", "double.u")])) as master:
        found = linearize(master, inputs=["double.u"], outputs=["double.y"])
    assert found.states == ()
    np.testing.assert_allclose(found.model.D, [[2.0]])


def test_the_reason_is_in_the_message(frame, monkeypatch):
    monkeypatch.setattr("co_sim.responses._MISFIT", -1.0)
    with (
        pytest.raises(InputError, match="its responses to pulses differ from those of a linear model"),
        Master(System({"frame": FmuComponent(frame)}, step=1e-3)) as master,
    ):
        linearize(master)
