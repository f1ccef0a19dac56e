"""Stands in for the master: shows a table of values to observers in blocks."""

import itertools

import numpy as np
import pytest


def show(observers, signals, values, *, t0=0.0, h=0.5, sizes=(1,), n_steps=None, error=None):
    """Show rows in blocks of `sizes`, over and over, from arrays that are spoilt after each call."""
    values = np.asarray(values, dtype=float)
    n = len(values)
    for observer in observers:
        observer.begin(tuple(signals), t0, h, n - 1 if n_steps is None else n_steps)
    k, cuts = 0, itertools.cycle(sizes)
    while k < n:
        j = min(k + next(cuts), n)
        time, block = t0 + h * np.arange(k, j), values[k:j].copy()
        seen = block.view()
        seen.flags.writeable = False
        for observer in observers:
            observer.observe(k, time, seen)
        time[:], block[:] = np.nan, np.nan
        k = j
    for observer in observers:
        observer.end(error)


@pytest.fixture(scope="session")
def drive():
    return show
