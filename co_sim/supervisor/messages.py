"""What a supervised process and its supervisor tell each other."""

from __future__ import annotations

import pickle
import traceback
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from co_sim.supervisor.pickling import dumps

if TYPE_CHECKING:
    from co_sim.supervisor.board import Format

__all__ = ["ChildError", "Done", "Ended", "Full", "Order", "Packed", "Rows", "Task"]


class ChildError(Exception):
    """The traceback of an error in the supervised process, as the cause of the error."""

    def __str__(self) -> str:
        return f'in the supervised process\n"""\n{self.args[0]}"""'


@dataclass(frozen=True, slots=True)
class Packed:
    """An error on its way.

    Parameters
    ----------
    data : the pickled error. kind, text, trace : what is left of it where it cannot be unpickled.
    """

    data: bytes
    kind: str
    text: str
    trace: str

    @classmethod
    def of(cls, error: BaseException) -> Packed:
        """Pack an error."""
        try:
            data = dumps(error)
        except Exception:
            data = b""
        return cls(data, type(error).__name__, str(error), "".join(traceback.format_exception(error)))

    def unpacked(self) -> BaseException:
        """Return the error, with the traceback as its cause."""
        try:
            error: BaseException = pickle.loads(self.data)
        except Exception:
            error = RuntimeError(f"{self.kind}: {self.text}")
        error.__cause__ = ChildError(self.trace)
        return error


@dataclass(frozen=True, slots=True)
class Order:
    """How to prepare the process: module path, working directory and environment as here, and limits.

    Parameters
    ----------
    memory : that the run may allocate, bytes. sizes : of the board.
    """

    path: list[str]
    directory: str
    environment: dict[str, str]
    memory: int
    sizes: Format


@dataclass(frozen=True, slots=True)
class Task:
    """A method of the master to be called; ``close`` ends the process."""

    method: str
    arguments: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Rows:
    """There are new rows."""


@dataclass(frozen=True, slots=True)
class Full:
    """The run waits until `rows` rows are consumed."""

    rows: int


@dataclass(frozen=True, slots=True)
class Ended:
    """A run is over; its components will be closed now if there is an error."""

    error: Packed | None


@dataclass(frozen=True, slots=True)
class Done:
    """A task is done: the step that the master is at, what the task warned of, and what it raised."""

    step: int
    warnings: list[tuple[type[Warning], str]]
    error: Packed | None
