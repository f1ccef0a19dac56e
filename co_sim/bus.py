"""Where the outputs of a system lie in one array, and where its inputs read them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.component import Component, Vector
    from co_sim.system import System

__all__ = ["Bus", "Part", "build_bus", "upstream_first", "wiring"]


class Part(NamedTuple):
    """A component with its inputs and its slice of one bus."""

    name: str
    component: Component
    u: Vector
    y: Vector


class Bus(NamedTuple):
    """The outputs of all components at one time, and constants behind them."""

    values: Vector
    outputs: Vector
    parts: tuple[Part, ...]


def wiring(system: System) -> tuple[NDArray[np.intp], list[float]]:
    """Return where each input reads on a bus, and the constants that lie behind the outputs."""
    position = {signal.name: i for i, signal in enumerate(system.signals)}
    source_of = {connection.target: connection.source for connection in system.connections}
    sources: list[int] = []
    constants: list[float] = []
    for name, component in system.components.items():
        for port in component.inputs:
            source = source_of.get(f"{name}.{port.name}")
            if source is not None:
                sources.append(position[source])
            elif port.start is not None:
                sources.append(len(position) + len(constants))
                constants.append(port.start)
    return np.array(sources, dtype=np.intp), constants


def build_bus(system: System, inputs: Vector, constants: list[float]) -> Bus:
    """Return a bus with constants, cut into the slices of the components.

    An output begins as the start value of an input that it feeds, zero if there is none: what that input
    sees before the output is known.
    """
    guesses = _guesses(system)
    n_outputs = len(system.signals)
    values = np.array([*(guesses.get(signal.name, 0.0) for signal in system.signals), *constants])
    outputs = values[:n_outputs]
    outputs.flags.writeable = False
    parts = []
    i = j = 0
    for name, component in system.components.items():
        n_u, n_y = len(component.inputs), len(component.outputs)
        parts.append(Part(name, component, inputs[i : i + n_u], values[j : j + n_y]))
        i, j = i + n_u, j + n_y
    return Bus(values, outputs, tuple(parts))


def _guesses(system: System) -> dict[str, float]:
    """Return the start value of an input of each output that feeds one with a start value."""
    starts = {
        f"{name}.{port.name}": port.start
        for name, component in system.components.items()
        for port in component.inputs
        if port.start is not None
    }
    return {c.source: starts[c.target] for c in system.connections if c.target in starts}


def upstream_first(system: System) -> list[str]:
    """Return the names of the components, each after those that feed it as far as there is no loop."""
    feeders: dict[str, list[str]] = {name: [] for name in system.components}
    for connection in system.connections:
        source, target = (end.partition(".")[0] for end in (connection.source, connection.target))
        feeders[target].append(source)
    order: list[str] = []
    seen: set[str] = set()
    for first in system.components:
        stack = [(first, iter(feeders[first]))] if first not in seen else []
        seen.add(first)
        while stack:
            name, remaining = stack[-1]
            following = next((source for source in remaining if source not in seen), None)
            if following is None:
                order.append(name)
                stack.pop()
            else:
                seen.add(following)
                stack.append((following, iter(feeders[following])))
    return order
