"""The instance of a Model Exchange FMU, with its table for compiled code."""

from __future__ import annotations

import zipfile
from abc import abstractmethod
from ctypes import c_size_t, c_void_p
from ctypes import cast as cast_pointer
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from fmpy import fmi2, fmi3

from co_sim.errors import InputError
from co_sim.fmi import FmuError, Slave, _Slave2, _Slave3

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from fmpy.model_description import ModelDescription, ModelVariable
    from numpy.typing import ArrayLike, NDArray

    from co_sim.component import Vector

__all__ = ["METHODS", "Binding", "ExchangeModel", "model_type"]

#: Nodes and weights of explicit Runge-Kutta methods whose stages each use the slope of the one before only.
METHODS = {
    "euler": ((0.0,), (1.0,)),
    "midpoint": ((0.0, 0.5), (0.0, 1.0)),
    "rk4": ((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}
#: The worst status after which more than freeing the instance is allowed.
_DISCARD = 2


class Binding(NamedTuple):
    """What of the FMU is used, and how it is integrated."""

    inputs: Sequence[ModelVariable]
    outputs: Sequence[ModelVariable]
    is_smooth: Sequence[bool]  # for each input: may it change in continuous-time mode?
    substep: float  # s; 0 for the whole step
    method: str


class ExchangeModel(Slave):
    """An FMU for Model Exchange, unpacked and loaded, in terms that both versions of FMI share.

    Attributes
    ----------
    table : the instance as compiled code sees it; an array of the type `co_sim.exchange_calls.MODEL`.
    arrays : those that the table points to, by the names of its fields.
    """

    version: ClassVar[int]
    #: Names of the C functions without prefix, by the names that are used here for both versions.
    functions: ClassVar[dict[str, str]] = {
        "set_time": "SetTime",
        "set_states": "SetContinuousStates",
        "get_states": "GetContinuousStates",
        "get_indicators": "GetEventIndicators",
        "leave_initialisation": "ExitInitializationMode",
        "enter_event_mode": "EnterEventMode",
        "enter_continuous_mode": "EnterContinuousTimeMode",
        "complete_step": "CompletedIntegratorStep",
        "get_nominals": "GetNominalsOfContinuousStates",
    }
    table: NDArray[np.void]
    arrays: dict[str, NDArray[Any]]

    def __init__(self, description: ModelDescription, archive: Path, folder: str) -> None:
        super().__init__(description, archive, folder)
        self.description = description
        self.arrays = {}

    @staticmethod
    def _interface(description: ModelDescription) -> Any:
        return description.modelExchange

    def _sizes(self) -> tuple[int, int]:
        """Return the numbers of continuous states and of event indicators."""
        return self.description.numberOfContinuousStates, self.description.numberOfEventIndicators

    def tabulate(self, binding: Binding, t0: float) -> None:
        """Fill the table for compiled code."""
        from co_sim.exchange_calls import MODEL, Action

        self.table = np.zeros((), MODEL)
        self.table["time"] = t0
        self.table["version"] = self.version
        self.table["instance"] = self._fmu.component
        for action in Action:
            name = action.name.lower()
            function = self._fmu.dll[self.prefix + self.functions[name]]
            self.table[name] = cast_pointer(function, c_void_p).value
        self.table["completes_steps"] = self.description.modelExchange.needsCompletedIntegratorStep
        self.table["never_back"] = not self.description.modelExchange.canGetAndSetFMUstate
        self._place_method(binding)
        self._place_ports(binding)

    def _place_method(self, binding: Binding) -> None:
        nodes, weights = METHODS[binding.method]
        self._place("nodes", nodes, "n_stages")
        self._place("weights", weights)
        n_states, n_indicators = self._sizes()
        for name in ("x", "x_new", "x_stage", "derivatives"):
            self._place(name, np.zeros(n_states), "n_states")
        for name in ("z", "z_new", "z_low", "z_high"):
            self._place(name, np.zeros(n_indicators), "n_indicators")
        self._place("flags", np.zeros(4))
        self.table["substep"] = binding.substep
        self.table["next_event"] = np.inf

    def _place_ports(self, binding: Binding) -> None:
        references = np.array([v.valueReference for v in binding.inputs], dtype=np.uint32)
        is_smooth = np.array(binding.is_smooth, dtype=bool)
        self.table["n_inputs"] = len(references)
        for name, chosen in (("smooth", is_smooth), ("discrete", ~is_smooth)):
            self._place(name, np.flatnonzero(chosen).astype(np.int64), f"n_{name}")
            self._place(f"{name}_references", references[chosen])
            self._place(f"{name}_values", np.zeros(chosen.sum()))
        outputs = np.array([v.valueReference for v in binding.outputs], dtype=np.uint32)
        self._place("output_references", outputs, "n_outputs")

    def _place(self, name: str, values: ArrayLike, size: str | None = None) -> None:
        """Keep an array and enter its address, and its size where a field of the table is named for it."""
        array = np.ascontiguousarray(values)
        self.arrays[name] = array
        self.table[name] = array.ctypes.data
        if size is not None:
            self.table[size] = array.size

    @property
    def is_usable(self) -> bool:
        """Whether no call returned a status after which the standard forbids all but freeing."""
        return self._worst_status() <= _DISCARD

    def recover(self) -> None:
        """Go on after a failure, since a sound state has been restored."""
        self.table["failure"] = self.table["terminates"] = self._worst = 0

    def call(self, function: str, *arguments: object) -> None:
        """Call a C function, given by its key in `functions`, with values of ctypes."""
        name = self.functions[function]
        c_function = self._fmu.dll[self.prefix + name]
        self._check(name, c_function(c_void_p(self._fmu.component), *arguments))

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set all inputs and get the outputs in initialisation mode."""
        for name in ("smooth", "discrete"):
            values = self.arrays[f"{name}_values"]
            values[:] = u[self.arrays[name]]
            self.transfer("set_floats", self.arrays[f"{name}_references"], values)
        self.transfer("get_floats", self.arrays["output_references"], y)

    def transfer(self, function: str, references: NDArray[np.uint32], values: Vector) -> None:
        """Set or get variables."""
        if values.size:
            arguments = c_void_p(references.ctypes.data), c_size_t(references.size)
            self.call(function, *arguments, *self.counted(values))

    @abstractmethod
    def counted(self, values: Vector) -> tuple[object, ...]:
        """Return values of variables as arguments: in FMI 3 their number follows."""

    def failure(self, status: int) -> FmuError:
        """Return the error for what a step of machine code returned."""
        from co_sim.exchange_calls import OWN_FAILURES, Action, Failure
        from co_sim.exchange_step import MAX_EVENTS, MAX_ITERATIONS

        t = f"t = {float(self.table['time']):.12g} s"
        if status >= OWN_FAILURES:
            action, fmi_status = divmod(status, OWN_FAILURES)
            name = self.prefix + self.functions[Action(action).name.lower()]
            try:
                self._check(f"{name}, in integrating from {t},", fmi_status)
            except FmuError as error:
                return error
        texts = {
            Failure.TERMINATED: f"the FMU ended the simulation at {t}",
            Failure.UNSETTLED: f"the event at {t} did not settle in {MAX_ITERATIONS} iterations",
            Failure.CHATTERING: f"more than {MAX_EVENTS} events in one step, the last at {t}: they follow"
            " each other ever faster, or an indicator returns to zero after each",
        }
        return FmuError(texts[Failure(status)] + self._last_words())

    def release(self) -> None:
        """Terminate, free and unload, as far as the standard allows."""
        if self.arrays:
            self._worst = self._worst_status()
            self._initialised = bool(self.table["running"])
        super().release()

    def _worst_status(self) -> int:
        from co_sim.exchange_calls import OWN_FAILURES

        action, status = divmod(int(self.table["failure"]), OWN_FAILURES) if self.arrays else (0, 0)
        return max(self._worst, status if action else 0)


class Model2(ExchangeModel, _Slave2):
    """FMI 2.0."""

    version = 2
    fmpy_class = fmi2.FMU2Model
    functions: ClassVar[dict[str, str]] = ExchangeModel.functions | {
        "get_derivatives": "GetDerivatives",
        "set_floats": "SetReal",
        "get_floats": "GetReal",
        "update": "NewDiscreteStates",
        "get_state": "GetFMUstate",
        "set_state": "SetFMUstate",
        "free_state": "FreeFMUstate",
        "state_size": "SerializedFMUstateSize",
        "write_state": "SerializeFMUstate",
        "read_state": "DeSerializeFMUstate",
        "get_directional": "GetDirectionalDerivative",
    }

    def counted(self, values: Vector) -> tuple[object, ...]:
        """Return values of variables as arguments: the number of references says how many."""
        return (c_void_p(values.ctypes.data),)


class Model3(ExchangeModel, _Slave3):
    """FMI 3.0."""

    version = 3
    fmpy_class = fmi3.FMU3Model
    functions: ClassVar[dict[str, str]] = ExchangeModel.functions | {
        "get_derivatives": "GetContinuousStateDerivatives",
        "set_floats": "SetFloat64",
        "get_floats": "GetFloat64",
        "update": "UpdateDiscreteStates",
        "get_state": "GetFMUState",
        "set_state": "SetFMUState",
        "free_state": "FreeFMUState",
        "state_size": "SerializedFMUStateSize",
        "write_state": "SerializeFMUState",
        "read_state": "DeserializeFMUState",
        "get_directional": "GetDirectionalDerivative",
    }

    def counted(self, values: Vector) -> tuple[object, ...]:
        """Return values of variables as arguments, with their number."""
        return c_void_p(values.ctypes.data), c_size_t(values.size)

    def _sizes(self) -> tuple[int, int]:
        # The sizes of arrays may depend on parameters.
        return self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators()


def model_type(path: Path, description: ModelDescription) -> type[ExchangeModel]:
    """Return the adapter for an FMU that can be run here."""
    version = {2: Model2, 3: Model3}.get(description.fmiMajorVersion)
    if version is None or description.modelExchange is None:
        kind = "with" if description.modelExchange else "without"
        raise InputError(
            f"FMU {path}",
            got=f"FMI {description.fmiVersion} {kind} Model Exchange",
            expected="FMI 2.0 or 3.0 for Model Exchange",
            remedy="use FmuComponent if it is for co-simulation, else export the model again",
        )
    library = version.library(description.modelExchange.modelIdentifier)
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
