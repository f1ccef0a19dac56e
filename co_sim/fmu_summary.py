"""What an FMU is: ports, parameters, capabilities, platforms, default experiment."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from co_sim.archives import contents
from co_sim.errors import InputError
from co_sim.exchange_model import model_type
from co_sim.fmi import platforms_of, slave_type
from co_sim.fmi_description import read_description
from co_sim.fmu_variables import attribute, kind_of, shape_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fmpy.model_description import ModelDescription, ModelVariable

__all__ = ["CAPABILITIES", "FmuSummary", "Interface", "Quantity", "summarise"]

#: What an interface type may be able to do, by fmpy's names of the flags.
CAPABILITIES = {
    "canGetAndSetFMUstate": "saves and restores its state",
    "canSerializeFMUstate": "turns its state into bytes",
    "providesDirectionalDerivative": "gives directional derivatives",
    "providesAdjointDerivatives": "gives adjoint derivatives",
    "canHandleVariableCommunicationStepSize": "takes steps of varying size",
    "canInterpolateInputs": "takes derivatives of inputs",
    "mightReturnEarlyFromDoStep": "may return early from a step",
    "hasEventMode": "has an event mode",
    "needsCompletedIntegratorStep": "wants to be told of completed steps",
    "canBeInstantiatedOnlyOncePerProcess": "allows one instance in a process",
    "needsExecutionTool": "needs the tool that exported it",
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """A variable.

    Parameters
    ----------
    name, description, causality, variability : as declared, or the default.
    kind : type of its values in the terms of FMI 3, such as ``"float64"``.
    shape : of an array; empty for a scalar.
    unit : empty if there is none.
    start : as it is written; ``None`` if there is none.
    minimum, maximum : as they are written; ``None`` without a bound.
    literals : names of the values of an enumeration by number.
    """

    name: str
    description: str
    causality: str
    variability: str
    kind: str
    shape: tuple[int, ...]
    unit: str
    start: str | list[str] | None
    minimum: str | None
    maximum: str | None
    literals: Mapping[int, str]


@dataclass(frozen=True, slots=True)
class Interface:
    """An interface type of an FMU.

    Parameters
    ----------
    kind : ``"CoSimulation"``, ``"ModelExchange"`` or ``"ScheduledExecution"``.
    identifier : name of its library without ending.
    capabilities : of `CAPABILITIES`, those that mean something for this type.
    cannot_run : why it cannot be run here; ``None`` if nothing is known to be in the way.
    """

    kind: str
    identifier: str
    capabilities: Mapping[str, bool]
    cannot_run: str | None


@dataclass(frozen=True, slots=True)
class FmuSummary:
    """What an FMU is.

    Parameters
    ----------
    path, model, description, fmi_version, tool, author, version : texts; empty if there are none.
    interfaces : its interface types.
    platforms : with a library in the archive, in the terms of its version of FMI.
    has_sources : whether C code comes with it.
    n_states, n_event_indicators : of Model Exchange.
    experiment : start, stop, tolerance and step that it suggests, as far as it does, in s but for the
        tolerance.
    variables : all of them, in their order.
    """

    path: str
    model: str
    description: str
    fmi_version: str
    tool: str
    author: str
    version: str
    interfaces: tuple[Interface, ...]
    platforms: tuple[str, ...]
    has_sources: bool
    n_states: int
    n_event_indicators: int
    experiment: Mapping[str, float]
    variables: tuple[Quantity, ...]

    def of(self, *causalities: str) -> Sequence[Quantity]:
        """Return the variables of some causalities."""
        return [quantity for quantity in self.variables if quantity.causality in causalities]

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain objects, for JSON."""
        return asdict(self)


def summarise(path: Path) -> FmuSummary:
    """Return what an FMU is; no code of it runs.

    Raises
    ------
    InputError
        If the archive or its description is refused.
    """
    description = read_description(path)
    names = contents(path)
    return FmuSummary(
        path=str(path),
        model=description.modelName or "",
        description=description.description or "",
        fmi_version=description.fmiVersion,
        tool=description.generationTool or "",
        author=description.author or "",
        version=description.version or "",
        interfaces=tuple(_interfaces(path, description)),
        platforms=tuple(platforms_of(names)),
        has_sources=any(name.startswith("sources/") for name in names),
        n_states=description.numberOfContinuousStates,
        n_event_indicators=description.numberOfEventIndicators,
        experiment=_experiment(description),
        variables=tuple(_quantity(variable) for variable in description.modelVariables),
    )


def _interfaces(path: Path, description: ModelDescription) -> list[Interface]:
    found = []
    for kind, interface in (
        ("CoSimulation", description.coSimulation),
        ("ModelExchange", description.modelExchange),
        ("ScheduledExecution", description.scheduledExecution),
    ):
        if interface is not None:
            able = {flag: getattr(interface, flag) for flag in CAPABILITIES if hasattr(interface, flag)}
            reason = _cannot_run(path, description, kind)
            found.append(Interface(kind, interface.modelIdentifier or "", able, reason))
    return found


def _cannot_run(path: Path, description: ModelDescription, kind: str) -> str | None:
    if kind == "ScheduledExecution":
        return "this master does not schedule"
    try:
        (slave_type if kind == "CoSimulation" else model_type)(path, description)
    except InputError as error:
        return f"{error.faults[0].got}; {error.faults[0].remedy}"
    return None


def _experiment(description: ModelDescription) -> dict[str, float]:
    default = description.defaultExperiment
    names = {"start": "startTime", "stop": "stopTime", "tolerance": "tolerance", "step": "stepSize"}
    given = {name: getattr(default, name_, None) for name, name_ in names.items()}
    return {name: float(value) for name, value in given.items() if value is not None}


def _quantity(variable: ModelVariable) -> Quantity:
    definition = variable.declaredType
    literals = {int(item.value): item.name for item in definition.items} if definition is not None else {}
    return Quantity(
        name=variable.name,
        description=variable.description or getattr(definition, "description", None) or "",
        causality=variable.causality,
        variability=variable.variability,
        kind=kind_of(variable) or variable.type.lower(),
        shape=shape_of(variable, {}),
        unit=attribute(variable, "unit") or "",
        start=variable.start,
        minimum=attribute(variable, "min"),
        maximum=attribute(variable, "max"),
        literals=literals,
    )
