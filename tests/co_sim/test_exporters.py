"""FMUs of PythonFMU, PythonFMU3 and our own C, coupled across the versions of FMI.

A control loop: difference (PythonFMU3, FMI 3) -> lag (C, FMI 2) -> integrator (PythonFMU, FMI 2)
-> lag (C, FMI 3) -> difference.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from co_sim import Connection, Constant, Coupling, FmuComponent, Master, Port, Recorder, RunError, System

pythonfmu = pytest.importorskip("pythonfmu", reason="PythonFMU is in the extra `test`")
pythonfmu3 = pytest.importorskip("pythonfmu3", reason="PythonFMU3 is a dependency")

T1, T2, GAIN, WANTED = 0.2, 0.05, 2.0, 1.5


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The archives of both exporters by name."""
    folder = tmp_path_factory.mktemp("exporters")
    scripts = Path(__file__).with_name("exporters")
    return {
        "integrator": Path(pythonfmu.FmuBuilder.build_FMU(scripts / "integrator.py", dest=folder)),
        "difference": Path(pythonfmu3.FmuBuilder.build_FMU(scripts / "difference.py", dest=folder)),
    }


def control_loop(exported, lag_fmus, step=0.01, coupling=None, **inputs):
    names = [
        "wanted",
        "found",
        *(["on"] if "on" in inputs else []),
        *(["count"] if "count" in inputs else []),
    ]
    parts = {
        "target": Constant([WANTED], [Port("y")]),
        "difference": FmuComponent(exported["difference"], inputs=names),
        "actuator": FmuComponent(lag_fmus[2], outputs=["x"], parameters={"T": T1}),
        "plant": FmuComponent(
            exported["integrator"], outputs=["y", "steps", "high"], parameters={"gain": GAIN}
        ),
        "sensor": FmuComponent(lag_fmus[3], outputs=["x"], parameters={"T": T2}),
    }
    wires = [
        Connection("target.y", "difference.wanted"),
        # The lags count in volts; the other exporters leave units out.
        Connection("sensor.x", "difference.found", convert_units=False),
        Connection("difference.error", "actuator.u", convert_units=False),
        Connection("actuator.x", "plant.u", convert_units=False),
        Connection("plant.y", "sensor.u", convert_units=False),
    ]
    wires += [Connection(source, f"difference.{name}") for name, source in inputs.items()]
    return System(parts, wires, step=step, coupling=coupling or Coupling())


def trajectory(system, duration=2.0, **options):
    recorder = Recorder()
    with Master(system, observers=[recorder], **options) as master:
        master.run(duration)
    return recorder


SIGNALS = ("difference.error", "actuator.x", "plant.y", "sensor.x")


def jacobi(step, n):
    """Return the loop in this process: everything sees what was known when the step began."""
    rows = [np.array([WANTED, 0.0, 0.0, 0.0])]
    for _ in range(n):
        e, a, y, s = rows[-1]
        rows.append(
            np.array(
                [
                    WANTED - s,
                    e + (a - e) * np.exp(-step / T1),
                    y + GAIN * a * step,
                    y + (s - y) * np.exp(-step / T2),
                ]
            )
        )
    return np.array(rows)


def gauss_seidel(step, n):
    """Return the loop in this process: each sees what those before it have made of the step."""
    rows = [np.array([WANTED, 0.0, 0.0, 0.0])]
    for _ in range(n):
        _, a, y, s = rows[-1]
        e = WANTED - s
        a = e + (a - e) * np.exp(-step / T1)
        y = y + GAIN * a * step
        rows.append(np.array([e, a, y, y + (s - y) * np.exp(-step / T2)]))
    return np.array(rows)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_loop_of_four_fmus_is_that_of_one_process(exported, lag_fmus, compiled):
    record = trajectory(control_loop(exported, lag_fmus), compiled=compiled)
    got = np.column_stack([record[name] for name in SIGNALS])
    np.testing.assert_allclose(got, jacobi(0.01, 200), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(record["plant.steps"], np.arange(201))
    np.testing.assert_array_equal(record["plant.high"], record["plant.y"] > 0.5)


def test_one_after_the_other_is_that_of_one_process_too(exported, lag_fmus):
    record = trajectory(control_loop(exported, lag_fmus, coupling=Coupling("gauss-seidel")))
    got = np.column_stack([record[name] for name in SIGNALS])
    reference = gauss_seidel(0.01, 200)
    assert np.abs(reference - jacobi(0.01, 200)).max() > 1e-3
    np.testing.assert_allclose(got, reference, rtol=0, atol=1e-12)


def test_the_loop_converges_to_the_differential_equation(exported, lag_fmus):
    A = np.array([[-1 / T1, 0, -1 / T1], [GAIN, 0, 0], [0, 1 / T2, -1 / T2]])
    rest = np.array([0.0, WANTED, WANTED])
    errors = []
    for step in (0.01, 0.005, 0.0025):
        record = trajectory(control_loop(exported, lag_fmus, step=step))
        exact = np.array([rest + expm(A * t) @ -rest for t in record.time])
        got = np.column_stack([record[name] for name in SIGNALS[1:]])
        errors.append(np.abs(got - exact).max())
    assert errors[0] < 0.1
    assert errors[0] / errors[1] > 1.8
    assert errors[1] / errors[2] > 1.8


def test_integers_and_booleans_pass_from_fmi_2_to_fmi_3(exported, lag_fmus):
    system = control_loop(exported, lag_fmus, on="plant.high", count="plant.steps")
    record = trajectory(system, 0.5)
    # It is off while the plant is low, which it stays.
    assert not record["difference.error"].any()
    assert record["plant.steps"][-1] == 50


def test_texts_of_pythonfmu_are_read(exported):
    plant = FmuComponent(exported["integrator"], outputs=["words", "y"])
    record = trajectory(System({"plant": plant}, step=0.1), 0.3)
    assert record["plant.words"][-1] == "Größe 3"


def test_a_failure_in_python_is_told_with_its_words_and_its_time(exported):
    parts = {"source": Constant([2e3], [Port("u")]), "plant": FmuComponent(exported["integrator"])}
    with pytest.raises(RunError) as caught, Master(System(parts, [Connection("source.u", "plant.u")])) as m:
        m.run(0.1)
    assert caught.value.component == "plant"
    assert "discard" in str(caught.value)
    assert "an input of 2000 is too much" in str(caught.value)
