"""Workers for a campaign: a local cluster, or one that is there already."""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from distributed import Client

__all__ = ["connect", "cores"]

_SETTINGS = {
    # A worker gets a case when it is free for it: then a worker that dies takes one case with it, and which
    # case that was is no guess.
    "distributed.scheduler.worker-saturation": 1.0,
    # A case that kills its worker is not given to the next one; the engine tries it again by itself.
    "distributed.scheduler.allowed-failures": 0,
    # So long after its death a worker that nobody restarted is given up, and another can take its place.
    "distributed.deploy.lost-worker-timeout": "10s",
    "distributed.logging": {"distributed": "critical", "tornado": "critical"},
    "distributed.admin.low-level-log-length": 0,
}


def cores() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def connect(scheduler: str | None = None, workers: int | None = None) -> Iterator[Client]:
    """Give a client of a cluster, and close what was opened for it.

    Parameters
    ----------
    scheduler : address of an existing scheduler, such as ``"tcp://host:8786"``; ``None`` starts workers here.
    workers : processes to start here, one for each core by default; of an existing cluster, how many must
        be there.

    Raises
    ------
    InputError
        If there is no scheduler at that address, or it has no workers.
    """
    import dask
    from distributed import Client, LocalCluster

    if scheduler is not None:
        yield from _existing(scheduler, workers or 1)
        return
    with (
        dask.config.set(_SETTINGS),
        LocalCluster(
            n_workers=workers or cores(), threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _existing(address: str, workers: int) -> Iterator[Client]:
    from distributed import Client

    try:
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}",
            got=f"no answer ({error or type(error).__name__})",
            expected="the address of a running dask scheduler, such as tcp://host:8786",
            remedy="start one with `dask scheduler` and workers with `dask worker ADDRESS`",
        ) from None
    with client:
        try:
            client.wait_for_workers(workers, timeout=30.0)
        except TimeoutError:
            raise InputError(
                f"--scheduler {address}",
                got=f"{len(client.scheduler_info()['workers'])} workers after 30 s",
                expected=f"at least {workers}",
                remedy=f"start workers with `dask worker {address}`",
            ) from None
        yield client
