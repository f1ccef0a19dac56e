"""Tasks in processes of their own."""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from typing import TYPE_CHECKING

import pytest

from co_sim import InputError
from co_sim.wheelset.reporting.workers import run_tasks

if TYPE_CHECKING:
    from collections.abc import Callable


def square(x: int, progress: Callable[[float], None]) -> int:
    progress(0.5)
    time.sleep(0.05 * (3 - x))
    progress(1.0)
    return x * x


def refuse(progress: Callable[[float], None]) -> None:
    raise InputError("x", got="y", expected="z", remedy="w")


def sleep(progress: Callable[[float], None]) -> None:
    time.sleep(60.0)


def die(progress: Callable[[float], None]) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def give_a_lock(progress: Callable[[float], None]) -> object:
    import threading

    return threading.Lock()


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_order_with_their_progress(processes: int) -> None:
    told: list[tuple[int, float]] = []
    found = run_tasks(
        [partial(square, x) for x in (1, 2)], lambda i, share: told.append((i, share)), processes
    )
    assert found == [1, 4]
    assert sorted(told) == [(i, share) for i in range(2) for share in (0.5, 1.0)]


def test_an_error_ends_the_others() -> None:
    since = time.monotonic()
    with pytest.raises(InputError, match="x: got y"):
        run_tasks([sleep, refuse], lambda i, share: None, 2)
    assert time.monotonic() - since < 30.0


def test_a_death_is_told() -> None:
    with pytest.raises(RuntimeError, match="task 0 ended with code -9 and no result"):
        run_tasks([die], lambda i, share: None, 2)


def test_a_result_that_cannot_travel_is_told_with_its_place() -> None:
    with pytest.raises(TypeError, match="pickle") as caught:
        run_tasks([give_a_lock], lambda i, share: None, 2)
    assert any("_serve" in note for note in caught.value.__notes__)
