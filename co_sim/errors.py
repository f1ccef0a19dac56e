"""The errors that a user can meet, each told in one sentence with its remedy."""

from __future__ import annotations

import difflib
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from co_sim.observers.memory import Record

__all__ = ["Fault", "InputError", "RunError", "suggestion"]


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault in what the user gave.

    Parameters
    ----------
    what : the thing at fault, such as ``"wheelset.m_w"``.
    got, expected, remedy : the value found, the values allowed, and what to do.
    """

    what: str
    got: str
    expected: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what}: got {self.got}, expected {self.expected}; {self.remedy}"


class InputError(Exception):
    """A fault in what the user gave; nothing has been run or written.

    Parameters
    ----------
    what : the thing at fault, such as ``"wheelset.m_w"``.
    got, expected, remedy : the value found, the values allowed, and what to do.
    """

    def __init__(self, what: str, *, got: str, expected: str, remedy: str) -> None:
        fault = Fault(what, got, expected, remedy)
        super().__init__(str(fault))
        self.faults: tuple[Fault, ...] = (fault,)

    def __reduce__(self) -> tuple[Any, ...]:
        return InputError.from_faults, (self.faults,), self.__dict__

    @classmethod
    def from_faults(cls, faults: Sequence[Fault]) -> Self:
        """Join several faults, at least one, in one error that tells each on a line of its own."""
        error = cls(**asdict(faults[0]))
        error.faults = tuple(faults)
        return error

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))


class RunError(Exception):
    """A run stopped before its end; the recorder holds everything up to `time`.

    Parameters
    ----------
    component : name of the component that failed.
    time : start of the step that failed, s.
    step : index of that step.
    reason : what happened, with the component's own words where it has any.
    instance : what the component is, such as the file of an FMU.
    log : the last lines that it logged or printed, as far as they were kept.
    """

    def __init__(
        self,
        component: str,
        *,
        time: float,
        step: int,
        reason: str,
        instance: str = "",
        log: Sequence[str] = (),
    ) -> None:
        super().__init__(f"{component} stopped at t = {time:g} s (step {step}): {reason}")
        self.component = component
        self.time = time
        self.step = step
        self.reason = reason
        self.instance = instance
        self.log = tuple(log)
        #: The signals of all complete steps, where the run was made by `co_sim.run`.
        self.record: Record | None = None

    def __reduce__(self) -> tuple[Callable[..., RunError], tuple[str], dict[str, object]]:
        rebuild = partial(RunError, time=self.time, step=self.step, reason=self.reason)
        return rebuild, (self.component,), self.__dict__


def suggestion(name: str, known: Collection[str]) -> str:
    """Return the remedy for an unknown name: the closest known name, else the names to choose from."""
    closest = difflib.get_close_matches(name, known, n=1)
    if closest:
        return f'did you mean "{closest[0]}"?'
    if not known:
        return "there is none to choose from"
    shown = sorted(known)[:8]
    return f"choose from {', '.join(shown)}{', ...' if len(known) > len(shown) else ''}"
