"""Every component travels to another process before it is started, and gives the same rows there."""

from __future__ import annotations

import pickle

import control
import numpy as np
import pytest

import fmu_wheelset
from co_sim import (
    CompiledComponent,
    Constant,
    ExchangeFmu,
    FmuComponent,
    FunctionComponent,
    LinearComponent,
    Master,
    Port,
    Recorder,
    System,
    TimeTable,
    run,
)
from co_sim.compiled_component import compiled
from co_sim.component import StateError
from co_sim.kernel import gather
from co_sim.supervisor.pickling import dumps
from co_sim.wheelset.assembly import assemble
from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.scenario_file import load_scenario


@compiled
def decay(t, h, u, y, x, p):
    x[0] -= h * p[0] * x[0]
    y[0] = x[0]
    return 0


def plain_decay(t, h, u, y, x, p):
    x[0] -= 2.0 * h * x[0]
    y[0] = x[0]
    return 0


def scenario():
    plan, folder = load_scenario("default")
    return assemble(plan, Laboratory(plan, "default", folder).cases[0], None)


def alone(component, step=0.01):
    return System({"part": component}, step=step)


OUTPUT = [Port("y", start=1.0)]
MODEL = control.ss([[-1.0, 2.0], [-2.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
SYSTEMS = {
    "function": lambda: alone(FunctionComponent(lambda t, u: [np.sin(t)], outputs=OUTPUT)),
    "compiled": lambda: alone(
        CompiledComponent(decay, outputs=OUTPUT, state=[1.0], parameters={"rate": 3.0}, feedthrough={})
    ),
    "prepared": lambda: alone(
        CompiledComponent(
            decay, outputs=OUTPUT, state=[1.0], prepare=lambda h, values: [0.1 / h], feedthrough={}
        )
    ),
    "plain": lambda: alone(CompiledComponent(plain_decay, outputs=OUTPUT, state=[1.0], feedthrough={})),
    "linear": lambda: alone(LinearComponent(MODEL, inputs=[Port("u", start=1.0)], x0=[1.0, 0.0])),
    "constant": lambda: alone(Constant(["wet", 2.0], [Port("rail", kind="string"), Port("x")])),
    "table": lambda: alone(TimeTable([0.0, 0.2], [0.0, 5.0], [Port("x")], interpolation="linear")),
    "fmu": lambda: alone(FmuComponent(fmu_wheelset.path(), parameters={"lateral_displacement": 0.003}), 1e-3),
    "exchange": lambda: alone(
        ExchangeFmu(fmu_wheelset.path(), parameters={"lateral_displacement": 0.003}, substep=2e-4), 1e-3
    ),
    "scenario": scenario,
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_same_rows_in_another_process(name):
    system = SYSTEMS[name]()
    record = run(system, 30 * system.step)
    recorder = Recorder()
    with Master(system, observers=[recorder]) as master:
        master.run(n_steps=30)
    assert record.names == recorder.names
    assert np.array_equal(record.table, recorder.table)
    assert np.ptp(record.table, axis=0).any() or name == "constant"


def test_importable_compiled_functions_travel_by_name():
    assert pickle.loads(dumps(gather)) is gather


@pytest.mark.parametrize("nested", [True, False])
def test_other_compiled_functions_keep_their_cache(nested):
    dumps(_nested())  # in the cache from now on
    function = pickle.loads(dumps(_nested() if nested else decay))
    assert function.stats.cache_hits or function is decay
    assert not function.stats.cache_misses or function is decay
    y = np.zeros(1)
    assert function(0.0, 0.25, np.zeros(0), y, np.ones(1), np.ones(1)) == 0
    assert y[0] == (0.25 if nested else 0.75)


def _nested():
    @compiled
    def nested(t, h, u, y, x, p):
        y[0] = h
        return 0

    return nested


def test_a_running_fmu_does_not_travel(faulty_fmu):
    component = FmuComponent(faulty_fmu)
    with Master(System({"part": component}, step=0.1)) as master:
        master.start()
        with pytest.raises(StateError, match="is running"):
            dumps(component)
    dumps(component)


def test_relative_paths_lead_to_the_same_file(faulty_fmu, monkeypatch, tmp_path):
    monkeypatch.chdir(faulty_fmu.parent)
    component = FmuComponent(faulty_fmu.name)
    data = dumps(component)
    monkeypatch.chdir(tmp_path)
    with Master(System({"part": pickle.loads(data)}, step=0.1)) as master:
        master.run(n_steps=1)
