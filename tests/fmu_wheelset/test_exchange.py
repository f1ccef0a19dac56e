"""Model exchange: an integrator outside finds the motion of co-simulation, and wrong calls are refused."""

from __future__ import annotations

import ctypes
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException

from fmu_wheelset.variables import VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import SimpleNamespace

    from fmpy.model_description import ModelDescription

    MakePlant = Callable[..., Any]
    Extracted = dict[int, tuple[Path, ModelDescription]]

both = pytest.mark.parametrize("fmi", [2, 3])
modes = pytest.mark.parametrize("mode", list(DriveMode))
STATES = tuple(v.name for v in VARIABLES if v.is_state)
DERIVATIVES = tuple(next(v.name for v in VARIABLES if v.derivative_of == name) for name in STATES)
OUTPUTS = tuple(v.name for v in VARIABLES if v.causality in {"output", "local"})
INPUTS = tuple(v.name for v in VARIABLES if v.causality == "input")
NOMINALS = np.array([v.nominal for v in VARIABLES if v.is_state])
N = len(STATES)
ERROR, DISCARD = 3, 2


def buffer(values: Any = (0.0,) * N) -> Any:
    return (ctypes.c_double * len(values))(*values)


def states(one: Any) -> np.ndarray:
    x = buffer()
    one.slave.getContinuousStates(x, N)
    return np.array(x)


def derivatives(one: Any) -> np.ndarray:
    x_dot = buffer()
    (one.slave.getDerivatives if one.fmi == 2 else one.slave.getContinuousStateDerivatives)(x_dot, N)
    return np.array(x_dot)


def update_discrete_states(one: Any) -> tuple[Any, ...]:
    s = one.slave
    return tuple((s.newDiscreteStates if one.fmi == 2 else s.updateDiscreteStates)())


def started(plant: MakePlant, fmi: int, **start: float) -> Any:
    """An instance in continuous-time mode."""
    one = plant(fmi, exchange=True, **start).initialise()
    one.slave.enterContinuousTimeMode()
    return one


def refused(one: Any, call: Callable[[], object], message: str, status: int = ERROR) -> None:
    one.messages.clear()
    with pytest.raises(FMICallException) as caught:
        call()
    assert caught.value.status == status
    assert len(one.messages) == 1
    assert re.search(message, one.messages[0]), one.messages[0]


# Motion ----------------------------------------------------------------------------------------------


def simulate(
    extracted: Extracted, fmi: int, kind: str, start: dict[str, float], **options: Any
) -> np.ndarray:
    folder, description = extracted[fmi]
    result = simulate_fmu(
        str(folder),
        model_description=description,
        fmi_type=kind,
        start_values=start,
        stop_time=0.3,
        output_interval=1e-3,
        relative_tolerance=1e-10,
        output=STATES,
        **options,
    )
    return np.array([result[name] for name in STATES])


@modes
@pytest.mark.parametrize(("speed", "forward"), [(20.0, True), (60.0, False), (0.5, False)])
def test_cvode_finds_the_motion_of_co_simulation(
    extracted: Extracted, mode: DriveMode, speed: float, forward: bool
) -> None:
    start = {"drive_mode": mode.value, "speed": speed, "forward_dynamics": forward}
    start |= {"lateral_displacement": 1e-3, "traction_torque": 4e3, "prescribed_creepage": 5e-3}
    start |= {"running_resistance": 500.0}
    runs = [simulate(extracted, fmi, "ModelExchange", start, solver="CVode") for fmi in (2, 3)]
    assert runs[0].tobytes() == runs[1].tobytes()
    expected = simulate(extracted, 3, "CoSimulation", start)
    size = np.maximum(np.abs(expected).max(axis=1), NOMINALS)
    assert runs[0].shape == (N, 301)
    assert (np.abs(runs[0] - expected).max(axis=1) / size).max() < 1e-6
    moved = np.ptp(expected, axis=1) > 1e-6 * NOMINALS
    torque = mode is DriveMode.TORQUE_DRIVEN
    assert list(moved) == [True] * 4 + [torque] * 3 + [forward]


def test_inputs_may_move_and_jump(extracted: Extracted) -> None:
    """A track that steps and slopes: events at the integrator, held inputs at the communication points."""
    t = np.array([0.0, 0.1, 0.1, 0.2, 0.3])
    track = np.array([0.0, 0.0, 4e-4, 4e-4, 4e-4])
    signal = np.array(
        list(zip(t, track, strict=True)), dtype=[("time", float), ("track_lateral_offset", float)]
    )
    runs = [simulate(extracted, 3, kind, {"yaw_angle": 1e-4}, input=signal, record_events=False)
            for kind in ("ModelExchange", "CoSimulation")]  # fmt: skip
    size = np.maximum(np.abs(runs[1]).max(axis=1), NOMINALS)[:, None]
    assert (np.abs(runs[0] - runs[1]) / size).max() < 1e-6


# Values ----------------------------------------------------------------------------------------------


@both
@modes
@pytest.mark.parametrize("forward", [False, True])
def test_derivatives_are_those_of_the_equations(
    plant: MakePlant, reference: SimpleNamespace, fmi: int, mode: DriveMode, forward: bool
) -> None:
    given = {"prescribed_creepage": 3e-3, "running_resistance": 500.0}
    one = started(plant, fmi, drive_mode=mode, forward_dynamics=forward, **given)
    x = np.array([1e-3, 2e-4, 5e-3, -2e-3, 39.9, 40.2, 1e-4, 19.9])
    one.slave.setTime(0.125)
    one.slave.setContinuousStates(buffer(x), N)
    expected = reference.Model(mode, forward).x_dot(list(x), reference.INPUTS | given)
    assert derivatives(one) == pytest.approx(expected, rel=1e-11, abs=1e-13)
    assert one.get(*DERIVATIVES) == list(derivatives(one))
    assert one.get("time") == [0.125]
    assert one.get(*STATES) == list(x) == list(states(one))
    moving = np.array([True] * 4 + [mode is DriveMode.TORQUE_DRIVEN] * 3 + [forward])
    assert (derivatives(one)[~moving] == 0.0).all()
    assert (derivatives(one)[moving] != 0.0).all()


@both
def test_outputs_follow_states_and_inputs(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi)
    one.slave.setContinuousStates(buffer([2e-3, *(0.0,) * 7]), N)
    assert one.get("relative_displacement") == [2e-3]
    one.set(track_lateral_offset=5e-4)
    assert one.get("relative_displacement") == [1.5e-3]
    before = derivatives(one)
    one.set(curve_force=1e3)
    assert derivatives(one)[2] > before[2]


@both
def test_outputs_are_those_of_co_simulation_at_the_same_states(plant: MakePlant, fmi: int) -> None:
    """After 20 ms of co-simulation, to the bit."""
    start = {"drive_mode": DriveMode.TORQUE_DRIVEN, "forward_dynamics": True, "traction_torque": 4e3}
    stepped, one = plant(fmi, **start).initialise(), started(plant, fmi, **start)
    stepped.run(20)
    one.slave.setContinuousStates(buffer(stepped.get(*STATES)), N)
    assert one.get(*OUTPUTS) == stepped.get(*OUTPUTS)


@both
def test_order_and_nominals_of_the_states_are_described(
    extracted: Extracted, plant: MakePlant, fmi: int
) -> None:
    """Each state in turn is one million; the variable behind its derivative reads it."""
    one, described = started(plant, fmi), extracted[fmi][1].derivatives
    names = [unknown.variable.derivative.name for unknown in described]
    nominals = buffer()
    one.slave.getNominalsOfContinuousStates(nominals, N)
    assert list(nominals) == [float(unknown.variable.derivative.nominal) for unknown in described]
    for i, name in enumerate(names):
        x = np.zeros(N)
        x[i] = 1e6
        one.slave.setContinuousStates(buffer(x), N)
        assert [name for name in names if one.get(name) == [1e6]] == [name]
    if fmi == 3:
        assert one.slave.getNumberOfContinuousStates() == N
        assert one.slave.getNumberOfEventIndicators() == 0
    assert extracted[fmi][1].numberOfContinuousStates == N
    assert extracted[fmi][1].numberOfEventIndicators == 0


@both
def test_states_follow_the_speed_during_initialisation(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, exchange=True)
    if fmi == 2:
        one.slave.setupExperiment(startTime=0.0)
    one.slave.enterInitializationMode()
    for speed in (10.0, 30.0):
        one.set(speed=speed, lateral_displacement=1e-3)
        assert list(states(one)) == [1e-3, 0, 0, 0, 2 * speed, 2 * speed, 0, speed]
        assert derivatives(one)[3] < 0.0


@both
def test_jacobian_is_that_of_the_derivatives(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi, drive_mode=DriveMode.TORQUE_DRIVEN, forward_dynamics=True, c_s=40.0)
    x = np.array([1e-3, 2e-4, 5e-3, -2e-3, 39.9, 40.2, 1e-4, 19.9])
    columns = []
    for i in range(N):
        h = 1e-5 * max(abs(x[i]), 1e-3) * np.eye(N)[i]
        ends = []
        for y in (x + h, x - h):
            one.slave.setContinuousStates(buffer(y), N)
            ends.append(np.array([*derivatives(one), *one.get(*OUTPUTS)]))
        columns.append((ends[0] - ends[1]) / (2 * h[i]))
    one.slave.setContinuousStates(buffer(x), N)
    expected, found = np.column_stack(columns), one.jacobian((*DERIVATIVES, *OUTPUTS), STATES)
    size = np.maximum(np.abs(expected), 1e-3 * np.abs(expected).max(axis=1, keepdims=True))
    assert (np.abs(found - expected) <= 2e-5 * size).all()


@both
def test_there_are_no_events(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi)
    assert not any(one.slave.completedIntegratorStep())
    one.slave.enterEventMode()
    assert not any(update_discrete_states(one))
    one.set(speed=33.0)  # inputs may jump
    one.slave.setTime(1.0)
    one.slave.enterContinuousTimeMode()
    assert one.get("forward_speed", "time") == [33.0, 1.0]
    one.slave.terminate()
    assert states(one).shape == (N,)


@both
def test_state_of_the_fmu_goes_back_to_continuous_time(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi, lateral_displacement=1e-3)
    state, before = one.slave.getFMUState(), derivatives(one)
    one.slave.setContinuousStates(buffer([5e-3] * N), N)
    one.slave.terminate()
    one.slave.setFMUState(state)
    assert np.array_equal(derivatives(one), before)
    one.slave.setContinuousStates(buffer(), N)
    other = plant(fmi)
    refused(other, lambda: other.slave.setFMUState(state), "FMU state: got one of the other interface type")
    one.slave.freeFMUState(state)


@both
def test_reset_instance_is_again_for_model_exchange(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi, lateral_displacement=1e-3)
    one.slave.reset()
    one.initialise()
    one.slave.enterContinuousTimeMode()
    assert not states(one)[:4].any()


# Wrong calls -----------------------------------------------------------------------------------------


@both
def test_order_of_calls(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, exchange=True)
    s = one.slave
    refused(one, lambda: states(one), "GetContinuousStates: not allowed while the instance is instantiated")
    refused(one, s.enterContinuousTimeMode, "not allowed while the instance is instantiated")
    refused(one, s.terminate, "not allowed while the instance is instantiated")
    one.initialise()
    for call in (s.completedIntegratorStep, s.enterEventMode, lambda: s.setContinuousStates(buffer(), N)):
        refused(one, call, "not allowed while the instance is in event mode; check the order of calls")
    refused(one, lambda: one.set(m_w=1e3), "m_w: cannot be set while the instance is in event mode; set it")
    s.enterContinuousTimeMode()
    refused(one, lambda: update_discrete_states(one), "not allowed while .* in continuous-time mode")
    refused(one, s.enterContinuousTimeMode, "not allowed while .* in continuous-time mode")
    refused(one, one.initialise, "not allowed while the instance is in continuous-time mode")
    library, instance = ctypes.CDLL(s.dll._name), ctypes.c_void_p(s.component)
    step = library.fmi2DoStep if fmi == 2 else library.fmi3DoStep
    one.messages.clear()
    assert step(instance, ctypes.c_double(0.0), ctypes.c_double(1e-3), 1, *[None] * 4) == ERROR
    assert "DoStep: not allowed while the instance is in continuous-time mode" in one.messages[0]
    s.terminate()
    refused(one, lambda: s.setTime(0.0), "SetTime: not allowed while the instance is terminated")
    refused(one, lambda: s.setContinuousStates(buffer(), N), "not allowed while the instance is terminated")


@both
def test_co_simulation_has_no_integrator_outside(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi).initialise()
    library, instance = ctypes.CDLL(one.slave.dll._name), ctypes.c_void_p(one.slave.component)
    names = ["EnterEventMode", "EnterContinuousTimeMode", "CompletedIntegratorStep", "GetEventIndicators"]
    names += ["SetContinuousStates", "GetContinuousStates", "GetNominalsOfContinuousStates"]
    names += ["NewDiscreteStates", "GetDerivatives"] if fmi == 2 else ["UpdateDiscreteStates"]
    names += [] if fmi == 2 else ["GetContinuousStateDerivatives", "GetNumberOfContinuousStates"]
    for name in names:
        one.messages.clear()
        zeros = [ctypes.c_size_t(0)] * 6
        assert getattr(library, f"fmi{fmi}{name}")(instance, *zeros) == ERROR, name
        assert one.messages == [
            f"fmi{fmi}{name}: not allowed in co-simulation; instantiate for model exchange"
        ]
    one.step(0.0, 1e-3)


@both
def test_wrong_numbers_of_states(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi)
    s = one.slave
    read = s.getDerivatives if fmi == 2 else s.getContinuousStateDerivatives
    calls = (s.setContinuousStates, s.getContinuousStates, read, s.getNominalsOfContinuousStates)
    for call in calls:
        message = "continuous states: got an array of 7, expected 8"
        refused(one, lambda call=call: call(buffer(), 7), message)
        refused(one, lambda call=call: call(None, N), "got a null array, expected 8 elements")
    refused(one, lambda: s.getEventIndicators(buffer(), 1), "event indicators: got an array of 1, expected 0")
    s.getEventIndicators(None, 0)


@both
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_states_that_are_not_finite_are_discarded(plant: MakePlant, fmi: int, value: float) -> None:
    one = started(plant, fmi, lateral_displacement=1e-3)
    before = states(one)
    x = buffer([0.0, 0.0, value, *(0.0,) * 5])
    call = lambda: one.slave.setContinuousStates(x, N)  # noqa: E731
    refused(one, call, r"continuous state 2: got -?\w+ at 0 s, expected a finite number; try", DISCARD)
    assert np.array_equal(states(one), before)
    refused(one, lambda: one.slave.setTime(value), "time: got")


@both
def test_derivatives_that_are_not_finite_are_discarded(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi)
    one.slave.setContinuousStates(buffer([1e308] * N), N)
    refused(one, lambda: derivatives(one), "derivative of continuous state .* expected a finite", DISCARD)
    one.slave.setContinuousStates(buffer(), N)
    assert np.isfinite(derivatives(one)).all()


@both
def test_states_that_start_infinite_are_discarded(plant: MakePlant, fmi: int) -> None:
    one = started(plant, fmi, r0=5e-324, speed=20.0)
    refused(one, lambda: states(one), r"continuous state \d: got inf at 0 s, expected a finite", DISCARD)
