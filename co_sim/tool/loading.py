"""From a file to a system: an FMU alone, or an SSP."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError, suggestion
from co_sim.fmi_description import read_description
from co_sim.fmu import FmuComponent
from co_sim.model_exchange import ExchangeFmu
from co_sim.signals import Constant
from co_sim.system import Connection, System

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from co_sim.component import Component, Port, Scalar

__all__ = ["Loaded", "load", "parse_settings", "with_settings"]

#: Name of the component that holds inputs set on the command line.
SETTINGS = "set"
#: Steps in the default experiment of a file that tells no step.
_STEPS = 1000


@dataclass(frozen=True, slots=True)
class Loaded:
    """A system from a file, and the experiment that the file proposes.

    Parameters
    ----------
    system : ready to run. start, stop : s; ``None`` where the file tells nothing.
    """

    system: System
    start: float | None
    stop: float | None


def load(path: Path, *, tolerance: float | None = None) -> Loaded:
    """Read an FMU or an SSP.

    Parameters
    ----------
    path : the file.
    tolerance : relative, for all FMUs; ``None`` takes that of each FMU's default experiment.

    Raises
    ------
    InputError
        If there is no such file, it is of another kind, or cannot be read or run here.
    """
    if not path.is_file():
        raise InputError(f"{path}", got="no such file", expected="an FMU or an SSP", remedy="check the path")
    suffix = path.suffix.lower()
    if suffix == ".fmu":
        return _load_fmu(path, tolerance)
    if suffix in {".ssp", ".ssd"}:
        return _load_ssp(path, tolerance)
    raise InputError(
        f"{path}",
        got=f'the ending "{path.suffix}"',
        expected=".fmu, .ssp or .ssd",
        remedy="rename or export it",
    )


def _load_fmu(path: Path, tolerance: float | None) -> Loaded:
    description = read_description(path)
    kind = FmuComponent if description.coSimulation else ExchangeFmu
    fmu: Component = kind(path, tolerance=tolerance)
    experiment = description.defaultExperiment
    start, stop, step = (
        _number(getattr(experiment, name, None)) for name in ("startTime", "stopTime", "stepSize")
    )
    if step is None:
        step = ((stop or 1.0) - (start or 0.0)) / _STEPS
    name = re.sub(r"[^\w-]", "_", path.stem)
    return Loaded(System({name: fmu}, step=step), start, stop)


def _load_ssp(path: Path, tolerance: float | None) -> Loaded:
    from co_sim.ssp import open_ssp

    model = open_ssp(path, tolerance=tolerance)
    return Loaded(model.system, model.start_time, model.stop_time)


def _number(text: str | float | None) -> float | None:
    return None if text is None else float(text)


def parse_settings(texts: Sequence[str]) -> dict[str, Scalar]:
    """Return the values of ``NAME=VALUE``: true and false, whole numbers, numbers, else texts.

    Raises
    ------
    InputError
        If a text has no ``=`` or no name; all faults are told.
    """
    faults = [
        Fault(
            f'setting "{text}"',
            "no NAME=VALUE",
            "a name, an equals sign and a value",
            "as in --set mass=1250",
        )
        for text in texts
        if not re.match(r"[^=]+=", text)
    ]
    if faults:
        raise InputError.from_faults(faults)
    pairs = (text.split("=", 1) for text in texts)
    return {name.strip(): _value(value.strip()) for name, value in pairs}


def _value(text: str) -> Scalar:
    if text in {"true", "false"}:
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def with_settings(system: System, settings: Mapping[str, Scalar]) -> System:
    """Return the system with parameters set, and with constants at inputs that nothing feeds.

    Names are ``component.name``; in a system of one component its own names will do.

    Raises
    ------
    InputError
        If a name is neither a parameter nor a free input; the parameters' own faults are told by the
        check of the system.
    """
    full = {_full_name(system, name): value for name, value in settings.items()}
    free = _free_inputs(system)
    inputs = {name: value for name, value in full.items() if name in free}
    parameters = {name: value for name, value in full.items() if name not in free}
    unknown = [
        Fault(
            f'setting "{name}"',
            "an unknown component",
            "component.name of a parameter or of an input that nothing feeds",
            suggestion(name.partition(".")[0], list(system.components)),
        )
        for name in parameters
        if name.partition(".")[0] not in system.components
    ]
    if unknown:
        raise InputError.from_faults(unknown)
    system = replace(system, parameters={**system.parameters, **parameters})
    if not inputs:
        return system
    ports = [replace(free[name], name=name, start=None) for name in inputs]
    constants = Constant(list(inputs.values()), ports)
    wires = [Connection(f"{SETTINGS}.{name}", name) for name in inputs]
    return replace(
        system,
        components={**system.components, SETTINGS: constants},
        connections=[*system.connections, *wires],
    )


def _full_name(system: System, name: str) -> str:
    (first, *others) = system.components
    return name if others or name.startswith(f"{first}.") else f"{first}.{name}"


def _free_inputs(system: System) -> dict[str, Port]:
    fed = {connection.target for connection in system.connections}
    return {
        f"{name}.{port.name}": port
        for name, component in system.components.items()
        for port in component.inputs
        if f"{name}.{port.name}" not in fed
    }
