"""Tasks in processes of their own, which tell how far they are."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

__all__ = ["run_tasks"]


@dataclass(frozen=True, slots=True)
class _Running:
    index: int
    process: BaseProcess


def run_tasks(
    tasks: Sequence[Callable[[Callable[[float], None]], Any]],
    progress: Callable[[int, float], None],
    processes: int,
) -> list[Any]:
    """Run each task with a function that takes its share done, and return their results in order.

    Parameters
    ----------
    tasks : started in this order; they and their results must be picklable.
    progress : called here with the index of a task and its share done.
    processes : how many run at once; 1 runs them here, one after the other.

    Raises
    ------
    Exception
        That of the first task that fails; the others are ended.
    RuntimeError
        If a process ends without a result.
    """
    if processes == 1:
        return [task(lambda share, i=i: progress(i, share)) for i, task in enumerate(tasks)]  # type: ignore[misc]
    results: list[Any] = [None] * len(tasks)
    waiting = list(enumerate(tasks))[::-1]
    running: dict[Any, _Running] = {}
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                index, task = waiting.pop()
                connection, process = _started(task)
                running[connection] = _Running(index, process)
            for ready in wait(list(running)):
                _heed(ready, running, results, progress)
    finally:
        for connection, left in running.items():
            left.process.terminate()
            left.process.join()
            connection.close()
    return results


def _started(task: Callable[[Callable[[float], None]], Any]) -> tuple[Connection, BaseProcess]:
    # A forked child would inherit locks of threads that it does not have.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(task, theirs), daemon=True)
    process.start()
    theirs.close()
    return ours, process


def _heed(
    ready: Any, running: dict[Any, _Running], results: list[Any], progress: Callable[[int, float], None]
) -> None:
    """Take one message of a task: its share done, its result or its exception."""
    one = running[ready]
    try:
        kind, content = ready.recv()
    except EOFError:
        one.process.join()
        raise RuntimeError(f"task {one.index} ended with code {one.process.exitcode} and no result") from None
    if kind == "share":
        progress(one.index, content)
        return
    del running[ready]
    one.process.join()
    ready.close()
    if kind == "error":
        raise content
    results[one.index] = content


def _serve(task: Callable[[Callable[[float], None]], Any], connection: Connection) -> None:
    from threadpoolctl import threadpool_limits

    # Ctrl-C reaches every process of the terminal; the parent ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        # The processes share the cores, and the matrices are small.
        with threadpool_limits(1):
            result = task(lambda share: connection.send(("share", share)))
        connection.send(("result", result))
    except Exception as error:
        error.add_note(f"in a process of its own:\n{traceback.format_exc()}")
        connection.send(("error", error))
