"""A supervised process as its supervisor sees it, and the server that starts it."""

from __future__ import annotations

import atexit
import json
import os
import select
import shutil
import socket
import subprocess
import sys
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any

from co_sim.supervisor.tail import Tail

__all__ = ["Exit", "Process", "start_server"]

_PIPE_SIZE = 2**20
#: How long a killed process may take to disappear, s.
_LAST_MOMENTS = 5.0
_SERVE = (
    "import sys; sys.path[:] = {path!r}; "
    "from co_sim.supervisor.server import main; main({descriptor}, {modules!r})"
)


class _Server:
    """The server of this process; started at the first need."""

    def __init__(self) -> None:
        self._control: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = Lock()
        self._modules: tuple[str, ...] = ()

    def forget(self) -> None:
        """Know no server: after a fork it is that of the parent."""
        if self._control is not None:
            self._control.close()
        self._control = self._process = None
        self._lock = Lock()

    def stop(self) -> None:
        """End the server and all that it has started."""
        if self._control is not None and self._process is not None:
            self._control.close()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_MOMENTS)

    def start(self, modules: tuple[str, ...]) -> None:
        """Start the server, if it is not running, with these modules imported."""
        with self._lock:
            self._modules = modules or self._modules
            self._start()

    def _start(self) -> socket.socket:
        if self._control is not None and self._process is not None and self._process.poll() is None:
            return self._control
        ours, theirs = socket.socketpair()
        with theirs:
            command = _SERVE.format(path=sys.path, descriptor=theirs.fileno(), modules=self._modules)
            self._process = subprocess.Popen(
                [sys.executable, "-c", command],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                # Ctrl-C is for this process; it ends the others in good order.
                start_new_session=True,
            )
        if self._control is not None:
            self._control.close()
        self._control = ours
        return ours

    def order(self, descriptors: list[int]) -> None:
        """Have a process started that gets the descriptors."""
        with self._lock:
            socket.send_fds(self._start(), [b"+"], descriptors)


_SERVER = _Server()
atexit.register(_SERVER.stop)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_SERVER.forget)


def start_server(*modules: str) -> None:
    """Start the server if it is not running; it needs a second, but not from this process.

    Parameters
    ----------
    modules : what the server imports when it starts, so that no run has to: what the components need that are
        sent to it. They must start no threads.
    """
    _SERVER.start(modules)


@dataclass(frozen=True, slots=True)
class Exit:
    """How a process ended.

    Parameters
    ----------
    code : exit code, or minus the number of the signal that ended it; ``None`` if nobody knows.
    resident : largest resident memory, bytes.
    """

    code: int | None
    resident: int


class Process:
    """A process forked by the server, with a channel to it and the tail of its log.

    Parameters
    ----------
    memory : descriptor of the memory to share. echo : whether to print what it prints, too.
    """

    def __init__(self, memory: int, *, echo: bool) -> None:
        ours, theirs = socket.socketpair()
        lifeline, other = socket.socketpair()
        log, log_end = os.pipe()
        _enlarge(log_end)
        with theirs, other:
            try:
                _SERVER.order([theirs.fileno(), memory, log_end, other.fileno()])
            finally:
                os.close(log_end)
        self.channel: Connection[Any, Any] = Connection(ours.detach())
        self.tail = Tail(log, echo=echo)
        self.pid = 0
        self.exit: Exit | None = None
        self._lifeline = lifeline
        self._lifeline.setblocking(False)
        self._folder = ""
        self._poll = select.poll()
        for descriptor in (self.channel.fileno(), log, self._lifeline.fileno()):
            self._poll.register(descriptor, select.POLLIN)
        self._told = b""
        self._messages: deque[object] = deque()

    @property
    def alive(self) -> bool:
        """Whether it is there and can be talked to."""
        return self.exit is None and not self.channel.closed

    def look(self, seconds: float) -> list[object]:
        """Wait so long for anything to happen; return the messages that have come."""
        ready = {fd for fd, _ in self._poll.poll(1e3 * seconds)}
        if self.tail.descriptor in ready:
            self._read_tail()
        if self._lifeline.fileno() in ready:
            self._listen()
        if not self.channel.closed and self.channel.fileno() in ready:
            self._receive()
        messages = list(self._messages)
        self._messages.clear()
        return messages

    def send(self, message: object) -> None:
        """Send a message; one that comes too late is lost."""
        with suppress(OSError):
            self.channel.send(message)

    def send_bytes(self, data: bytes) -> None:
        """Send a pickled message."""
        with suppress(OSError):
            self.channel.send_bytes(data)

    def kill(self) -> None:
        """Kill the process and wait until it is gone."""
        with suppress(OSError):
            self._lifeline.send(b"-")
        deadline = time.monotonic() + _LAST_MOMENTS
        while self.exit is None and time.monotonic() < deadline:
            self._messages.extend(self.look(0.05))
        self._read_tail()

    def close(self) -> None:
        """Kill the process if it lives, and release everything."""
        if self.exit is None:
            self.kill()
        self.channel.close()
        self._lifeline.close()
        self.tail.close()
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _read_tail(self) -> None:
        if self.tail.open and not self.tail.read():
            self._poll.unregister(self.tail.descriptor)

    def _receive(self) -> None:
        try:
            while self.channel.poll():
                self._messages.append(self.channel.recv())
        except Exception:  # Its end, or a process that writes where it should not.
            self._poll.unregister(self.channel.fileno())
            self.channel.close()

    def _listen(self) -> None:
        """Take what the server says."""
        try:
            data = self._lifeline.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._poll.unregister(self._lifeline.fileno())
            self.exit = self.exit or Exit(None, 0)
            return
        *lines, self._told = (self._told + data).split(b"\n")
        for line in lines:
            told = json.loads(line)
            if "pid" in told:
                self.pid, self._folder = told["pid"], told["folder"]
            else:
                self.exit = Exit(told["code"], told["resident"])


def _enlarge(pipe: int) -> None:
    """Let a pipe hold more, so that one who prints need not wait for us; where the system can do that."""
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
