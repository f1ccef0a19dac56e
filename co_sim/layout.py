"""Where the values of a system lie: outputs in rows of a table, inputs in one array, links in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from co_sim.dependencies import component_order
from co_sim.kernel import LINK, PART, Feed
from co_sim.snapshot import TextPlaces
from co_sim.texts import as_number

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.component import Component, Port, Vector
    from co_sim.kernel import Integers
    from co_sim.system import Link, System

__all__ = ["Layout", "Links", "Part", "lay_out"]


class Links(NamedTuple):
    """The links of all parts, each an array over links; see `co_sim.kernel`."""

    source: Integers
    target: Integers
    period: Integers
    order: Integers
    scaled: Integers
    gain: Vector
    offset: Vector


@dataclass(frozen=True, slots=True)
class Part:
    """A component and its place.

    Parameters
    ----------
    name, component : of the system.
    u : the component's slice of all inputs, as its `step` takes them. place : where that begins.
    y : the columns of its outputs.
    period : of its steps, in steps of the master.
    derived : how many inputs have their derivatives behind them; 0 where it wants means over a step, -1
        where it wants values at the end of a step.
    behind, ahead, end : its links, as `co_sim.kernel` has them.
    """

    name: str
    component: Component
    place: int
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

    def fed(self, links: slice | NDArray[np.intp], row: Vector) -> Vector:
        """Return what links pass on of a row, without extrapolation."""
        table = self.links
        fed: Vector = table.gain[links] * row[table.source[links]] + table.offset[links]
        return fed

    def inputs(self, part: Part, row: Vector) -> Vector:
        """Return the inputs of a part at the instant of a row, without derivatives."""
        u = part.values.copy()
        links = slice(part.behind, part.end)
        u[self.links.target[links] - part.place] = self.fed(links, row)
        return u

    def tables(self) -> tuple[Integers, Integers]:
        """Return the parts, without their steps, and the links as the compiled loop takes them.

        The parts hold addresses of links and of `u`.
        """
        links = np.zeros((len(self.links.source), len(LINK)), dtype=np.int64)
        for i, name in enumerate(LINK):
            links[:, i] = getattr(self.links, name).view(np.int64)
        begin, size = links.ctypes.data, links.strides[0]
        parts = np.zeros((len(self.parts), len(PART)), dtype=np.int64)
        for i, (row, part) in enumerate(zip(parts, self.parts, strict=True)):
            values = {
                "index": i,
                "u": part.u.ctypes.data,
                "y": part.y.start,
                "n_y": part.y.stop - part.y.start,
                "feed": self._feed(part),
                "behind": begin + size * part.behind,
                "ahead": begin + size * part.ahead,
                "end": begin + size * part.end,
                "period": part.period,
                "derived": part.derived,
            }
            for name, value in values.items():
                row[PART.index(name)] = value
        return parts, links

    def _feed(self, part: Part) -> Feed:
        held = not self.links.order[part.behind : part.ahead].any()
        return Feed.HELD if held and part.period == 1 and part.ahead == part.end else Feed.ANY

    def stretch(self, part: Part) -> int | None:
        """Return where the inputs of a part stand in a row, side by side and in their order, if they do.

        Such inputs need not be copied at all, for a step that begins when they are read.
        """
        of_part = slice(part.behind, part.end)
        source, target = self.links.source[of_part], self.links.target[of_part]
        order = np.argsort(target)
        side_by_side = source.size == part.u.size > 0 and (np.diff(source[order]) == 1).all()
        if self._feed(part) is Feed.HELD and side_by_side and not self.links.scaled[of_part].any():
            return int(source[order[0]])
        return None


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
                begin,
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
        scaled=integers([(link.gain, link.offset) != (1.0, 0.0) for link in links]),
        gain=np.array([link.gain for link in links], dtype=np.float64),
        offset=np.array([link.offset for link in links], dtype=np.float64),
    )
