"""Chooses algorithm, order and step of the coupling by the error that each of them is seen to make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from co_sim.coupling import Coupling
from co_sim.coupling_check import check_coupling
from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from co_sim.coupling_check import CouplingCheck
    from co_sim.system import System

__all__ = ["CANDIDATES", "Choice", "Trial", "choose"]

#: Couplings that are tried: what needs no saved states, cheapest first.
CANDIDATES = (
    Coupling("jacobi", order=0),
    Coupling("jacobi", order=1),
    Coupling("gauss-seidel", order=0),
    Coupling("gauss-seidel", order=1),
)
#: Signals that are compared: what drives the bogie is the same at every step.
_COUPLED = ("front.*", "rear.*", "frame.*")
#: Steps that may be chosen, s; each divides the time by which the rear wheelset is late at 20 m/s.
_STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5)


@dataclass(frozen=True, slots=True)
class Trial:
    """A coupling and what its check says."""

    coupling: Coupling
    check: CouplingCheck

    @property
    def error(self) -> float:
        """Largest error as part of its signal's range."""
        return self.check.signals[0].relative


@dataclass(frozen=True, slots=True)
class Choice:
    """What was tried at the first step, and the trial that is good enough: coupling, step and check."""

    tried: tuple[Trial, ...]
    chosen: Trial

    @property
    def trials(self) -> tuple[Trial, ...]:
        """All that is to be told, the chosen one last."""
        return (*(trial for trial in self.tried if trial is not self.chosen), self.chosen)

    @property
    def coupling(self) -> Coupling:
        """The coupling to run with."""
        return self.chosen.coupling

    @property
    def step(self) -> float:
        """The step to run with, s."""
        return self.chosen.check.step


def choose(
    system: Callable[[float, Coupling], System],
    duration: float,
    *,
    candidates: Sequence[Coupling] = CANDIDATES,
    steps: Sequence[float] = _STEPS,
    in_process: bool = False,
) -> Choice:
    """Return the coupling with the largest step that keeps every error below 1 % of its signal's range.

    Parameters
    ----------
    system : makes the system for a step (s) and a coupling. duration : of each run that is compared, s.
    candidates : all are tried with the first step; the best of them goes on to smaller ones.
    steps : that may be chosen, s, in falling order.
    in_process : as of `check_coupling`.

    Raises
    ------
    InputError
        If no step is good enough.
    """

    def trial(step: float, coupling: Coupling) -> Trial:
        check = check_coupling(system(step, coupling), duration, patterns=_COUPLED, in_process=in_process)
        return Trial(coupling, check)

    tried = tuple(trial(steps[0], coupling) for coupling in candidates)
    best = min(tried, key=lambda each: each.error)
    for step in steps[1:]:
        if best.check.verdict == "fine":
            break
        if step <= 1.001 * (best.check.recommended_step or step):
            best = trial(step, best.coupling)
    if best.check.verdict != "fine":
        raise InputError(
            "coupling",
            got=best.check.sentence.rstrip("."),
            expected="errors below 1 %",
            remedy="allow smaller steps",
        )
    return Choice(tried, best)
