"""What the master adds: the whole scheme of `wheelset run`, against the sum of its parts.

    python benchmarks/scheme_cost.py

The whole: one run in the compiled loop with every signal recorded. The sum: each part alone in a bare loop of
machine code, over the inputs that it had in the run. The plant is stepped there by the three C functions
of its FMU, the others by their own steps; what they write must be what the run recorded, bit for bit.
Starting components (unpacking the FMU) counts on neither side. Rounds alternate between both sides; a
ratio is the median over the rounds. Times are of the processor, so that other programs count little.
"""

from __future__ import annotations

import statistics
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import carray, njit, types

from co_sim import fmi_table as at
from co_sim.fmu import FmuComponent
from co_sim.master import Master
from co_sim.native import STEP, caller, integers_at
from co_sim.observers import Recorder
from co_sim.wheelset.assembly import assemble
from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.scenario_file import load_scenario

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.component import Component
    from co_sim.system import System

    Table = NDArray[np.float64]

ROUNDS = 15

_pointer, _double, _int = types.intp, types.float64, types.int32
call_step = caller(STEP)
transfer = caller(_int(_pointer, _pointer, _pointer, _pointer, _pointer))
do_step = caller(_int(_pointer, _double, _double, _int, _pointer, _pointer, _pointer, _pointer))


@njit(nogil=True, error_model="numpy")
def steps_alone(address: int, data: int, h: float, u: Table, y: Table) -> int:
    """Step a component over the rows of inputs `u`; its outputs go to the rows of `y`."""
    for k in range(len(u)):
        status = call_step(
            address, (k * h, h, u.ctypes.data + 8 * k * u.shape[1], y.ctypes.data + 8 * k * y.shape[1], data)
        )
        if status:
            return k
    return len(u)


@njit(nogil=True, error_model="numpy")
def fmu_alone(table: NDArray[np.int64], h: float, u: Table, y: Table, scratch: NDArray[np.int64]) -> int:
    """Step an FMI 3 instance, as `steps_alone`, by the functions of the FMU."""
    inputs, outputs = table[at.HEADER :], table[at.HEADER + at.ROW :]
    set_values, get_values, step = inputs[at.FUNCTION], outputs[at.FUNCTION], table[at.DO_STEP]
    set_references, get_references = inputs[at.REFERENCES], outputs[at.REFERENCES]
    instance, n_u, n_y, flags = table[at.INSTANCE], u.shape[1], y.shape[1], scratch.ctypes.data
    for k in range(len(u)):
        status = transfer(set_values, (instance, set_references, n_u, u.ctypes.data + 8 * k * n_u, n_u))
        status += do_step(step, (instance, k * h, h, 1, flags, flags + 1, flags + 2, flags + 8))
        status += transfer(get_values, (instance, get_references, n_y, y.ctypes.data + 8 * k * n_y, n_y))
        if status:
            return k
    return len(u)


def whole(system: System, n: int) -> tuple[float, Recorder]:
    """Return the time of a run of `n` steps, s, and its record."""
    recorder = Recorder()
    with Master(system, observers=[recorder]) as master:
        master.start()
        begin = time.thread_time()
        master.run(n_steps=n)
        return time.thread_time() - begin, recorder


def inputs_of(system: System, name: str, record: Recorder) -> Table:
    """Return what a component was given at each step; all signals are scalars."""
    sources = {connection.target: connection.source for connection in system.connections}
    ports = system.components[name].inputs
    u = np.empty((len(record.time) - 1, len(ports)))
    for i, port in enumerate(ports):
        source = sources.get(f"{name}.{port.name}")
        u[:, i] = port.start if source is None else record[source][:-1]
    return u


def alone(component: Component, h: float, u: Table, expected: Table) -> float:
    """Return the time of a component's steps in a loop of its own, s."""
    component.start(0.0, h)
    try:
        # As a master starts it, at the inputs of the start.
        component.exchange(u[0] if len(u[0]) else np.empty(0), np.empty(expected.shape[1]))
        component.enter_steps()
        y, scratch = np.zeros(expected.shape), np.zeros(2, dtype=np.int64)
        address, data, _ = component.native()
        table = table_at(data)
        begin = time.thread_time()
        if isinstance(component, FmuComponent):
            done = fmu_alone(table, h, u, y, scratch)
        else:
            done = steps_alone(address, data, h, u, y)
        used = time.thread_time() - begin
    finally:
        component.close()
    assert done == len(u)
    np.testing.assert_array_equal(y, expected)
    return used


@njit
def table_at(address: int) -> Any:
    """Return the first rows of the table of an FMU."""
    return carray(integers_at(address), at.HEADER + 2 * at.ROW)


def measure(scenario_name: str) -> None:
    """Print the cost of the first run of a scenario, and of its parts."""
    scenario, folder = load_scenario(scenario_name)
    laboratory = Laboratory(scenario, scenario_name, folder)
    identifier = laboratory.identifier(laboratory.run().filters)
    case, h = laboratory.cases[0], scenario.simulation.step
    system = assemble(scenario, case, identifier)
    n = round(case.duration / h)
    _, record = whole(system, n)
    columns = [name.partition(".")[0] for name in record.names]
    given = {name: inputs_of(system, name, record) for name in system.components}
    wrote = {name: record.table[1:, [c == name for c in columns]].copy() for name in system.components}
    runs, parts = [], {name: [] for name in system.components}
    for _ in range(ROUNDS):
        runs.append(whole(system, n)[0])
        for name, component in system.components.items():
            parts[name].append(alone(component, h, given[name], wrote[name]))
    sums = [sum(times) for times in zip(*parts.values(), strict=True)]
    ratio = statistics.median(a / b for a, b in zip(runs, sums, strict=True))
    print(f"{scenario_name}, run {case.name}: {n} steps of {h:g} s, {len(record.names)} signals recorded")
    for name, times in [*parts.items(), ("sum of the parts", sums), ("whole scheme", runs)]:
        used = statistics.median(times)
        print(f"  {name:18} {1e6 * used / n:7.2f} us a step {n * h / used:9.0f} x real time")
    print(f"  whole / sum of the parts: {ratio:.2f}")


def main() -> None:
    """Measure both packaged scenarios."""
    for name in ("default", "adhesion-drop"):
        measure(name)


if __name__ == "__main__":
    main()
