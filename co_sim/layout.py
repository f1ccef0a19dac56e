"""Where the values of a system lie: outputs in rows of a table, inputs in one array, links in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.dependencies import component_order
from co_sim.kernel import PART, Links
from co_sim.snapshot import TextPlaces
from co_sim.texts import as_number

if TYPE_CHECKING:
    from co_sim.component import Component, Port, Vector
    from co_sim.kernel import Integers
    from co_sim.system import Link, System

__all__ = ["Layout", "Part", "lay_out"]


@dataclass(frozen=True, slots=True)
class Part:
    """A component and its place.

    Parameters
    ----------
    name, component : of the system.
    u : the component's slice of all inputs, as its `step` takes them.
    y : the columns of its outputs.
    period : of its steps, in steps of the master.
    derived : how many inputs have their derivatives behind them; 0 where it wants means over a step, -1
        where it wants values at the end of a step.
    behind, ahead, end : its links, as `co_sim.kernel` has them.
    """

    name: str
    component: Component
    u: Vector
    y: slice
    period: int
    derived: int
    behind: int
    ahead: int
    end: int

    @property
    def values(self) -> Vector:
        """The inputs without their derivatives, as `exchange` takes them."""
        return self.u[: self.derived] if self.derived > 0 else self.u


@dataclass(frozen=True, slots=True)
class Layout:
    """The places of all values of a system.

    Parameters
    ----------
    parts : in the order of their steps.
    links : between outputs and inputs.
    u : all inputs; those that nothing feeds have their start values, for good.
    first_row : what the outputs are taken to be before they are known: the start value of an input that
        they feed, else zero.
    history : rows before the present one that the links may read.
    texts : outputs and inputs that are texts.
    """

    parts: tuple[Part, ...]
    links: Links
    u: Vector
    first_row: Vector
    history: int
    texts: TextPlaces

    def table(self) -> Integers:
        """Return the parts as the compiled loop takes them, without the addresses of their steps."""
        table = np.zeros((len(self.parts), len(PART)), dtype=np.int64)
        begins = np.cumsum([0, *(part.u.size for part in self.parts)])
        for row, part, begin in zip(table, self.parts, begins, strict=False):
            row[2:] = (
                begin,
                part.derived,
                part.y.start,
                part.y.stop - part.y.start,
                part.period,
                part.behind,
                part.ahead,
                part.end,
            )
        return table


def lay_out(system: System) -> Layout:
    """Return the places of the values of a system without faults."""
    order = list(system.components) if system.coupling.algorithm == "jacobi" else component_order(system)
    column = {signal.name: i for i, signal in enumerate(system.signals)}
    links = system.links()
    places = _input_places(system, order)
    u = np.zeros(sum(_width(system.components[name]) for name in order))
    for element, value in _start_values(system).items():
        u[places[element]] = value
    sorted_links, bounds = _sort(system, links, order)
    return Layout(
        parts=_parts(system, order, u, bounds),
        links=_link_table(system, sorted_links, column, places),
        u=u,
        first_row=_first_row(system, links, column),
        # A polynomial of order 2 reads back two periods of a source, from a sample up to one period old.
        history=3 * max(system.rates.values(), default=1),
        texts=_text_places(system, places),
    )


def _text_places(system: System, places: dict[str, int]) -> TextPlaces:
    signals = [i for i, signal in enumerate(system.signals) if signal.kind == "string"]
    inputs = [
        places[f"{name}.{element}"]
        for name, component in system.components.items()
        for port in component.inputs
        if port.kind == "string"
        for element in port.elements
    ]
    return TextPlaces(np.array(signals, dtype=np.intp), np.array(inputs, dtype=np.intp))


def _width(component: Component) -> int:
    """Return how many values a component's `u` has."""
    return _size(component.inputs) * (3 if component.takes_derivatives else 1)


def _size(ports: tuple[Port, ...]) -> int:
    return sum(port.size for port in ports)


def _input_places(system: System, order: list[str]) -> dict[str, int]:
    places: dict[str, int] = {}
    begin = 0
    for name in order:
        component = system.components[name]
        elements = [f"{name}.{element}" for port in component.inputs for element in port.elements]
        places.update((element, begin + i) for i, element in enumerate(elements))
        begin += _width(component)
    return places


def _start_values(system: System) -> dict[str, float]:
    """Return the start values of inputs as numbers."""
    return {
        f"{name}.{element}": as_number(value)
        for name, component in system.components.items()
        for port in component.inputs
        for element, value in zip(port.elements, port.starts or (), strict=False)
    }


def _first_row(system: System, links: list[Link], column: dict[str, int]) -> Vector:
    row = np.zeros(len(column))
    starts = _start_values(system)
    for link in links:
        # Through a gain the start value of an input says nothing certain about the output: no guess.
        if link.target in starts and (link.gain, link.offset) == (1.0, 0.0):
            row[column[link.source]] = starts[link.target]
    return row


def _sort(
    system: System, links: list[Link], order: list[str]
) -> tuple[list[Link], dict[str, tuple[int, int, int]]]:
    """Return the links part by part, those that read ahead last, and where each part's links lie."""
    place = {name: i for i, name in enumerate(order)}
    algorithm = system.coupling.algorithm
    of: dict[str, tuple[list[Link], list[Link]]] = {name: ([], []) for name in order}
    for link in links:
        source, target = link.source.partition(".")[0], link.target.partition(".")[0]
        reads_ahead = algorithm == "iterated" or (
            algorithm == "gauss-seidel" and place[source] < place[target]
        )
        of[target][reads_ahead].append(link)
    result: list[Link] = []
    bounds = {}
    for name in order:
        behind, ahead = of[name]
        begin = len(result)
        result += [*behind, *ahead]
        bounds[name] = begin, begin + len(behind), len(result)
    return result, bounds


def _parts(
    system: System, order: list[str], u: Vector, bounds: dict[str, tuple[int, int, int]]
) -> tuple[Part, ...]:
    columns: dict[str, slice] = {}
    begin = 0
    for name, component in system.components.items():
        columns[name] = slice(begin, begin + _size(component.outputs))
        begin = columns[name].stop
    parts = []
    begin = 0
    for name in order:
        component = system.components[name]
        width = _width(component)
        derived = _size(component.inputs) if component.takes_derivatives else -component.takes_end_values
        parts.append(
            Part(
                name,
                component,
                u[begin : begin + width],
                columns[name],
                system.rates.get(name, 1),
                derived,
                *bounds[name],
            )
        )
        begin += width
    return tuple(parts)


def _link_table(system: System, links: list[Link], column: dict[str, int], places: dict[str, int]) -> Links:
    order = system.coupling.order

    def integers(values: list[int]) -> Integers:
        return np.array(values, dtype=np.int64)

    return Links(
        source=integers([column[link.source] for link in links]),
        target=integers([places[link.target] for link in links]),
        period=integers([system.rates.get(link.source.partition(".")[0], 1) for link in links]),
        order=integers([order if link.continuous else 0 for link in links]),
        gain=np.array([link.gain for link in links], dtype=np.float64),
        offset=np.array([link.offset for link in links], dtype=np.float64),
    )
