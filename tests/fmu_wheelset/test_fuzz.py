"""Random legal and illegal calls of the FMU's C interface, which must obey the laws of every call.

The functions are called through ctypes, not through fmpy, so that nothing stands between a wrong call and the
FMU. `FUZZ_EXAMPLES` sets the number of examples of each interface of each standard.
"""

from __future__ import annotations

import ctypes
import faulthandler
import math
import os
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fmu_wheelset import build
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from fmpy.model_description import ModelDescription

# Each example runs its calls three times over.
EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "60"))
OK, WARNING, DISCARD, ERROR, FATAL = range(5)
N_STATES = sum(v.is_state for v in VARIABLES)
REALS = [i for i, v in enumerate(VARIABLES) if v.kind == "Float64"]
SETTABLE = [i for i in REALS if VARIABLES[i].start is not None]
COMPUTED = [i for i in REALS if VARIABLES[i].start is None and VARIABLES[i].name != "time"]
KNOWN = [i for i in REALS if VARIABLES[i].causality == "input" or VARIABLES[i].is_state]
UNKNOWN = [len(VARIABLES), 2**32 - 1]

Call = tuple[Any, ...]


@dataclass(frozen=True)
class Result:
    """What a call gave back: its status, the numbers it wrote, and what it logged."""

    call: Call
    status: int
    values: tuple[float, ...] = ()
    messages: tuple[tuple[int, str], ...] = ()

    @property
    def bits(self) -> tuple[object, ...]:
        """All of it in a form in which NaN equals itself and -0 is not 0."""
        return self.call[0], self.status, tuple(v.hex() for v in self.values), self.messages

    @property
    def refused(self) -> bool:
        """Whether the call may leave no trace: all that are not OK, but for a step without solution."""
        return self.status != OK and not any("cannot be integrated" in text for _, text in self.messages)


# The interface ---------------------------------------------------------------------------------------


def doubles(values: Sequence[float]) -> Any:
    return (ctypes.c_double * len(values))(*values)


def references(values: Sequence[int]) -> Any:
    return (ctypes.c_uint32 * len(values))(*values)


size = ctypes.c_size_t
real = ctypes.c_double


class Fmi2Callbacks(ctypes.Structure):
    Logger = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, ctypes.c_int, *[ctypes.c_char_p] * 2)
    _fields_ = (("logger", Logger), ("others", ctypes.c_void_p * 4))


Fmi3Logger = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, *[ctypes.c_char_p] * 2)


@dataclass
class Fuzzed:
    """An instance that performs calls given as data; each method named like a call returns what it wrote."""

    library: ctypes.CDLL
    fmi: int
    exchange: bool
    handle: ctypes.c_void_p = field(default_factory=ctypes.c_void_p)
    logged: list[tuple[int, str]] = field(default_factory=list)
    status: int = OK

    def __post_init__(self) -> None:
        self.slots = [ctypes.c_void_p(), ctypes.c_void_p()]
        self._logger: Any
        if self.fmi == 2:
            self._logger = Fmi2Callbacks.Logger(lambda _e, _n, s, _c, text: self._log(s, text))
            self._callbacks = Fmi2Callbacks(self._logger)
        else:
            self._logger = Fmi3Logger(lambda _e, s, _c, text: self._log(s, text))

    def _log(self, status: int, text: bytes) -> None:
        self.logged.append((status, text.decode()))

    def _do(self, name: str, *arguments: Any) -> None:
        if self.status == OK:  # the second function of a call runs only if the first went well
            self.status = getattr(self.library, f"fmi{self.fmi}{name}")(self.handle, *arguments)

    def instantiate(self, token: str) -> bool:
        start = self.library[f"fmi{self.fmi}Instantiate{self._kind}"]
        start.restype = ctypes.c_void_p
        if self.fmi == 2:
            kind = ctypes.c_int(0 if self.exchange else 1)
            made = start(b"a", kind, token.encode(), b"", ctypes.byref(self._callbacks), 0, 0)
        else:
            unused = () if self.exchange else (False, False, None, size(0))
            rest = () if self.exchange else (None,)
            made = start(b"a", token.encode(), b"", False, False, *unused, None, self._logger, *rest)
        self.handle = ctypes.c_void_p(made)
        return bool(made)

    @property
    def _kind(self) -> str:
        return "" if self.fmi == 2 else "ModelExchange" if self.exchange else "CoSimulation"

    def free(self) -> None:
        for slot in range(len(self.slots)):
            self.perform(("forget", slot))
        getattr(self.library, f"fmi{self.fmi}FreeInstance")(self.handle)

    def perform(self, call: Call) -> Result:
        self.logged.clear()
        self.status = OK
        name, *arguments = call
        values = getattr(self, name)(*arguments) or ()
        return Result(call, self.status, tuple(values), tuple(self.logged))

    # Life cycle

    def begin(self, start: float, stop: float | None) -> None:
        times = real(start), int(stop is not None), real(stop or 0.0)
        if self.fmi == 2:
            self._do("SetupExperiment", 0, real(0.0), *times)
            self._do("EnterInitializationMode")
        else:
            self._do("EnterInitializationMode", False, real(0.0), *times)

    def enter(self) -> None:
        """Without times, which FMI 2 allows."""
        self._do(
            "EnterInitializationMode",
            *((False, real(0.0), real(0.0), False, real(0.0)) if self.fmi == 3 else ()),
        )

    def plain(self, name: str) -> None:
        """A function that takes the instance only."""
        self._do(name)

    def step(self, late: float, duration: float) -> None:
        point = real(self._now() + late)
        reached = [ctypes.byref(ctypes.c_bool()) for _ in range(3)] + [ctypes.byref(real())]
        self._do("DoStep", point, real(duration), 1, *(reached if self.fmi == 3 else ()))

    def _now(self) -> float:
        value = real()
        counts = (size(1),) if self.fmi == 3 else ()
        read = getattr(self.library, f"fmi{self.fmi}Get{'Real' if self.fmi == 2 else 'Float64'}")
        assert (
            read(self.handle, references([REFERENCES["time"]]), size(1), ctypes.byref(value), *counts) == OK
        )
        return value.value

    # Variables

    def access(self, verb: str, kind: str, where: Sequence[int], given: Sequence[float], surplus: int) -> Any:
        """Get or set; `surplus` wrongly counted values in FMI 3, -1 for a null array."""
        names = {
            "Float64": ("Real", "Float64"),
            "Enumeration": ("Integer", "Int64"),
            "Boolean": ("Boolean",) * 2,
        }
        types = {
            "Float64": (real, real),
            "Enumeration": (ctypes.c_int, ctypes.c_int64),
            "Boolean": (ctypes.c_int, ctypes.c_bool),
        }
        chosen = types[kind][self.fmi - 2]
        array: Any = (chosen * (len(where) + 1))()
        for i, value in enumerate(given[: len(where)]):
            array[i] = value if kind == "Float64" else whole(value)
        counts = (size(len(where) + max(surplus, 0)),) if self.fmi == 3 else ()
        passed = None if surplus < 0 else array
        self._do(f"{verb}{names[kind][self.fmi - 2]}", references(where), size(len(where)), passed, *counts)
        return [float(v) for v in array[: len(where)]] if verb == "Get" and self.status == OK else ()

    # States of the FMU

    @property
    def _word(self) -> str:
        return "FMUstate" if self.fmi == 2 else "FMUState"

    def remember(self, slot: int) -> None:
        self._do(f"Get{self._word}", ctypes.byref(self.slots[slot]))

    def restore(self, slot: int) -> None:
        self._do(f"Set{self._word}", self.slots[slot])

    def forget(self, slot: int) -> None:
        self._do(f"Free{self._word}", ctypes.byref(self.slots[slot]))

    def copy(self, slot: int, damaged: int | None, missing: int) -> None:
        """Through bytes into the same slot, with one byte damaged or the last ones missing."""
        needed = size()
        self._do(f"Serialized{self._word}Size", self.slots[slot], ctypes.byref(needed))
        data = ctypes.create_string_buffer(needed.value + 1)
        self._do(f"Serialize{self._word}", self.slots[slot], data, needed)
        if damaged is not None and needed.value:
            data[damaged % needed.value] = bytes([data[damaged % needed.value][0] ^ 0x40])
        read = f"{'DeSerialize' if self.fmi == 2 else 'Deserialize'}{self._word}"
        self._do(read, data, size(max(needed.value - missing, 0)), ctypes.byref(self.slots[slot]))

    # Derivatives and model exchange

    def sensitivity(
        self, adjoint: bool, rows: Sequence[int], columns: Sequence[int], seed: float, surplus: int
    ) -> Any:
        name = "GetAdjointDerivative" if adjoint and self.fmi == 3 else "GetDirectionalDerivative"
        n_seed, n = (len(rows), len(columns)) if "Adjoint" in name else (len(columns), len(rows))
        found = doubles([0.0] * (n + 1))
        seeds: tuple[Any, ...] = (doubles([seed] * n_seed),)
        given = (*seeds, size(n_seed + surplus), found, size(n)) if self.fmi == 3 else (*seeds, found)
        self._do(name, references(rows), size(len(rows)), references(columns), size(len(columns)), *given)
        return found[:n] if self.status == OK else ()

    def vector(self, what: str, n: int) -> Any:
        """Read states, their derivatives, nominals, or event indicators."""
        short = {"ContinuousStateDerivatives": "Derivatives"} if self.fmi == 2 else {}
        found = doubles([0.0] * max(n, 1))
        self._do(f"Get{short.get(what, what)}", found, size(n))
        return found[:n] if self.status == OK else ()

    def move(self, values: Sequence[float]) -> None:
        self._do("SetContinuousStates", doubles(values), size(len(values)))

    def at(self, time: float) -> None:
        self._do("SetTime", real(time))

    def discrete(self) -> None:
        if self.fmi == 2:
            self._do("NewDiscreteStates", None)
        else:
            self._do("UpdateDiscreteStates", *[None] * 6)

    def completed(self) -> None:
        self._do("CompletedIntegratorStep", 1, None, None)


def whole(value: float) -> int:
    return max(-(2**31), min(2**31 - 1, int(value))) if math.isfinite(value) else 0


# Random calls ----------------------------------------------------------------------------------------

EXTREME = [
    0.0,
    -0.0,
    5e-324,
    1e-300,
    1e-12,
    -1.0,
    1e12,
    1e300,
    -1e300,
    sys.float_info.max,
    math.inf,
    math.nan,
]
numbers = st.sampled_from(EXTREME) | st.floats(-1e4, 1e4)
any_reference = st.sampled_from([*range(len(VARIABLES)), *UNKNOWN])
real_reference = st.sampled_from(REALS)
surplus = st.sampled_from([0, 0, 0, 1, -1])


def few(elements: st.SearchStrategy[Any], most: int = 4) -> st.SearchStrategy[list[Any]]:
    return st.lists(elements, max_size=most)


def mostly(right: list[int]) -> st.SearchStrategy[list[int]]:
    """References of which in most cases all are right."""
    some = st.lists(st.sampled_from(right), min_size=1, max_size=4)
    return st.one_of(some, some, some, few(any_reference))


@st.composite
def settings_of_one(draw: st.DrawFn) -> Call:
    """Set one variable, most often to something sensible."""
    reference = draw(st.sampled_from(SETTABLE))
    start = VARIABLES[reference].start or 0.0
    size = abs(start) or VARIABLES[reference].nominal or 1.0
    value = draw(st.floats(-1.0, 1.0).map(lambda f: start + f * size / 2) | st.sampled_from(EXTREME))
    return ("access", "Set", "Float64", [reference], [value], 0)


def chosen(name: str, value: int) -> Call:
    kind = VARIABLES[REFERENCES[name]].kind
    return ("access", "Set", kind, [REFERENCES[name]], [value], 0)


@st.composite
def half_wrong(draw: st.DrawFn) -> Call:
    """Values that can be set, and behind them one that cannot."""
    name, right, wrong = draw(
        st.sampled_from(
            [
                ("m_w", 900.0, math.nan),
                ("speed", 7.0, math.inf),
                ("drive_mode", 2.0, 4.0),
                ("forward_dynamics", 1.0, 2.0),
            ]
        )
    )
    where = [REFERENCES[name]] * 2
    if draw(st.booleans()):
        return ("access", "Set", VARIABLES[where[0]].kind, where, [right, wrong], 0)
    return ("access", "Set", VARIABLES[where[0]].kind, [where[0], UNKNOWN[0]], [right, right], 0)


#: Allowed each, and together beyond what a double holds.
absurd = st.sampled_from(
    [
        ("r0", 5e-324),
        ("m_w", 1e-300),
        ("m_w", 1e300),
        ("I_R", 1e-300),
        ("v0", 1e-300),
        ("speed", 1e300),
        ("speed", 1e-12),
        ("normal_load_left", 1e-300),
        ("curve_force", 1e300),
        ("patch.G", 1e300),
    ]
).map(lambda pair: ("access", "Set", "Float64", [REFERENCES[pair[0]]], [pair[1]], 0))
options = st.sampled_from(
    [chosen("drive_mode", mode) for mode in DriveMode] + [chosen("forward_dynamics", flag) for flag in (0, 1)]
)
begins = st.builds(
    lambda t, s: ("begin", t, s),
    st.sampled_from([0.0, 0.0, -5.0, 1e9, *EXTREME]),
    st.sampled_from([None, None, 10.0, 1e10, math.inf, math.nan]),
)
steps = st.builds(
    lambda late, h: ("step", late, h),
    st.sampled_from([0.0] * 8 + [1e-3, -1.0, math.nan, math.inf]),
    st.sampled_from([1e-3] * 6 + [1e-9, 0.3, 3600.0, *EXTREME]),
)
lives = st.builds(
    lambda name: ("plain", name),
    st.sampled_from(
        ["ExitInitializationMode", "Terminate", "Reset", "EnterEventMode"] + ["EnterContinuousTimeMode"] * 2
    ),
)


@st.composite
def accesses(draw: st.DrawFn) -> Call:
    """Variables of any number, most often of the right kind and with as many values."""
    kind = draw(st.sampled_from(["Float64", "Float64", "Enumeration", "Boolean"]))
    right = st.sampled_from([i for i, v in enumerate(VARIABLES) if v.kind == kind])
    where = draw(few(right) | few(any_reference))
    given = draw(st.lists(st.integers(-1, 4).map(float) | numbers, min_size=len(where), max_size=len(where)))
    return ("access", draw(st.sampled_from(["Get", "Set"])), kind, where, given, draw(surplus))


reads = st.builds(lambda where: ("access", "Get", "Float64", where, (), 0), few(real_reference, 8))
slots = st.integers(0, 1)
memories = st.one_of(
    st.builds(lambda verb, slot: (verb, slot), st.sampled_from(["remember", "restore", "forget"]), slots),
    st.builds(
        lambda *a: ("copy", *a), slots, st.none() | st.integers(0, 5000), st.sampled_from([0, 0, 1, 64])
    ),
)
sensitivities = st.builds(
    lambda *a: ("sensitivity", *a),
    st.booleans(),
    mostly(COMPUTED),
    mostly(KNOWN),
    st.sampled_from([1.0, 1e300, math.inf, math.nan]) | numbers,
    st.sampled_from([0, 0, 0, 1]),
)
lengths = st.sampled_from([N_STATES] * 6 + [0, 1, N_STATES + 1])
exchanges = st.one_of(
    st.builds(
        lambda what, n: ("vector", what, n),
        st.sampled_from(
            [
                "ContinuousStates",
                "ContinuousStateDerivatives",
                "NominalsOfContinuousStates",
                "EventIndicators",
            ]
        ),
        lengths,
    ),
    st.builds(
        lambda x: ("move", x),
        lengths.flatmap(lambda n: st.lists(st.floats(-1.0, 1.0) | numbers, min_size=n, max_size=n)),
    ),
    st.builds(lambda t: ("at", t), numbers),
    st.sampled_from([("discrete",), ("completed",), ("plain", "EnterContinuousTimeMode")]),
)

anything = [
    st.just(("enter",)),
    half_wrong(),
    settings_of_one(),
    options,
    begins,
    lives,
    accesses(),
    reads,
    memories,
    sensitivities,
    exchanges,
]


def sequences(exchange: bool) -> st.SearchStrategy[list[Call]]:
    """Calls before a run, the way into it in most cases, and calls within and after it."""
    running = [
        *anything,
        sensitivities,
        absurd,
        *([exchanges] * 4 if exchange else [steps] * 4),
        settings_of_one(),
        reads,
    ]
    into: list[Call] = [("begin", 0.0, None), ("plain", "ExitInitializationMode")]
    into += [("plain", "EnterContinuousTimeMode")] if exchange else [("step", 0.0, 1e-3)]
    way = st.sampled_from([into, into, into, into[:1], []])
    before = few(settings_of_one() | options | half_wrong() | absurd, 3) | few(st.one_of(anything), 3)
    run = st.lists(st.one_of(running), min_size=4, max_size=24)
    return st.builds(lambda *parts: [call for part in parts for call in part], before, way, run)


EVERYTHING = [("access", "Get", v.kind, [i], (), 0) for i, v in enumerate(VARIABLES)]

# Laws ------------------------------------------------------------------------------------------------


def lawful(result: Result) -> None:
    """What holds for every call of the interface."""
    assert result.status in {OK, DISCARD, ERROR}, result
    if result.status == OK:
        assert result.messages == (), result
        assert all(map(math.isfinite, result.values)), result
    else:
        assert [status for status, _ in result.messages] == [result.status], result
        text = result.messages[0][1]
        assert len(text) > 20, result
        assert text.isprintable(), result


def behaviour(one: Fuzzed) -> list[tuple[object, ...]]:
    """A short legal run from the first call on."""
    calls: list[Call] = [chosen("drive_mode", DriveMode.TORQUE_DRIVEN), chosen("forward_dynamics", 1)]
    for name, value in {"lateral_displacement": 1e-3, "traction_torque": 4e3}.items():
        calls.append(("access", "Set", "Float64", [REFERENCES[name]], [value], 0))
    calls += [("begin", 0.0, None), ("plain", "ExitInitializationMode")]
    calls += [("plain", "EnterContinuousTimeMode")] if one.exchange else [("step", 0.0, 1e-3)] * 3
    calls.append(("access", "Get", "Float64", REALS, (), 0))
    results = [one.perform(call) for call in calls]
    assert all(result.status == OK for result in results)
    return [result.bits for result in results]


@pytest.fixture(autouse=True)
def watched() -> Iterator[None]:
    """A hang ends the run with a traceback, as no exception could end it."""
    faulthandler.dump_traceback_later(120 + EXAMPLES, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="module")
def libraries(extracted: dict[int, tuple[Path, ModelDescription]]) -> dict[int, ctypes.CDLL]:
    platforms = {2: "linux64", 3: "x86_64-linux"}
    return {
        fmi: ctypes.CDLL(str(next((folder / "binaries" / platforms[fmi]).glob("*.so"))))
        for fmi, (folder, _) in extracted.items()
    }


@pytest.fixture
def instance(libraries: dict[int, ctypes.CDLL]) -> Callable[[int, bool], Fuzzed]:
    def make(fmi: int, exchange: bool) -> Fuzzed:
        one = Fuzzed(libraries[fmi], fmi, exchange)
        assert one.instantiate(build.present_token())
        return one

    return make


BITS = {"NaN": "7ff8000000000000", "-1": "bff0000000000000"}
TAILS = [
    "",
    "[",
    "[]",
    "[0=0]",
    "[1=3ff0000000000000,]",
    *(f"[{REFERENCES['m_w']}={b}]" for b in BITS.values()),
]
TOKENS = st.sampled_from(TAILS) | st.text("[]={},019af", max_size=40)

fuzzed = settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
interfaces = [(fmi, exchange) for fmi in (2, 3) for exchange in (False, True)]


@pytest.mark.parametrize(("fmi", "exchange"), interfaces)
def test_random_calls_obey_the_laws(
    instance: Callable[[int, bool], Fuzzed], fmi: int, exchange: bool
) -> None:
    fresh = instance(fmi, exchange)
    of_fresh = behaviour(fresh)
    fresh.free()

    def run(calls: list[Call]) -> list[Result]:
        one = instance(fmi, exchange)
        results = [one.perform(call) for call in [*calls, *EVERYTHING]]
        assert one.perform(("plain", "Reset")).status == OK
        assert behaviour(one) == of_fresh
        one.free()
        return results

    @fuzzed
    @given(sequences(exchange))
    def check(calls: list[Call]) -> None:
        results = run(calls)
        for result in results:
            lawful(result)
        assert [r.bits for r in run(calls)] == [r.bits for r in results]
        accepted = [r for r in results[: len(calls)] if not r.refused]
        expected = [*accepted, *results[len(calls) :]]
        assert [r.bits for r in run([r.call for r in accepted])] == [r.bits for r in expected]

    check()


@pytest.mark.parametrize(("fmi", "exchange"), interfaces)
def test_a_wrong_token_gives_one_message(libraries: dict[int, ctypes.CDLL], fmi: int, exchange: bool) -> None:
    @fuzzed
    @given(TOKENS, st.booleans())
    def check(tail: str, whole: bool) -> None:
        one = Fuzzed(libraries[fmi], fmi, exchange)
        made = one.instantiate((build.present_token() if whole else "") + tail)
        assert len(one.logged) == (0 if made else 1), one.logged
        one.free()

    check()
