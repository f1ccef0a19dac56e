"""Ports of every type: the FMU in parrot.c says each input again, plus the number of steps done."""

import copy
import itertools
import pickle
import threading
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim import Connection, Constant, FmuComponent, InputError, Master, Port, System
from co_sim.local_model import NotLinearizableError
from co_sim.texts import number_of, text_of
from co_sim.units import Unit

INTEGERS = {
    "int8": (-(2**7), 2**7 - 1),
    "uint8": (0, 2**8 - 1),
    "int16": (-(2**15), 2**15 - 1),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
    "int64": (-(2**53), 2**53),
    "uint64": (0, 2**53),
    "boolean": (0, 1),
    "enumeration": (-(2**53), 2**53),
}
NUMERIC = ("float64", "float32", *INTEGERS)


class Running:
    """A component between `start` and `close`, past its initialisation."""

    def __init__(self, component, u=None, t0=0.0):
        self.component = component
        self.u, self.t0 = u, t0
        self.y = np.full(sum(port.size for port in component.outputs), np.nan)

    def __enter__(self):
        self.component.start(self.t0, 0.5)
        if self.u is None:
            self.u = starts(self.component)
        self.component.exchange(self.u[: self.n_inputs], self.y)
        self.component.enter_steps()
        return self

    def __exit__(self, *_):
        self.component.close()

    @property
    def n_inputs(self):
        return sum(port.size for port in self.component.inputs)

    def step(self, u=None, t=0.0):
        self.component.step(t, 0.5, np.ascontiguousarray(self.u if u is None else u, dtype=float), self.y)
        return self.y.copy()


def starts(component):
    values = [start for port in component.inputs for start in port.starts]
    return np.array([number_of(value) if isinstance(value, str) else value for value in values])


def named(ports):
    return {port.name: port for port in ports}


def kinds_of(path):
    return [port.kind for port in FmuComponent(path).inputs if port.name == f"{port.kind}_in"]


def test_ports_of_fmi_3_have_the_kind_shape_and_start_of_the_description(parrots):
    fmu = FmuComponent(parrots[3])
    inputs, outputs = named(fmu.inputs), named(fmu.outputs)
    for kind in (*NUMERIC, "string"):
        start = {"boolean": 1.0, "enumeration": 2.0, "string": "hi"}.get(kind, 1.0)
        is_float = kind in {"float64", "float32"}
        assert inputs[f"{kind}_in"] == Port(f"{kind}_in", start=start, kind=kind, continuous=is_float)
        assert outputs[f"{kind}_out"] == Port(f"{kind}_out", kind=kind, continuous=is_float)
    assert inputs["a_in"] == Port("a_in", "m", (1.0, 2.0, 3.0, 4.0), shape=(2, 2))
    assert inputs["v_in"] == Port("v_in", start=(5.0, 6.0), kind="int32", shape=(2,), continuous=False)
    assert inputs["texts_in"].starts == ("x", "y")
    assert outputs["texts_out"].elements == ("texts_out[1]", "texts_out[2]")


def test_ports_of_fmi_2_have_the_kind_of_the_description(parrots):
    fmu = FmuComponent(parrots[2])
    assert [port.kind for port in fmu.inputs] == ["float64", "int32", "boolean", "enumeration", "string"]
    assert [port.continuous for port in fmu.inputs] == [True, False, False, False, False]
    assert fmu.inputs[-1].start == "hi"


def test_binaries_clocks_and_clocked_variables_are_no_ports(parrots):
    assert not {"blob", "tick", "ticked"} & set(named(FmuComponent(parrots[3]).inputs))
    with pytest.raises(InputError) as caught:
        FmuComponent(parrots[3], inputs=["blob", "tick", "ticked"])
    for line, what in zip(
        str(caught.value).splitlines(),
        ["a scalar of type Binary", "a scalar of type Clock", "a clocked variable of type Float64"],
        strict=True,
    ):
        assert f"got {what}, expected a number, a boolean or a text" in line


@pytest.mark.parametrize("with_texts", [False, True])
def test_every_type_passes_both_ways(parrot, with_texts):
    kinds = [kind for kind in kinds_of(parrot) if with_texts or kind != "string"]
    fmu = FmuComponent(
        parrot, inputs=[f"{kind}_in" for kind in kinds], outputs=[f"{kind}_out" for kind in reversed(kinds)]
    )
    values = {"float64": 0.1, "float32": 0.5, "uint8": 250, "boolean": 1, "enumeration": 2}
    u = np.array([number_of("Jürgen") if kind == "string" else values.get(kind, 100) for kind in kinds])
    if fmu.takes_derivatives:
        u = np.concatenate([u, np.zeros(2 * len(u))])
    with Running(fmu, u) as run:
        assert (fmu.native() is None) == with_texts
        for step in (1, 2, 3):
            expected = {kind: values.get(kind, 100) + step for kind in kinds}
            expected |= {"boolean": float(step % 2 == 0), "enumeration": 2}
            y = run.step()
            for kind, value in zip(reversed(kinds), y, strict=True):
                if kind == "string":
                    assert text_of(value) == f"Jürgen{step}"
                else:
                    assert value == expected[kind]


def test_arrays_travel_row_by_row(parrots):
    fmu = FmuComponent(
        parrots[3],
        inputs=["v_in", "a_in"],
        outputs=["a_out", "v_out"],
        parameters={"n": 3, "gains": [[1.0, 10.0], [100.0, 1000.0]]},
    )
    assert [port.shape for port in fmu.outputs] == [(2, 2), (3,)]
    assert named(fmu.inputs)["v_in"].start is None  # the description has two values for three elements
    with Running(fmu, np.array([7.0, 8.0, 9.0, 1.0, 2.0, 3.0, 4.0])) as run:
        np.testing.assert_array_equal(run.y, [1.0, 20.0, 300.0, 4000.0, 9.0, 8.0, 7.0])
        np.testing.assert_array_equal(run.step(), [2.0, 21.0, 301.0, 4001.0, 10.0, 9.0, 8.0])


def test_structural_parameters_of_a_system_change_the_shapes(parrots):
    fmu = FmuComponent(parrots[3], inputs=[], outputs=["v_out"], parameters={"n": 1})
    assert fmu.outputs[0].shape == (1,)
    fmu.set_parameters({"n": 4})
    assert fmu.outputs[0].shape == (4,)
    with Running(fmu) as run:
        assert run.step().tolist() == [1.0, 1.0, 1.0, 1.0]
    fmu.set_parameters({})
    assert fmu.outputs[0].shape == (1,)


def test_texts_in_arrays(parrots):
    fmu = FmuComponent(parrots[3], inputs=["texts_in"], outputs=["texts_out"])
    with Running(fmu) as run:
        assert [text_of(number) for number in run.step()] == ["y1", "x1"]


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("gains", [1.0, 2.0], "expected an array of 2 by 2, a finite number"),
        ("gains", [[1.0], [2.0, 3.0]], "expected an array of 2 by 2"),
        ("gains", 1.0, "expected an array of 2 by 2"),
        ("gains", [[1.0, 2.0], [3.0, "4"]], "got '4', expected a finite number"),
        ("n", 9, "expected a whole number from 0 to 8"),
        ("n", 2.0, "expected a whole number from 0 to 8"),
        ("offset", [1], "got [1], expected a whole number"),
    ],
)
def test_parameters_of_another_shape_are_refused(parrots, name, value, told):
    faults = list(FmuComponent(parrots[3]).parameter_faults({name: value}))
    assert [told in str(fault) for fault in faults] == [True]


def rows(path, u, *, in_python):
    """Return three steps by machine code or by the interpreter."""
    fmu = FmuComponent(
        path,
        inputs=[p.name for p in FmuComponent(path).inputs if p.kind != "string"],
        outputs=[p.name for p in FmuComponent(path).outputs if p.kind != "string"],
    )
    with Running(fmu, u) as run:
        if in_python:
            for k in range(3):
                fmu._bound.step(0.5 * k, 0.5, u[: run.n_inputs], run.y)
                yield run.y.copy()
        else:
            for k in range(3):
                yield run.step(t=0.5 * k)


@given(st.data())
@settings(max_examples=25, deadline=None)
def test_machine_code_and_interpreter_agree_bit_for_bit(parrots, data):
    version = data.draw(st.sampled_from([2, 3]))
    ports = [port for port in FmuComponent(parrots[version]).inputs if port.kind != "string"]
    values = []
    for port in ports:
        if port.kind in INTEGERS:
            low, high = INTEGERS[port.kind]
            if port.kind == "enumeration" and version == 2:
                low, high = INTEGERS["int32"]
            strategy = st.integers(low, high - 3 if port.kind in {"int64", "uint64"} else high)
        else:
            strategy = st.floats(width=int(port.kind[-2:]))
        values += [float(data.draw(strategy)) for _ in range(port.size)]
    u = np.array(values)
    if version == 2:
        u = np.concatenate([u, np.zeros(2 * len(u))])
    native, python = (list(rows(parrots[version], u, in_python=p)) for p in (False, True))
    assert [row.tobytes() for row in native] == [row.tobytes() for row in python]


def outcome(run, u, *, in_python):
    try:
        if in_python:
            run.component._bound.step(0.0, 0.5, u, run.y)
        else:
            run.step(u)
    except Exception as error:
        return str(error)
    return None


@given(kind=st.sampled_from(sorted(INTEGERS)), data=st.data())
@settings(max_examples=150, deadline=None)
def test_whole_numbers_pass_if_and_only_if_the_type_holds_them(parrots, kind, data):
    low, high = INTEGERS[kind]
    edges = [edge + d for edge in (low, high) for d in (-2, -1, -0.5, 0, 0.5, 1, 2)]
    x = data.draw(st.sampled_from(edges) | st.integers(-(2**60), 2**60) | st.floats())
    x = float(x)
    fits = np.isfinite(x) and x == int(x) and low <= x <= high
    fmu = FmuComponent(parrots[3], inputs=["float64_in", f"{kind}_in"], outputs=["float64_out"])
    with Running(fmu, np.array([0.0, 0.0])) as run:
        told = [outcome(run, np.array([0.0, x]), in_python=in_python) for in_python in (False, True)]
    assert told[0] == told[1]
    assert (told[0] is None) == fits
    if not fits:
        limits = "0 or 1" if kind == "boolean" else f"a whole number from {low} to {high}"
        assert told[0] == f'input "{kind}_in" is {x!r}, expected {limits}'


@pytest.mark.parametrize("x", [1e39, -3.5e38, np.inf, np.nan, 3.4e38])
def test_a_float32_is_not_turned_into_infinity(parrots, x):
    fmu = FmuComponent(parrots[3], inputs=["float32_in"], outputs=["float32_out"])
    with Running(fmu, np.zeros(1)) as run:
        told = [outcome(run, np.array([x]), in_python=in_python) for in_python in (False, True)]
    assert told[0] == told[1]
    assert (told[0] is not None) == (abs(x) > 3.41e38 and np.isfinite(x))


@pytest.mark.parametrize(
    ("kind", "offset", "value"),
    [
        ("int64", 2**53, 2**53 + 1),
        ("int64", -(2**53) - 9, -(2**53) - 8),
        ("uint64", 2**53, 2**53 + 1),
        ("uint64", -5, 2**64 - 4),
    ],
)
def test_whole_numbers_that_a_float64_rounds_stop_the_run(parrots, kind, offset, value):
    fmu = FmuComponent(
        parrots[3], inputs=[], outputs=["int8_out", f"{kind}_out"], parameters={"offset": offset}
    )
    told = f'output "{kind}_out" is {value}, and beyond 2**53 not every {kind} is a float64'
    with Running(FmuComponent(parrots[3], inputs=[], outputs=[])) as idle:
        assert outcome(idle, np.empty(0), in_python=False) is None
    fmu.start(0.0, 0.5)
    fmu.enter_steps()
    y = np.zeros(2)
    with pytest.raises(Exception, match="beyond") as native:
        fmu.step(0.0, 0.5, np.empty(0), y)
    with pytest.raises(Exception, match="beyond") as python:
        fmu._bound.step(0.5, 0.5, np.empty(0), y)
    fmu.close()
    assert str(native.value) == told
    assert str(python.value) == told.replace(str(value), str(value + 1))


@pytest.mark.parametrize("outputs", [["float64_out"], ["int32_out"]])
@pytest.mark.parametrize(
    ("status", "label"),
    [
        (2, "discard"),
        (3, "error"),
        (4, "fatal"),
        (5, "pending; asynchronous FMUs are not supported"),
        (-1, "-1, which is none of FMI"),
        (77, "77, which is none of FMI"),
    ],
)
@pytest.mark.parametrize(
    ("call", "action"), [(1, "setting the inputs"), (2, "doStep"), (3, "getting the outputs")]
)
def test_refused_calls_say_which_and_how(parrot, outputs, status, label, call, action):
    parameters = {"trouble": status, "trouble_in": call}
    fmu = FmuComponent(parrot, inputs=["int32_in"], outputs=outputs, parameters=parameters)
    with Running(fmu) as run:
        run.step()
        assert outcome(run, run.u, in_python=False) == f"{action} returned the status {label}"
        assert outcome(run, run.u, in_python=True) == f"{action} returned the status {label}"


@pytest.mark.parametrize("call", [1, 2, 3])
@pytest.mark.parametrize("inputs", [["float64_in"], ["int32_in"], []])
def test_warnings_change_nothing(parrot, call, inputs):
    parameters = {"trouble": 1, "trouble_in": call}
    fmu = FmuComponent(parrot, inputs=inputs, outputs=["sum"], parameters=parameters)
    with Running(fmu, np.array([1.0, 0.0, 0.0])[: 3 * len(inputs)]) as run:
        steps = [run.step()[0] for _ in range(3)]
    expected = [0.5, 1.0, 1.5] if inputs == ["float64_in"] else [0.0] * 3
    assert steps == expected


@pytest.mark.parametrize("outputs", [["float64_out"], ["int32_out"], ["string_out"]])
def test_an_early_return_is_a_failure(parrots, outputs):
    fmu = FmuComponent(parrots[3], outputs=outputs, inputs=[], parameters={"trouble_in": 4})
    with Running(fmu) as run:
        run.step()
        with pytest.raises(Exception, match=r"the FMU ended the simulation at t = 0\.75 s$"):
            run.step(t=0.5)


def test_derivatives_of_inputs_are_set_when_there_are_any(parrots):
    fmu = FmuComponent(parrots[2], inputs=["float64_in"], outputs=["sum", "order"])
    assert fmu.takes_derivatives
    with Running(fmu, np.array([1.0, 0.0, 0.0])) as run:
        assert run.step().tolist() == [0.5, 0.0]
        assert run.step([1.0, 2.0, 0.0]).tolist() == [0.5 + 0.75, 1.0]
        assert run.step([0.0, 0.0, 6.0])[1] == 2.0
        assert run.y[0] == 0.5 + 0.75 + 0.125
        run.y[1] = np.nan
        # The last ones are taken back.
        assert run.step([1.0, 0.0, 0.0]).tolist() == [0.5 + 0.75 + 0.125 + 0.5, 2.0]


def test_fmi_3_and_texts_have_no_derivatives(parrots):
    assert not FmuComponent(parrots[3]).takes_derivatives
    assert not FmuComponent(parrots[2]).takes_derivatives
    assert not FmuComponent(parrots[2], inputs=["int32_in"], outputs=[]).takes_derivatives


def test_dependencies_are_those_of_the_description(parrot):
    fmu = FmuComponent(parrot)
    every = frozenset(port.name for port in fmu.inputs)
    assert fmu.feedthrough["float64_out"] == {"float64_in"}
    assert fmu.feedthrough["string_out"] == every  # says nothing
    assert fmu.feedthrough["sum"] == {"float64_in"}  # during initialisation
    chosen = FmuComponent(parrot, inputs=["int32_in"], outputs=["float64_out", "int32_out", "trouble"])
    assert chosen.feedthrough == {"float64_out": set(), "int32_out": {"int32_in"}, "trouble": set()}
    state = FmuComponent(parrot, outputs=["der(sum)", "sum"]).feedthrough
    assert state == {"der(sum)": every, "sum": {"float64_in"}}


def test_an_fmu_that_declares_no_dependencies_is_not_known(lag_fmu):
    assert FmuComponent(lag_fmu).feedthrough is None


def test_states_and_directional_derivatives(parrot, lag_fmu):
    fmu = FmuComponent(parrot)
    (state,) = fmu.states
    assert (state.name, state.unit, state.derivative, state.derivative_unit) == (
        "sum",
        "m",
        "der(sum)",
        "m/s",
    )
    with Running(fmu):
        result = fmu.directional_derivative(["der(sum)", "float64_out"], ["sum", "float64_in"], [2.0, 3.0])
        with pytest.raises(InputError, match=r'variable "summ" of parrot.*did you mean "sum"'):
            fmu.directional_derivative(["sum"], ["summ"], [1.0])
    assert result.tolist() == [3.0, 3.0]
    other = FmuComponent(lag_fmu)
    assert other.states is None
    assert other.directional_derivative(["x"], ["u"], [1.0]) is None


def test_copies_and_pickles_are_independent(parrot):
    original = FmuComponent(parrot, inputs=["int32_in"], outputs=["int32_out"])
    parts = [original, copy.deepcopy(original), pickle.loads(pickle.dumps(original))]
    for part in parts[1:]:
        part.set_parameters({"trouble": 3, "trouble_in": 2})
    for part, fails in zip(parts, [False, True, True], strict=True):
        with Running(part, np.zeros(1)) as run:
            run.step()
            assert (outcome(run, run.u, in_python=False) is not None) == fails


def test_instances_run_in_threads_side_by_side(parrot):
    results = {}

    def work(i):
        for _ in range(5):
            fmu = FmuComponent(parrot, inputs=["int32_in", "float64_in"], outputs=["int32_out", "sum"])
            u = np.array([i, i, 0, 0, 0, 0], dtype=float)
            with Running(fmu, u) as run:
                results[i] = [run.step().tolist() for _ in range(50)]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in range(8):
        assert results[i] == [[i + k, i * k / 2] for k in range(1, 51)]


def test_bad_ports_of_every_combination_of_native_and_python_agree_on_order(parrots):
    """The position that is told is the element's, wherever its group stands."""
    for order in itertools.permutations(["int8_in", "float64_in", "v_in"]):
        fmu = FmuComponent(parrots[3], inputs=order, outputs=[])
        names = [element for port in fmu.inputs for element in port.elements]
        u = np.zeros(len(names))
        u[names.index("v_in[2]")] = 0.25
        with Running(fmu, np.zeros(len(names))) as run:
            assert outcome(run, u, in_python=False) == outcome(run, u, in_python=True)
            assert 'input "v_in[2]" is 0.25' in outcome(run, u, in_python=False)


def test_a_start_value_that_a_float64_rounds_is_none(parrots, tmp_path):
    path = tmp_path / "large.fmu"
    with zipfile.ZipFile(parrots[3]) as source, zipfile.ZipFile(path, "w") as target:
        for item in source.infolist():
            content = source.read(item)
            if item.filename == "modelDescription.xml":
                old = b'name="int64_in" valueReference="8" causality="input" start="1"'
                assert old in content
                content = content.replace(old, old.replace(b'"1"', b'"9007199254740993"'))
            target.writestr(item, content)
    assert named(FmuComponent(path).inputs)["int64_in"].start is None


def test_a_linear_model_from_directional_derivatives(parrot, lag_fmu):
    fmu = FmuComponent(parrot, inputs=["int32_in", "float64_in"], outputs=["sum", "int32_out", "float64_out"])
    u = np.array([3.0, 4.0, 0.0, 0.0, 0.0, 0.0])
    with Running(fmu, u):
        model = fmu.linearize(0.0, u[:2])
    assert (model.states, model.state_units, model.dt) == (("sum",), ("m",), 0.0)
    np.testing.assert_array_equal(model.A, [[0.0]])
    np.testing.assert_array_equal(model.B, [[0.0, 1.0]])
    np.testing.assert_array_equal(model.C, [[1.0], [0.0], [0.0]])
    np.testing.assert_array_equal(model.D, [[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    with (
        Running(FmuComponent(lag_fmu)) as run,
        pytest.raises(NotLinearizableError, match="no continuous states"),
    ):
        run.component.linearize(0.0, run.u)


def test_inputs_take_start_values_among_the_parameters(parrot):
    values = {
        "float64_in": 2.5,
        "int32_in": 7,
        "boolean_in": False,
        "enumeration_in": "red",
        "string_in": "ho",
    }
    fmu = FmuComponent(parrot, parameters=values)
    inputs = named(fmu.inputs)
    expected = {
        "float64_in": 2.5,
        "int32_in": 7.0,
        "boolean_in": 0.0,
        "enumeration_in": 1.0,
        "string_in": "ho",
    }
    assert {name: inputs[name].start for name in expected} == expected
    fmu.set_parameters({"float64_in": 3.5})
    assert named(fmu.inputs)["float64_in"].start == 3.5
    with pytest.raises(InputError, match=r'"int32_in".*got 0\.5'):
        FmuComponent(parrot, parameters={"int32_in": 0.5})
    # An input that is no port keeps the value as well.
    alone = FmuComponent(parrot, inputs=[], outputs=["float64_out"], parameters={"float64_in": 2.5})
    with Running(alone, u=np.zeros(0)) as running:
        assert running.step()[0] == 2.5 + 1


def test_a_unit_is_given_where_the_fmu_declares_none(parrots):
    metre = Unit(m=1)
    units = {"float64_in": ("ell", metre), "a_in": ("ell", metre)}
    inputs = named(FmuComponent(parrots[3], units=units).inputs)
    assert (inputs["float64_in"].unit, inputs["float64_in"].definition) == ("ell", metre)
    assert inputs["a_in"].unit == "m"


def test_units_mean_what_the_fmu_declares(lag_fmu, tmp_path):
    path = tmp_path / "own.fmu"
    with zipfile.ZipFile(lag_fmu) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            if name == "modelDescription.xml":
                text = text.replace(
                    b'<Unit name="V"/>', b'<Unit name="V"><BaseUnit m="1" factor="2"/></Unit>'
                )
            new.writestr(name, text)
    fmu = FmuComponent(path)
    assert {port.definition for port in (*fmu.inputs, *fmu.outputs)} == {Unit(m=1, factor=2.0)}


def test_a_system_sets_shapes_and_start_values(parrots):
    part = FmuComponent(parrots[3], inputs=["float64_in", "v_in"], outputs=["float64_out", "v_out"])
    source = Constant([[4, 5, 6]], [Port("y", kind="int32", shape=(3,))])
    system = System(
        {"source": source, "part": part},
        [Connection("source.y", "part.v_in")],
        parameters={"part.n": 3, "part.float64_in": 2.5},
        step=0.5,
    )
    for _ in range(2):
        with Master(system) as master:
            assert master.signals[-1].name == "part.v_out[3]"
            master.run(0.5)
            # The parrot says arrays backwards, and adds the number of steps.
            assert list(master.values) == [4.0, 5.0, 6.0, 2.5 + 1, 6.0 + 1, 5.0 + 1, 4.0 + 1]
