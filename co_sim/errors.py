"""The errors that a user can meet, each told in one sentence with its remedy."""

from __future__ import annotations

__all__ = ["InputError", "RunError"]


class InputError(Exception):
    """A fault in what the user gave; nothing has been run or written.

    Parameters
    ----------
    what : the thing at fault, such as ``"wheelset.m_w"``.
    got, expected, remedy : the value found, the values allowed, and what to do.
    """

    def __init__(self, what: str, *, got: str, expected: str, remedy: str) -> None:
        super().__init__(f"{what}: got {got}, expected {expected}; {remedy}")


class RunError(Exception):
    """A run stopped before its end; the recorder holds everything up to `time`.

    Parameters
    ----------
    component : name of the component that failed.
    time : start of the step that failed, s.
    step : index of that step.
    reason : what happened, with the component's own words where it has any.
    """

    def __init__(self, component: str, *, time: float, step: int, reason: str) -> None:
        super().__init__(f"{component} stopped at t = {time:g} s (step {step}): {reason}")
        self.component = component
        self.time = time
        self.step = step
        self.reason = reason
