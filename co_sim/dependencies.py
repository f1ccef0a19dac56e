"""Who depends on whom in a system: orders of computation, and algebraic loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import networkx as nx

if TYPE_CHECKING:
    from collections.abc import Iterator

    from co_sim.system import System

__all__ = ["algebraic_loops", "component_order", "initial_groups", "looped_components"]


def algebraic_loops(system: System) -> list[list[str]]:
    """Return the loops that the declared dependencies form, each as the names of its outputs.

    Components that declare nothing are taken to break a loop: only running them can tell.
    """
    ports = nx.DiGraph()
    for source, target in _ends(system):
        ports.add_edge(f"{source} (output)", f"{target} (input)")
    for name, component in system.components.items():
        for output, inputs in (component.feedthrough or {}).items():
            ports.add_edges_from((f"{name}.{i} (input)", f"{name}.{output} (output)") for i in sorted(inputs))
    loops = []
    for members in nx.strongly_connected_components(ports):
        if len(members) > 1:
            cycle = [edge[0] for edge in nx.find_cycle(ports.subgraph(sorted(members)))]
            outputs = [node.removesuffix(" (output)") for node in cycle if node.endswith(" (output)")]
            first = outputs.index(min(outputs))
            loops.append([*outputs[first:], *outputs[: first + 1]])
    return sorted(loops)


def component_order(system: System) -> list[str]:
    """Return an order for steps one after the other: each component after those that feed it.

    In a loop of components, one whose outputs follow its inputs at once comes after those that feed it;
    beyond that the order of the system decides.
    """
    order: list[str] = []
    for group in _groups(_graph(system)):
        at_once = _graph(system, at_once=True).subgraph(group)
        place = {name: i for i, name in enumerate(system.components)}
        order += [name for part in _groups(at_once) for name in sorted(part, key=place.__getitem__)]
    return order


def looped_components(system: System) -> set[str]:
    """Return the components that act back on themselves through connections, at once or later.

    Without them a coupling is a cascade, which is stable whenever its parts are.
    """
    graph = _graph(system)
    loops = {name for group in nx.strongly_connected_components(graph) if len(group) > 1 for name in group}
    return loops | {name for name, _ in nx.selfloop_edges(graph)}


def initial_groups(system: System) -> list[list[str]]:
    """Return the components in groups, each after those that feed it at once; groups of several are loops."""
    place = {name: i for i, name in enumerate(system.components)}
    return [sorted(group, key=place.__getitem__) for group in _groups(_graph(system, at_once=True))]


def _groups(graph: nx.DiGraph) -> Iterator[set[str]]:
    """Yield the strongly connected groups of a graph, each after those before it, in a repeatable order."""
    place = {name: i for i, name in enumerate(graph)}
    condensed = nx.condensation(graph)
    members = condensed.nodes(data="members")
    first = {group: min(map(place.__getitem__, members[group])) for group in condensed}
    for group in nx.lexicographical_topological_sort(condensed, key=first.__getitem__):
        yield members[group]


def _graph(system: System, *, at_once: bool = False) -> nx.DiGraph:
    """Return who feeds whom; `at_once`: only into components whose outputs may follow that input at once."""
    graph = nx.DiGraph()
    graph.add_nodes_from(system.components)
    for source, target in _ends(system):
        origin, (aim, _, port) = source.partition(".")[0], target.partition(".")
        if not at_once or _follows_at_once(system, aim, port):
            graph.add_edge(origin, aim)
    return graph


def _follows_at_once(system: System, name: str, port: str) -> bool:
    feedthrough = system.components[name].feedthrough
    return feedthrough is None or any(port in inputs for inputs in feedthrough.values())


def _ends(system: System) -> Iterator[tuple[str, str]]:
    """Yield the ports at the ends of each connection; an element of an array counts as the whole."""
    ports = {
        f"{name}.{element}": f"{name}.{port.name}"
        for name, component in system.components.items()
        for port in (*component.inputs, *component.outputs)
        for element in port.elements
    }
    for connection in system.connections:
        yield ports.get(connection.source, connection.source), ports.get(connection.target, connection.target)
