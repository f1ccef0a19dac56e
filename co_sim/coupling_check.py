"""Is a coupled result right? The same run with the step, half of it and a quarter of it.

With ``e_1 = y_h - y_h/2`` and ``e_2 = y_h/2 - y_h/4`` at common times, a coupling of order ``p`` makes
``|e_1|/|e_2| = 2^p``, and the error of the first run is (Richardson) ::

    |y_h - y| = |e_1| 2^p/(2^p - 1)

A system that is unstable by nature grows in all three runs alike. One whose coupling is unstable grows the
less, the smaller the step.
"""

from __future__ import annotations

import copy
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError, RunError
from co_sim.master import Master, step_count
from co_sim.observers import Recorder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from co_sim.kernel import Matrix
    from co_sim.supervisor import Supervised
    from co_sim.system import System

__all__ = ["CouplingCheck", "SignalError", "check_coupling", "refined"]

_REFINEMENTS = (1, 2, 4)
#: Points in time at which runs are compared, at most.
_POINTS = 20_000
#: Below this share of a signal's range, differences are rounding.
_ROUNDING = 1e-11
#: Part of a signal's range that makes its error a warning; what a step is recommended for.
_TOLERABLE = 0.01
#: A smaller step must shrink differences by at least this factor, or the results do not converge.
_SHRINKING = 1.3


@dataclass(frozen=True, slots=True)
class SignalError:
    """What the step costs one signal.

    Parameters
    ----------
    name, unit : of the signal.
    error : estimated largest error of the run with the given step, in that unit.
    relative : the same over the range of the signal in the finest run (0 where there is no error, infinite
        where the range is zero).
    order : observed order of convergence; nan where the differences are rounding.
    """

    name: str
    unit: str
    error: float
    relative: float
    order: float


@dataclass(frozen=True, slots=True)
class CouplingCheck:
    """Outcome of `check_coupling`; as text, a few sentences and a table.

    Parameters
    ----------
    step : that was checked, s. compared_until : time up to which the runs could be compared, s.
    verdict : ``"fine"``, ``"inaccurate"`` (an error above 1 % of a signal's range), ``"not converging"`` or
        ``"unstable"``.
    signals : largest relative error first.
    recommended_step : for errors below 1 %, s; ``None`` where nothing can be recommended.
    stopped : what ended the runs with the step, half of it and a quarter of it, if anything did.
    """

    step: float
    compared_until: float
    verdict: str
    signals: tuple[SignalError, ...]
    recommended_step: float | None
    stopped: tuple[str | None, ...]

    def __str__(self) -> str:
        return "\n".join([self.sentence, *self._all_stopped(), *self._table()])

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        worst = self.signals[0]
        remedy = "" if self.recommended_step is None else f"; {self.recommended_step:.2g} s would do"
        if self.verdict == "unstable":
            why = self.stopped[0] or (
                f"{worst.name} is off by {worst.relative:.3g} times its range, and half the step changes that"
            )
            return f"The coupling is unstable at a step of {self.step:g} s: {why}{remedy}."
        if self.verdict == "not converging":
            return (
                f"The results do not converge: {worst.name} differs by {worst.relative:.3g} of its range "
                "and a smaller step does not bring the runs together; look for jumps, or for a component "
                "that depends on the step."
            )
        found = (
            f"{worst.name} is off by about {worst.error:.3g} {worst.unit} ({worst.relative:.2%} of its range)"
        )
        if self.verdict == "inaccurate":
            return f"A step of {self.step:g} s is coarse: {found}{remedy}."
        return f"A step of {self.step:g} s is fine: {found}, and no signal by more."

    def _all_stopped(self) -> list[str]:
        """Return what ended the finest run too, so that the step is not to blame."""
        reason = self.stopped[-1]
        return [f"Even with a quarter of the step the run stopped: {reason}."] if reason else []

    def _table(self) -> list[str]:
        width = max(len(s.name) for s in self.signals)
        head = f"{'signal':{width}}  {'error':>10}  {'unit':8}  {'of range':>9}  order"
        return [head] + [
            f"{s.name:{width}}  {s.error:10.3g}  {s.unit:8}  {_percent(s.relative):>9}  {_number(s.order)}"
            for s in self.signals
        ]


def _percent(share: float) -> str:
    return f"{share:.2%}" if share < 100.0 else f"{100.0 * share:.1e}%"


def _number(order: float) -> str:
    return "-" if math.isnan(order) else f"{order:.1f}"


def refined(system: System, factor: int) -> System:
    """Return an independent copy of a system with its step divided; rates keep their sample time."""
    components = {name: copy.deepcopy(component) for name, component in system.components.items()}
    rates = {name: rate * factor for name, rate in system.rates.items()}
    return replace(system, components=components, step=system.step / factor, rates=rates)


def check_coupling(
    system: System,
    duration: float,
    *,
    t0: float = 0.0,
    patterns: Sequence[str] = ("*",),
    in_process: bool = True,
) -> CouplingCheck:
    """Estimate the error that the coupling makes in each signal, from three runs side by side.

    Parameters
    ----------
    system : not yet started; it is copied. duration : of the runs, s. t0 : their start, s.
    patterns : signals to compare; those that jump (``continuous=False``) converge with order 1 at best.
    in_process : whether to run in this process instead of in processes under supervision, where a component
        that crashes or hangs does no harm.

    Raises
    ------
    InputError
        If the system has faults, or a component does not bear a smaller step.
    RunError
        If even the run with a quarter of the step cannot start.
    """
    system.check()
    count = step_count(duration, system.step)
    if count < 1:
        raise InputError("duration", got=f"{duration} s", expected="at least one step", remedy="lengthen it")
    every = -(-count // _POINTS)
    with ThreadPoolExecutor(len(_REFINEMENTS)) as pool:
        jobs = [
            pool.submit(
                _run, refined(system, factor), t0, count * factor, patterns, every * factor, in_process
            )
            for factor in _REFINEMENTS
        ]
        runs = [job.result() for job in jobs]
    recorders, stopped = zip(*runs, strict=True)
    rows = min(len(recorder.time) for recorder in recorders)
    tables = [recorder.table[:rows] for recorder in recorders]
    order = system.coupling.order + 1
    errors = _signal_errors(recorders[0].names, recorders[0].units, tables, order)
    verdict = _verdict(errors, tables, stopped)
    return CouplingCheck(
        step=system.step,
        compared_until=float(recorders[0].time[rows - 1]),
        verdict=verdict,
        signals=errors,
        recommended_step=_recommended(system.step, verdict, errors, tables, order),
        stopped=stopped,
    )


def _run(
    system: System, t0: float, n_steps: int, patterns: Sequence[str], every: int, in_process: bool
) -> tuple[Recorder, str | None]:
    recorder = Recorder(patterns, every=every)
    try:
        with _master(in_process)(system, t0, observers=[recorder], quiet=True) as master:
            master.run(n_steps=n_steps)
    except RunError as error:
        if len(recorder.time) == 0:
            raise
        return recorder, error.reason
    return recorder, None


def _master(in_process: bool) -> type[Master | Supervised]:
    from co_sim.supervisor import Supervised

    return Master if in_process else Supervised


def _signal_errors(
    names: Sequence[str], units: Sequence[str], tables: Sequence[Matrix], order: int
) -> tuple[SignalError, ...]:
    coarse, half, fine = tables
    e1, e2 = np.abs(coarse - half).max(axis=0), np.abs(half - fine).max(axis=0)
    span = np.ptp(fine, axis=0)
    rounding = _ROUNDING * np.maximum(np.abs(fine).max(axis=0), span)
    errors = []
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        observed = math.nan
        if e2[i] > rounding[i] and e1[i] > rounding[i]:
            observed = math.log2(e1[i] / e2[i])
        p = min(max(observed, 1.0), order) if not math.isnan(observed) else order
        error = 0.0 if e1[i] <= rounding[i] else float(e1[i] * 2.0**p / (2.0**p - 1.0))
        relative = 0.0 if error == 0.0 else (error / span[i] if span[i] > 0.0 else math.inf)
        errors.append(SignalError(name, unit, error, float(relative), observed))
    return tuple(sorted(errors, key=lambda e: -e.relative))


def _verdict(errors: Sequence[SignalError], tables: Sequence[Matrix], stopped: Sequence[str | None]) -> str:
    worst = errors[0]
    if stopped[0] and not stopped[-1]:
        return "unstable"
    if worst.relative <= _TOLERABLE and (all(stopped) or not any(stopped)):
        return "fine"
    coarse, _, fine = tables
    outgrown = np.abs(coarse).max(axis=0) > 10.0 * np.maximum(np.abs(fine).max(axis=0), 1e-300)
    if worst.relative > 1.0 and (outgrown.any() or any(stopped)):
        return "unstable"
    if worst.order < math.log2(_SHRINKING):
        return "not converging"
    return "inaccurate"


def _recommended(
    step: float, verdict: str, errors: Sequence[SignalError], tables: Sequence[Matrix], order: int
) -> float | None:
    """Return the step at which the errors should be tolerable, from the two finer runs."""
    if verdict in {"fine", "not converging"}:
        return None
    _, half, fine = tables
    span = np.ptp(fine, axis=0)
    e2 = np.abs(half - fine).max(axis=0)
    if not (span > 0.0).any():
        return None
    # The finest run's differences hold when the coarse ones are beyond all laws.
    worst = float((e2[span > 0.0] / span[span > 0.0]).max()) * 2.0
    wanted = 0.5 * step * min((_TOLERABLE / worst) ** (1.0 / order), 1.0) if worst > 0.0 else 0.5 * step
    return _round_down(wanted)


def _round_down(step: float) -> float:
    """Return the next lower step out of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return max(m * power for m in (1.0, 2.0, 5.0) if m * power <= step * (1.0 + 1e-9))
