"""A system of connected components as plain data, checked before anything is started.

Ends of a connection are written ``"component.port"``. The first dot separates, so a port may carry
dots of its own and a component may not.

Units must be equal. An empty unit means ``"1"``. An angle is not a plain number here: ``"rad"``
connects to ``"rad"`` only, because a ``"1"`` at one end of an angle is more often a forgotten unit.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError, suggestion

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from co_sim.component import Component, Kind, Port

__all__ = ["Connection", "Signal", "System"]


@dataclass(frozen=True, slots=True)
class Connection:
    """One output that feeds one input, such as ``Connection("plant.yaw_rate", "sensors.yaw_rate")``."""

    source: str
    target: str

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


@dataclass(frozen=True, slots=True)
class Signal:
    """An output of the system: its full name ``"component.port"``, unit, description and kind."""

    name: str
    unit: str
    description: str = ""
    kind: Kind = "float64"

    @property
    def component(self) -> str:
        """Name of the component that computes this signal."""
        return self.name.partition(".")[0]


@dataclass(frozen=True)
class System:
    """Components by name, and the connections between their ports.

    Parameters
    ----------
    components : each under a name of its own without a dot; the order is the order of the signals.
    connections : each input at most once; an output may feed any number of inputs.
    """

    components: Mapping[str, Component]
    connections: Sequence[Connection] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", MappingProxyType(dict(self.components)))
        object.__setattr__(self, "connections", tuple(self.connections))

    @property
    def signals(self) -> tuple[Signal, ...]:
        """All outputs, component by component, in the order of the declared ports."""
        return tuple(
            Signal(name, canonical_unit(port.unit), port.description)
            for name, port in self._outputs().items()
        )

    def check(self) -> None:
        """Raise one `InputError` that tells all faults, a line each, if there are any."""
        faults = self.faults()
        if faults:
            raise InputError.from_faults(faults)

    def faults(self) -> list[Fault]:
        """Return everything that is wrong with this description; empty if it can be run."""
        return [
            *self._name_faults(),
            *self._port_faults(),
            *self._connection_faults(),
            *self._input_faults(),
        ]

    def _outputs(self) -> dict[str, Port]:
        return {
            f"{name}.{port.name}": port for name, part in self.components.items() for port in part.outputs
        }

    def _inputs(self) -> dict[str, Port]:
        return {f"{name}.{port.name}": port for name, part in self.components.items() for port in part.inputs}

    def _name_faults(self) -> Iterator[Fault]:
        if not self.components:
            yield Fault("system", "no component", "at least one", "add the components to be run")
        for name in self.components:
            if not name or "." in name:
                yield Fault(f'component "{name}"', f'"{name}"', "a name without dots", "rename the component")
        names_of: dict[int, list[str]] = {}
        for name, component in self.components.items():
            names_of.setdefault(id(component), []).append(name)
        for names in names_of.values():
            if len(names) > 1:
                yield Fault(
                    f"components {', '.join(names)}",
                    "the same object under several names",
                    "one object for each name",
                    "build a second component",
                )

    def _port_faults(self) -> Iterator[Fault]:
        for name, component in self.components.items():
            for kind, ports in (("input", component.inputs), ("output", component.outputs)):
                for port, count in Counter(port.name for port in ports).items():
                    if count > 1:
                        yield Fault(
                            f"{name}.{port}", f"{count} {kind}s of this name", "one", "rename the others"
                        )

    def _connection_faults(self) -> Iterator[Fault]:
        outputs, inputs = self._outputs(), self._inputs()
        for connection in self.connections:
            source, target = outputs.get(connection.source), inputs.get(connection.target)
            if source is None:
                yield self._unknown_end(connection, connection.source, "output", outputs)
            if target is None:
                yield self._unknown_end(connection, connection.target, "input", inputs)
            if source and target and canonical_unit(source.unit) != canonical_unit(target.unit):
                yield Fault(
                    f"connection {connection}",
                    f'"{canonical_unit(source.unit)}" into "{canonical_unit(target.unit)}"',
                    "the same unit at both ends",
                    "correct the unit of a port, or convert in a component between them",
                )

    def _unknown_end(self, connection: Connection, end: str, kind: str, known: Mapping[str, Port]) -> Fault:
        name = end.partition(".")[0]
        got = (
            f'unknown {kind} "{end}"' if name in self.components else f'unknown component "{name}" in "{end}"'
        )
        return Fault(
            f"connection {connection}", got, f"an {kind} written component.port", suggestion(end, known)
        )

    def _input_faults(self) -> Iterator[Fault]:
        times_connected = Counter(connection.target for connection in self.connections)
        for name, port in self._inputs().items():
            count = times_connected[name]
            if count > 1:
                yield Fault(f"input {name}", f"{count} connections", "one", "remove the others")
            elif count == 0 and port.start is None:
                yield Fault(
                    f"input {name}",
                    "no connection",
                    "one, as it has no start value",
                    "connect it to an output",
                )
            elif count == 0 and port.start is not None and not math.isfinite(port.start):
                yield Fault(
                    f"input {name}", f"start value {port.start}", "a finite number", "correct the port"
                )


def canonical_unit(unit: str) -> str:
    """Return the unit as compared: an empty unit is ``"1"``, any other is itself."""
    return unit or "1"
