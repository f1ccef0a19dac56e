"""The server: a process that has everything imported, and forks a new one for each supervised run.

It has one thread and takes part in no run, so that forking it is safe, whatever threads and libraries the
user's process has. It asks nobody's leave to die: when its owner is gone, it ends all its runs, removes
their folders and goes.

Its owner sends it one byte for each run, with four descriptors: the run's channel, its memory, its log and a
*lifeline*. On the lifeline the server tells the process number and the folder of the run, and in the end how
it ended, a line of JSON each; when the owner writes anything on it, or closes it, the run is killed.
"""

from __future__ import annotations

import gc
import json
import os
import selectors
import shutil
import signal
import socket
import tempfile
import warnings
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from co_sim.component import Port
from co_sim.master import Master
from co_sim.signals import Constant
from co_sim.supervisor import child
from co_sim.system import System

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["main"]


@dataclass(frozen=True, slots=True)
class _Run:
    pid: int
    lifeline: socket.socket
    folder: str


def main(descriptor: int, modules: Sequence[str]) -> None:
    """Serve the owner of a socket until it is gone, with these modules imported."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _warm_up(modules)
    server = _Server(socket.socket(fileno=descriptor))
    try:
        server.serve()
    finally:
        server.end_all()


def _warm_up(modules: Sequence[str]) -> None:
    """Have the modules and the compiled loop loaded, so that no run needs to."""
    for name in modules:
        with suppress(ImportError):  # Whoever needs it will be told.
            import_module(name)
    with Master(System({"constant": Constant([0.0], [Port("value")])}, step=1.0)) as master:
        master.run(n_steps=1)
    gc.collect()
    # What the garbage collector does not touch, the processes keep sharing.
    gc.freeze()


class _Server:
    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._runs: dict[int, _Run] = {}
        self._wake, waker = socket.socketpair()
        self._waker = waker
        for end in (self._wake, waker):
            end.setblocking(False)
        signal.set_wakeup_fd(waker.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        self._selector = selectors.DefaultSelector()
        self._selector.register(control, selectors.EVENT_READ)
        self._selector.register(self._wake, selectors.EVENT_READ)

    def serve(self) -> None:
        """Start and end runs until the owner is gone."""
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is self._control:
                    if not self._take_order():
                        return
                elif key.fileobj is self._wake:
                    with suppress(BlockingIOError):
                        self._wake.recv(4096)
                    self._reap()
                elif key.fd in {run.lifeline.fileno() for run in self._runs.values()}:
                    self._kill(key.data)
                    self._selector.unregister(key.fileobj)

    def end_all(self) -> None:
        """Kill what is left."""
        for run in list(self._runs.values()):
            self._kill(run.pid)
            os.waitpid(run.pid, 0)
            shutil.rmtree(run.folder, ignore_errors=True)

    def _take_order(self) -> bool:
        message, descriptors, _, _ = socket.recv_fds(self._control, 1, 4)
        if not message:
            return False
        channel, memory, log, lifeline = descriptors
        folder = tempfile.mkdtemp(prefix="co_sim_")
        server = os.getpid()
        with warnings.catch_warnings():
            # The threads of numerical libraries are idle here, and prepared for a fork.
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
        if pid == 0:
            self._become_run(channel, memory, log, lifeline, folder, server)
        for descriptor in (channel, memory, log):
            os.close(descriptor)
        run = _Run(pid, socket.socket(fileno=lifeline), folder)
        self._runs[pid] = run
        self._selector.register(run.lifeline, selectors.EVENT_READ, pid)
        _tell(run, {"pid": pid, "folder": folder})
        return True

    def _become_run(
        self, channel: int, memory: int, log: int, lifeline: int, folder: str, server: int
    ) -> None:
        code = 70
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            self._selector.close()
            os.close(lifeline)
            for end in (self._control, self._wake, self._waker, *(r.lifeline for r in self._runs.values())):
                end.close()
            child.main(channel, memory, log, folder, server)
            code = 0
        finally:
            os._exit(code)

    def _kill(self, pid: int) -> None:
        """Kill a run and what it has started; it is not reaped yet, so that its number is its own."""
        for kill in (os.killpg, os.kill):
            with suppress(ProcessLookupError, PermissionError):
                kill(pid, signal.SIGKILL)

    def _reap(self) -> None:
        for pid, run in list(self._runs.items()):
            if os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                continue
            self._kill(pid)
            _, status, usage = os.wait4(pid, 0)
            del self._runs[pid]
            with suppress(KeyError):
                self._selector.unregister(run.lifeline)
            shutil.rmtree(run.folder, ignore_errors=True)
            code = os.waitstatus_to_exitcode(status)
            _tell(run, {"code": code, "resident": usage.ru_maxrss * 1024})
            run.lifeline.close()


def _tell(run: _Run, what: dict[str, object]) -> None:
    with suppress(OSError):
        run.lifeline.sendall(json.dumps(what).encode() + b"\n")
