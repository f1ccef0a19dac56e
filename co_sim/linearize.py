"""A coupled system as one linear model around its present point.

Each component gives its own model (`Component.linearize`): an FMU from its directional derivatives, others
from central differences. With the models side by side in block diagonals ``A, B, C, D``, the connections
``u = K y + L w`` for outside inputs ``w``, and ``M = (I - K D)^-1`` ::

    x' = (A + B M K C) x + B M L w
    y  = (C + D M K C) x + D M L w
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag

from co_sim.errors import InputError
from co_sim.local_model import LocalModel, NotLinearizableError
from co_sim.patterns import matching
from co_sim.system import canonical_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.kernel import Matrix
    from co_sim.layout import Part
    from co_sim.master import Master
    from co_sim.system import System

__all__ = ["Linearization", "linearize"]


@dataclass(frozen=True, eq=False)
class Linearization:
    """A linear model of a whole system, and what it rests on.

    Parameters
    ----------
    model : a `control.StateSpace` in deviations from the point. Its labels are the names below with ``_`` for
        each dot, which python-control reserves.
    states, inputs, outputs : names ``component.state``, ``component.input`` and ``component.output``.
    state_units, input_units, output_units : units, in the order of the model.
    time : of the point, s.
    methods : how each component's matrices were found.
    error : largest estimated error of an element of a component's matrix, relative to the largest element of
        that matrix; 0 where all are exact.
    """

    model: Any
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    time: float
    methods: Mapping[str, str]
    error: float


def linearize(
    master: Master, inputs: Sequence[str] | None = None, outputs: Sequence[str] = ("*",)
) -> Linearization:
    """Return the linear model of a running system at its present point; the run can go on.

    Parameters
    ----------
    master : started here if need be; its initialisation ends.
    inputs : patterns for the outside inputs, ``"component.input"``, see `co_sim.patterns.matching`; ``None``
        takes all that are not connected. An outside input adds to what a connection feeds.
    outputs : patterns for signals.

    Raises
    ------
    InputError
        If a pattern matches nothing, a component cannot be linearised, continuous and sampled components
        are mixed, or an algebraic loop has no unique solution.
    """
    import control

    # Some FMUs give derivatives of states only when these are no longer to be found.
    master.enter_steps()
    system, parts = master.system, master.parts
    models = {part.name: _local(part, master) for part in parts}
    dt = _common_dt(models)
    A, B, C, D = (block_diag(*(getattr(models[p.name], m) for p in parts)) for m in "ABCD")
    names_u, units_u = _elements(system, parts, "inputs")
    names_y, units_y = _elements(system, parts, "outputs")
    K = _connections(system, names_u, names_y)
    fed = {link.target for link in system.links()}
    chosen_u = matching(inputs, names_u, "input", "an input") if inputs is not None else _free(names_u, fed)
    chosen_y = matching(outputs, [signal.name for signal in system.signals], "output", "an output")
    L = np.eye(len(names_u))[:, chosen_u]
    M = _solved(np.eye(len(names_u)) - K @ D, np.hstack([K @ C, L]))
    MKC, ML = M[:, : C.shape[1]], M[:, C.shape[1] :]
    order = [names_y.index(system.signals[i].name) for i in chosen_y]
    states = tuple(f"{p.name}.{state}" for p in parts for state in models[p.name].states)
    inner, outer = tuple(names_u[i] for i in chosen_u), tuple(names_y[i] for i in order)
    model = control.ss(
        A + B @ MKC,
        B @ ML,
        (C + D @ MKC)[order],
        (D @ ML)[order],
        dt,
        states=_labels(states) or None,
        inputs=_labels(inner) or None,
        outputs=_labels(outer),
        remove_useless_states=False,
    )
    return Linearization(
        model=model,
        states=states,
        inputs=inner,
        outputs=outer,
        state_units=tuple(unit for p in parts for unit in models[p.name].state_units),
        input_units=tuple(units_u[i] for i in chosen_u),
        output_units=tuple(units_y[i] for i in order),
        time=master.time,
        methods={name: local.method for name, local in models.items()},
        error=max(local.error for local in models.values()),
    )


def _labels(names: Sequence[str]) -> list[str]:
    return [name.replace(".", "_") for name in names]


def _local(part: Part, master: Master) -> LocalModel:
    try:
        return part.component.linearize(master.time, master.inputs_of(part.name))
    except NotLinearizableError as error:
        raise InputError(
            f"linear model of {part.name}",
            got=str(error),
            expected="a component with a linear model at this point",
            remedy="leave the component out of the system, or give it a linearize method",
        ) from error


def _common_dt(models: Mapping[str, LocalModel]) -> float:
    dynamic = {name: local.dt for name, local in models.items() if local.states}
    times = set(dynamic.values())
    if len(times) > 1:
        found = ", ".join(f"{name} {f'{dt:g} s' if dt else 'continuous'}" for name, dt in dynamic.items())
        raise InputError(
            "sampling times of the components",
            got=found,
            expected="all continuous, or all of one sampling time",
            remedy="linearise the two groups apart",
        )
    return times.pop() if times else 0.0


def _elements(system: System, parts: Sequence[Part], side: str) -> tuple[list[str], list[str]]:
    named = [
        (f"{part.name}.{element}", canonical_unit(port.unit))
        for part in parts
        for port in getattr(system.components[part.name], side)
        for element in port.elements
    ]
    return [name for name, _ in named], [unit for _, unit in named]


def _connections(system: System, names_u: list[str], names_y: list[str]) -> Matrix:
    row, column = ({name: i for i, name in enumerate(names)} for names in (names_u, names_y))
    K = np.zeros((len(names_u), len(names_y)))
    for link in system.links():
        K[row[link.target], column[link.source]] = link.gain
    return K


def _free(names: list[str], fed: set[str]) -> list[int]:
    return [i for i, name in enumerate(names) if name not in fed]


def _solved(loop: Matrix, right: Matrix) -> Matrix:
    if np.linalg.cond(loop) > 1.0 / np.finfo(np.float64).eps:
        raise InputError(
            "linear model",
            got="an algebraic loop whose gain is one",
            expected="loops with a unique solution",
            remedy="break the loop, or linearise at another point",
        )
    return np.linalg.solve(loop, right).astype(np.float64, copy=False)
