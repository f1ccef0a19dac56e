"""Waiting for a supervised process: as long as it gets on, and no longer."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim.supervisor.board import Board, new_memory
from co_sim.supervisor.deaths import cause_of, memory_hint
from co_sim.supervisor.messages import Done, Order
from co_sim.supervisor.process import Exit, Process
from co_sim.supervisor.processes import available_memory, memory_of
from co_sim.supervisor.watchdog import LOOK, Watchdog

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.errors import RunError
    from co_sim.supervisor.board import Format
    from co_sim.supervisor.deaths import Crew
    from co_sim.supervisor.watchdog import Limits

__all__ = ["Attention", "Circumstances"]


@dataclass(frozen=True, slots=True)
class Circumstances:
    """Of a run, for those who watch it.

    Parameters
    ----------
    crew : who takes part. limits : how long things may take. time_of : time of a step of the master, s.
    sizes : of the board. memory : limit of the memory, bytes; ``None`` leaves it to the machine.
    echo : whether to print what the process prints.
    """

    crew: Crew
    limits: Limits
    time_of: Callable[[int], float]
    sizes: Format
    memory: int | None
    echo: bool


class Attention:
    """A process at work, and the eye on it.

    Parameters
    ----------
    circumstances : of its run. payload : the pickled arguments of its master.
    """

    def __init__(self, circumstances: Circumstances, payload: bytes) -> None:
        self._circumstances = circumstances
        self._limit = circumstances.memory or available_memory()
        self._used = 0
        self._measured = 0.0
        self._watchdog = Watchdog()
        memory = new_memory(circumstances.sizes.size)
        try:
            self.board = Board(memory, circumstances.sizes)
            self.process = Process(memory, echo=circumstances.echo)
        finally:
            os.close(memory)
        here = str(Path.cwd())
        self.process.send(Order(list(sys.path), here, dict(os.environ), self._limit, circumstances.sizes))
        self.process.send_bytes(payload)

    def look(self) -> list[object]:
        """Return the messages that have come, after a short time at most.

        Raises
        ------
        RunError
            If the process is dead and has left no message, or was killed because it did not get on.
        """
        process = self.process
        messages = process.look(LOOK)
        if process.alive:
            self._measure()
            self._check_pulse()
        elif not messages:
            process.kill()
            raise self._death(cause_of(process.exit or Exit(None, 0)))
        return messages

    def until_done(self) -> Done:
        """Return how the present task ended."""
        while True:
            for message in self.look():
                if isinstance(message, Done):
                    return message

    def _measure(self) -> None:
        at_first, _ = self.board.memory
        now = time.monotonic()
        if at_first and now - self._measured > LOOK:
            self._measured = now
            self._used = max(self._used, memory_of(self.process.pid)[0] - at_first)

    def _check_pulse(self) -> None:
        here, progress = self._circumstances, self.board.progress
        limit = here.limits.of(progress.phase, here.crew.member(progress))
        if self._watchdog.see(self.board.pulse) > limit:
            self.process.kill()
            raise self._death(f"nothing happened for {limit:g} s {{when}}, so that its process was killed")

    def _death(self, cause: str) -> RunError:
        here, progress = self._circumstances, self.board.progress
        _, at_first = self.board.memory
        resident = self.process.exit.resident - at_first if self.process.exit and at_first else 0
        hint = memory_hint(max(self._used, resident), self._limit)
        return here.crew.error(progress, here.time_of(progress.step), cause, hint, self.process.tail.lines)
