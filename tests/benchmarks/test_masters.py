"""The benchmark of masters: its loop in C is an independent reference; a master that fails is a mere line."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from masters.cases import masses
from masters.contender import Contender
from masters.floor import BareLoop
from masters.ours import Compiled, Interpreted
from masters.workers import FailedError, Worker


class Crashing(Contender):
    """Takes its process with it."""

    def run(self, n, *, record):
        os._exit(7)

    def trajectory(self):
        raise NotImplementedError


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return masses(tmp_path_factory.mktemp("masses"), substeps=3)


@pytest.mark.parametrize("ours", [Compiled, Interpreted])
def test_a_loop_by_hand_in_c_computes_the_same_bits(case, tmp_path, ours):
    n = 1500  # the push changes its sign after 1000 steps
    floor, master = BareLoop(case, tmp_path), ours(case, tmp_path)
    assert floor.run(n, record=True) > 0.0
    assert master.run(n, record=True) > 0.0
    reference = floor.trajectory()
    assert reference.shape == (n, 4)
    assert np.ptp(reference, axis=0).min() > 1e-3
    np.testing.assert_array_equal(master.trajectory(), reference)


def test_a_master_that_crashes_or_is_missing_is_told_with_its_reason(case):
    for place, reason in (
        (f"{__name__}:Crashing", "its process ended with the code 7"),
        ("masters.nobody:Nobody", "masters.nobody is not installed"),
    ):
        worker = Worker(place, case)
        with pytest.raises(FailedError, match=reason):
            worker.ask("run", 10, record=False)
        worker.close()
