"""The state of a whole system, in memory and in a file.

A file is an archive of numpy arrays without pickled objects: reading one runs no code. It holds what it was
made from, and is refused by a system that differs in its signals, step or coupling. Parameters are not
compared: to branch into a future with another parameter is a use, not a mistake.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from co_sim.component import StateError
from co_sim.errors import InputError
from co_sim.files import checked_path, whole_file
from co_sim.texts import number_of, text_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.kernel import Matrix
    from co_sim.system import System

__all__ = ["Snapshot", "TextPlaces", "read_snapshot", "write_snapshot"]

_FORMAT = 1


class TextPlaces(NamedTuple):
    """Which outputs and which inputs are texts."""

    signals: NDArray[np.intp]
    inputs: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of a system after `k` steps.

    Parameters
    ----------
    k : steps made.
    rows : outputs now (last row) and before, as far back as the coupling looks.
    u : inputs as last set; a slow component is in the middle of its step with these.
    states : of the components, by name.
    begun : whether the first step has been made.
    scale : largest magnitudes so far, of iterated coupling; empty without.
    """

    k: int
    rows: Matrix
    u: Vector
    states: Mapping[str, object]
    begun: bool
    scale: Vector


def write_snapshot(path: Path, snapshot: Snapshot, system: System, t0: float, places: TextPlaces) -> None:
    """Write a snapshot to a file that is whole or not there."""
    path = checked_path(path)
    header = {
        "k": snapshot.k,
        "begun": snapshot.begun,
        "texts": _texts(snapshot, places),
        **_made_from(system, t0),
    }
    arrays: dict[str, Any] = {
        "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8),
        "rows": snapshot.rows,
        "u": snapshot.u,
        "scale": snapshot.scale,
    }
    for name, component in system.components.items():
        try:
            data = component.serialize(snapshot.states[name])
        except StateError as error:
            raise _unwritten(name, error) from error
        arrays[f"state.{name}"] = np.frombuffer(data, dtype=np.uint8)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def read_snapshot(path: Path, system: System, t0: float, places: TextPlaces) -> Snapshot:
    """Read a file of `write_snapshot` for a started system.

    Raises
    ------
    InputError
        If it cannot be read, or was made from another system.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        header = json.loads(arrays["header"].tobytes())
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"state {path}",
            got=str(error) or type(error).__name__,
            expected="a file that write_state has made",
            remedy="check the path",
        ) from error
    _compare(path, header, _made_from(system, t0))
    states = {}
    for name, component in system.components.items():
        try:
            states[name] = component.deserialize(arrays[f"state.{name}"].tobytes())
        except StateError as error:
            raise _unwritten(name, error) from error
    rows, u = arrays["rows"], arrays["u"]
    _renumber(header["texts"], rows, u, places)
    return Snapshot(header["k"], rows, u, states, header["begun"], arrays["scale"])


def _made_from(system: System, t0: float) -> dict[str, Any]:
    """Return what must agree between the systems that write and read a state."""
    return {
        "format": _FORMAT,
        "components": list(system.components),
        "signals": [signal.name for signal in system.signals],
        "inputs": [
            f"{name}.{element}"
            for name, component in system.components.items()
            for port in component.inputs
            for element in port.elements
        ],
        "start time": t0,
        "step": system.step,
        "rates": dict(system.rates),
        "algorithm": system.coupling.algorithm,
        "order": system.coupling.order,
    }


def _compare(path: Path, header: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    for what, value in expected.items():
        if header.get(what) != value:
            raise InputError(
                f"state {path}: {what}",
                got=_short(header.get(what)),
                expected=_short(value),
                remedy="read it into the system that it was made from",
            )


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def _texts(snapshot: Snapshot, places: TextPlaces) -> dict[str, list[Any]]:
    """Return the texts among outputs and inputs: the numbers that stand for them hold in one process only."""
    return {
        "rows": [[text_of(number) for number in row[places.signals]] for row in snapshot.rows],
        "u": [text_of(number) for number in snapshot.u[places.inputs]],
    }


def _renumber(texts: Mapping[str, list[Any]], rows: Matrix, u: Vector, places: TextPlaces) -> None:
    """Put the numbers in that stand for the texts in this process."""
    for row, row_texts in zip(rows, texts["rows"], strict=True):
        row[places.signals] = [number_of(text) for text in row_texts]
    u[places.inputs] = [number_of(text) for text in texts["u"]]


def _unwritten(name: str, error: StateError) -> InputError:
    return InputError(
        f"state of {name}",
        got=str(error),
        expected="a component whose state can be written and read",
        remedy="keep the state in memory with save(), or use another component",
    )
