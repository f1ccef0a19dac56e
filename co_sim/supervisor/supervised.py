"""The supervisor: same use as `co_sim.Master`, but the components run in a process of their own."""

from __future__ import annotations

import sys
import warnings
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from co_sim.errors import Fault, InputError, RunError, suggestion
from co_sim.layout import lay_out
from co_sim.master import checked_count, ending, last_step, longest_block, require_within, step_count
from co_sim.observers import Recorder
from co_sim.supervisor.attention import Attention, Circumstances
from co_sim.supervisor.board import Format
from co_sim.supervisor.deaths import Crew
from co_sim.supervisor.following import follow
from co_sim.supervisor.messages import Task
from co_sim.supervisor.pickling import dumps
from co_sim.supervisor.process import start_server
from co_sim.supervisor.watchdog import Limits
from co_sim.texts import number_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from co_sim.component import Vector
    from co_sim.kernel import Matrix
    from co_sim.observers import Observer
    from co_sim.supervisor.messages import Done
    from co_sim.system import System

__all__ = ["Supervised", "run"]


class Supervised:
    """Runs a system in a process of its own, under supervision.

    Whatever a component does there, this process lives, and a run that ends early is a `RunError` with the
    component, its time and step, and the last lines that it logged or printed; the observers have seen all
    complete steps. Observers are called in this process.

    Use it as a context manager, or call `close`.

    Parameters
    ----------
    system : what to run; checked here. Its components are sent to the other process and never started here.
    t0 : start time, s.
    h : communication step, s, instead of the system's own.
    observers : see the signals of each `run`, in this order.
    timeout : longest time that a component may take for one step, s.
    start_timeout : longest time for anything else that it does: to be loaded, to initialise, to be closed, s.
    timeouts : other times for single components, by name, for both.
    memory_limit : bytes that the process may allocate; ``None``: four fifths of what is free when it starts.
    echo : print what the components print, on the standard error stream.
    stop_time, compiled, quiet : as of `Master`.

    Raises
    ------
    InputError
        If the system has faults (all are told) or cannot be sent to another process, or a time or the
        limit is not a positive number.
    """

    def __init__(
        self,
        system: System,
        t0: float = 0.0,
        h: float | None = None,
        observers: Sequence[Observer] = (),
        *,
        timeout: float = 10.0,
        start_timeout: float = 60.0,
        timeouts: Mapping[str, float] = MappingProxyType({}),
        memory_limit: int | None = None,
        echo: bool = False,
        stop_time: float | None = None,
        compiled: bool = True,
        quiet: bool = False,
    ) -> None:
        if sys.platform != "linux":
            raise InputError(
                "supervised run",
                got=f"the system {sys.platform}",
                expected="linux",
                remedy="run the system in this process: Master",
            )
        given = {"timeout": timeout, "start_timeout": start_timeout, **timeouts}
        if memory_limit is not None:
            given["memory_limit"] = memory_limit
        _check(given, timeouts, system)
        start_server()
        if h is not None:
            system = replace(system, step=h)
        system.check()
        self.system = system
        self.t0, self.h, self.k = t0, system.step, 0
        self.observers = tuple(observers)
        self.signals = system.signals
        self._last_step = last_step(t0, stop_time, self.h)
        self._arguments = {
            "system": system,
            "t0": t0,
            "stop_time": stop_time,
            "compiled": compiled,
            "quiet": quiet,
        }
        limits = Limits(timeout, start_timeout, dict(timeouts))
        layout = lay_out(system)
        #: Columns of texts, and the numbers here of the texts that have been told there.
        self._text_columns = np.flatnonzero([signal.kind == "string" for signal in self.signals])
        self._text_numbers = [number_of("")]
        sizes = Format.of(
            layout.history,
            len(self.signals),
            longest_block(self.observers),
            texts=self._text_columns.size > 0,
        )
        crew = Crew.of(system, layout.parts)
        self._circumstances = Circumstances(crew, limits, self._time_of, sizes, memory_limit, echo)
        self._attention: Attention | None = None
        self._closed = False
        self._output: tuple[str, ...] = ()
        self._values = np.full(len(self.signals), np.nan)

    @property
    def time(self) -> float:
        """Present time, s: ``t0 + k*h``."""
        return self.t0 + self.k * self.h

    @property
    def values(self) -> Vector:
        """Outputs at the end of the last run, in the order of `signals`; nan before the first run."""
        return self._values.copy()

    @property
    def output(self) -> tuple[str, ...]:
        """The last lines that the components logged or printed."""
        return self._attention.process.tail.lines if self._attention else self._output

    def run(self, duration: float | None = None, *, n_steps: int | None = None) -> None:
        """Advance by `duration` or by `n_steps` and show every step to the observers; see `Master.run`.

        An interrupt (Ctrl-C) ends the run at the next block of steps; the observers have then seen all
        complete steps. A second one ends it at once.

        Parameters
        ----------
        duration : s, a multiple of the step.
        n_steps : instead of `duration`.

        Raises
        ------
        InputError
            If the step does not divide `duration`, an observer refuses, or the values do not settle.
        RunError
            If a component fails, an output is not finite, a signal grows beyond all bounds, or the process
            dies, hangs or uses too much memory.

        Warns
        -----
        CouplingWarning
            If a signal was still growing when the run ended.
        """
        if (duration is None) == (n_steps is None):
            raise TypeError("give either duration or n_steps")
        count = checked_count(n_steps) if duration is None else step_count(duration, self.h)
        require_within(self.k + count, self._last_step, self.h)
        try:
            with ExitStack() as ends:
                for observer in self.observers:
                    observer.begin(self.signals, self.time, self.h, count)
                    ends.push(ending(observer))
                attention = self._opened()
                attention.process.send(Task("run", {"n_steps": count}))
                begin = self.k
                done = follow(attention, partial(self._show, begin))
                self._finish(done)
        except BaseException as error:
            self._close_after(error)
            raise
        for category, text in done.warnings:
            warnings.warn(text, category, stacklevel=2)

    def write_state(self, path: Path) -> None:
        """Write the present state to a file; see `Master.write_state`."""
        self._do(Task("write_state", {"path": path.absolute()}))

    def read_state(self, path: Path) -> None:
        """Go to the state in a file of `write_state`; see `Master.read_state`."""
        self._do(Task("read_state", {"path": path.absolute()}))

    def close(self) -> None:
        """Close all components and end the process; safe to call twice.

        Raises
        ------
        RunError
            If a component cannot be closed, or the process dies of it.
        """
        self._closed = True
        attention = self._attention
        if attention is None:
            return
        try:
            if attention.process.alive:
                attention.process.send(Task("close"))
                self._finish(attention.until_done())
        finally:
            self._attention = None
            self._output = attention.process.tail.lines
            attention.process.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close_after(error)

    def _opened(self) -> Attention:
        """Return the process with its master, which does not start anything yet."""
        if self._closed:
            raise RuntimeError("this run is closed; build a new one")
        if self._attention is None:
            self._attention = Attention(self._circumstances, _packed(self._arguments))
            self._finish(self._attention.until_done())
        return self._attention

    def _do(self, task: Task) -> None:
        try:
            attention = self._opened()
            attention.process.send(task)
            self._finish(attention.until_done())
        except BaseException as error:
            self._close_after(error)
            raise

    def _finish(self, done: Done) -> None:
        self.k = done.step
        if done.error is None:
            return
        assert self._attention is not None
        self._attention.process.kill()  # It has closed its components, and has nothing left to do.
        error = done.error.unpacked()
        if isinstance(error, RunError):
            error.log = error.log or self._attention.process.tail.lines
        raise error

    def _show(self, begin: int, first: int, rows: Matrix) -> None:
        """Show rows to the observers; `first` is their number in the run that began at step `begin`."""
        step = begin + first
        times = np.arange(step, step + len(rows), dtype=np.float64)
        times *= self.h
        times += self.t0
        if self._text_columns.size:
            rows = self._translated(rows)
        self._values[:] = rows[-1]
        self.k = step + len(rows) - 1
        for observer in self.observers:
            observer.observe(first, times, rows)

    def _translated(self, rows: Matrix) -> Matrix:
        """Return a copy of rows with the numbers that texts have in this process."""
        assert self._attention is not None
        self._text_numbers += map(number_of, self._attention.board.new_texts())
        rows = rows.copy()
        there = rows[:, self._text_columns].astype(np.int64)
        rows[:, self._text_columns] = np.array(self._text_numbers)[there]
        rows.flags.writeable = False
        return rows

    def _time_of(self, step: int) -> float:
        return self.t0 + step * self.h

    def _close_after(self, error: BaseException | None) -> None:
        """Close; if an error is under way, a second one becomes a note to it instead of hiding it."""
        if self._attention and error is not None and not isinstance(error, Exception):
            self._attention.process.kill()  # Who interrupts does not want to wait.
        try:
            self.close()
        except Exception as second:
            if error is None:
                raise
            error.add_note(f"while closing: {second}")


def run(
    system: System,
    duration: float,
    *,
    t0: float = 0.0,
    h: float | None = None,
    observers: Sequence[Observer] = (),
    **options: Any,
) -> Recorder:
    """Run a system under supervision, once, and return the record of all its signals.

    Parameters
    ----------
    system, t0, h, observers : as of `Supervised`. duration : s.
    options : the other parameters of `Supervised`.

    Raises
    ------
    InputError
        See `Supervised`.
    RunError
        See `Supervised.run`; its `record` has the signals of all complete steps.
    """
    recorder = Recorder()
    options.setdefault("stop_time", t0 + duration)
    with Supervised(system, t0, h, [recorder, *observers], **options) as supervised:
        try:
            supervised.run(duration)
            supervised.close()
        except RunError as error:
            error.record = recorder
            raise
    return recorder


def _packed(arguments: Mapping[str, object]) -> bytes:
    try:
        return dumps(arguments)
    except Exception as error:
        raise InputError(
            "system",
            got=f"a part that cannot be sent to another process ({type(error).__name__}: {error})",
            expected="components that can be pickled before they are started",
            remedy="open files, locks and sockets in `start`, or run it in this process: Master",
        ) from error


def _check(limits: Mapping[str, float], own: Mapping[str, float], system: System) -> None:
    faults = [
        Fault(f"limit {name}", repr(value), "a positive number", "correct it")
        for name, value in limits.items()
        if not value > 0.0
    ]
    faults += [
        Fault(f"timeout of {name}", "an unknown name", "a component", suggestion(name, system.components))
        for name in own
        if name not in system.components
    ]
    if faults:
        raise InputError.from_faults(faults)
