"""FMUs behind one interface for FMI 2.0 and 3.0.

What differs between the versions lies in `_Slave2` and `_Slave3`, chosen once for each FMU. Compiled steps
(`co_sim.fmi_step`) call the C functions by their address.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections import deque
from contextlib import chdir, contextmanager, suppress
from ctypes import POINTER, addressof, byref, c_bool, c_char, c_double, c_size_t, c_uint8, c_uint32, c_void_p
from ctypes import cast as cast_pointer
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, ClassVar, cast

import fmpy
from fmpy import fmi2, fmi3

from co_sim.archives import contents
from co_sim.errors import InputError
from co_sim.fmi_values import write
from co_sim.witness import witness

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy as np
    from fmpy.model_description import ModelDescription, ModelVariable
    from numpy.typing import NDArray

    from co_sim.component import Kind, Vector

    _References = NDArray[np.uint32]

__all__ = ["FmuError", "Slave", "platforms_of", "require_library", "slave_type", "this_platform"]

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_OK, _WARNING, _ERROR, _FATAL, _PENDING = 0, 1, 3, 4, 5
#: Loading a library changes the working directory, which threads share.
_LOADING = Lock()
#: Log messages kept of each FMU: the last ones tell why it failed.
_MESSAGES = 5


class FmuError(Exception):
    """An FMU refused a call; the text has its status and its last log messages."""


class _Log:
    """The last log messages of an instance."""

    def __init__(self, instance: str) -> None:
        self._instance = instance
        self.messages: deque[str] = deque(maxlen=_MESSAGES)

    def add(self, status: int, message: str) -> None:
        """Keep a message, and tell it to the witness."""
        self.messages.append(message)
        witness().logs(self._instance, _label(status), message)


class Slave(ABC):
    """An FMU loaded, in terms that both versions of FMI share.

    Parameters
    ----------
    description : of the FMU.
    folder : with the unpacked archive; to be kept by the caller until `release`.
    name : of the instance, for its log; the model identifier if it is empty.
    """

    version: ClassVar[int]
    prefix: ClassVar[str]
    fmpy_class: ClassVar[Any]
    #: Names of the functions that the versions spell differently, after "Get", "Serialize" and so on.
    state: ClassVar[str]
    deserialise: ClassVar[str]
    #: Bytes of a state, and what `transfer` passes.
    _byte: ClassVar[Any]
    _arguments: ClassVar[Sequence[Any]]

    def __init__(self, description: ModelDescription, folder: str, name: str = "") -> None:
        interface = self.interface(description)
        #: What the FMU needs besides its library, for the words of an error.
        self._needs = _needs(interface, description)
        try:
            # fmpy leaves the working directory changed if the library cannot be loaded.
            with _LOADING, chdir(Path.cwd()):
                self._fmu = self.fmpy_class(
                    guid=description.guid,
                    modelIdentifier=interface.modelIdentifier,
                    unzipDirectory=folder,
                    instanceName=name or None,
                )
        except Exception as error:
            reason = str(error).replace(folder, "")
            raise FmuError(f"its library cannot be loaded: {reason}{self._needs}") from error
        self._log = _Log(self._fmu.instanceName)
        self._worst = 0
        self._states: set[int] = set()
        self._dropped: deque[int] = deque()
        self._owned: list[NDArray[np.int64]] = []
        #: Whether the initialisation is over.
        self.is_stepping = False
        #: Whether no earlier state will be restored, which an FMU may want to know in `do_step`.
        self.never_back = True

    @staticmethod
    def interface(description: ModelDescription) -> Any:
        """Return what the description says about the interface type that is used."""
        return description.coSimulation

    @staticmethod
    @abstractmethod
    def library(identifier: str) -> str:
        """Return the place of the shared library for this platform in the archive."""

    @abstractmethod
    def _instantiate(self) -> None:
        """Create the instance and collect its log messages."""

    @abstractmethod
    def enter_initialisation(self, t0: float, stop: float | None, tolerance: float | None) -> None:
        """Enter initialisation mode for a run from `t0` to `stop` (s); ``None`` is not defined."""

    @abstractmethod
    def transfer(self, function: Any, references: int, n: int, values: int, n_values: int) -> int:
        """Set or get `n` variables by the function for their type; return its status."""

    @abstractmethod
    def _do_step(self, t: float, h: float) -> int:
        """Advance from `t` by `h` and return a status."""

    @abstractmethod
    def derivative(self, unknowns: _References, knowns: _References, seed: Vector, result: Vector) -> None:
        """Write the directional derivatives of the unknowns into `result`."""

    def instantiate(self) -> None:
        """Create the instance."""
        try:
            with self._telling("Instantiate"):
                self._instantiate()
        except Exception as error:
            raise FmuError(f"{error}{self._last_words()}{self._needs}") from error

    @property
    def instance(self) -> int:
        """Pointer to the instance."""
        return cast("int", self._fmu.component)

    def configure(self, values: Iterable[tuple[ModelVariable, Kind, Sequence[Any]]]) -> None:
        """Set structural parameters."""
        self._call("EnterConfigurationMode")
        for value in values:
            self.set(*value)
        self._call("ExitConfigurationMode")

    def set(self, variable: ModelVariable, kind: Kind, values: Sequence[Any]) -> None:
        """Set the elements of a variable, texts as UTF-8."""
        name, buffer, address = write(self.version, kind, values)
        reference = c_uint32(variable.valueReference)
        function = self.function(f"Set{name}")
        with self._telling(f"Set{name}"):
            status = self.transfer(function, addressof(reference), 1, address, len(buffer))
        self.check(f"setting {variable.name}", status)

    def enter_steps(self) -> None:
        """End the initialisation."""
        self._call("ExitInitializationMode")
        self.is_stepping = True

    def do_step(self, t: float, h: float) -> None:
        """Advance from `t` by `h`."""
        self.check("doStep", self._do_step(t, h))

    def save(self) -> int:
        """Return a pointer to a copy of the state."""
        self._free_states()
        state = c_void_p()
        self._call(f"Get{self.state}", byref(state))
        pointer = cast("int", state.value)
        self._states.add(pointer)
        return pointer

    def restore(self, pointer: int, *, is_stepping: bool) -> None:
        """Return to a state; that is allowed after any failure but a fatal one."""
        self._free_states()
        self._call(f"Set{self.state}", c_void_p(pointer))
        self.is_stepping = is_stepping
        self._worst = 0

    def drop(self, pointer: int) -> None:
        """Have a state freed; any thread may do so, at any time, so that it happens later."""
        self._dropped.append(pointer)

    def own(self, kept: NDArray[np.int64]) -> None:
        """Free at the end the state whose pointer an array then has, if it has one."""
        self._owned.append(kept)

    def serialize(self, pointer: int) -> bytes:
        """Return a state as bytes."""
        size = c_size_t()
        self._call(f"Serialized{self.state}Size", c_void_p(pointer), byref(size))
        buffer = (c_char * size.value)()
        self._call(f"Serialize{self.state}", c_void_p(pointer), cast_pointer(buffer, self._byte), size)
        return buffer.raw

    def deserialize(self, data: bytes) -> int:
        """Return a pointer to the state from the bytes of `serialize`."""
        buffer, state = (c_char * len(data)).from_buffer_copy(data), c_void_p()
        arguments = cast_pointer(buffer, self._byte), c_size_t(len(data)), byref(state)
        self._call(self.deserialise, *arguments)
        pointer = cast("int", state.value)
        self._states.add(pointer)
        return pointer

    def release(self) -> None:
        """Terminate, free and unload, as far as the standard allows in the present state."""
        if self._worst >= _FATAL:
            return  # Not even freeing is allowed then.
        try:
            self._states.update(int(kept[0]) for kept in self._owned if kept[0])
            self._dropped.extend(self._states)
            if self._fmu.component:
                self._free_states()
            if self.is_stepping and self._worst <= _WARNING:
                self._call("Terminate")
        finally:
            # fmpy's freeInstance unloads the library too.
            free = self._fmu.freeInstance if self._fmu.component else self._fmu.freeLibrary
            with self._telling("FreeInstance"):
                free()

    def function(self, name: str) -> Any:
        """Return a C function that takes what `transfer` gives it; fmpy's declarations stay as they are."""
        function = self._fmu.dll[self.prefix + name]
        function.argtypes = self._arguments
        return function

    def address(self, name: str) -> int:
        """Return the address of a C function."""
        return cast("int", cast_pointer(self._fmu.dll[self.prefix + name], c_void_p).value)

    def check(self, action: str, status: int) -> None:
        """Raise if a call was refused."""
        if not _OK <= status <= _WARNING:
            raise self.refusal(action, status)

    def refusal(self, action: str, status: int) -> FmuError:
        """Return the error of a call that was refused, and take note of it."""
        self._worst = max(self._worst, status if 0 <= status < len(_STATUS) else _ERROR)
        hint = "; asynchronous FMUs are not supported" if status == _PENDING else ""
        return FmuError(f"{action} returned the status {_label(status)}{hint}{self._last_words()}")

    def ended(self, t: float) -> FmuError:
        """Return the error of an FMU that ended the simulation at `t` (s)."""
        return FmuError(f"the FMU ended the simulation at t = {t:g} s{self._last_words()}")

    def _free_states(self) -> None:
        while self._dropped:
            pointer = self._dropped.popleft()
            if pointer in self._states:
                self._states.remove(pointer)
                self._call(f"Free{self.state}", byref(c_void_p(pointer)))

    def _call(self, name: str, *arguments: object) -> None:
        if self._worst >= _FATAL:
            raise FmuError("after a fatal error no call is allowed")
        with self._telling(name):
            status = getattr(self._fmu.dll, self.prefix + name)(self._fmu.component, *arguments)
        self.check(name, status)

    @contextmanager
    def _telling(self, function: str) -> Iterator[None]:
        witness().calls(self.prefix + function)
        yield
        witness().calls("")

    def _last_words(self) -> str:
        return f'; its log says "{" | ".join(self._log.messages)}"' if self._log.messages else ""


class _Slave2(Slave):
    """FMI 2.0."""

    version = 2
    prefix = "fmi2"
    fmpy_class = fmi2.FMU2Slave
    state = "FMUstate"
    deserialise = "DeSerializeFMUstate"
    _byte = POINTER(c_char)
    _arguments = (c_void_p, c_void_p, c_size_t, c_void_p)

    @staticmethod
    def library(identifier: str) -> str:
        return f"binaries/{fmpy.platform}/{identifier}{fmpy.sharedLibraryExtension}"

    def _instantiate(self) -> None:
        self._key = next(_KEYS)
        _LOGS[self._key] = self._log
        self._fmu.instantiate(callbacks=_callbacks2(self._key), loggingOn=True)

    def enter_initialisation(self, t0: float, stop: float | None, tolerance: float | None) -> None:
        arguments = (*_defined(tolerance), c_double(t0), *_defined(stop))
        self._call("SetupExperiment", *arguments)
        self._call("EnterInitializationMode")

    def transfer(self, function: Any, references: int, n: int, values: int, n_values: int) -> int:
        return cast("int", function(self.instance, references, n, values))

    def _do_step(self, t: float, h: float) -> int:
        return cast("int", self._fmu.dll.fmi2DoStep(self.instance, t, h, self.never_back))

    def derivative(self, unknowns: _References, knowns: _References, seed: Vector, result: Vector) -> None:
        self._call(
            "GetDirectionalDerivative",
            _pointer(unknowns, c_uint32),
            len(unknowns),
            _pointer(knowns, c_uint32),
            len(knowns),
            _pointer(seed, c_double),
            _pointer(result, c_double),
        )

    def release(self) -> None:
        try:
            super().release()
        finally:
            _LOGS.pop(self._key, None)


class _Slave3(Slave):
    """FMI 3.0."""

    version = 3
    prefix = "fmi3"
    fmpy_class = fmi3.FMU3Slave
    state = "FMUState"
    deserialise = "DeserializeFMUState"
    _byte = POINTER(c_uint8)
    _arguments = (c_void_p, c_void_p, c_size_t, c_void_p, c_size_t)

    @staticmethod
    def library(identifier: str) -> str:
        return f"binaries/{fmpy.platform_tuple}/{identifier}{fmpy.sharedLibraryExtension}"

    def _instantiate(self) -> None:
        def log(environment: int | None, status: int, category: bytes, message: bytes | None) -> None:
            self._log.add(status, _text(message))

        self._fmu.instantiate(loggingOn=True, logMessage=log)

    def enter_initialisation(self, t0: float, stop: float | None, tolerance: float | None) -> None:
        arguments = (*_defined(tolerance), c_double(t0), *_defined(stop))
        self._call("EnterInitializationMode", *arguments)

    def transfer(self, function: Any, references: int, n: int, values: int, n_values: int) -> int:
        return cast("int", function(self.instance, references, n, values, n_values))

    def _do_step(self, t: float, h: float) -> int:
        event, terminate, early = c_bool(), c_bool(), c_bool()
        last = c_double()
        results = byref(event), byref(terminate), byref(early), byref(last)
        status = cast("int", self._fmu.dll.fmi3DoStep(self.instance, t, h, self.never_back, *results))
        if _OK <= status <= _WARNING and (terminate.value or early.value):
            raise self.ended(last.value)
        return status

    def derivative(self, unknowns: _References, knowns: _References, seed: Vector, result: Vector) -> None:
        self._call(
            "GetDirectionalDerivative",
            _pointer(unknowns, c_uint32),
            len(unknowns),
            _pointer(knowns, c_uint32),
            len(knowns),
            _pointer(seed, c_double),
            len(seed),
            _pointer(result, c_double),
            len(result),
        )


#: FMI 2 log messages pass through a helper of fmpy that fills in their printf arguments. The helper
#: knows one receiver for the whole process, so that each FMU must be told by a key in its environment.
_LOGS: dict[int, _Log] = {}
_KEYS = itertools.count(1)


@fmi2.fmi2CallbackLoggerTYPE  # type: ignore[untyped-decorator]
def _log2(key: int | None, instance: bytes, status: int, category: bytes, message: bytes | None) -> None:
    if key in _LOGS:
        _LOGS[key].add(status, _text(message))


def _callbacks2(key: int) -> Any:
    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _log2
    callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
    callbacks.componentEnvironment = key
    # fmpy has no helper for some platforms; messages then keep their printf fields.
    with suppress(ImportError, OSError):
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(byref(callbacks))
    return callbacks


def _label(status: int) -> str:
    return _STATUS[status] if 0 <= status < len(_STATUS) else f"{status}, which is none of FMI"


def _needs(interface: Any, description: ModelDescription) -> str:
    """Return a hint for an FMU that only passes calls on to its tool."""
    if not interface.needsExecutionTool:
        return ""
    tool = description.generationTool or "that which exported it"
    return f"; it declares that it needs its tool on this machine ({tool})"


def _text(message: bytes | None) -> str:
    return (message or b"").decode(errors="replace").strip()


def _defined(value: float | None) -> tuple[bool, c_double]:
    """Return whether there is a value, and the value: two arguments of a C function."""
    return value is not None, c_double(value or 0.0)


def _pointer(array: NDArray[Any], element: Any) -> Any:
    """Return a pointer to an array; it keeps the array alive."""
    return array.ctypes.data_as(POINTER(element))


def slave_type(path: Path, description: ModelDescription) -> type[Slave]:
    """Return the adapter for an FMU that can be run here."""
    version = {2: _Slave2, 3: _Slave3}.get(description.fmiMajorVersion)
    if version is None or description.coSimulation is None:
        kind = "with" if description.coSimulation else "without"
        integrable = version is not None and description.modelExchange is not None
        raise InputError(
            f"FMU {path}",
            got=f"FMI {description.fmiVersion} {kind} co-simulation",
            expected="FMI 2.0 or 3.0 for co-simulation",
            remedy="use ExchangeFmu" if integrable else "export the model again for co-simulation",
        )
    require_library(path, version.library(description.coSimulation.modelIdentifier))
    return version


def platforms_of(names: Iterable[str]) -> list[str]:
    """Return the platforms that an archive of these entries has libraries for."""
    return sorted(
        {name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1}
    )


def this_platform(version: int) -> str:
    """Return the name that a version of FMI has for this platform."""
    return cast("str", fmpy.platform if version == 2 else fmpy.platform_tuple)


def require_library(path: Path, library: str) -> None:
    """Refuse an FMU without the library for this platform."""
    contained = contents(path)
    if library not in contained:
        platforms = platforms_of(contained)
        has_sources = any(name.startswith("sources/") and name.endswith(".c") for name in contained)
        others = f" but for {', '.join(platforms)}" if platforms else ""
        raise InputError(
            f"FMU {path}",
            got=f"no {library}{others}",
            expected="a library for this platform",
            remedy="compile its sources for here" if has_sources else "have it exported for this platform",
        )
