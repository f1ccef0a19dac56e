"""What a check finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from co_sim.errors import Fault

__all__ = ["Finding", "Report", "Severity", "from_fault"]

#: An error breaks a rule of the standard or keeps the FMU from running; a warning is allowed here but likely
#: to be a mistake, or trouble elsewhere; a note tells what was done.
Severity = Literal["error", "warning", "note"]
_ORDER: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found.

    Parameters
    ----------
    severity : ``"error"``, ``"warning"`` or ``"note"``.
    topic : what was checked, such as ``"units"``.
    where : line, entry of the archive or name that it is about; may be empty.
    message : what is wrong, in one sentence.
    """

    severity: Severity
    topic: str
    where: str
    message: str


@dataclass(frozen=True, slots=True)
class Report:
    """All findings about a file, the most severe first.

    Parameters
    ----------
    path : the file as it was given.
    findings : in any order; kept by severity, those of equal severity in their order.
    """

    path: str
    findings: tuple[Finding, ...]

    def __post_init__(self) -> None:
        ordered = sorted(self.findings, key=lambda finding: _ORDER.index(finding.severity))
        object.__setattr__(self, "findings", tuple(ordered))

    def of(self, severity: Severity) -> Sequence[Finding]:
        """Return the findings of a severity."""
        return [finding for finding in self.findings if finding.severity == severity]

    @property
    def passed(self) -> bool:
        """Whether there are no errors."""
        return not self.of("error")


def from_fault(fault: Fault, topic: str, what: str) -> Finding:
    """Return a fault as an error; `what`, which every finding is about, is left out of it."""
    where = fault.what.removeprefix(what).lstrip(":, ")
    return Finding("error", topic, where, f"{fault.got}; expected {fault.expected}")
