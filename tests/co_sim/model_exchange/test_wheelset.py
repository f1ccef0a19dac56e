"""The packaged wheelset through Model Exchange, against its own co-simulation and central differences."""

import contextlib

import numpy as np
import pytest

import fmu_wheelset
from co_sim.fmu import FmuComponent
from co_sim.model_exchange import ExchangeFmu

H = 1e-3
INPUTS = ["track_lateral_offset", "suspension_lateral_force", "traction_torque", "speed"]
OUTPUTS = ["lateral_displacement", "yaw_angle", "yaw_rate", "axle_twist", "left.creepage_x", "adhesion_used"]


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def path(request):
    return fmu_wheelset.path(request.param)


def excitation(k):
    return np.array([1e-3 * (k // 25 % 2), 2e3 * (k // 40 % 3), 400.0 * (k // 30 % 2), 20.0])


@contextlib.contextmanager
def started(part):
    try:
        part.start(0.0, H)
        part.exchange(excitation(0), np.zeros(len(part.outputs)))
        part.enter_steps()
        yield part
    finally:
        part.close()


def steps(part, ks):
    rows = np.zeros((len(ks), len(part.outputs)))
    for k, row in zip(ks, rows, strict=True):
        u = excitation(k)
        part.step(k * H, H, np.concatenate([u, 0 * u, 0 * u]) if part.takes_derivatives else u, row)
    return rows


def test_small_substeps_agree_with_co_simulation(path):
    parameters = {"drive_mode": "torque_driven"}
    with started(FmuComponent(path, inputs=INPUTS, outputs=OUTPUTS, parameters=parameters)) as part:
        reference = steps(part, range(200))
    errors = []
    for substep in (1e-4, 5e-5):
        part = ExchangeFmu(path, inputs=INPUTS, outputs=OUTPUTS, parameters=parameters, substep=substep)
        with started(part):
            errors.append(np.abs(steps(part, range(200)) - reference).max(0) / np.abs(reference).max(0))
    assert errors[1].max() < 1e-5
    assert (errors[1] < errors[0] / 2).all()


def test_saved_states_go_on_bit_for_bit(path):
    with started(ExchangeFmu(path, inputs=INPUTS, outputs=OUTPUTS, substep=2e-4)) as part:
        steps(part, range(50))
        state = part.save()
        data = part.serialize(state)
        first = steps(part, range(50, 100))
        part.restore(state)
        np.testing.assert_array_equal(steps(part, range(50, 100)), first)
        part.restore(part.deserialize(data))
        np.testing.assert_array_equal(steps(part, range(50, 100)), first)


def test_the_linear_model_from_directional_derivatives_is_that_from_central_differences(path, monkeypatch):
    outputs = ["adhesion_used", "left.creep_force_x", "lateral_acceleration"]
    parameters = {"drive_mode": "torque_driven"}
    part = ExchangeFmu(path, inputs=INPUTS, outputs=outputs, parameters=parameters, substep=2e-4)
    with started(part):
        steps(part, range(60))
        state = part.save()
        after = steps(part, range(60, 80))
        part.restore(state)
        exact = part.linearize(60 * H, excitation(60))
        monkeypatch.setattr(ExchangeFmu, "_has_directional_derivatives", False)
        numeric = part.linearize(60 * H, excitation(60))
        np.testing.assert_array_equal(steps(part, range(60, 80)), after)  # nothing has changed
    assert (exact.method, numeric.method) == ("directional derivatives", "central differences")
    assert exact.states == tuple(state.name for state in part.states)
    for name in "ABCD":
        expected = getattr(exact, name)
        size = np.abs(expected).max()
        np.testing.assert_allclose(getattr(numeric, name), expected, rtol=0, atol=1e-6 * size)
