"""Follows one run and shows its rows to the observers."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING

from co_sim.errors import RunError
from co_sim.supervisor.interrupts import Interrupts
from co_sim.supervisor.messages import Done, Ended, Full

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.kernel import Matrix
    from co_sim.supervisor.attention import Attention
    from co_sim.supervisor.messages import Packed

__all__ = ["follow"]

#: How long a run that shall stop may take for its last block and to close its components, s.
_GRACE = 2.0


def follow(attention: Attention, show: Callable[[int, Matrix], None]) -> Done:
    """Follow a run that has just been ordered, to its end.

    Parameters
    ----------
    show : is called with the number of the first row and the rows, in order and without gaps.

    Returns
    -------
    How the run ended.

    Raises
    ------
    RunError
        If the process died; all complete rows have been shown.
    KeyboardInterrupt
        After Ctrl-C; all complete rows have been shown, unless it was pressed twice.
    """
    following = _Following(attention, show)
    with Interrupts() as interrupts:
        try:
            while following.done is None and not interrupts.pending:
                following.go_on()
        except RunError:
            raise
        except BaseException:
            following.wind_up()
            raise
        if interrupts.pending:
            following.wind_up()
    assert following.done is not None
    return following.done


class _Following:
    def __init__(self, attention: Attention, show: Callable[[int, Matrix], None]) -> None:
        self.done: Done | None = None
        self._attention, self._board = attention, attention.board
        self._show = show
        self._shown = 0
        self._showing = False
        self._ended: Packed | None = None

    def go_on(self) -> None:
        """Wait for messages, and heed them."""
        try:
            messages = self._attention.look()
        except RunError as death:
            self._show_to(self._board.complete)
            if self._ended is None:
                raise
            error = self._ended.unpacked()
            error.add_note(f"while closing: {death}")
            raise error from error.__cause__
        self._show_to(self._board.published)
        for message in messages:
            match message:
                case Full():
                    self._attention.process.send("go on")
                case Ended():
                    self._ended = message.error
                case Done():
                    self.done = message

    def wind_up(self) -> None:
        """Have the run stop, within a short time; show what it has made, unless an observer has failed."""
        if self._showing:
            self._show = _not_at_all
        self._board.stop = True
        deadline = time.monotonic() + _GRACE
        # That it is dead is no error: it was to end.
        with suppress(Exception):
            while self.done is None and time.monotonic() < deadline:
                self.go_on()
        self._attention.process.kill()
        if self.done is None:
            self._show_to(self._board.complete)

    def _show_to(self, end: int) -> None:
        if self._shown == 0 and end > 1:
            self._show_to(1)  # the initial values by themselves, as the master shows them
        begin, self._shown = self._shown, max(end, self._shown)
        for rows in self._board.rows(begin, end):
            rows.flags.writeable = False
            self._showing = True
            self._show(begin, rows)
            self._showing = False
            begin += len(rows)
        self._board.consumed = self._shown


def _not_at_all(first: int, rows: Matrix) -> None:
    """Show nothing."""
