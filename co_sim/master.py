"""The master: carries signals between components and advances them together in fixed steps.

The values of all outputs at ``t_k`` are one row of a table; components write the row of ``t_k+1``
(`co_sim.kernel`). Steps are made in blocks without the interpreter; observers see each block when it is
complete. A step that fails leaves the rows before it intact. How long a block is depends on the time
that it takes, and changes no result.
"""

from __future__ import annotations

import math
import time
import warnings
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from co_sim.component import StateError
from co_sim.dependencies import looped_components
from co_sim.errors import InputError, RunError
from co_sim.initial import settle
from co_sim.iterated import CompiledIteratedLoop, IteratedLoop
from co_sim.layout import lay_out
from co_sim.loops import CompiledLoop, InterpretedLoop
from co_sim.snapshot import Snapshot, read_snapshot, write_snapshot
from co_sim.table import LONGEST_BLOCK, Phase, Table
from co_sim.watch import Watch, advice

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import TracebackType

    from co_sim.component import Component, Vector
    from co_sim.kernel import Matrix
    from co_sim.layout import Part
    from co_sim.loops import Failure, Loop
    from co_sim.observers import Observer
    from co_sim.system import System
    from co_sim.watch import Growth

__all__ = ["CouplingWarning", "Master", "checked_count", "ending", "longest_block", "step_count"]

#: Blocks are made as long as this, s: short enough for an interrupt, long enough to cost nothing.
_BLOCK_TIME = 0.02
#: Steps in the first block, and how many times longer than the last one a block may be.
_FIRST_BLOCK = 1
_GROWTH_OF_BLOCKS = 16.0


class CouplingWarning(UserWarning):
    """A run reached its end, but a signal was still growing without pause."""


class Master:
    """Runs a system.

    Use it as a context manager, or call `close`: components may hold processes, libraries and files.

    Parameters
    ----------
    system : what to run; checked here, before any component is started.
    t0 : start time, s.
    h : communication step, s, instead of the system's own.
    observers : see the signals of each `run`, in this order; a `step` of its own is not observed.
    stop_time : s, if it is known that no run goes beyond it. FMUs are told, and most refuse to be stepped
        further: leave it out if you do not know how many runs there will be.
    quiet : do not warn of signals that still grow at the end of a run.
    compiled : make steps without the interpreter; ``False`` makes the same steps in Python, for debugging.
    table : makes the rows from their history and the number of signals; for those who share them.

    Raises
    ------
    InputError
        If the system has faults (all are told), `t0` is not finite, or the step does not divide the time to
        `stop_time`.
    """

    def __init__(
        self,
        system: System,
        t0: float = 0.0,
        h: float | None = None,
        observers: Sequence[Observer] = (),
        *,
        stop_time: float | None = None,
        compiled: bool = True,
        quiet: bool = False,
        table: Callable[[int, int], Table] = Table,
    ) -> None:
        if h is not None:
            system = replace(system, step=h)
        _set_parameters(system)
        system.check()
        if not math.isfinite(t0):
            raise InputError("start time", got=f"{t0} s", expected="a finite time", remedy="correct it")
        self.system = system
        self.t0 = t0
        self.h = system.step
        self.k = 0
        self.observers = tuple(observers)
        self.signals = system.signals
        self._looped = looped_components(system)
        self._last_step = last_step(t0, stop_time, self.h)
        self._compiled = compiled
        self._quiet = quiet
        self._layout = lay_out(system)
        self._table = table(self._layout.history, len(self.signals))
        self._loop: Loop | None = None
        self._begun = False
        self._closed = False
        self._places = {name: i for i, name in enumerate(system.components)}
        self._resources = ExitStack()
        for name, component in system.components.items():
            component.instance_name = name
            component.stop_time = self._stop_time
            self._resources.callback(self._close_component, name, component)

    @property
    def time(self) -> float:
        """Present time, s: ``t0 + k*h``, never a sum of steps."""
        return self.t0 + self.k * self.h

    @property
    def values(self) -> Vector:
        """Present outputs in the order of `signals`, shape ``(n_signals,)``; read-only."""
        values: Vector = self._rows[self._row]
        values.flags.writeable = False
        return values

    @property
    def parts(self) -> tuple[Part, ...]:
        """The components with their places, in the order of their steps."""
        return self._layout.parts

    @property
    def table(self) -> Table:
        """The rows and the progress."""
        return self._table

    @property
    def _stop_time(self) -> float | None:
        """The stop time that components are told: not before the end of the last step as they reckon it."""
        if self._last_step is None:
            return None
        return max(self.t0 + self._last_step * self.h, self.t0 + (self._last_step - 1) * self.h + self.h)

    @property
    def _rows(self) -> Matrix:
        return self._table.rows

    @property
    def _row(self) -> int:
        """Which of the rows is the present one."""
        return self._table.row

    def inputs_of(self, name: str) -> Vector:
        """Return the inputs of a component as they are now, without extrapolation."""
        part = next(part for part in self._layout.parts if part.name == name)
        return self._layout.inputs(part, self._rows[self._row])

    def start(self) -> None:
        """Start all components and settle their values at `t0`; does nothing if they are started.

        Raises
        ------
        InputError
            If a component refuses its description or the step, or the values do not settle because
            outputs depend on themselves.
        RunError
            If a component fails or an output is not finite.
        """
        with self._closed_on_error():
            self._start()

    def _start(self) -> None:
        if self._closed:
            raise RuntimeError("this master is closed; build a new one")
        if self._loop is not None:
            return
        for name, component in self.system.components.items():
            component.set_parameters(self.system.parameters_of(name))
            period = self.system.rates.get(name, 1)
            self._ask(Phase.STARTING, name, partial(component.start, self.t0, period * self.h))
        row = self._rows[self._row]
        row[:] = self._layout.first_row
        settle(self.system, self._layout, row, self._exchange)
        self._check_start(row)
        if self.system.coupling.algorithm == "iterated":
            self._saved_states()  # tells now which component cannot be taken back
        self._loop = self._new_loop()

    def enter_steps(self) -> None:
        """End the initialisation, as the first step would; starts the components if need be."""
        self.start()
        with self._closed_on_error():
            self._enter_steps()

    def step(self) -> None:
        """Advance all components by one step; starts them if need be.

        Raises
        ------
        RunError
            If a component fails or an output is not finite. The components are then closed.
        """
        require_within(self.k + 1, self._last_step, self.h)
        self.start()
        with self._closed_on_error():
            self._advance(1)

    def run(self, duration: float | None = None, *, n_steps: int | None = None) -> None:
        """Advance by `duration` or by `n_steps` and show every step to the observers.

        A second call continues; it shows the values where it begins as its step 0. Whatever ends a run
        early, an interrupt too, ends the observers, closes the components and is raised.

        Parameters
        ----------
        duration : s, a multiple of the step.
        n_steps : instead of `duration`.

        Raises
        ------
        InputError
            If the step does not divide `duration`, the run would go beyond the stop time, an observer
            refuses, or the values do not settle.
        RunError
            If a component fails, an output is not finite, or a signal grows beyond all bounds.

        Warns
        -----
        CouplingWarning
            If a signal was still growing when the run ended.
        """
        if (duration is None) == (n_steps is None):
            raise TypeError("give either duration or n_steps")
        count = checked_count(n_steps) if duration is None else step_count(duration, self.h)
        require_within(self.k + count, self._last_step, self.h)
        with self._closed_on_error(), ExitStack() as ends:
            for observer in self.observers:
                observer.begin(self.signals, self.time, self.h, count)
                ends.push(ending(observer))
            self._start()
            growth = self._observed(count)
        if growth and not self._quiet:
            warnings.warn(f"{growth}; {advice(self.system.coupling, self.h)}", CouplingWarning, stacklevel=2)

    def save(self) -> Snapshot:
        """Return the present state of the whole system, for `restore`; starts the components if need be.

        It holds as long as this master is open.

        Raises
        ------
        InputError
            If a component cannot save its state.
        """
        self.start()
        assert self._loop is not None
        states = self._saved_states()
        rows = self._rows[self._row - self._layout.history : self._row + 1].copy()
        return Snapshot(self.k, rows, self._layout.u.copy(), states, self._begun, self._loop.scale.copy())

    def _saved_states(self) -> dict[str, object]:
        states = {}
        for name, component in self.system.components.items():
            with _telling_state_of(name):
                states[name] = component.save()
        return states

    def restore(self, snapshot: Snapshot) -> None:
        """Go back, or on, to a state of `save`; may be done any number of times.

        Raises
        ------
        InputError
            If a component cannot restore its state.
        """
        self.start()
        assert self._loop is not None
        for name, component in self.system.components.items():
            with _telling_state_of(name):
                component.restore(snapshot.states[name])
        self._table.row = self._layout.history
        self._rows[: self._row + 1] = snapshot.rows
        self._layout.u[:] = snapshot.u
        self.k = snapshot.k
        self._begun = snapshot.begun
        self._loop.scale[:] = snapshot.scale

    def write_state(self, path: Path | str) -> None:
        """Write the present state to a file, whole or not there, for `read_state` of any process.

        Raises
        ------
        InputError
            If a component cannot write its state, or there is no such folder.
        """
        write_snapshot(Path(path), self.save(), self.system, self.t0, self._layout.texts)

    def read_state(self, path: Path | str) -> None:
        """Go to the state in a file of `write_state`, made from the same system.

        Raises
        ------
        InputError
            If the file is not one of a system with these components, signals and step.
        """
        self.start()
        self.restore(read_snapshot(Path(path), self.system, self.t0, self._layout.texts))

    def close(self) -> None:
        """Close all components, the last one first; safe to call twice.

        Raises
        ------
        RunError
            If a component cannot be closed; the others are closed all the same.
        """
        self._closed = True
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close_after(error)

    def _new_loop(self) -> Loop:
        if self.system.coupling.algorithm == "iterated":
            iterated = CompiledIteratedLoop if self._compiled else IteratedLoop
            return iterated(self._layout, self.t0, self.h, self.system.coupling, self._table.progress)
        kind = CompiledLoop if self._compiled else InterpretedLoop
        return kind(self._layout, self.t0, self.h, self._table.progress)

    def _observed(self, count: int) -> Growth | None:
        """Make `count` steps in blocks that the observers see; return what was still growing at the end."""
        watch = Watch(self.system, self._looped)
        begin = self.k
        self._show(0, self._row, 1)
        block = _FIRST_BLOCK
        longest = longest_block(self.observers)
        self._table.make_room(min(longest, self._table.room(), count))
        while self.k < begin + count:
            n = min(block, longest, self._table.room(), begin + count - self.k)
            started = time.perf_counter()
            self._advance_and_show(n, begin)
            newest = self._rows[self._row + 1 - n : self._row + 1]
            diverged = watch.see(newest, self.k + 1 - n, self.t0, self.h)
            if diverged:
                step, growth = diverged
                reason = f"{growth}; {advice(self.system.coupling, self.h)}"
                name = self.signals[growth.column].component
                raise RunError(name, time=self.t0 + step * self.h, step=step, reason=reason)
            elapsed = time.perf_counter() - started
            longer = min(_BLOCK_TIME / max(elapsed, 1e-9), _GROWTH_OF_BLOCKS)
            block = max(min(int(block * longer), LONGEST_BLOCK), 1)
        return watch.unfinished()

    def _advance_and_show(self, n: int, begin: int) -> None:
        """Make `n` steps and show those that were complete."""
        k = self.k
        try:
            self._advance(n)
        finally:
            made = self.k - k
            if made:
                self._show(k + 1 - begin, self._row - made + 1, made)

    def _advance(self, n: int) -> None:
        """Make `n` steps; if one fails, those before it are complete."""
        self._table.make_room(n)
        self._enter_steps()
        assert self._loop is not None
        self._table.tell(Phase.STEPPING, self.k, 0)
        made, failure = self._loop.advance(self._rows, self._row, self.k, n)
        self._table.row += made
        self.k += made
        if failure:
            raise self._error_of(failure)
        self._table.tell(Phase.BETWEEN, self.k, 0)

    def _enter_steps(self) -> None:
        if not self._begun:
            for name, component in self.system.components.items():
                self._ask(Phase.ENTERING, name, component.enter_steps)
            self._begun = True

    def _show(self, i: int, row: int, n: int) -> None:
        if not self.observers:
            return
        values = self._rows[row : row + n]
        values.flags.writeable = False
        times = np.arange(self.k - n + 1, self.k + 1, dtype=np.float64)
        times *= self.h
        times += self.t0
        for observer in self.observers:
            observer.observe(i, times, values)

    def _exchange(self, part: Part, row: Vector) -> None:
        self._ask(Phase.INITIALISING, part.name, partial(part.component.exchange, part.values, row[part.y]))

    def _check_start(self, row: Vector) -> None:
        wrong = np.flatnonzero(~np.isfinite(row))
        if wrong.size:
            raise self._not_finite(int(wrong[0]), row, self.t0)

    def _ask(self, phase: Phase, name: str, call: Callable[[], object]) -> None:
        """Call a component; its exceptions become errors of the run."""
        self._tell(phase, name)
        try:
            call()
        except InputError:
            raise
        except Exception as error:
            raise self._failure(name, error) from error
        self._table.tell(Phase.BETWEEN, self.k, 0)

    def _tell(self, phase: Phase, name: str) -> None:
        self._table.tell(phase, self.k, self._places[name])

    def _error_of(self, failure: Failure) -> BaseException:
        part, error = failure
        if error is None:
            row = self._rows[self._row + 1]
            wrong = part.y.start + int(np.flatnonzero(~np.isfinite(row[part.y]))[0])
            return self._not_finite(wrong, row, self.time + self.h)
        if not isinstance(error, Exception):
            return error
        run_error = self._failure(part.name, error)
        run_error.__cause__ = error
        return run_error

    def _not_finite(self, column: int, row: Vector, t: float) -> RunError:
        signal = self.signals[column]
        reason = f"{signal.name} became {row[column]} at t = {t:g} s"
        if self.k > 0 and signal.component in self._looped:
            reason += f"; {advice(self.system.coupling, self.h)}"
        return self._run_error(signal.component, reason)

    def _failure(self, name: str, error: Exception) -> RunError:
        # A ValueError of ours is a whole sentence; other exceptions say little without their type.
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        return self._run_error(name, reason)

    def _run_error(self, name: str, reason: str) -> RunError:
        instance = self.system.components[name].identity
        return RunError(name, time=self.time, step=self.k, reason=reason, instance=instance)

    def _close_component(self, name: str, component: Component) -> None:
        self._tell(Phase.CLOSING, name)
        try:
            component.close()
        except Exception as error:
            raise self._failure(name, error) from error

    @contextmanager
    def _closed_on_error(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            self._close_after(error)
            raise

    def _close_after(self, error: BaseException | None) -> None:
        """Close; if an error is under way, a second one becomes a note to it instead of hiding it."""
        try:
            self.close()
        except RunError as second:
            if error is None:
                raise
            error.add_note(f"while closing: {second}")


def _set_parameters(system: System) -> None:
    """Give the components their sound parameters, on which shapes and start values of ports may depend."""
    for name, component in system.components.items():
        values = system.parameters_of(name)
        if not any(component.parameter_faults(values)):
            component.set_parameters(values)


@contextmanager
def _telling_state_of(name: str) -> Iterator[None]:
    try:
        yield
    except StateError as error:
        raise InputError(
            f"state of {name}",
            got=str(error),
            expected="a component whose state can be saved and restored",
            remedy="use another component, or another algorithm",
        ) from error


def step_count(duration: float, h: float) -> int:
    """Return how many steps of `h` make `duration` (both s).

    Raises
    ------
    InputError
        If `duration` is negative or not finite, or `h` does not divide it to a relative 1e-9.
    """
    if not (math.isfinite(duration) and duration >= 0.0):
        raise InputError(
            "duration", got=f"{duration} s", expected="a finite time >= 0 s", remedy="correct it"
        )
    count = round(duration / h)
    if abs(count * h - duration) > 1e-9 * duration:
        raise InputError(
            "duration",
            got=f"{duration!r} s",
            expected=f"a multiple of the step of {h!r} s",
            remedy=f"use {count * h:.12g} s, or another step",
        )
    return count


def last_step(t0: float, stop_time: float | None, h: float) -> int | None:
    """Return the step that ends at the stop time; ``None`` without one. Times in s.

    Raises
    ------
    InputError
        If the step does not divide the time from `t0`, or that is negative.
    """
    if stop_time is None:
        return None
    duration = stop_time - t0
    if not math.isfinite(duration):
        return step_count(duration, h)
    # Times far from zero have fewer digits than their difference needs.
    count = round(duration / h)
    rounding = 4.0 * math.ulp(max(abs(t0), abs(stop_time)))
    return step_count(count * h if abs(count * h - duration) <= rounding else duration, h)


def require_within(end: int, last: int | None, h: float) -> None:
    """Raise `InputError` if a run to step `end` goes beyond the `last` one; steps of `h` (s)."""
    if last is not None and end > last:
        raise InputError(
            "duration",
            got=f"a run to {end * h:g} s after the start",
            expected=f"at most the {last * h:g} s to the stop time, beyond which FMUs refuse to go",
            remedy="shorten it, or leave stop_time out",
        )


def longest_block(observers: Sequence[Observer]) -> int:
    """Return how many steps may be made at once, for the observers."""
    wanted: list[int | None] = [getattr(observer, "max_block", None) for observer in observers]
    return min([LONGEST_BLOCK, *(n for n in wanted if n is not None)])


def checked_count(n_steps: int | None) -> int:
    """Return a number of steps if it is one."""
    if not isinstance(n_steps, int) or n_steps < 0:
        raise InputError("n_steps", got=repr(n_steps), expected="a whole number >= 0", remedy="correct it")
    return n_steps


def ending(observer: Observer) -> Callable[..., None]:
    """Return the exit function that tells `observer` how its run ended."""

    def end(
        kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        observer.end(error)

    return end
