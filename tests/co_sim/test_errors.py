"""Errors cross the border between processes as they are."""

import pickle

import pytest

from co_sim import Fault, InputError, RunError
from co_sim.units import UnknownUnitError, conversion


def copied(error):
    return pickle.loads(pickle.dumps(error))


def test_all_faults_of_an_input_error_arrive():
    error = InputError.from_faults([Fault("a", "1", "2", "x"), Fault("b", "3", "4", "y")])
    assert (type(copied(error)), copied(error).faults, str(copied(error))) == (
        InputError,
        error.faults,
        str(error),
    )


def test_a_run_error_arrives():
    error = RunError("plant", time=0.5, step=500, reason="no solution")
    again = copied(error)
    assert (again.component, again.time, again.step, str(again)) == ("plant", 0.5, 500, str(error))


def test_an_unknown_unit_arrives():
    with pytest.raises(UnknownUnitError) as caught:
        conversion("furlongish", "m")
    assert str(copied(caught.value)) == str(caught.value)
