"""Has the cases of a plan computed on a cluster, and keeps each result before the next counts."""

from __future__ import annotations

import json
import time
from concurrent.futures import CancelledError
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

from co_sim.campaign.journal import Entry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from distributed import Client, Future

    from co_sim.campaign.journal import Journal
    from co_sim.campaign.plan import Case

__all__ = ["ClusterLostError", "Outcome", "estimate", "run_campaign"]

#: Cases on their way for each worker: one that runs, one that waits for it.
_AHEAD = 2
#: After so long without a result it is looked whether all workers are there, s.
_PATIENCE = 5.0
#: How often a case is given to a worker that then dies.
_ATTEMPTS = 2


class ClusterLostError(Exception):
    """The scheduler no longer answers; what had been computed is in the journal."""

    def __init__(self) -> None:
        super().__init__("the scheduler no longer answers")


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a campaign went.

    Parameters
    ----------
    done, failed : cases computed now, and those of them that failed. seconds : wall time, s.
    """

    done: int
    failed: int
    seconds: float


def estimate(outcome: Outcome, remaining: int) -> float:
    """Return the seconds that `remaining` further cases will take, from those that `outcome` took."""
    return remaining * outcome.seconds / max(outcome.done, 1)


def run_campaign(
    function: Callable[[Case], dict[str, Any]],
    cases: Iterable[Case],
    journal: Journal,
    client: Client,
    *,
    show: Callable[[Entry], None] = lambda entry: None,
) -> Outcome:
    """Compute all cases that the journal does not have.

    A case whose function raises is kept as failed, with the reason. A case whose worker dies is tried once
    more at the end, by itself; if that worker dies too, it is kept as failed.

    Parameters
    ----------
    function : from a case to numbers and texts by name; importable on the workers.
    cases : of a plan. journal : where results go; what it has is not computed again.
    client : of a cluster, see `connect`. show : told of each result when it is on the disk.

    Raises
    ------
    ClusterLostError
        If the scheduler dies.
    """
    begin, count = time.perf_counter(), [0, 0]

    def keep(entry: Entry) -> None:
        journal.add(entry)
        count[0] += 1
        count[1] += entry.status == "failed"
        show(entry)

    todo = (case for case in cases if case.number not in journal.entries)
    workers = max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)
    suspects = _compute(function, todo, client, keep, ahead=_AHEAD * workers, attempt=1)
    for case in suspects:
        for dead in _compute(function, iter([case]), client, keep, ahead=1, attempt=_ATTEMPTS):
            reason = f"its worker died, {_ATTEMPTS} times: a crash, or more memory than the worker may have"
            keep(Entry(dead.number, "failed", reason=reason))
    return Outcome(count[0], count[1], time.perf_counter() - begin)


def _compute(
    function: Callable[[Case], dict[str, Any]],
    cases: Iterator[Case],
    client: Client,
    keep: Callable[[Entry], None],
    *,
    ahead: int,
    attempt: int,
) -> list[Case]:
    """Compute cases, so many `ahead` at once; return those whose worker died."""
    from distributed.scheduler import KilledWorker

    prefix = f"case-{id(cases):x}-{attempt}"
    running: dict[Future[Entry], Case] = {}
    suspects: list[Case] = []

    def fill() -> None:
        for case in islice(cases, ahead - len(running)):
            key = f"{prefix}-{case.number}"
            running[client.submit(_attempt, function, case, key=key, pure=False)] = case

    fill()
    while running:
        for future in _finished(client, running):
            case = running.pop(future)
            try:
                keep(future.result())
            except KilledWorker:
                suspects.append(case)
            except CancelledError:
                raise ClusterLostError from None
        fill()
    return suspects


def _finished(client: Client, running: Iterable[Future[Entry]]) -> list[Future[Entry]]:
    """Wait until a case is computed; return all that are."""
    from distributed import wait

    while True:
        try:
            return list(wait(list(running), timeout=_PATIENCE, return_when="FIRST_COMPLETED").done)
        except CancelledError:
            raise ClusterLostError from None
        except TimeoutError:
            if client.status != "running":
                raise ClusterLostError from None
            if client.cluster is not None:
                # A worker that died while it started is not started again by itself.
                client.cluster.scale(len(client.cluster.worker_spec))


def _attempt(function: Callable[[Case], dict[str, Any]], case: Case) -> Entry:
    """Compute a case on a worker."""
    begin = time.perf_counter()
    try:
        record = function(case)
        json.dumps(record, allow_nan=False)  # what the journal has no place for is a failure of the case
    except Exception as error:  # whatever a case raises is its result
        return Entry(case.number, "failed", reason=_told(error), seconds=time.perf_counter() - begin)
    return Entry(case.number, "done", record, seconds=time.perf_counter() - begin)


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"
