"""The master: carries signals between components and advances them together in fixed steps.

Exchange is of Jacobi type: in step ``k`` every component reads what all components had at ``t_k`` and
writes what they have at ``t_k+1``. No component sees another one's new output, so their order cannot
change a result.

All outputs lie in one array, the bus; each component writes a slice of it. There are two buses, one
for ``t_k`` and one for ``t_k+1``, that change places after each complete step: a step that fails leaves
the values before it intact. Constants for inputs that are not connected lie behind the outputs, so
that one indexed copy gathers the inputs of all components.
"""

from __future__ import annotations

import math
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Self

import numpy as np

from co_sim.bus import build_bus, upstream_first, wiring
from co_sim.errors import InputError, RunError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import TracebackType

    from co_sim.bus import Bus, Part
    from co_sim.component import Component, Vector
    from co_sim.recorder import Observer
    from co_sim.system import System

__all__ = ["Master", "step_count"]


class Master:
    """Runs a system with the communication step `h`.

    Use it as a context manager, or call `close`: components may hold processes, libraries and files.

    Parameters
    ----------
    system : what to run; checked here, before any component is started.
    t0 : start time, s.
    h : communication step, s.
    observers : see the signals of each `run`, in this order; a `step` of its own is not observed.

    Raises
    ------
    InputError
        If the system has faults (all are told), `t0` is not finite or `h` not positive.
    """

    def __init__(
        self, system: System, t0: float = 0.0, h: float = 1e-3, observers: Sequence[Observer] = ()
    ) -> None:
        system.check()
        _check_clock(t0, h)
        self.system = system
        self.t0 = t0
        self.h = h
        self.k = 0
        self.observers = tuple(observers)
        self.signals = system.signals
        self._sources, constants = wiring(system)
        self._u = np.zeros(len(self._sources))
        self._now = build_bus(system, self._u, constants)
        self._next = build_bus(system, self._u, constants)
        self._finite = np.empty(len(self.signals), dtype=np.bool_)
        self._started = False
        self._closed = False
        self._resources = ExitStack()
        for name, component in system.components.items():
            self._resources.callback(self._close_component, name, component)

    @property
    def time(self) -> float:
        """Present time, s: ``t0 + k*h``, never a sum of steps."""
        return self.t0 + self.k * self.h

    @property
    def values(self) -> Vector:
        """Present outputs in the order of `signals`, shape ``(n_signals,)``; read-only."""
        return self._now.outputs

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
        if self._closed:
            raise RuntimeError("this master is closed; build a new one")
        if self._started:
            return
        with self._closed_on_error():
            for name, component in self.system.components.items():
                try:
                    component.start(self.t0, self.h)
                except InputError:
                    raise
                except Exception as error:
                    raise self._failure(name, error) from error
            self._settle()
            for name, component in self.system.components.items():
                try:
                    component.enter_steps()
                except Exception as error:
                    raise self._failure(name, error) from error
        self._started = True

    def step(self) -> None:
        """Advance all components by `h`; starts them if need be.

        Raises
        ------
        RunError
            If a component fails or an output is not finite. The components are then closed.
        """
        self.start()
        with self._closed_on_error():
            self._advance()

    def run(self, duration: float | None = None, *, n_steps: int | None = None) -> None:
        """Advance by `duration` or by `n_steps` and show every step to the observers.

        A second call continues; it shows the values where it begins as its step 0. Whatever ends a run
        early, an interrupt too, ends the observers, closes the components and is raised.

        Parameters
        ----------
        duration : s, a multiple of `h`.
        n_steps : instead of `duration`.

        Raises
        ------
        InputError
            If `h` does not divide `duration`, an observer refuses, or the values do not settle.
        RunError
            If a component fails or an output is not finite.
        """
        if (duration is None) == (n_steps is None):
            raise TypeError("give either duration or n_steps")
        count = _checked_count(n_steps) if duration is None else step_count(duration, self.h)
        with self._closed_on_error(), ExitStack() as ends:
            for observer in self.observers:
                observer.begin(self.signals, self.time, self.h, count)
                ends.push(_ending(observer))
            self.start()
            self._show(0)
            for i in range(1, count + 1):
                self._advance()
                self._show(i)

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

    def _advance(self) -> None:
        now, following = self._now, self._next
        t = self.time
        self._gather()
        name = ""
        try:
            for name, component, u, y in following.parts:  # noqa: B007 - the name is for the except clause
                component.step(t, self.h, u, y)
        except Exception as error:
            raise self._failure(name, error) from error
        self._check_finite(following, t + self.h)
        self._now, self._next = following, now
        self.k += 1

    def _gather(self) -> None:
        # All indices are valid; mode "clip" only spares numpy a second copy.
        self._now.values.take(self._sources, out=self._u, mode="clip")

    def _show(self, i: int) -> None:
        t, outputs = self.time, self._now.outputs
        for observer in self.observers:
            observer.observe(i, t, outputs)

    def _settle(self) -> None:
        """Sweep until no output changes.

        Components are swept in the order of their connections, so that each sees what feeds it, and only
        in a loop the start values of its inputs. A component can be passed more than once, so signals
        count, not components; the last sweep only confirms.
        """
        order = upstream_first(self.system)
        parts = sorted(self._now.parts, key=lambda part: order.index(part.name))
        for _ in range(len(self.signals) + 1):
            before = self._now.outputs.copy()
            self._sweep(parts)
            if np.array_equal(self._now.outputs, before, equal_nan=True):
                self._check_finite(self._now, self.t0)
                return
        changing = {self.signals[i].name for i in np.flatnonzero(self._now.outputs != before)}
        names = ", ".join(sorted(self._loop(changing) or changing))
        raise InputError(
            "initial values",
            got=f"{names} still changing after {len(self.signals) + 1} sweeps",
            expected="outputs that do not depend on themselves at the same time",
            remedy="break the algebraic loop with a component whose output does not follow its input at once",
        )

    def _sweep(self, parts: Sequence[Part]) -> None:
        for name, component, u, y in parts:
            self._gather()
            try:
                component.exchange(u, y)
            except Exception as error:
                raise self._failure(name, error) from error

    def _loop(self, names: set[str]) -> set[str]:
        """Return the changing signals without those that only follow the loop and feed nothing in it."""
        while True:
            components = {name.partition(".")[0] for name in names}
            feeding = {
                c.source
                for c in self.system.connections
                if c.source in names and c.target.partition(".")[0] in components
            }
            if feeding == names:
                return names
            names = feeding

    def _check_finite(self, bus: Bus, t: float) -> None:
        np.isfinite(bus.outputs, out=self._finite)
        # A search for a zero byte takes a third of the time of numpy's all().
        if b"\0" in self._finite.tobytes():
            i = int(np.argmin(self._finite))
            signal = self.signals[i]
            reason = f"{signal.name} became {bus.outputs[i]} at t = {t:g} s"
            raise RunError(signal.component, time=self.time, step=self.k, reason=reason)

    def _failure(self, name: str, error: Exception) -> RunError:
        # A ValueError of ours is a whole sentence; other exceptions say little without their type.
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        return RunError(name, time=self.time, step=self.k, reason=reason)

    def _close_component(self, name: str, component: Component) -> None:
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


def _checked_count(n_steps: int | None) -> int:
    if not isinstance(n_steps, int) or n_steps < 0:
        raise InputError("n_steps", got=repr(n_steps), expected="a whole number >= 0", remedy="correct it")
    return n_steps


def _check_clock(t0: float, h: float) -> None:
    if not math.isfinite(t0):
        raise InputError("t0", got=f"{t0} s", expected="a finite time", remedy="use 0")
    if not (math.isfinite(h) and h > 0.0):
        raise InputError("h", got=f"{h} s", expected="a finite step > 0 s", remedy="use 1e-3, for example")


def _ending(observer: Observer) -> Callable[..., None]:
    """Return the exit function that tells `observer` how its run ended."""

    def end(
        kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        observer.end(error)

    return end
