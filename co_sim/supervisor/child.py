"""The supervised process: builds the master and does what the supervisor says."""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import resource
import signal
import sys
import time as clocks
import warnings
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from co_sim import fmu_archive
from co_sim.master import Master
from co_sim.supervisor.board import Board, SharedTable
from co_sim.supervisor.deaths import Crew
from co_sim.supervisor.messages import Done, Ended, Full, Order, Packed, Rows, Task
from co_sim.supervisor.pickling import dumps
from co_sim.supervisor.processes import memory_of
from co_sim.table import PHASE, Phase
from co_sim.texts import listen
from co_sim.witness import Witness, set_witness

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.errors import RunError
    from co_sim.system import Signal

__all__ = ["main"]

_PR_SET_PDEATHSIG = 1
#: Shortest time between two messages of new rows, s, unless observers wait for them.
_NEWS = 0.01


class _Stopped(BaseException):
    """The supervisor wants the run to end."""


class _Publisher:
    """An observer that declares rows complete and wakes the supervisor."""

    def __init__(self, board: Board, connection: Connection[Any, Any]) -> None:
        self._board, self._connection = board, connection
        self._last = 0.0
        self.master: Master | None = None
        #: The last run's end if a component wanted to end the whole process.
        self.exit: RunError | None = None

    def begin(self, signals: tuple[Signal, ...], t0: float, h: float, n_steps: int) -> None:
        """Tell where the first row is."""
        assert self.master is not None
        table = self.master.table
        assert isinstance(table, SharedTable)
        self._board.begin_run(table.segment, table.row, self.master.k)

    def observe(self, k: int, time: Vector, values: NDArray[Any]) -> None:
        """Tell of new rows, from time to time."""
        self._board.published = k + len(time)
        now = clocks.monotonic()
        if self._board.sizes.prompt or now - self._last > _NEWS:
            self._connection.send(Rows())
            self._last = now
        if self._board.stop:
            raise _Stopped

    def end(self, error: BaseException | None) -> None:
        """Tell of the end, before components are closed: that may be the end of this process."""
        if error and not isinstance(error, Exception | _Stopped):
            error = self.exit = self._exit_of(error)
        self._connection.send(Ended(Packed.of(error) if error else None))

    def _exit_of(self, error: BaseException) -> RunError:
        assert self.master is not None
        master, progress = self.master, self._board.progress
        crew = Crew.of(master.system, master.parts)
        reason = f"{type(error).__name__}: {error} {{when}}"
        exit_error = crew.error(progress, master.time, reason, "", ())
        exit_error.__cause__ = error
        return exit_error

    def wait(self, rows: int) -> None:
        """Wait until the supervisor has consumed so many rows."""
        if self._board.consumed < rows:
            self._connection.send(Full(rows))
            self._connection.recv()


class _Reporter(Witness):
    """Tells of calls on the board, and of log messages on the standard error stream, which is a pipe."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def calls(self, function: str) -> None:
        """Tell of a call."""
        self._board.tell_function(function)

    def logs(self, instance: str, status: str, message: str) -> None:
        """Print a message."""
        os.write(2, f"{instance}: {status}: {message}\n".encode())


def main(channel: int, memory: int, log: int, folder: str, parent: int) -> None:
    """Be a supervised process; the descriptors and the folder are its own, `parent` started it."""
    _die_with(parent)
    _redirect(log)
    connection: Connection[Any, Any] = Connection(channel)
    order: Order = connection.recv()
    board = Board(memory, order.sizes)
    os.close(memory)
    fmu_archive.set_place(folder)
    set_witness(_Reporter(board))
    with suppress(EOFError):  # The supervisor is gone.
        try:
            publisher = _publisher(order, connection, board)
        except BaseException as error:
            connection.send(Done(0, [], Packed.of(error)))
            return
        connection.send(Done(0, [], None))
        while _do(connection.recv(), publisher, connection):
            pass


def _publisher(order: Order, connection: Connection[Any, Any], board: Board) -> _Publisher:
    """Prepare this process and build the master, with its observer."""
    board.integers[PHASE] = Phase.PREPARING
    sys.path[:] = order.path
    os.environ.clear()
    os.environ.update(order.environment)
    os.chdir(order.directory)
    arguments = pickle.loads(connection.recv_bytes())
    if board.sizes.texts:
        listen(board.tell_text)
    publisher = _Publisher(board, connection)
    table = partial(SharedTable, board, publisher.wait)
    publisher.master = Master(**arguments, observers=[publisher], table=table)
    _limit_memory(board, order.memory)
    return publisher


def _do(task: Task, publisher: _Publisher, connection: Connection[Any, Any]) -> bool:
    """Do a task; return whether another may follow."""
    packed = None
    master = publisher.master
    assert master is not None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            getattr(master, task.method)(**task.arguments)
        except BaseException as error:
            packed = Packed.of(publisher.exit or error)
    told = [(each.category, str(each.message)) for each in caught]
    connection.send_bytes(dumps(Done(master.k, told, packed)))
    return packed is None and task.method != "close"


def _die_with(parent: int) -> None:
    """Have the system end this process, and no other, together with its parent."""
    os.setpgid(0, 0)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    # If the memory of the machine is exhausted, this process is the first to go.
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")
    # A crash is no surprise here, and an image of the memory for each would fill the disk.
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def _redirect(log: int) -> None:
    """Send all that is printed into the pipe, at once: what a dead process has in its buffers is lost."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(nothing)
    os.close(log)
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        raw = io.FileIO(descriptor, "w", closefd=False)
        setattr(sys, name, io.TextIOWrapper(raw, errors="replace", write_through=True))
    library = ctypes.CDLL(None)
    line_by_line = 1
    with suppress(ValueError):  # A C library that has no such variable.
        library.setvbuf(ctypes.c_void_p.in_dll(library, "stdout"), None, line_by_line, 0)


def _limit_memory(board: Board, limit: int) -> None:
    """Refuse allocations beyond what there is and `limit` (bytes)."""
    board.memory = memory_of(os.getpid())
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = board.memory[0] + limit
    resource.setrlimit(
        resource.RLIMIT_DATA, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most)
    )
