"""Wrong calls: each gives an error with one message that helps, and leaves the instance as it was."""

from __future__ import annotations

import ctypes
import math
import re
from typing import TYPE_CHECKING, Any

import pytest
from fmpy.fmi1 import FMICallException

from fmu_wheelset import build
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fmpy.model_description import ModelDescription

    MakePlant = Callable[..., Any]

both = pytest.mark.parametrize("fmi", [2, 3])
DISCARD, ERROR = 2, 3


def refused(plant: Any, call: Callable[[], object], message: str, status: int = ERROR) -> None:
    """The call returns the status and logs exactly one message."""
    plant.messages.clear()
    with pytest.raises(FMICallException) as caught:
        call()
    assert caught.value.status == status
    assert len(plant.messages) == 1
    assert re.search(message, plant.messages[0]), plant.messages[0]


@both
def test_order_of_calls(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    s = one.slave
    refused(
        one,
        s.exitInitializationMode,
        "ExitInitializationMode: not allowed while the instance is instantiated",
    )
    refused(one, lambda: one.step(0.0, 1e-3), "DoStep: not allowed while the instance is instantiated")
    refused(one, s.terminate, "Terminate: not allowed while the instance is instantiated")
    one.initialise()
    refused(one, s.exitInitializationMode, "not allowed while the instance is initialized")
    refused(one, one.initialise, "not allowed while the instance is initialized")
    one.step(0.0, 1e-3)
    s.terminate()
    refused(one, lambda: one.step(1e-3, 1e-3), "DoStep: not allowed while the instance is terminated")
    refused(one, lambda: one.set(speed=1.0), "speed: cannot be set while the instance is terminated")
    assert one.get("time") == [1e-3]


@both
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["speed", "normal_load_left", "m_w", "lateral_displacement", "rail_left.B"])
def test_values_that_are_not_finite(plant: MakePlant, fmi: int, name: str, value: float) -> None:
    one = plant(fmi)
    before = one.get(name)
    refused(
        one, lambda: one.set_named(name, value), rf"^{re.escape(name)}: got -?\w+, expected a finite value"
    )
    assert one.get(name) == before


@both
@pytest.mark.parametrize(
    ("name", "value"),
    [("m_w", 0.0), ("m_w", -1.0), ("c_s", -1.0), ("rail_left.A", 1.5), ("rail_right.k_A", 0.0), ("v0", 0.0)],
)
def test_values_out_of_bounds(plant: MakePlant, fmi: int, name: str, value: float) -> None:
    one = plant(fmi)
    refused(one, lambda: one.set_named(name, value), rf"^{re.escape(name)}: got {value:g}, expected .* from")


@both
def test_radii_that_are_none(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, r0=0.04, delta_r=-0.08)
    refused(one, one.initialise, "delta_r: got -0.08 m, expected a difference of radii below 2 r0 = 0.08 m")
    one.slave.reset()
    one.set(r0=0.04, delta_r=-0.079)
    one.initialise().step(0.0, 1e-3)


@both
@pytest.mark.parametrize("value", [0, 4, -1])
def test_unknown_drive_mode(plant: MakePlant, fmi: int, value: int) -> None:
    one = plant(fmi)
    refused(one, lambda: one.set(drive_mode=value), rf"^drive_mode: got {value}, expected .* from 1 to 3")


@both
def test_parameters_and_states_are_fixed_after_initialisation(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi).initialise()
    for name in ("m_w", "v0", "drive_mode", "forward_dynamics", "lateral_displacement", "axle_twist"):
        refused(
            one, lambda name=name: one.set_named(name, 1), f"^{name}: cannot be set while .* set it earlier"
        )


@both
@pytest.mark.parametrize("name", ["time", "left.g11", "lateral_acceleration", "state.forward_speed"])
def test_computed_variables_cannot_be_set(plant: MakePlant, fmi: int, name: str) -> None:
    one = plant(fmi)
    refused(
        one, lambda: one.set_named(name, 1.0), f"^{re.escape(name)}: cannot be set .* computed by the model"
    )


@both
def test_unknown_value_references(plant: MakePlant, fmi: int) -> None:
    one, n = plant(fmi), len(VARIABLES)
    read, write = (
        (one.slave.getReal, one.slave.setReal) if fmi == 2 else (one.slave.getFloat64, one.slave.setFloat64)
    )
    for reference in (n, 2**32 - 1):
        message = f"value reference: got {reference}, expected less than {n}"
        refused(one, lambda r=reference: read([r]), message)
        refused(one, lambda r=reference: write([r], [1.0]), message)


@both
def test_access_by_another_type(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    integer, real = (
        (one.slave.getInteger, one.slave.getReal) if fmi == 2 else (one.slave.getInt64, one.slave.getFloat64)
    )
    refused(one, lambda: integer([REFERENCES["speed"]]), "^speed: got access as enumeration, expected float")
    refused(one, lambda: real([REFERENCES["drive_mode"]]), "^drive_mode: got access as float, expected enum")
    refused(one, lambda: one.slave.getBoolean([REFERENCES["speed"]]), "^speed: got access as Boolean")


@both
def test_nothing_is_set_if_one_value_is_wrong(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    write = one.slave.setReal if fmi == 2 else one.slave.setFloat64
    references = [REFERENCES["speed"], REFERENCES["curve_force"]]
    refused(one, lambda: write(references, [77.0, math.nan]), "^curve_force: got nan")
    assert one.get("speed") == [20.0]


@both
def test_no_integer_is_set_if_one_is_wrong(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    s, reference = one.slave, REFERENCES["drive_mode"]
    read, write = (s.getInteger, s.setInteger) if fmi == 2 else (s.getInt64, s.setInt64)
    refused(one, lambda: write([reference] * 2, [2, 4]), "^drive_mode: got 4")
    assert list(read([reference])) == [1]


@both
def test_values_that_come_out_infinite_are_never_silent(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, m_w=1e-300, curve_force=1e300).initialise()
    refused(
        one,
        lambda: one.get("lateral_acceleration"),
        "^lateral_acceleration: got inf at 0 s, expected a finite number; check inputs, parameters and",
        DISCARD,
    )
    refused(
        one,
        lambda: one.derivatives(["lateral_acceleration"], ["curve_force"], [1e300]),
        "^lateral_acceleration: got inf",
        DISCARD,
    )
    one.set(curve_force=0.0)  # it can go on
    assert math.isfinite(one.get("lateral_acceleration")[0])


@both
@pytest.mark.parametrize(
    ("t", "h", "message"),
    [
        (0.0, 0.0, "communication step size: got 0 s, expected more than 0 s"),
        (0.0, -1e-3, "communication step size: got -0.001 s"),
        (0.0, math.nan, "communication step size: got -?nan s"),
        (0.5, 1e-3, "communication point: got 0.5 s, expected 0 s"),
        (math.nan, 1e-3, "communication point: got -?nan s"),
        (0.0, 2.0, "communication step: ends at 2 s, expected at most the stop time of 1 s"),
    ],
)
def test_wrong_steps(plant: MakePlant, fmi: int, t: float, h: float, message: str) -> None:
    one = plant(fmi).initialise(stopTime=1.0)
    refused(one, lambda: one.step(t, h), message)
    one.step(0.0, 1e-3)  # it can go on
    assert one.get("time") == [1e-3]


@both
def test_step_beyond_all_times(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, speed=0.0).initialise(1.7e308)
    refused(
        one, lambda: one.step(1.7e308, 1e308), "communication step: ends at inf s, expected a finite time"
    )


@both
def test_wrong_times(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    begin = one.slave.setupExperiment if fmi == 2 else one.slave.enterInitializationMode
    refused(one, lambda: begin(startTime=math.nan), "start time: got -?nan")
    refused(one, lambda: begin(startTime=2.0, stopTime=1.0), "stop time: got 1 s, expected at least")


@both
def test_step_without_solution_fails_once_and_keeps_the_states(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, drive_mode=DriveMode.TORQUE_DRIVEN, I_R=1e-300, lateral_displacement=1e-3)
    one.set(traction_torque=1e300)
    one.initialise()
    before = one.get(*one.states)
    refused(
        one, lambda: one.step(0.0, 1e-3), r"step from 0 s by 0\.001 s: cannot be integrated, .*check inputs"
    )
    assert one.get(*one.states) == before
    assert one.get("time") == [0.0]
    refused(one, lambda: one.step(0.0, 1e-3), "DoStep: not allowed while the instance is failed")
    one.slave.reset()
    one.initialise().step(0.0, 1e-3)


@both
def test_wrong_token_is_refused(
    extracted: dict[int, tuple[Path, ModelDescription]], plant: MakePlant, fmi: int
) -> None:
    one = plant(fmi)
    folder, description = extracted[fmi]
    right, description.guid = description.guid, "{another}"
    try:
        with pytest.raises(Exception, match="Failed to instantiate"):
            type(one)(folder, description)
    finally:
        description.guid = right


# Functions beyond the capabilities --------------------------------------------------------------------


def raw(plant: Any) -> ctypes.CDLL:
    """The same library without the argument types that fmpy declares."""
    return ctypes.CDLL(plant.slave.dll._name)


def declared(version: int) -> dict[str, str]:
    """Argument list of each function type of the FMI headers by function name."""
    text = (build.fmi_headers() / f"fmi{version}FunctionTypes.h").read_text()
    found = re.findall(rf"typedef\s+[\w ]+\*?\s+(fmi{version}\w+?)TYPE\s*\(([^;]*)\);", text)
    return dict(found)


@pytest.mark.parametrize("fmi", [2, 3])
def test_no_function_crashes_without_an_instance(plant: MakePlant, fmi: int) -> None:
    """All functions of an instance return an error if there is none."""
    library, tried = raw(plant(fmi)), 0
    for name, arguments in declared(fmi).items():
        if "Instantiate" in name or "GetVersion" in name or "TypesPlatform" in name:
            continue
        function = getattr(library, name)
        if name.endswith("FreeInstance"):
            function(None)
            continue
        values = [ctypes.c_double(0.0) if re.search(r"(Real|Float64)\s+\w+$", a.strip()) else None
                  for a in arguments.split(",")]  # fmt: skip
        assert function(*values) == ERROR, name
        tried += 1
    assert tried == {2: 40, 3: 70}[fmi]


def call_with_nothing(library: Any, name: str, arguments: str, instance: Any) -> int:
    values: list[Any] = [instance]
    for argument in arguments.split(",")[1:]:
        real = re.search(r"(Real|Float64)\s+\w+$", argument.strip())
        values.append(ctypes.c_double(0.0) if real else ctypes.c_size_t(0))
    return int(getattr(library, name)(*values))


@both
def test_unsupported_functions_say_so(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi).initialise()
    instance, said = ctypes.c_void_p(one.slave.component), 0
    supported = re.compile(
        r"fmi\d(Instantiate|Free(Inst)|GetVersion|GetTypesPlatform|SetDebugLogging|Setup|Enter(Init)|Exit(Init)|Terminate"
        r"|Reset|[GS]et(Real|Integer|Boolean|Float64|Int64)$|DoStep|Get(Real|Boolean)Status|\w*FMU[sS]tate"
        r"|Get(Directional|Adjoint)Der|(Enter(Event|Continuous)|CompletedI|NewDisc|UpdateDisc|SetTime|GetDerivatives"
        r"|GetEventI|GetNom|\w*ContinuousState|GetNumberOf(Ev|Con)))"
    )
    for name, arguments in declared(fmi).items():
        if supported.match(name):
            continue
        one.messages.clear()
        assert call_with_nothing(raw(one), name, arguments, instance) == ERROR, name
        assert one.messages == [
            f"{name}: not supported by this FMU; see the capability flags in modelDescription.xml"
        ]
        said += 1
    assert said == {2: 8, 3: 38}[fmi]


@both
def test_null_arrays_are_refused(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi)
    instance, dll = ctypes.c_void_p(one.slave.component), raw(one)
    names = (
        ("GetReal", "SetReal", "GetInteger", "SetBoolean")
        if fmi == 2
        else ("GetFloat64", "SetInt64", "GetBoolean")
    )
    for name in names:
        one.messages.clear()
        tail = (ctypes.c_size_t(2), None) + ((ctypes.c_size_t(2),) if fmi == 3 else ())
        assert getattr(dll, f"fmi{fmi}{name}")(instance, None, *tail) == ERROR
        assert one.messages == ["variables: got a null array, expected 2 elements"]


def test_number_of_values_must_match_in_fmi_3(plant: MakePlant) -> None:
    one = plant(3)
    references, values = (ctypes.c_uint32 * 2)(1, 2), (ctypes.c_double * 3)()
    instance, two, three = ctypes.c_void_p(one.slave.component), ctypes.c_size_t(2), ctypes.c_size_t(3)
    assert one.slave.dll.fmi3GetFloat64(instance, references, two, values, three) == ERROR
    assert one.messages == ["variables: got 3 values for 2 scalar variables"]


def test_scheduled_execution_cannot_be_instantiated(plant: MakePlant) -> None:
    dll = raw(plant(3))
    dll.fmi3InstantiateScheduledExecution.restype = ctypes.c_void_p
    token = build.present_token().encode()
    assert dll.fmi3InstantiateScheduledExecution(b"a", token, b"", False, False, *[None] * 5) is None


def test_model_exchange_asks_for_the_token_too(plant: MakePlant) -> None:
    dll = raw(plant(3))
    dll.fmi3InstantiateModelExchange.restype = ctypes.c_void_p
    assert dll.fmi3InstantiateModelExchange(b"a", b"b", b"", False, False, None, None) is None


def test_status_of_a_synchronous_fmi_2_component(plant: MakePlant) -> None:
    one = plant(2).initialise()
    one.step(0.0, 1e-3)
    dll, instance, real, flag = (
        one.slave.dll,
        ctypes.c_void_p(one.slave.component),
        ctypes.c_double(),
        ctypes.c_int(7),
    )
    assert dll.fmi2GetRealStatus(instance, 2, ctypes.byref(real)) == 0
    assert dll.fmi2GetBooleanStatus(instance, 3, ctypes.byref(flag)) == 0
    assert (real.value, flag.value) == (1e-3, 0)
    assert dll.fmi2GetRealStatus(instance, 0, ctypes.byref(real)) == 2  # discard


@both
def test_booleans_and_enumerations_read_back(plant: MakePlant, fmi: int) -> None:
    one = plant(fmi, drive_mode=DriveMode.FREE_ROLLING, forward_dynamics=True)
    integer = one.slave.getInteger if fmi == 2 else one.slave.getInt64
    assert list(integer([REFERENCES["drive_mode"]])) == [2]
    assert [bool(b) for b in one.slave.getBoolean([REFERENCES["forward_dynamics"]])] == [True]
    one.slave.setDebugLogging(True, [])
    assert one.messages == []
