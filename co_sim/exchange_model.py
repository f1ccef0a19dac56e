"""Model Exchange FMUs behind one interface for FMI 2.0 and 3.0."""

from __future__ import annotations

from ctypes import c_size_t, c_void_p
from typing import TYPE_CHECKING, Any, ClassVar

from fmpy import fmi2, fmi3

from co_sim.errors import InputError
from co_sim.fmi import Slave, _Slave2, _Slave3, require_library

if TYPE_CHECKING:
    from pathlib import Path

    from fmpy.model_description import ModelDescription

    from co_sim.component import Vector

__all__ = ["ExchangeModel", "model_type"]


class ExchangeModel(Slave):
    """A loaded FMU for Model Exchange."""

    #: Names of the C functions without prefix, by the names that are used here for both versions.
    functions: ClassVar[dict[str, str]] = {
        "set_time": "SetTime",
        "set_states": "SetContinuousStates",
        "get_states": "GetContinuousStates",
        "get_indicators": "GetEventIndicators",
        "get_nominals": "GetNominalsOfContinuousStates",
        "leave_initialisation": "ExitInitializationMode",
        "enter_event_mode": "EnterEventMode",
        "enter_continuous_mode": "EnterContinuousTimeMode",
        "complete_step": "CompletedIntegratorStep",
    }

    def __init__(self, description: ModelDescription, folder: str, name: str = "") -> None:
        super().__init__(description, folder, name)
        self._description = description

    @staticmethod
    def interface(description: ModelDescription) -> Any:
        """Return what the description says about Model Exchange."""
        return description.modelExchange

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of continuous states and of event indicators."""
        return self._description.numberOfContinuousStates, self._description.numberOfEventIndicators

    @property
    def completes_steps(self) -> bool:
        """Whether the FMU wants to be told of the end of each substep."""
        return bool(self._description.modelExchange.needsCompletedIntegratorStep)

    def address(self, name: str) -> int:
        """Return the address of a C function; there is no `DoStep`."""
        return 0 if name == "DoStep" else super().address(name)

    def name_of(self, function: str) -> str:
        """Return the full name of a function of `functions`."""
        return self.prefix + self.functions[function]

    def transfer_array(self, function: str, values: Vector) -> Vector:
        """Set or get all states, derivatives or nominal values; return the array."""
        if values.size:
            call = self._fmu.dll[self.name_of(function)]
            call.argtypes = (c_void_p, c_void_p, c_size_t)
            self.check(self.name_of(function), call(self.instance, values.ctypes.data, values.size))
        return values


class _Model2(ExchangeModel, _Slave2):
    """FMI 2.0."""

    fmpy_class = fmi2.FMU2Model
    functions: ClassVar[dict[str, str]] = ExchangeModel.functions | {
        "get_derivatives": "GetDerivatives",
        "set_floats": "SetReal",
        "get_floats": "GetReal",
        "update": "NewDiscreteStates",
    }


class _Model3(ExchangeModel, _Slave3):
    """FMI 3.0."""

    fmpy_class = fmi3.FMU3Model
    functions: ClassVar[dict[str, str]] = ExchangeModel.functions | {
        "get_derivatives": "GetContinuousStateDerivatives",
        "set_floats": "SetFloat64",
        "get_floats": "GetFloat64",
        "update": "UpdateDiscreteStates",
    }

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of continuous states and of event indicators; structural parameters may change them."""
        return self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators()


def model_type(path: Path, description: ModelDescription) -> type[ExchangeModel]:
    """Return the adapter for an FMU that can be run here."""
    version = {2: _Model2, 3: _Model3}.get(description.fmiMajorVersion)
    if version is None or description.modelExchange is None:
        kind = "with" if description.modelExchange else "without"
        raise InputError(
            f"FMU {path}",
            got=f"FMI {description.fmiVersion} {kind} Model Exchange",
            expected="FMI 2.0 or 3.0 for Model Exchange",
            remedy="use FmuComponent if it is for co-simulation, else export the model again",
        )
    require_library(path, version.library(description.modelExchange.modelIdentifier))
    return version
