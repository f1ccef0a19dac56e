"""Functions of cases that the workers of the tests import."""

import os
import signal
from typing import Any

from co_sim.campaign import Case


def doubled(case: Case) -> dict[str, Any]:
    return {"y": 2.0 * float(case.values["a"]), "seed_seen": case.seed}


def moody(case: Case) -> dict[str, Any]:
    """Raise for 4, kill the worker for 3, return what JSON has no place for for 5."""
    if case.values["a"] == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if case.values["a"] == 4:
        raise ValueError("4 is not to my taste")
    return doubled(case) | ({"y": float("nan")} if case.values["a"] == 5 else {})
