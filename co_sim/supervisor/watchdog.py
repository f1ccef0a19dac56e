"""Notices that a run no longer gets on."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from co_sim.table import Phase

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["LOOK", "Limits", "Watchdog"]

#: Longest time between two looks, s. Time in which nobody looked is not held against the run: the
#: supervisor may have been stopped, or busy with an observer while the run waited for it.
LOOK = 0.1
#: For reading the system and compiling what is not in numba's cache yet, s.
_PREPARATION = 300.0


@dataclass(frozen=True, slots=True)
class Limits:
    """How long things may take, s.

    Parameters
    ----------
    step : a step of a component. start : anything else that a component does. own : of components that need
        another time, for both.
    """

    step: float
    start: float
    own: Mapping[str, float]

    def of(self, phase: Phase, component: str) -> float:
        """Return the limit for what is going on."""
        if phase in {Phase.BETWEEN, Phase.PREPARING}:
            return _PREPARATION
        return self.own.get(component, self.step if phase == Phase.STEPPING else self.start)


class Watchdog:
    """Measures for how long a pulse has not changed."""

    def __init__(self) -> None:
        self._pulse = b""
        self._last = time.monotonic()
        self.idle = 0.0

    def see(self, pulse: bytes) -> float:
        """Look; return for how long nothing has changed, s."""
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        self.idle = self.idle + min(elapsed, 2 * LOOK) if pulse == self._pulse else 0.0
        self._pulse = pulse
        return self.idle
