"""The step of a Model Exchange FMU as machine code: Runge-Kutta substeps and events.

A substep ends early where an event indicator changes its sign or the FMU has announced a time event. There
the FMU handles the event, and the rest of the substep follows. Event indicators count as
positive or not positive, as FMI has it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cfunc, njit
from numba.np.numpy_support import carray

from co_sim.exchange_calls import (
    Action,
    Failure,
    change_mode,
    complete_step,
    get_outputs,
    model_at,
    set_inputs,
    set_smooth,
    set_time,
    transfer,
    update,
)
from co_sim.native import STEP, doubles_at, integers_at

__all__ = ["MAX_EVENTS", "MAX_ITERATIONS", "exchange_step"]

#: Events in one step before it counts as chattering.
MAX_EVENTS = 1000
#: Iterations of one event before it counts as never settling.
MAX_ITERATIONS = 100
#: Tolerance of the time of a state event, in parts of the step, and for rounding in ulps of the time.
EVENT_TOLERANCE = 1e-12
EVENT_ULPS = 4.0


@njit(error_model="numpy")
def copy(source: int, target: int, n: int) -> None:
    """Copy `n` numbers from one address to another."""
    values, copies = doubles_at(source), doubles_at(target)
    for i in range(n):
        copies[i] = values[i]


@njit(error_model="numpy")
def halve(address: int, n: int) -> None:
    """Halve the `n` numbers at an address."""
    values = doubles_at(address)
    for i in range(n):
        values[i] *= 0.5


@njit(error_model="numpy")
def set_smooth_inputs(m: Any, t: float) -> None:
    """Set the inputs that may change in continuous-time mode to their polynomial's values at `t`."""
    u = doubles_at(m.u)
    positions = integers_at(m.smooth)
    values = doubles_at(m.smooth_values)
    tau = t - m.start
    for i in range(m.n_smooth):
        k = positions[i]
        values[i] = u[k] + tau * (u[m.n_inputs + k] + 0.5 * tau * u[2 * m.n_inputs + k])
    set_smooth(m)


@njit(error_model="numpy")
def set_point(m: Any, t: float, x: int) -> None:
    """Set time, states (at the address `x`) and inputs."""
    set_time(m, t)
    transfer(m, Action.SET_STATES, m.set_states, x, m.n_states)
    set_smooth_inputs(m, t)


@njit(error_model="numpy")
def advance(m: Any, end: float) -> None:
    """Integrate from the present point to `end` in one step of the method; see `x_new` and `z_new`."""
    n = m.n_states
    x, x_new = doubles_at(m.x), doubles_at(m.x_new)
    x_stage, k = doubles_at(m.x_stage), doubles_at(m.derivatives)
    nodes, weights = doubles_at(m.nodes), doubles_at(m.weights)
    h = end - m.time
    copy(m.x, m.x_new, n)
    for stage in range(m.n_stages if n > 0 else 0):
        for i in range(n):
            x_stage[i] = x[i] if stage == 0 else x[i] + nodes[stage] * h * k[i]
        set_point(m, m.time + nodes[stage] * h, m.x_stage)
        transfer(m, Action.GET_DERIVATIVES, m.get_derivatives, m.derivatives, n)
        for i in range(n):
            x_new[i] += weights[stage] * h * k[i]
    set_point(m, end, m.x_new)
    transfer(m, Action.GET_INDICATORS, m.get_indicators, m.z_new, m.n_indicators)


@njit(error_model="numpy")
def has_crossed(m: Any) -> bool:
    """Return whether an indicator's sign at the end differs from that at the present point."""
    z, z_new = doubles_at(m.z), doubles_at(m.z_new)
    crossed = False
    for i in range(m.n_indicators):
        crossed |= (z[i] > 0.0) != (z_new[i] > 0.0)
    return crossed


@njit(error_model="numpy")
def first_secant_root(m: Any, low: float, high: float) -> float:
    """Return where the secants of the indicators that change sign first cross zero."""
    n = m.n_indicators
    z, z_low, z_high = (
        doubles_at(m.z),
        doubles_at(m.z_low),
        doubles_at(m.z_high),
    )
    root = high
    for i in range(n):
        if (z[i] > 0.0) != (z_high[i] > 0.0):
            root = min(root, low + (high - low) * z_low[i] / (z_low[i] - z_high[i]))
    # A guess that is right to the tolerance must not leave the far end of the bracket where it is.
    return float(min(max(root, low + 0.5 * m.tolerance), high - 0.5 * m.tolerance))


@njit(error_model="numpy")
def locate(m: Any, end: float) -> float:
    """Find the first change of sign up to `end`, where there is one, and integrate to just behind it.

    The Illinois method, each third guess by bisection so that it always ends. Each guess is integrated
    anew from the present point: the state at the event is as accurate as at the end of a substep.
    """
    n = m.n_indicators
    copy(m.z, m.z_low, n)
    copy(m.z_new, m.z_high, n)
    low, high, t, side, guesses = m.time, end, end, 0, 0
    while high - low > m.tolerance and m.failure == 0:
        guesses += 1
        t = 0.5 * (low + high) if guesses % 3 == 0 else first_secant_root(m, low, high)
        advance(m, t)
        if has_crossed(m):
            high = t
            copy(m.z_new, m.z_high, n)
            if side > 0:
                halve(m.z_low, n)
            side = 1
        else:
            low = t
            copy(m.z_new, m.z_low, n)
            if side < 0:
                halve(m.z_high, n)
            side = -1
    if t != high:
        advance(m, high)
    return high


@njit(error_model="numpy")
def settle(m: Any) -> None:
    """Iterate the discrete states in event mode, then go on in continuous-time mode."""
    m.states_changed = 0
    iterations = 0
    m.needs_update = 1
    while m.needs_update != 0 and m.terminates == 0 and m.failure == 0:
        if iterations == MAX_ITERATIONS:
            m.failure = Failure.UNSETTLED
        iterations += 1
        update(m)
    stop_if_asked(m)
    change_mode(m, Action.ENTER_CONTINUOUS_MODE, m.enter_continuous_mode)
    if m.states_changed != 0:
        transfer(m, Action.GET_STATES, m.get_states, m.x, m.n_states)
    transfer(m, Action.GET_INDICATORS, m.get_indicators, m.z, m.n_indicators)


@njit(error_model="numpy")
def stop_if_asked(m: Any) -> None:
    """Turn the FMU's wish to end the simulation into a failure."""
    if m.terminates != 0 and m.failure == 0:
        m.failure = Failure.TERMINATED


@njit(error_model="numpy")
def handle_event(m: Any) -> None:
    """Handle an event at the present point."""
    m.events += 1
    if m.events > MAX_EVENTS and m.failure == 0:
        m.failure = Failure.CHATTERING
    change_mode(m, Action.ENTER_EVENT_MODE, m.enter_event_mode)
    settle(m)


@njit(error_model="numpy")
def integrate(m: Any, end: float) -> None:
    """Advance to `end` through all events; a time event closer than the tolerance behind it counts."""
    while m.time < end and m.failure == 0:
        is_event = m.next_event <= end + m.tolerance
        target = max(m.next_event, m.time) if is_event else end
        if target > m.time:
            advance(m, target)
            if has_crossed(m):
                is_event = True
                target = locate(m, target)
            accept(m, target)
            is_event |= complete_step(m)
            stop_if_asked(m)
        if is_event:
            handle_event(m)


@njit(error_model="numpy")
def accept(m: Any, t: float) -> None:
    """Make the result of `advance` the present point."""
    if m.failure == 0:
        m.time = t
        copy(m.x_new, m.x, m.n_states)
        copy(m.z_new, m.z, m.n_indicators)


@njit(error_model="numpy")
def take_discrete_inputs(m: Any) -> bool:
    """Take over the inputs that change at events only; return whether one of them is new."""
    u = doubles_at(m.u)
    positions = integers_at(m.discrete)
    values = doubles_at(m.discrete_values)
    changed = False
    for i in range(m.n_discrete):
        if values[i] != u[positions[i]]:
            values[i] = u[positions[i]]
            changed = True
    return changed


@njit(error_model="numpy")
def begin(m: Any, t: float) -> None:
    """Leave initialisation mode with the inputs of the first step and settle the discrete states."""
    m.time = t
    take_discrete_inputs(m)
    set_inputs(m)
    change_mode(m, Action.LEAVE_INITIALISATION, m.leave_initialisation)
    m.running = 1
    settle(m)
    transfer(m, Action.GET_STATES, m.get_states, m.x, m.n_states)


@njit(error_model="numpy")
def take_inputs(m: Any) -> None:
    """Take the inputs of a step; new discrete ones, and jumps that change a sign, are events."""
    set_point(m, m.time, m.x)
    if take_discrete_inputs(m):
        change_mode(m, Action.ENTER_EVENT_MODE, m.enter_event_mode)
        set_inputs(m)
        settle(m)
        return
    transfer(m, Action.GET_INDICATORS, m.get_indicators, m.z_new, m.n_indicators)
    if has_crossed(m):
        handle_event(m)
    else:
        copy(m.z_new, m.z, m.n_indicators)


@cfunc(STEP, cache=True, error_model="numpy")
def exchange_step(t: float, h: float, u: int, y: int, data: int) -> int:
    """Advance from `t` to ``t + h`` in equal substeps and get the outputs there."""
    m = carray(model_at(data), 1)[0]
    m.u = u
    m.start = t
    m.events = 0
    m.tolerance = EVENT_TOLERANCE * h + EVENT_ULPS * np.finfo(np.float64).eps * max(abs(t), abs(t + h))
    if m.running == 0:
        begin(m, t)
    else:
        take_inputs(m)
    n = max(1, int(np.ceil(h / m.substep - 1e-9))) if m.substep > 0.0 else 1
    for i in range(1, n + 1):
        integrate(m, t + h if i == n else t + h * i / n)
    get_outputs(m, y)
    return int(m.failure)
