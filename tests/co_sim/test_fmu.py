import re
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from co_sim import Connection, Constant, FmuComponent, InputError, Master, Port, Recorder, RunError, System
from co_sim.fmi import Slave


@pytest.fixture(autouse=True)
def temporary_folder(tmp_path, monkeypatch):
    """Every test must leave this folder as empty as it was."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    before = Path.cwd()
    yield folder
    assert list(folder.iterdir()) == []
    assert Path.cwd() == before


def run(fmu, *, n_steps=10, h=0.25, source=None):
    recorder = Recorder()
    components = {"lag": fmu}
    wires = []
    if source is not None:
        components["source"] = Constant([source], [Port("y", "V")])
        wires.append(Connection("source.y", "lag.u"))
    with Master(System(components, wires), h=h, observers=[recorder]) as master:
        master.run(n_steps=n_steps)
    return recorder


def test_ports_come_from_the_description(lag_fmu):
    fmu = FmuComponent(lag_fmu)
    assert fmu.inputs == (Port("u", "V", 0.5),)
    assert fmu.outputs == (Port("x", "V", None, "lagged voltage"), Port("direct", "V"))


def test_ports_can_be_chosen_in_any_order_and_causality(lag_fmu):
    fmu = FmuComponent(lag_fmu, inputs=[], outputs=["T", "direct"], parameters={"T": 3.0})
    assert fmu.inputs == ()
    assert [port.name for port in fmu.outputs] == ["T", "direct"]
    np.testing.assert_array_equal(run(fmu, n_steps=2).table, [[3.0, 0.0]] * 3)


@pytest.mark.parametrize("negative", [False, True])
def test_the_exact_solution_at_every_step(lag_fmu, negative):
    parameters = {"T": 2.0, "x0": -1.0, "negative": negative}
    recorder = run(FmuComponent(lag_fmu, parameters=parameters), source=3.0, n_steps=40)
    end = -3.0 if negative else 3.0
    expected = end + (-1.0 - end) * np.exp(-recorder.time / 2.0)
    np.testing.assert_allclose(recorder["lag.x"], expected, rtol=0, atol=1e-13)


def test_inputs_arrive_before_the_first_step(lag_fmu):
    recorder = run(FmuComponent(lag_fmu, parameters={"x0": 0.125}), source=3.0, n_steps=1)
    assert recorder["lag.x"][0] == 0.125
    assert recorder["lag.direct"].tolist() == [3.0, 3.0]


def test_an_input_without_connection_has_the_start_value_of_the_description(lag_fmu):
    assert run(FmuComponent(lag_fmu), n_steps=0)["lag.direct"].tolist() == [0.5]


def test_both_versions_of_fmi_agree_bit_for_bit(lag_fmus):
    tables = [run(FmuComponent(path, parameters={"T": 0.7}), source=1.1).table for path in lag_fmus.values()]
    np.testing.assert_array_equal(*tables)


def test_two_instances_keep_their_own_states(lag_fmu):
    parts = {name: FmuComponent(lag_fmu, parameters={"x0": x0}) for name, x0 in (("a", 1.0), ("b", -1.0))}
    recorder = Recorder()
    with Master(System(parts), h=0.1, observers=[recorder]) as master:
        master.run(n_steps=5)
    alone = run(FmuComponent(lag_fmu, parameters={"x0": -1.0}), n_steps=5, h=0.1)
    np.testing.assert_array_equal(recorder["b.x"], alone["lag.x"])
    assert (recorder["a.x"] != recorder["b.x"]).all()


def test_a_component_can_run_again_after_close(lag_fmu):
    fmu = FmuComponent(lag_fmu, parameters={"x0": 1.0})
    np.testing.assert_array_equal(run(fmu).table, run(fmu).table)


@pytest.mark.parametrize("literal", ["warning", 1])
def test_a_warning_does_not_stop_the_run(lag_fmu, literal):
    troubled = FmuComponent(lag_fmu, parameters={"trouble_step": 3, "trouble": literal})
    np.testing.assert_array_equal(run(troubled).table, run(FmuComponent(lag_fmu)).table)


@pytest.mark.parametrize("status", ["discard", "error", "fatal", "terminate"])
def test_other_statuses_stop_the_run_with_the_words_of_the_fmu(lag_fmu, status):
    parameters = {"trouble_step": 3, "trouble": status, "label": "Jürgen"}
    recorder = Recorder()
    master = Master(
        System({"lag": FmuComponent(lag_fmu, parameters=parameters)}), h=0.5, observers=[recorder]
    )
    with pytest.raises(RunError) as caught:
        master.run(n_steps=10)
    assert (caught.value.component, caught.value.time, caught.value.step) == ("lag", 1.5, 3)
    assert "Jürgen had trouble in step 3" in caught.value.reason
    assert len(recorder.time) == 4
    assert not hasattr(caught.value, "__notes__")  # closing went well
    if status != "terminate":
        assert f"doStep returned the status {status}" in caught.value.reason


def test_log_messages_go_to_the_instance_that_wrote_them(lag_fmu):
    def troubled(label, step, status):
        parameters = {"label": label, "trouble": status, "trouble_step": step}
        return FmuComponent(lag_fmu, parameters=parameters)

    parts = {"a": troubled("Anna", 2, "error"), "b": troubled("Bert", 1, "warning")}
    with pytest.raises(RunError, match=r'a stopped .* its log says "Anna had trouble in step 2"$'):
        Master(System(parts)).run(n_steps=9)


def test_nothing_is_unpacked_before_the_start(lag_fmu, temporary_folder):
    fmu = FmuComponent(lag_fmu)
    assert list(temporary_folder.iterdir()) == []
    fmu.close()
    fmu.start(0.0, 1.0)
    assert len(list(temporary_folder.iterdir())) == 1
    fmu.close()
    fmu.close()


def test_all_faults_of_names_and_values_are_told_together(lag_fmu):
    with pytest.raises(InputError) as caught:
        FmuComponent(
            lag_fmu,
            inputs=["U", "x"],
            outputs=["dirct"],
            parameters={
                "t": 1.0,
                "T": 0.0,
                "trouble": "warnng",
                "trouble_step": 2**31,
                "negative": 1,
                "label": 3,
                "x": 1.0,
                "x0": True,
            },
        )
    lines = str(caught.value).splitlines()
    name = lag_fmu.name
    assert lines[0] == (
        f'input "U" of {name}: got an unknown name, expected a name from its description; choose from u'
    )
    for line, expected in zip(
        lines[1:],
        [
            "got a variable with causality output, expected an input",
            'did you mean "direct"?',
            'parameter "t"',
            "got 0.0, expected a finite number from 0.001 to 100 s",
            "got 'warnng', expected one of ok, warning, discard, error, fatal, terminate",
            "got 2147483648, expected a whole number from -1 to 2.14748e+09",
            "got 1, expected True or False",
            "got 3, expected a text",
            "leave it out",
            "got True, expected a finite number from -inf to inf V",
        ],
        strict=True,
    ):
        assert expected in line


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 100.1, "1", 0.000_999])
def test_values_out_of_bounds_are_refused(lag_fmu, value):
    with pytest.raises(InputError, match=r"from 0\.001 to 100 s"):
        FmuComponent(lag_fmu, parameters={"T": value})


@pytest.mark.parametrize("value", [0.001, 100, np.float64(3.0), np.int64(3)])
def test_values_on_the_bounds_and_of_numpy_are_taken(lag_fmu, value):
    assert run(FmuComponent(lag_fmu, outputs=["T"], parameters={"T": value}))["lag.T"][-1] == value


def edited(path, folder, *changes):
    """Return a copy of an archive with changes in its description."""
    copy = folder / "edited.fmu"
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(copy, "w") as target:
        for item in source.infolist():
            content = source.read(item)
            if item.filename == "modelDescription.xml":
                before = content
                for old, new in changes:
                    content = content.replace(old.encode(), new.encode())
                assert content != before
            target.writestr(item, content)
    return copy


def test_an_archive_without_a_library_for_here_is_refused(lag_fmu, tmp_path):
    other = edited(lag_fmu, tmp_path, ('modelIdentifier="lag"', 'modelIdentifier="lead"'))
    with pytest.raises(
        InputError, match=r"got no binaries/.*lead\..* but for .*expected a library for this platform"
    ):
        FmuComponent(other)


def test_model_exchange_is_refused(lag_fmu, tmp_path):
    other = edited(
        lag_fmu,
        tmp_path,
        ("<CoSimulation", "<ModelExchange"),
        (' canHandleVariableCommunicationStepSize="true"', ""),
    )
    with pytest.raises(InputError, match="without co-simulation"):
        FmuComponent(other)


@pytest.mark.parametrize("content", [None, b"", b"no archive"])
def test_what_is_no_fmu_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "broken.fmu"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"broken\.fmu: got .* expected a ZIP archive") as caught:
        FmuComponent(path)
    assert "\n" not in str(caught.value)


def test_a_library_that_cannot_be_loaded_stops_the_start(lag_fmu, tmp_path):
    copy = tmp_path / "broken.fmu"
    with zipfile.ZipFile(lag_fmu) as source, zipfile.ZipFile(copy, "w") as target:
        for item in source.infolist():
            is_library = item.filename.startswith("binaries")
            target.writestr(item, b"no library" if is_library else source.read(item))
    with pytest.raises(RunError, match=r"lag stopped at t = 0 s \(step 0\): .*Failed to load shared library"):
        Master(System({"lag": FmuComponent(copy)})).start()


def test_an_fmu_that_refuses_to_be_instantiated_tells_why(lag_fmu, tmp_path):
    stranger = edited(lag_fmu, tmp_path, ('guid="lag"', 'guid="x"'), ('Token="lag"', 'Token="x"'))
    with pytest.raises(RunError, match=r"Failed to instantiate.*; its log says .wrong token x"):
        Master(System({"lag": FmuComponent(stranger)})).start()


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(t0=st.floats(-1e5, 1e5), h=st.floats(1e-4, 1.0), n=st.integers(1, 40))
def test_no_step_ends_behind_the_stop_time_by_a_rounding_error(lag_fmu, t0, h, n):
    with Master(System({"lag": FmuComponent(lag_fmu)}, step=h), t0, stop_time=t0 + n * h) as master:
        master.run(n_steps=n)
        with pytest.raises(InputError, match="beyond which FMUs refuse to go"):
            master.run(n_steps=1)


def test_an_fmu_is_told_the_stop_time_and_refuses_to_go_beyond(lag_fmu):
    component = FmuComponent(lag_fmu)
    component.stop_time = 1.0
    component.start(0.0, 0.5)
    component.exchange(np.zeros(1), np.zeros(2))
    component.enter_steps()
    component.step(0.5, 0.5, np.zeros(1), np.zeros(2))
    with pytest.raises(Exception, match="doStep returned the status error"):
        component.step(1.0, 0.5, np.zeros(1), np.zeros(2))
    component.close()


def test_a_run_in_pieces_has_no_stop_time(lag_fmu):
    with Master(System({"lag": FmuComponent(lag_fmu)}, step=0.5)) as master:
        for _ in range(3):
            master.run(1.0)


@pytest.mark.parametrize("stop_time", [1.3, -1.0, np.nan, np.inf])
def test_a_stop_time_between_steps_is_refused(lag_fmu, stop_time):
    with pytest.raises(InputError, match="duration: got"):
        Master(System({"lag": FmuComponent(lag_fmu)}, step=0.5), stop_time=stop_time)


@pytest.mark.parametrize(
    ("default", "given", "told"),
    [(None, None, None), ("1e-5", None, 1e-5), ("1e-5", 1e-7, 1e-7), (None, 1e-3, 1e-3)],
)
def test_the_tolerance_is_that_of_the_user_or_of_the_default_experiment(
    lag_fmu, tmp_path, monkeypatch, default, given, told
):
    path = tmp_path / "lag.fmu"
    with zipfile.ZipFile(lag_fmu) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "modelDescription.xml" and default:
                experiment = f'<DefaultExperiment tolerance="{default}"/><ModelVariables>'
                data = re.sub(b"<DefaultExperiment[^>]*/>", b"", data)
                data = data.replace(b"<ModelVariables>", experiment.encode())
            target.writestr(name, data)
    calls = {}

    def spy(self, name, *arguments):
        calls[name] = [getattr(a, "value", a) for a in arguments]
        return call(self, name, *arguments)

    call = Slave._call
    monkeypatch.setattr(Slave, "_call", spy)
    fmu = FmuComponent(path, tolerance=given)
    assert fmu.tolerance == told
    with Master(System({"lag": fmu}, step=0.5), 1.0, stop_time=2.0) as master:
        master.run(1.0)
    (arguments,) = (calls[name] for name in ("SetupExperiment", "EnterInitializationMode") if calls.get(name))
    assert arguments == [told is not None, told or 0.0, 1.0, True, 2.0]


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, np.nan, np.inf])
def test_a_tolerance_that_is_none_is_refused(lag_fmu, tolerance):
    with pytest.raises(InputError, match=r"tolerance of lag.*a positive number"):
        FmuComponent(lag_fmu, tolerance=tolerance)
