import numpy as np
import pytest

from co_sim import (
    Connection,
    Constant,
    FunctionComponent,
    InputError,
    Master,
    Port,
    Recorder,
    Signal,
    System,
    texts,
)
from co_sim.texts import number_of, text_of
from co_sim.units import Unit


def part(inputs=(), outputs=()):
    return FunctionComponent(lambda t, u: [0.0] * len(outputs), inputs=inputs, outputs=outputs)


def plant():
    return part(inputs=[Port("torque", "N.m", 0.0)], outputs=[Port("yaw_rate", "rad/s"), Port("body.x", "m")])


def sensors():
    return part(inputs=[Port("yaw_rate", "rad/s")], outputs=[Port("measured", "rad/s")])


def only_fault(system):
    (fault,) = system.faults()
    return str(fault)


def test_a_sound_system_has_no_faults_and_lists_its_signals():
    system = System(
        {"plant": plant(), "sensors": sensors()}, [Connection("plant.yaw_rate", "sensors.yaw_rate")]
    )
    assert system.faults() == []
    system.check()
    assert system.signals == (
        Signal("plant.yaw_rate", "rad/s"),
        Signal("plant.body.x", "m"),
        Signal("sensors.measured", "rad/s"),
    )
    assert system.signals[1].component == "plant"


def test_a_port_with_a_dot_connects():
    target = part(inputs=[Port("x", "m")])
    assert System({"plant": plant(), "b": target}, [Connection("plant.body.x", "b.x")]).faults() == []


def test_the_description_cannot_be_changed_from_outside():
    components = {"plant": plant()}
    connections = []
    system = System(components, connections)
    components["other"] = plant()
    connections.append(Connection("a.b", "c.d"))
    assert system.faults() == []
    assert list(system.components) == ["plant"]
    with pytest.raises(TypeError):
        system.components["other"] = plant()


def test_all_faults_are_told_together_one_line_each():
    doubled = part(inputs=[Port("u"), Port("u")], outputs=[Port("y"), Port("y")])
    system = System(
        {"plant": plant(), "sensors": sensors(), "a.b": doubled},
        [
            Connection("plnt.yaw_rate", "plant.torque"),
            Connection("plant.body.x", "sensors.yaw_rate"),
            Connection("plant.yaw_rate", "sensors.yaw_rate"),
        ],
    )
    with pytest.raises(InputError) as caught:
        system.check()
    lines = str(caught.value).splitlines()
    assert lines == [str(fault) for fault in system.faults()]
    for expected in (
        'component "a.b"',
        "a.b.u: got 2 inputs of this name",
        "a.b.y: got 2 outputs of this name",
        'unknown component "plnt" in "plnt.yaw_rate"',
        '"m" into "rad/s"',
        "input sensors.yaw_rate: got 2 connections",
        "input a.b.u: got no connection",
    ):
        assert sum(expected in line for line in lines) == 1, expected
    assert len(lines) == 7


@pytest.mark.parametrize(
    ("connection", "expected"),
    [
        (Connection("plnt.yaw_rate", "sensors.yaw_rate"), 'did you mean "plant.yaw_rate"?'),
        (Connection("plant.yaw_rat", "sensors.yaw_rate"), 'did you mean "plant.yaw_rate"?'),
        (Connection("plant.torque", "sensors.yaw_rate"), 'got unknown output "plant.torque"'),
        (Connection("nonsense", "sensors.yaw_rate"), 'unknown component "nonsense"'),
    ],
)
def test_an_unknown_source_comes_with_a_suggestion(connection, expected):
    assert expected in only_fault(System({"plant": plant(), "sensors": sensors()}, [connection]))


def test_an_unknown_target_comes_with_a_suggestion():
    system = System({"plant": plant()}, [Connection("plant.yaw_rate", "plant.torqe")])
    assert 'did you mean "plant.torque"?' in only_fault(system)


def test_an_unknown_unit_is_a_fault_like_any_other():
    parts = {"a": part(outputs=[Port("y", "furlongish")]), "b": part(inputs=[Port("u", "m")])}
    text = only_fault(System(parts, [Connection("a.y", "b.u")]))
    assert text.startswith("connection a.y -> b.u: ")
    assert "furlongish" in text


def test_without_a_close_name_the_choice_is_shown():
    text = only_fault(System({"plant": plant()}, [Connection("plant.zzz", "plant.torque")]))
    assert "choose from plant.body.x, plant.yaw_rate" in text
    empty = System({"a": part(inputs=[Port("u")])}, [Connection("b.y", "a.u")])
    assert "there is none to choose from" in only_fault(empty)


@pytest.mark.parametrize(
    ("source", "target", "fits"),
    [
        ("rad/s", "rad/s", True),
        ("", "1", True),
        ("1", "", True),
        ("rad", "rad", True),
        ("rad", "1", False),
        ("", "rad", False),
        ("deg", "rad", True),
        ("m", "mm", True),
        ("m", "s", False),
        ("m", "furlongish", False),
        ("furlongish", "furlongish", True),
        ("N.m", "kg.m2/s2", True),
        ("N", "kg", False),
    ],
)
def test_units_must_have_one_dimension_and_an_empty_one_is_1(source, target, fits):
    parts = {"a": part(outputs=[Port("y", source)]), "b": part(inputs=[Port("u", target)])}
    assert (System(parts, [Connection("a.y", "b.u")]).faults() == []) is fits


def test_an_input_needs_a_connection_or_a_start_value():
    assert "input sensors.yaw_rate: got no connection" in only_fault(System({"sensors": sensors()}))
    assert System({"plant": plant()}).faults() == []
    hopeless = part(inputs=[Port("u", start=float("nan"))])
    assert "start value nan" in only_fault(System({"a": hopeless}))


def test_one_object_cannot_be_two_components():
    shared = plant()
    assert "components a, b" in only_fault(System({"a": shared, "b": shared}))


def test_a_system_without_components_is_refused():
    assert "at least one" in only_fault(System({}))


def test_names_are_not_empty():
    assert "a name without dots" in only_fault(System({"": plant()}))


def values_of(system, n_steps=1):
    with Master(system, h=1.0) as master:
        master.run(n_steps=n_steps)
        return dict(zip((s.name for s in master.signals), master.values, strict=True))


def echo(port_in, port_out):
    """A component that passes all elements of its input on."""
    return FunctionComponent(lambda t, u: list(u), inputs=[port_in], outputs=[port_out])


@pytest.mark.parametrize(
    ("source", "target", "value", "expected"),
    [
        ("km/h", "m/s", 36.0, 10.0),
        ("degC", "K", 20.0, 293.15),
        ("deg", "rad", 180.0, np.pi),
        ("kN", "N", 1.5, 1500.0),
    ],
)
def test_units_are_converted_and_then_gain_and_offset_apply(source, target, value, expected):
    parts = {
        "a": Constant([value], [Port("y", source)]),
        "b": echo(Port("u", target), Port("y", target)),
        "c": echo(Port("u", target), Port("y", target)),
    }
    wires = [Connection("a.y", "b.u"), Connection("a.y", "c.u", gain=-2.0, offset=3.0)]
    values = values_of(System(parts, wires))
    assert values["b.y"] == pytest.approx(expected, rel=1e-15)
    assert values["c.y"] == pytest.approx(-2.0 * expected + 3.0, rel=1e-15)


def test_arrays_connect_whole_or_by_element():
    matrix = Constant([[[1.0, 2.0], [3.0, 4.0]]], [Port("M", "m", shape=(2, 2))])
    parts = {
        "a": matrix,
        "whole": echo(Port("u", "m", shape=(2, 2)), Port("y", "m", shape=(2, 2))),
        "mixed": echo(Port("u", "m", start=(7.0, 8.0, 9.0), shape=(3,)), Port("y", "m", shape=(3,))),
    }
    wires = [Connection("a.M", "whole.u"), Connection("a.M[2,1]", "mixed.u[2]")]
    values = values_of(System(parts, wires))
    assert [values[f"whole.y[{i},{j}]"] for i in (1, 2) for j in (1, 2)] == [1.0, 2.0, 3.0, 4.0]
    assert [values[f"mixed.y[{i}]"] for i in (1, 2, 3)] == [7.0, 3.0, 9.0]


def test_shapes_must_agree_and_elements_are_fed_once():
    parts = {
        "a": Constant([[1.0, 2.0]], [Port("v", shape=(2,))]),
        "b": echo(Port("u", shape=(3,)), Port("y", shape=(3,))),
    }
    wires = [Connection("a.v", "b.u"), Connection("a.v[1]", "b.u[1]"), Connection("a.v[2]", "b.u[1]")]
    text = "\n".join(map(str, System(parts, wires).faults()))
    assert "connection a.v -> b.u: got shape (2) into (3), expected the same shape" in text
    assert "input b.u[1]: got 3 connections" in text


@pytest.mark.parametrize(
    ("source", "target", "fits"),
    [
        ("float64", "float32", True),
        ("int32", "float64", True),
        ("int64", "int8", True),
        ("enumeration", "int32", True),
        ("float64", "int32", False),
        ("boolean", "float64", False),
        ("int32", "boolean", False),
        ("boolean", "boolean", True),
        ("string", "float64", False),
        ("string", "string", True),
    ],
)
def test_types_must_lose_nothing(source, target, fits):
    parts = {"a": part(outputs=[Port("y", kind=source)]), "b": part(inputs=[Port("u", kind=target)])}
    assert (System(parts, [Connection("a.y", "b.u")]).faults() == []) is fits


def test_texts_pass_through_a_run_and_through_a_file(tmp_path):
    def system():
        parts = {
            "a": Constant(["Grüße, Rad"], [Port("y", kind="string")]),
            "b": echo(Port("u", kind="string"), Port("y", kind="string")),
            "c": echo(Port("u", kind="string", start="alone"), Port("y", kind="string")),
        }
        return System(parts, [Connection("a.y", "b.u")])

    recorder = Recorder()
    with Master(system(), observers=[recorder]) as master:
        master.run(n_steps=1)
        master.write_state(tmp_path / "state.npz")
        assert [text_of(value) for value in master.values] == ["Grüße, Rad", "Grüße, Rad", "alone"]
    assert recorder["b.y"].tolist() == ["Grüße, Rad"] * 2
    # In another process these texts have other numbers: here they are made to.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(texts, "_TEXTS", [""])
        patch.setattr(texts, "_NUMBERS", {"": 0})
        number_of("something else")
        with Master(system()) as master:
            master.read_state(tmp_path / "state.npz")
            assert [text_of(value) for value in master.values] == ["Grüße, Rad", "Grüße, Rad", "alone"]
            master.run(n_steps=2)
            assert [text_of(value) for value in master.values] == ["Grüße, Rad", "Grüße, Rad", "alone"]


def test_a_start_value_must_be_of_its_kind():
    for port in (
        Port("u", kind="string", start=1.0),
        Port("u", start="one"),
        Port("u", start=(1.0, 2.0), shape=(3,)),
        Port("u", start=(1.0, float("inf")), shape=(2,)),
    ):
        assert "start value" in only_fault(System({"a": part(inputs=[port])}))


def test_gains_are_for_floats_and_finite():
    parts = {"a": part(outputs=[Port("y", kind="int32")]), "b": part(inputs=[Port("u", kind="int32")])}
    assert "a gain or offset into int32" in only_fault(System(parts, [Connection("a.y", "b.u", gain=2.0)]))
    parts = {"a": part(outputs=[Port("y")]), "b": part(inputs=[Port("u")])}
    assert "gain nan" in only_fault(System(parts, [Connection("a.y", "b.u", gain=float("nan"))]))


def test_a_declared_unit_means_what_its_declaration_says():
    league = Unit(m=1, factor=4828.0)
    parts = {
        "a": Constant([2.0], [Port("y", "league", definition=league)]),
        "b": echo(Port("u", "km"), Port("y", "km")),
        "c": echo(Port("u", "s"), Port("y", "s")),
    }
    values = values_of(System({"a": parts["a"], "b": parts["b"]}, [Connection("a.y", "b.u")]))
    assert values["b.y"] == pytest.approx(9.656, rel=1e-15)
    wrong = System({"a": parts["a"], "c": parts["c"]}, [Connection("a.y", "c.u")])
    assert '"league" into "s"' in only_fault(wrong)


def test_units_stay_as_they_are_where_a_connection_says_so():
    parts = {
        "a": Constant([3.0], [Port("y", "m")]),
        "b": FunctionComponent(lambda t, u: [u[0]], inputs=[Port("u", "nonsense")], outputs=[Port("y")]),
    }
    assert "nonsense" in only_fault(System(parts, [Connection("a.y", "b.u")]))
    system = System(parts, [Connection("a.y", "b.u", 2.0, 1.0, convert_units=False)])
    recorder = Recorder()
    with Master(system, observers=[recorder]) as master:
        master.run(0.1)
    assert recorder["b.y"][-1] == 7.0
