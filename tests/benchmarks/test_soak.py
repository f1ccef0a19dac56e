"""The verdict of the soak test: leaks are seen, caches that fill and noise are not taken for one."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import soak

RUNS = 10_000
PART = np.linspace(0.0, 1.0, soak.SAMPLES)


def readings(memory, files=0, pieces=0):
    n = len(memory)
    return soak.Readings(
        list(300e6 + np.asarray(memory)), [6 + (i * files) // n for i in range(n)], [900 + pieces] * n
    )


@pytest.mark.parametrize(
    "memory",
    [
        0.0 * PART,
        # Caches that fill with the first half of the work, in steps and slowly.
        np.minimum(30e6 * PART, 12e6),
        4e6 * np.floor(np.minimum(PART, 0.45) * 5.0),
        # Arenas that come and go.
        3e6 * (np.arange(len(PART)) % 3 == 0),
        0.2e6 * PART,
    ],
)
def test_what_is_flat(memory):
    assert readings(memory).verdict(RUNS, "run")


@pytest.mark.parametrize("per_run", [150.0, 1000.0])
def test_a_leak_is_seen_though_caches_fill(per_run):
    noise = 5e4 * np.random.default_rng(1).normal(size=len(PART))
    memory = np.minimum(30e6 * PART, 12e6) + per_run * RUNS * PART + noise
    assert not readings(memory).verdict(RUNS, "run")


def test_files_that_stay_open_are_seen():
    assert not readings(0.0 * PART, files=4).verdict(RUNS, "run")
