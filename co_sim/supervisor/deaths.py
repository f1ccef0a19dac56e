"""What a death is called, and whose it was."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

from co_sim.errors import RunError
from co_sim.table import Phase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from co_sim.layout import Part
    from co_sim.supervisor.board import Progress
    from co_sim.supervisor.process import Exit
    from co_sim.system import System

__all__ = ["Crew", "cause_of", "memory_hint"]

_WHEN = {
    Phase.BETWEEN: "between two calls of components",
    Phase.PREPARING: "while the system was prepared",
    Phase.STARTING: "while it was started",
    Phase.INITIALISING: "in its initialisation",
    Phase.ENTERING: "at the end of its initialisation",
    Phase.STEPPING: "in its step",
    Phase.CLOSING: "while it was closed",
}
#: From this share of the memory limit on, a death may have to do with it.
_NEARLY = 0.7
_LAST_WORDS = 5
_MEGABYTE = 1e6


def cause_of(end: Exit) -> str:
    """Return how a process ended; ``{when}`` is left open."""
    if end.code is None:
        return "its process vanished {when}"
    if end.code >= 0:
        return f"its process ended itself with the exit code {end.code} {{when}}"
    number = -end.code
    try:
        name = f"{signal.Signals(number).name} ({signal.strsignal(number)})"
    except ValueError:
        name = f"the signal {number}"
    by = " from outside, by the system if memory was short" if number == signal.SIGKILL else ""
    return f"its process was ended by {name}{by} {{when}}"


def memory_hint(used: int, limit: int) -> str:
    """Return a remark if a process used nearly all the memory (bytes) that it could have, else nothing."""
    if used < _NEARLY * limit:
        return ""
    return f"; it had allocated {used / _MEGABYTE:.0f} MB of the {limit / _MEGABYTE:.0f} MB that it may"


class Crew:
    """Who can be in action when a run ends.

    Parameters
    ----------
    names : of the components in the order of the system. steps : in the order of their steps.
    identities : what each of them is.
    """

    def __init__(self, names: Sequence[str], steps: Sequence[str], identities: dict[str, str]) -> None:
        self._names, self._steps, self._identities = names, steps, identities

    @classmethod
    def of(cls, system: System, parts: Sequence[Part]) -> Crew:
        """Return the components of a system, whose parts are in the order of their steps."""
        identities = {name: component.identity for name, component in system.components.items()}
        return cls(list(identities), [part.name for part in parts], identities)

    def member(self, progress: Progress) -> str:
        """Return the name of the component in action, or "system"."""
        if progress.phase in {Phase.BETWEEN, Phase.PREPARING}:
            return "system"
        names = self._steps if progress.phase == Phase.STEPPING else self._names
        return names[progress.part] if 0 <= progress.part < len(names) else "system"

    def error(self, progress: Progress, time: float, cause: str, hint: str, log: tuple[str, ...]) -> RunError:
        """Return the error of a run that died of a cause at `time` (s), with a hint and its last lines."""
        component = self.member(progress)
        when = _WHEN[progress.phase]
        if progress.function:
            when = f"in {progress.function}"
        words = f'; its last words: "{" | ".join(log[-_LAST_WORDS:])}"' if log else ""
        return RunError(
            component,
            time=time,
            step=progress.step,
            reason=f"{cause.format(when=when)}{hint}{words}",
            instance=self._identities.get(component, ""),
            log=log,
        )
