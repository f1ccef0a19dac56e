"""Each master in a process of its own: one that crashes or hangs is a line in the table, no more."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from masters.cases import Case
    from masters.contender import Trajectory

__all__ = ["FailedError", "Worker"]

#: Longest wait for an answer, s.
_PATIENCE = 300.0


class FailedError(Exception):
    """A master is not installed, cannot run the case, crashed or hangs; the text says which."""


class Worker:
    """A master in another process.

    Parameters
    ----------
    place : its module and class, such as ``"masters.ours:Compiled"``.
    """

    def __init__(self, place: str, case: Case) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, place, case), daemon=True)
        self._process.start()
        other.close()

    def ask(self, name: str, *arguments: Any, **named: Any) -> Any:
        """Call a method of the master and return its answer.

        Raises
        ------
        FailedError
            If there is none.
        """
        try:
            self._connection.send((name, arguments, named))
            if not self._connection.poll(_PATIENCE):
                self._process.kill()
                raise FailedError(f"no answer within {_PATIENCE:g} s")
            is_answer, answer = self._connection.recv()
        except (EOFError, BrokenPipeError, ConnectionResetError) as error:
            self._process.join()
            raise FailedError(f"its process ended with the code {self._process.exitcode}") from error
        if not is_answer:
            raise FailedError(answer)
        return answer

    def trajectory(self, n: int, *, record: bool) -> Trajectory:
        """Return the signals of `n` steps: all rows, or the last one if nothing is recorded."""
        self.ask("run", n, record=record)
        values: Trajectory = self.ask("trajectory")
        return values

    def close(self) -> None:
        """End the process."""
        if self._process.is_alive():
            self._connection.close()
        self._process.join(5.0)
        if self._process.is_alive():
            self._process.kill()


def _serve(connection: Connection, place: str, case: Case) -> None:
    """Answer until nobody asks any more."""
    # Masters that write to the terminal would spoil the table; what is wrong they also say in exceptions.
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    master: Any = None
    with tempfile.TemporaryDirectory() as folder:
        while True:
            try:
                name, arguments, named = connection.recv()
            except EOFError:
                return
            try:
                if master is None:
                    module, _, cls = place.partition(":")
                    master = getattr(importlib.import_module(module), cls)(case, Path(folder))
                answer = (True, getattr(master, name)(*arguments, **named))
            except Exception as error:
                answer = (False, _reason(error))
            connection.send(answer)


def _reason(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError):
        return f"{error.name} is not installed"
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0] if lines else ''}"
