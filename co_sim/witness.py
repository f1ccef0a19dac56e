"""What FMUs do, told to whoever has to explain their end.

A process that dies takes its memory along. The process of a supervised run therefore sets a `Witness`
that tells the supervisor at once of each log message and of each call outside of the steps.
"""

from __future__ import annotations

__all__ = ["Witness", "set_witness", "witness"]


class Witness:
    """Sees what FMUs do; this one keeps it to itself."""

    def calls(self, function: str) -> None:
        """Learn which function of an FMU is about to be called; the empty text: none any more."""

    def logs(self, instance: str, status: str, message: str) -> None:
        """Learn of a log message."""


_WITNESS = [Witness()]


def witness() -> Witness:
    """Return the witness of this process."""
    return _WITNESS[0]


def set_witness(new: Witness) -> None:
    """Have another witness from now on."""
    _WITNESS[0] = new
