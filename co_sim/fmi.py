"""FMUs for co-simulation behind one interface for FMI 2.0 and 3.0: the only file that uses fmpy.

What differs between the versions lies in `_Slave2` and `_Slave3`, chosen once for each FMU. In the
loop, C functions are called through ctypes with arguments prepared beforehand.
"""

from __future__ import annotations

import itertools
import zipfile
from abc import ABC, abstractmethod
from collections import deque
from contextlib import chdir, suppress
from ctypes import byref, c_bool, c_double, c_size_t, c_void_p
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

import fmpy
import numpy as np
from fmpy import fmi2, fmi3
from fmpy.model_description import read_model_description

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fmpy.model_description import ModelDescription, ModelVariable
    from numpy.typing import NDArray

    from co_sim.component import Vector

    Call = Callable[[], int]

__all__ = ["FmuError", "Slave", "read_description", "slave_type"]

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_WARNING, _FATAL = 1, 4
#: Log messages kept of each FMU: the last ones tell why it failed.
_MESSAGES = 5


class FmuError(Exception):
    """An FMU refused a call; the text has its status and its last log messages."""


class Slave(ABC):
    """An FMU unpacked and loaded, in terms that both versions of FMI share.

    Parameters
    ----------
    description : of the FMU.
    archive : the FMU.
    folder : empty and temporary, to unpack into; to be removed by the caller after `release`.
    """

    prefix: ClassVar[str]
    fmpy_class: ClassVar[Any]

    def __init__(self, description: ModelDescription, archive: Path, folder: str) -> None:
        fmpy.extract(archive, folder)
        # fmpy leaves the working directory changed if the library cannot be loaded.
        with chdir(Path.cwd()):
            self._fmu = self.fmpy_class(
                guid=description.guid,
                modelIdentifier=description.coSimulation.modelIdentifier,
                unzipDirectory=folder,
            )
        self._log: deque[str] = deque(maxlen=_MESSAGES)
        self._worst = 0
        self._initialised = False

    @staticmethod
    @abstractmethod
    def library(identifier: str) -> str:
        """Return the place of the shared library for this platform in the archive."""

    @abstractmethod
    def _instantiate(self) -> None:
        """Create the instance and collect its log messages."""

    @abstractmethod
    def set_parameter(self, variable: ModelVariable, value: float | int | bool | bytes) -> None:
        """Set a scalar of any type."""

    @abstractmethod
    def enter_initialisation(self, t0: float) -> None:
        """Enter initialisation mode for a run from `t0` (s)."""

    @abstractmethod
    def _transfer(self, direction: str, references: c_void_p, n: int, values: c_void_p) -> Call:
        """Return the call that gets or sets `n` floats and returns a status."""

    @abstractmethod
    def _stepper(self) -> Callable[[float, float], int]:
        """Return the call that advances from `t` by `h` and returns a status."""

    def instantiate(self) -> None:
        """Create the instance."""
        try:
            self._instantiate()
        except Exception as error:
            raise FmuError(f"{error}{self._last_words()}") from error

    def bind(self, inputs: Sequence[ModelVariable], outputs: Sequence[ModelVariable]) -> None:
        """Prepare the calls of the loop."""
        self._u, self._set_inputs = self._block("Set", inputs)
        self._y, self._get_outputs = self._block("Get", outputs)
        self._do_step = self._stepper()

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set the inputs and get the outputs."""
        self._u[:] = u
        self._check("setting the inputs", self._set_inputs())
        self._check("getting the outputs", self._get_outputs())
        y[:] = self._y

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance with the inputs held."""
        self._u[:] = u
        self._check("setting the inputs", self._set_inputs())
        if not self._initialised:
            self._call("ExitInitializationMode")
            self._initialised = True
        self._check("doStep", self._do_step(t, h))
        self._check("getting the outputs", self._get_outputs())
        y[:] = self._y

    def release(self) -> None:
        """Terminate, free and unload, as far as the standard allows in the present state."""
        if self._worst >= _FATAL:
            return  # Not even freeing is allowed then.
        try:
            if self._initialised and self._worst <= _WARNING:
                self._call("Terminate")
        finally:
            # fmpy's freeInstance unloads the library too.
            free = self._fmu.freeInstance if self._fmu.component else self._fmu.freeLibrary
            free()

    def _block(self, direction: str, variables: Sequence[ModelVariable]) -> tuple[Vector, Call]:
        """Return an array, and the call that sets the variables from it or gets them into it."""
        values = np.zeros(len(variables))
        if not variables:
            return values, lambda: 0
        references = np.array([variable.valueReference for variable in variables], dtype=np.uint32)
        transfer = self._transfer(direction, _address(references), len(variables), _address(values))
        return values, transfer

    def _function(self, name: str, *argument_types: type) -> Any:
        """Return a C function with argument types of its own; fmpy's declarations stay as they are."""
        function = self._fmu.dll[self.prefix + name]
        function.argtypes = argument_types
        return function

    def _call(self, name: str, *arguments: object) -> None:
        self._check(name, getattr(self._fmu.dll, self.prefix + name)(self._fmu.component, *arguments))

    def _check(self, action: str, status: int) -> None:
        if status > _WARNING:
            self._worst = max(self._worst, status)
            label = _STATUS[status] if status < len(_STATUS) else str(status)
            raise FmuError(f"{action} returned the status {label}{self._last_words()}")

    def _last_words(self) -> str:
        return f'; its log says "{" | ".join(self._log)}"' if self._log else ""


class _Slave2(Slave):
    """FMI 2.0."""

    prefix = "fmi2"
    fmpy_class = fmi2.FMU2Slave

    @staticmethod
    def library(identifier: str) -> str:
        return f"binaries/{fmpy.platform}/{identifier}{fmpy.sharedLibraryExtension}"

    def _instantiate(self) -> None:
        self._key = next(_KEYS)
        _LOGS[self._key] = self._log
        self._fmu.instantiate(callbacks=_callbacks2(self._key), loggingOn=True)

    def set_parameter(self, variable: ModelVariable, value: float | int | bool | bytes) -> None:
        name = "Integer" if variable.type == "Enumeration" else variable.type
        reference, c_value = (
            fmi2.fmi2ValueReference(variable.valueReference),
            getattr(fmi2, f"fmi2{name}")(value),
        )
        self._call(f"Set{name}", byref(reference), 1, byref(c_value))

    def enter_initialisation(self, t0: float) -> None:
        self._call("SetupExperiment", 0, 0.0, t0, 0, 0.0)
        self._call("EnterInitializationMode")

    def release(self) -> None:
        try:
            super().release()
        finally:
            _LOGS.pop(self._key, None)

    def _transfer(self, direction: str, references: c_void_p, n: int, values: c_void_p) -> Call:
        function = self._function(f"{direction}Real", c_void_p, c_void_p, c_size_t, c_void_p)
        return partial(function, c_void_p(self._fmu.component), references, c_size_t(n), values)

    def _stepper(self) -> Callable[[float, float], int]:
        function = self._function("DoStep", c_void_p, c_double, c_double, fmi2.fmi2Boolean)
        instance = c_void_p(self._fmu.component)
        never_back = fmi2.fmi2Boolean(1)
        return lambda t, h: cast("int", function(instance, t, h, never_back))


class _Slave3(Slave):
    """FMI 3.0."""

    prefix = "fmi3"
    fmpy_class = fmi3.FMU3Slave

    @staticmethod
    def library(identifier: str) -> str:
        return f"binaries/{fmpy.platform_tuple}/{identifier}{fmpy.sharedLibraryExtension}"

    def _instantiate(self) -> None:
        def log(environment: int | None, status: int, category: bytes, message: bytes | None) -> None:
            self._log.append(_text(message))

        self._fmu.instantiate(loggingOn=True, logMessage=log)

    def set_parameter(self, variable: ModelVariable, value: float | int | bool | bytes) -> None:
        name = "Int64" if variable.type == "Enumeration" else variable.type
        reference, c_value = (
            fmi3.fmi3ValueReference(variable.valueReference),
            getattr(fmi3, f"fmi3{name}")(value),
        )
        self._call(f"Set{name}", byref(reference), 1, byref(c_value), 1)

    def enter_initialisation(self, t0: float) -> None:
        self._call("EnterInitializationMode", False, 0.0, t0, False, 0.0)

    def _transfer(self, direction: str, references: c_void_p, n: int, values: c_void_p) -> Call:
        function = self._function(f"{direction}Float64", c_void_p, c_void_p, c_size_t, c_void_p, c_size_t)
        size = c_size_t(n)
        return partial(function, c_void_p(self._fmu.component), references, size, values, size)

    def _stepper(self) -> Callable[[float, float], int]:
        function = self._function("DoStep", c_void_p, c_double, c_double, c_bool, *[c_void_p] * 4)
        instance, never_back = c_void_p(self._fmu.component), c_bool(True)
        event, terminate, early = c_bool(), c_bool(), c_bool()
        last = c_double()
        results = byref(event), byref(terminate), byref(early), byref(last)

        def step(t: float, h: float) -> int:
            status: int = function(instance, t, h, never_back, *results)
            if terminate.value or early.value:
                raise FmuError(f"the FMU ended the simulation at t = {last.value:g} s{self._last_words()}")
            return status

        return step


#: FMI 2 log messages pass through a helper of fmpy that fills in their printf arguments. The helper
#: knows one receiver for the whole process, so that each FMU must be told by a key in its environment.
_LOGS: dict[int, deque[str]] = {}
_KEYS = itertools.count(1)


@fmi2.fmi2CallbackLoggerTYPE  # type: ignore[untyped-decorator]
def _log2(key: int | None, instance: bytes, status: int, category: bytes, message: bytes | None) -> None:
    if key in _LOGS:
        _LOGS[key].append(_text(message))


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


def _text(message: bytes | None) -> str:
    return (message or b"").decode(errors="replace").strip()


def _address(array: NDArray[Any]) -> c_void_p:
    """Return the address of an array; the pointer keeps the array alive."""
    return array.ctypes.data_as(c_void_p)


def read_description(path: Path) -> ModelDescription:
    """Return the description of the FMU at `path`, without unpacking the archive."""
    try:
        return read_model_description(path)
    except Exception as error:
        raise InputError(
            f"FMU {path}",
            got=" ".join(str(error).split()),
            expected="a valid FMU archive",
            remedy="check the path, then the archive with `fmpy validate`",
        ) from error


def slave_type(path: Path, description: ModelDescription) -> type[Slave]:
    """Return the adapter for an FMU that can be run here."""
    version = {2: _Slave2, 3: _Slave3}.get(description.fmiMajorVersion)
    if version is None or description.coSimulation is None:
        kind = "with" if description.coSimulation else "without"
        raise InputError(
            f"FMU {path}",
            got=f"FMI {description.fmiVersion} {kind} co-simulation",
            expected="FMI 2.0 or 3.0 for co-simulation",
            remedy="export the model again for co-simulation",
        )
    library = version.library(description.coSimulation.modelIdentifier)
    with zipfile.ZipFile(path) as archive:
        contained = archive.namelist()
    if library not in contained:
        raise InputError(
            f"FMU {path}",
            got=f"no {library}",
            expected="a library for this platform",
            remedy="build it for here",
        )
    return version
