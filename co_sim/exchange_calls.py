"""The C functions of a Model Exchange FMU, called by address from compiled code.

All differences between FMI 2 and FMI 3 that compiled code sees are in this file. After the first failure no
function is called any more: each call here looks at it first, so that the integrator need not ask.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numba import int32, njit, types
from numba.np.numpy_support import from_dtype

from co_sim.native import STEP, caller, doubles_at, pointer_to

__all__ = ["MODEL", "OWN_FAILURES", "Action", "Failure", "model_at"]

_WARNING = 1


class Action(IntEnum):
    """The calls that can fail; the address of each is in `MODEL` under its name in lower case."""

    SET_TIME = 1
    SET_STATES = 2
    GET_STATES = 3
    GET_DERIVATIVES = 4
    GET_INDICATORS = 5
    SET_FLOATS = 6
    GET_FLOATS = 7
    LEAVE_INITIALISATION = 8
    ENTER_EVENT_MODE = 9
    UPDATE = 10
    ENTER_CONTINUOUS_MODE = 11
    COMPLETE_STEP = 12


class Failure(IntEnum):
    """What stops a step although no call failed."""

    TERMINATED = 1
    UNSETTLED = 2
    CHATTERING = 3


#: A step returns 0, one of `Failure`, this number times the action plus the FMI status, or what a function of
#: `STEP` for the ports returned, negative.
OWN_FAILURES = 8

#: One instance as compiled code sees it. Pointers are addresses of arrays of float64, unless told otherwise.
MODEL = np.dtype(
    [
        ("version", np.int64),
        ("instance", np.int64),
        *((action.name.lower(), np.int64) for action in Action),
        ("n_states", np.int64),
        ("x", np.int64),  # states at `time`,
        ("x_new", np.int64),  # at the end of the part of the step in hand,
        ("x_stage", np.int64),  # and at a stage of the method
        ("derivatives", np.int64),
        ("n_indicators", np.int64),
        ("z", np.int64),  # indicators at `time`,
        ("z_new", np.int64),  # at the end of the part of the step in hand,
        ("z_low", np.int64),  # and before and behind a change of sign
        ("z_high", np.int64),
        ("n_stages", np.int64),
        ("nodes", np.int64),  # of the Runge-Kutta method
        ("weights", np.int64),
        ("n_inputs", np.int64),  # elements of all inputs
        ("u", np.int64),  # the inputs and their derivatives given to the step under way
        ("n_smooth", np.int64),  # elements of inputs that follow their polynomial
        ("smooth", np.int64),  # int64: their positions
        ("smooth_values", np.int64),
        ("n_smooth_references", np.int64),
        ("smooth_references", np.int64),  # uint32
        ("n_discrete", np.int64),  # elements of inputs that change at events only
        ("discrete", np.int64),
        ("discrete_values", np.int64),
        ("n_outputs", np.int64),
        # Where all inputs, or all outputs, are float64 one call passes them; else a function of `STEP`.
        ("n_input_references", np.int64),
        ("input_references", np.int64),
        ("set_ports", np.int64),
        ("n_output_references", np.int64),
        ("output_references", np.int64),
        ("get_ports", np.int64),
        ("ports", np.int64),  # what these functions work from
        ("flags", np.int64),  # room for what `update` and `complete_step` return: int32, then a float64
        ("completes_steps", np.int64),
        ("never_back", np.int64),  # whether the FMU may forget the past
        ("needs_update", np.int64),
        ("terminates", np.int64),
        ("states_changed", np.int64),
        ("events", np.int64),  # since the start of the step
        ("failure", np.int64),
        ("running", np.int64),  # whether initialisation mode has been left
        ("substep", np.float64),  # s; 0 for the whole step
        ("start", np.float64),  # s, of the step under way: where the polynomials begin
        ("time", np.float64),  # s
        ("next_event", np.float64),  # s; inf without a time event
        ("tolerance", np.float64),  # s, of the time of events
    ]
)

model_at = pointer_to(from_dtype(MODEL))
_flags_at = pointer_to(types.int32)

_call = caller(int32(types.intp))
_call_time = caller(int32(types.intp, types.float64))
_call_array = caller(int32(types.intp, types.intp, types.intp))
_call_pointer = caller(int32(types.intp, types.intp))
_call_floats2 = caller(int32(types.intp, types.intp, types.intp, types.intp))
_call_floats3 = caller(int32(types.intp, types.intp, types.intp, types.intp, types.intp))
_call_step = caller(STEP)
_call_update3 = caller(int32(*[types.intp] * 7))
# A C bool is passed like an int that is 0 or 1.
_call_complete = caller(int32(types.intp, types.int32, types.intp, types.intp))


@njit(error_model="numpy")
def note(m: Any, action: int, status: int) -> None:
    """Keep the first status that is worse than a warning."""
    if not 0 <= status <= _WARNING:
        m.failure = OWN_FAILURES * action + (status if 0 < status < OWN_FAILURES else OWN_FAILURES - 1)


@njit(error_model="numpy")
def change_mode(m: Any, action: int, address: int) -> None:
    """Call a function that has no arguments."""
    if m.failure == 0:
        note(m, action, _call(address, (m.instance,)))


@njit(error_model="numpy")
def transfer(m: Any, action: int, address: int, values: int, n: int) -> None:
    """Set or get `n` states, derivatives or indicators at the address `values`."""
    if m.failure == 0 and n > 0:
        note(m, action, _call_array(address, (m.instance, values, n)))


@njit(error_model="numpy")
def transfer_floats(
    m: Any, action: int, address: int, references: int, n: int, values: int, n_values: int
) -> None:
    """Set or get `n` float64 variables that have `n_values` elements."""
    if m.failure == 0 and n > 0:
        if m.version == 2:
            status = _call_floats2(address, (m.instance, references, n, values))
        else:
            status = _call_floats3(address, (m.instance, references, n, values, n_values))
        note(m, action, status)


@njit(error_model="numpy")
def set_smooth(m: Any) -> None:
    """Set the inputs that follow their polynomial."""
    references, n = m.smooth_references, m.n_smooth_references
    transfer_floats(m, Action.SET_FLOATS, m.set_floats, references, n, m.smooth_values, m.n_smooth)


@njit(error_model="numpy")
def set_inputs(m: Any) -> None:
    """Set all inputs to their values at the start of the step."""
    if m.set_ports == 0:
        references, n = m.input_references, m.n_input_references
        transfer_floats(m, Action.SET_FLOATS, m.set_floats, references, n, m.u, m.n_inputs)
    elif m.failure == 0:
        m.failure = -_call_step(m.set_ports, (0.0, 0.0, m.u, m.u, m.ports))


@njit(error_model="numpy")
def get_outputs(m: Any, y: int) -> None:
    """Get all outputs into the array at the address `y`."""
    if m.get_ports == 0:
        references, n = m.output_references, m.n_output_references
        transfer_floats(m, Action.GET_FLOATS, m.get_floats, references, n, y, m.n_outputs)
    elif m.failure == 0:
        m.failure = -_call_step(m.get_ports, (0.0, 0.0, m.u, y, m.ports))


@njit(error_model="numpy")
def set_time(m: Any, t: float) -> None:
    """Set the time."""
    if m.failure == 0:
        note(m, Action.SET_TIME, _call_time(m.set_time, (m.instance, t)))


@njit(error_model="numpy")
def clear_flags(m: Any) -> Any:
    """Return the flags, cleared: FMI 3 writes the first byte of each only."""
    flags = _flags_at(m.flags)
    for i in range(6):
        flags[i] = 0
    return flags


@njit(error_model="numpy")
def update(m: Any) -> None:
    """Do one iteration of the event mode."""
    if m.failure != 0:
        return
    flags = clear_flags(m)
    a = m.flags
    if m.version == 2:
        status = _call_pointer(m.update, (m.instance, a))
    else:
        status = _call_update3(m.update, (m.instance, a, a + 4, a + 8, a + 12, a + 16, a + 24))
    note(m, Action.UPDATE, status)
    m.needs_update = flags[0]
    m.terminates |= flags[1]
    m.states_changed |= flags[3]
    m.next_event = doubles_at(m.flags)[3] if flags[4] else np.inf


@njit(error_model="numpy")
def complete_step(m: Any) -> bool:
    """Tell the FMU that it has reached a point to stay; return whether it asks for an event."""
    if m.failure != 0 or m.completes_steps == 0:
        return False
    flags = clear_flags(m)
    arguments = (m.instance, int32(m.never_back), m.flags, m.flags + 4)
    note(m, Action.COMPLETE_STEP, _call_complete(m.complete_step, arguments))
    m.terminates |= flags[1]
    return bool(flags[0])
