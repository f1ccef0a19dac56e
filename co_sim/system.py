"""A system of connected components as plain data, checked before anything is started.

Ends of a connection are written ``"component.port"``. The first dot separates, so a port may carry
dots of its own and a component may not. An end names a whole port, or one element of an array
(``"component.port[2,1]"``).

Values are converted between units of the same dimension. An angle is not a plain number here:
``"rad"`` and ``"1"`` do not fit, because a ``"1"`` at one end of an angle is more often a forgotten unit.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from co_sim.coupling import Coupling
from co_sim.dependencies import algebraic_loops
from co_sim.errors import Fault, InputError, suggestion
from co_sim.units import UnknownUnitError, conversion

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from co_sim.component import Component, Kind, Port, Scalar

__all__ = ["Connection", "Link", "Signal", "System"]

_FLOATS = frozenset({"float32", "float64"})
_NOT_NUMBERS = frozenset({"boolean", "string"})


@dataclass(frozen=True, slots=True)
class Connection:
    """One output that feeds one input, such as ``Connection("plant.yaw_rate", "sensors.yaw_rate")``.

    Parameters
    ----------
    source, target : an output and an input of the same shape, or elements of arrays.
    gain, offset : the input is ``gain*output + offset``, in the unit of the input; units are
        converted before.
    convert_units : whether they are. Without, the bare number passes, whatever its unit.
    """

    source: str
    target: str
    gain: float = 1.0
    offset: float = 0.0
    convert_units: bool = True

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


@dataclass(frozen=True, slots=True)
class Signal:
    """An element of an output: its full name ``"component.port"``, unit, description and kind."""

    name: str
    unit: str
    description: str = ""
    kind: Kind = "float64"

    @property
    def component(self) -> str:
        """Name of the component that computes this signal."""
        return self.name.partition(".")[0]


class Link(NamedTuple):
    """One element of an input and what feeds it: ``input = gain*signal + offset``."""

    source: str
    target: str
    gain: float
    offset: float
    continuous: bool


class _End(NamedTuple):
    """What the name of an end stands for: a port, and the names of the elements meant."""

    port: Port
    elements: tuple[str, ...]
    shape: tuple[int, ...]


@dataclass(frozen=True)
class System:
    """Components by name, the connections between their ports, and how they step.

    Parameters
    ----------
    components : each under a name of its own without a dot; the order is the order of the signals.
    connections : each input at most once; an output may feed any number of inputs.
    parameters : of the components, by ``"component.parameter"``.
    step : communication step, s.
    rates : steps of a component in communication steps, where not 1: ``{"controller": 10}``. A
        component named here has a sample time of its own, which is kept when the step is halved to
        estimate the error of the coupling.
    coupling : which values a component sees during a step.
    """

    components: Mapping[str, Component]
    connections: Sequence[Connection] = ()
    parameters: Mapping[str, Scalar] = field(default_factory=dict)
    step: float = 1e-3
    rates: Mapping[str, int] = field(default_factory=dict)
    coupling: Coupling = field(default_factory=Coupling)

    def __post_init__(self) -> None:
        for name in ("components", "parameters", "rates"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "connections", tuple(self.connections))

    @property
    def signals(self) -> tuple[Signal, ...]:
        """All elements of all outputs, component by component, in the order of the declared ports."""
        return tuple(
            Signal(f"{name}.{element}", canonical_unit(port.unit), port.description, port.kind)
            for name, component in self.components.items()
            for port in component.outputs
            for element in port.elements
        )

    def check(self) -> None:
        """Raise one `InputError` that tells all faults, a line each, if there are any."""
        faults = self.faults()
        if faults:
            raise InputError.from_faults(faults)

    def faults(self) -> list[Fault]:
        """Return everything that is wrong with this description; empty if it can be run."""
        faults = [
            *self._name_faults(),
            *self._port_faults(),
            *self._connection_faults(),
            *self._input_faults(),
            *self._parameter_faults(),
            *self._step_faults(),
            *self.coupling.faults(),
        ]
        # Loops are looked for among sound connections only.
        return faults or list(self._loop_faults())

    def links(self) -> list[Link]:
        """Return every fed element of an input, connection by connection; for a system without faults."""
        outputs, inputs = self._ends("outputs"), self._ends("inputs")
        return [
            Link(
                source, target, connection.gain * factor, connection.gain * shift + connection.offset, smooth
            )
            for connection in self.connections
            for origin, aim in [(outputs[connection.source], inputs[connection.target])]
            for factor, shift in [_factor(connection, origin, aim)]
            for smooth in [_is_smooth(origin.port) and _is_smooth(aim.port)]
            for source, target in zip(origin.elements, aim.elements, strict=True)
        ]

    def parameters_of(self, name: str) -> dict[str, Scalar]:
        """Return the parameters of one component, by their own names."""
        return {
            parameter: value
            for key, value in self.parameters.items()
            for component, _, parameter in [key.partition(".")]
            if component == name
        }

    def _ends(self, side: str) -> dict[str, _End]:
        """Return what each possible end of a connection stands for: whole ports, and elements of arrays."""
        ends: dict[str, _End] = {}
        for name, component in self.components.items():
            for port in getattr(component, side):
                elements = tuple(f"{name}.{element}" for element in port.elements)
                ends.update((element, _End(port, (element,), ())) for element in elements)
                ends[f"{name}.{port.name}"] = _End(port, elements, port.shape)
        return ends

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
        outputs, inputs = self._ends("outputs"), self._ends("inputs")
        for connection in self.connections:
            source, target = outputs.get(connection.source), inputs.get(connection.target)
            if source is None:
                yield self._unknown_end(connection, connection.source, "output", outputs)
            if target is None:
                yield self._unknown_end(connection, connection.target, "input", inputs)
            if source and target:
                yield from _mismatches(connection, source, target)

    def _unknown_end(self, connection: Connection, end: str, kind: str, known: Mapping[str, _End]) -> Fault:
        name = end.partition(".")[0]
        got = (
            f'unknown {kind} "{end}"' if name in self.components else f'unknown component "{name}" in "{end}"'
        )
        return Fault(
            f"connection {connection}", got, f"an {kind} written component.port", suggestion(end, known)
        )

    def _input_faults(self) -> Iterator[Fault]:
        inputs = self._ends("inputs")
        fed = Counter(
            element
            for connection in self.connections
            if connection.target in inputs
            for element in inputs[connection.target].elements
        )
        for name, component in self.components.items():
            for port in {port.name: port for port in component.inputs}.values():
                elements = [f"{name}.{element}" for element in port.elements]
                for element in elements:
                    if fed[element] > 1:
                        yield Fault(
                            f"input {element}", f"{fed[element]} connections", "one", "remove the others"
                        )
                if not all(fed[element] for element in elements):
                    yield from _start_faults(f"input {name}.{port.name}", port)

    def _parameter_faults(self) -> Iterator[Fault]:
        for key in self.parameters:
            name = key.partition(".")[0]
            if name not in self.components:
                yield Fault(
                    f'parameter "{key}"',
                    f'unknown component "{name}"',
                    "a name written component.parameter",
                    suggestion(name, self.components),
                )
        for name, component in self.components.items():
            values = self.parameters_of(name)
            if values:
                for fault in component.parameter_faults(values):
                    yield Fault(f"{name}: {fault.what}", fault.got, fault.expected, fault.remedy)

    def _step_faults(self) -> Iterator[Fault]:
        if not (math.isfinite(self.step) and self.step > 0.0):
            yield Fault("step", f"{self.step} s", "a finite step > 0 s", "correct it")
        for name, rate in self.rates.items():
            if name not in self.components:
                known = suggestion(name, self.components)
                yield Fault(f'rate of "{name}"', "an unknown component", "a name of a component", known)
            if not isinstance(rate, int) or isinstance(rate, bool) or rate < 1:
                yield Fault(
                    f'rate of "{name}"',
                    f"{rate!r}",
                    "a whole number of steps >= 1",
                    "round it, or change the step",
                )
        if self.coupling.algorithm == "iterated" and any(rate != 1 for rate in self.rates.values()):
            yield Fault(
                "coupling algorithm",
                '"iterated" with several rates',
                "one rate for all components",
                'leave out the rates, or use "gauss-seidel"',
            )

    def _loop_faults(self) -> Iterator[Fault]:
        if self.coupling.loops == "solve":
            return
        for loop in algebraic_loops(self):
            yield Fault(
                "algebraic loop",
                " -> ".join(loop),
                "outputs that do not depend on themselves at the same time",
                'break it, say loops="solve", or declare the feedthrough of a component in it more closely',
            )


def _mismatches(connection: Connection, source: _End, target: _End) -> Iterator[Fault]:
    what = f"connection {connection}"
    if source.shape != target.shape:
        yield Fault(
            what,
            f"shape {_shape(source)} into {_shape(target)}",
            "the same shape at both ends",
            "connect element by element, as in port[1]",
        )
    if not _fits(source.port.kind, target.port.kind):
        yield Fault(
            what,
            f"{source.port.kind} into {target.port.kind}",
            "types that lose nothing",
            "convert in a component between them",
        )
    elif connection.convert_units:
        yield from _unit_faults(what, source.port, target.port)
    if not (math.isfinite(connection.gain) and math.isfinite(connection.offset)):
        got = f"gain {connection.gain}, offset {connection.offset}"
        yield Fault(what, got, "finite numbers", "correct them")
    elif (connection.gain, connection.offset) != (1.0, 0.0) and target.port.kind not in _FLOATS:
        yield Fault(what, f"a gain or offset into {target.port.kind}", "a floating-point input", "remove it")


def _unit_faults(what: str, source: Port, target: Port) -> Iterator[Fault]:
    try:
        factor = _conversion(source, target)
    except UnknownUnitError as error:
        for fault in error.faults:
            yield Fault(f"{what}: {fault.what}", fault.got, fault.expected, fault.remedy)
        return
    if factor is None:
        yield Fault(
            what,
            f'"{canonical_unit(source.unit)}" into "{canonical_unit(target.unit)}"',
            "units of the same dimension at both ends",
            "correct the unit of a port, or pass the bare number with convert_units=False",
        )


def _factor(connection: Connection, source: _End, target: _End) -> tuple[float, float]:
    """Return factor and offset between the units of the ends of a sound connection."""
    converted = _conversion(source.port, target.port) if connection.convert_units else None
    return converted or (1.0, 0.0)


def _conversion(source: Port, target: Port) -> tuple[float, float] | None:
    """Return factor and offset between the units of two ports, or ``None``."""
    declared = [{} if port.definition is None else {port.unit: port.definition} for port in (source, target)]
    return conversion(source.unit, target.unit, *declared)


def _shape(end: _End) -> str:
    return f"({', '.join(map(str, end.shape))})" if end.shape else "scalar"


def _fits(source: Kind, target: Kind) -> bool:
    """Return whether values pass without loss; integers are checked against their range as they arrive."""
    if source == target:
        return True
    if _NOT_NUMBERS & {source, target}:
        return False
    return source not in _FLOATS or target in _FLOATS


def _is_smooth(port: Port) -> bool:
    return port.continuous and port.kind in _FLOATS


def _start_faults(what: str, port: Port) -> Iterator[Fault]:
    """Find what is wrong with the start value of an input that is not connected."""
    starts = port.starts
    if starts is None:
        yield Fault(what, "no connection", "one, as it has no start value", "connect it to an output")
        return
    if len(starts) != port.size:
        yield Fault(what, f"{len(starts)} start values", f"{port.size}", "correct the port")
    expected = "a text" if port.kind == "string" else "a finite number"
    for value in starts:
        is_text = port.kind == "string"
        if isinstance(value, str) != is_text or not (isinstance(value, str) or math.isfinite(value)):
            yield Fault(what, f"start value {value!r}", expected, "correct the port")
            return


def canonical_unit(unit: str) -> str:
    """Return the unit as compared: an empty unit is ``"1"``, any other is itself."""
    return unit or "1"
