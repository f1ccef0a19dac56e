import pytest

from co_sim import Connection, FunctionComponent, InputError, Port, Signal, System


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
        ("N.m", "kg.m2/s2", True),
        ("N", "kg", False),
    ],
)
def test_units_must_be_of_one_dimension_and_an_empty_one_is_1(source, target, fits):
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
