"""Makes the components of a system from the FMUs of a structure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError
from co_sim.fmu import FmuComponent
from co_sim.fmu_parameters import sizes_of
from co_sim.fmu_variables import is_signal, port_of, select
from co_sim.model_exchange import ExchangeFmu
from co_sim.ssp.fmus import name_of
from co_sim.ssp.network import GIVING, Pin
from co_sim.ssp.notes import ports_of

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from co_sim.fmu_parameters import Value
    from co_sim.ssp.binding import Bound
    from co_sim.ssp.elements import Component, Path
    from co_sim.ssp.fmus import Fmu
    from co_sim.ssp.network import Network

__all__ = ["make_parts", "note"]


def make_parts(
    network: Network,
    components: Mapping[Path, Component],
    bound: Bound,
    fed: Collection[Pin],
    tolerance: float | None,
) -> dict[str, FmuComponent]:
    """Return the components by name; what is wrong with one is noted as a fault of it.

    Parameters
    ----------
    network : of their connectors.
    components : the elements of those FMUs that could be read, by path.
    bound : values of their parameters.
    fed : inputs with a connection.
    tolerance : of all FMUs; ``None`` is what the document or the FMU tells.
    """
    parts: dict[str, FmuComponent] = {}
    for path, item in components.items():
        name = name_of(path)
        if name in parts:
            item.node.fault(f'a second component "{name}"', "one of this name", "rename one of the two")
        try:
            parts[name] = _part(network, path, item, bound.get(path, {}), fed, tolerance)
        except InputError as error:
            note(item, error)
    return parts


def note(item: Component, error: InputError) -> None:
    """Note what is wrong with an FMU as faults of its component."""
    item.node.faults.extend(
        Fault(f"{item.node}: {fault.what}", fault.got, fault.expected, fault.remedy) for fault in error.faults
    )


def _part(
    network: Network,
    path: Path,
    item: Component,
    values: Mapping[str, Value],
    fed: Collection[Pin],
    tolerance: float | None,
) -> FmuComponent:
    """Return the component for one FMU.

    Ports are all inputs that have a value to begin with or a connection, and those connectors that give
    values; all outputs where no connector is declared.
    """
    for connector in item.connectors.values():
        network.knows(Pin(path, connector.name), connector.node)
    ports = ports_of(item.node)
    inputs = _inputs(network, path, values, fed) if ports.inputs is None else ports.inputs
    outputs = _outputs(network, path, item) if ports.outputs is None else ports.outputs
    units = {name: network.port_measure(Pin(path, name)) for name in (*inputs, *outputs)}
    assert item.fmu is not None
    integration = dict(ports.integration)
    if tolerance is not None:
        integration["tolerance"] = tolerance
    return _kind(network.fmus[path], item)(
        item.fmu,
        inputs=inputs,
        outputs=outputs,
        parameters=values,
        units={name: measure for name, measure in units.items() if measure},
        **integration,
    )


def _kind(fmu: Fmu, item: Component) -> type[FmuComponent]:
    """Return the class for the interface type of the FMU that is to be used."""
    wanted = item.implementation
    if wanted == "any":
        return ExchangeFmu if fmu.interfaces == ["ModelExchange"] else FmuComponent
    if wanted not in fmu.interfaces:
        raise InputError(
            "implementation",
            got=f"no {wanted} in the FMU",
            expected="what the component asks for",
            remedy=f"choose from {', '.join(fmu.interfaces)}",
        )
    return ExchangeFmu if wanted == "ModelExchange" else FmuComponent


def _inputs(network: Network, path: Path, values: Mapping[str, Value], fed: Collection[Pin]) -> list[str]:
    variables = network.fmus[path].variables
    sizes = sizes_of(variables, values)
    inputs = [v for v in variables.values() if v.causality == "input" and is_signal(v)]
    named = [v for v in inputs if v.name in values or Pin(path, v.name) in fed]
    # What is used by an alias needs no port under its own name.
    used = {(v.type, v.valueReference) for v in named}
    others = [v for v in select(variables, None, "input") if (v.type, v.valueReference) not in used]
    chosen = {v.name for v in named} | {v.name for v in others if port_of(v, sizes, {}).start is not None}
    return [name for name in variables if name in chosen]


def _outputs(network: Network, path: Path, item: Component) -> list[str]:
    variables = network.fmus[path].variables
    if item.connectors:
        wanted = {name for name, connector in item.connectors.items() if connector.kind in GIVING}
    else:
        wanted = {variable.name for variable in select(variables, None, "output")}
    return [
        variable.name
        for variable in variables.values()
        if network.outgoing.get(Pin(path, variable.name)) or (variable.name in wanted and is_signal(variable))
    ]
