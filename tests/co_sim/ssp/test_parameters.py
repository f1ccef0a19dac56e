"""Parameter bindings: sources, mappings, units, and which of several values counts."""

import zipfile

import pytest

from co_sim import InputError, Master, Recorder
from co_sim.ssp import read_ssp

from .conftest import (
    NAMESPACES,
    UNITS,
    bindings,
    component,
    connectors,
    inline,
    real,
    ssd,
    system,
    values,
    wire,
)


def mapping(*entries, around="ParameterMapping"):
    """Return an inline mapping from ``(source, target, transformation)``."""
    rows = "".join(
        f'<ssm:MappingEntry source="{source}" target="{target}" {attributes}>{inside}</ssm:MappingEntry>'
        for source, target, inside, attributes in entries
    )
    return (
        f"<ssd:ParameterMapping><ssm:ParameterMapping {NAMESPACES} version='1.0'>{rows}"
        "</ssm:ParameterMapping></ssd:ParameterMapping>"
    )


def bound(pack, text, name="lag", files=(), **arguments):
    return dict(read_ssp(pack(text, files, **arguments)).components[name].parameters)


def test_every_type_of_value(pack):
    rows = (
        real("T", "0.5"),
        ("trouble_step", "Integer", 'value="3"'),
        ("trouble", "Enumeration", 'value="error" name="Trouble"'),
        ("negative", "Boolean", 'value="1"'),
        ("label", "String", 'value="a b  c"'),
        real("not there", "1"),
    )
    expected = {"T": 0.5, "trouble_step": 3, "trouble": "error", "negative": True, "label": "a b  c"}
    text = ssd(system(component("lag", bindings(inline(*rows)))))
    found = bound(pack, text)
    assert found == expected
    assert [type(found[name]) for name in found] == [type(expected[name]) for name in found]


def test_whole_numbers_and_floats_meet_where_nothing_is_lost(pack):
    rows = ("T", "Integer", 'value="2"'), real("trouble_step", "3.0"), ("negative", "Integer", 'value="1"')
    text = ssd(system(component("lag", bindings(inline(*rows)))))
    assert bound(pack, text) == {"T": 2.0, "trouble_step": 3, "negative": True}
    with pytest.raises(InputError, match=r'<Component name="lag".*"trouble_step".*got 3.5'):
        bound(pack, ssd(system(component("lag", bindings(inline(real("trouble_step", "3.5")))))))


def test_arrays_of_ssp_2(pack):
    text = """<ssv:Parameter name="{}"><ssv:Float64 value="1 2  3 4"/>{}</ssv:Parameter>"""
    two = '<ssc:Dimension size="2"/><ssc:Dimension size="2"/>'
    texts = '<ssv:Parameter name="texts_in"><ssv:String><ssv:Value value="p q"/><ssv:Value value="r"/>'
    rows = (
        text.format("gains", two)
        + text.format("a_in", two)
        + texts
        + '</ssv:String><ssc:Dimension size="2"/></ssv:Parameter>'
    )
    rows = f"<ssv:Parameters>{rows}</ssv:Parameters>"
    sets = f'<ssv:ParameterSet {NAMESPACES} version="2.0" name="p">{rows}</ssv:ParameterSet>'
    inside = bindings(("", f"<ssd:ParameterValues>{sets}</ssd:ParameterValues>"))
    body = ssd(system(component("lag", inside, source="resources/the%20parrot.fmu")), version="2.0")
    found = read_ssp(pack(body)).components["lag"]
    assert found.parameters["gains"] == [[1.0, 2.0], [3.0, 4.0]]
    starts = {port.name: port.start for port in found.inputs}
    assert starts["a_in"] == (1.0, 2.0, 3.0, 4.0)
    assert starts["texts_in"] == ("p q", "r")
    with pytest.raises(InputError, match="got 4 values, expected 6"):
        bound(pack, body.replace('size="2"/></ssv:Parameter>', 'size="3"/></ssv:Parameter>', 1))


SSV = values(real("T", "0.25"), real("x0", "7", "mV"), units=UNITS.replace("ssd:", "ssv:"))
SSM = (
    f'<ssm:ParameterMapping {NAMESPACES} version="1.0">'
    '<ssm:MappingEntry source="T" target="T"><ssc:LinearTransformation factor="2" offset="1"/>'
    "</ssm:MappingEntry>"
    '<ssm:MappingEntry source="x0" target="x0"/></ssm:ParameterMapping>'
)


@pytest.mark.parametrize("bare", [False, True])
def test_values_and_mappings_in_files(pack, bare):
    files = {"resources/my set.ssv": SSV, "resources/map.ssm": SSM}
    mapped = '<ssd:ParameterMapping source="resources/map.ssm"/>'
    text = ssd(system(component("lag", bindings(('source="resources/my%20set.ssv"', mapped)))))
    assert bound(pack, text, files=files, bare=bare) == {"T": 1.5, "x0": 0.007}


def test_values_within_the_component(pack, lag_fmus, tmp_path):
    fmu = tmp_path / "with set.fmu"
    fmu.write_bytes(lag_fmus[2].read_bytes())
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("resources/set.ssv", SSV)
    inside = bindings(('source="resources/set.ssv" sourceBase="component"', ""))
    text = ssd(system(component("lag", inside, source="resources/own.fmu")))
    assert bound(pack, text, files={"resources/own.fmu": fmu.read_bytes()}) == {"T": 0.25, "x0": 0.007}


def test_higher_levels_and_later_bindings_count_more(pack):
    lag = component(
        "lag",
        bindings(inline(real("T", 1), real("x0", 1), real("u", 1)), inline(real("x0", 2), real("u", 2))),
    )
    middle = system(lag, name="middle", before=bindings(inline(real("lag.u", 3), real("u", 9))))
    text = ssd(
        system(middle, before=bindings(inline(real("middle.lag.u", 4)), inline(real("middle.lag.u", 5))))
    )
    assert bound(pack, text, "middle/lag") == {"T": 1.0, "x0": 2.0, "u": 5.0}


def test_a_prefix_goes_before_the_mapping(pack):
    by_prefix = inline(real("T", "3"), attributes='prefix="lag."')
    assert bound(pack, ssd(system(component("lag"), before=bindings(by_prefix)))) == {"T": 3.0}
    both = inline(real("T", "3"), attributes='prefix="some."', mapping=mapping(("some.T", "lag.T", "", "")))
    assert bound(pack, ssd(system(component("lag"), before=bindings(both)))) == {"T": 3.0}


def test_only_what_is_mapped_is_applied(pack):
    mapped = mapping(("a", "T", "", ""), ("a", "x0", '<ssc:LinearTransformation factor="10"/>', ""))
    rows = real("a", "3"), real("u", "4")
    assert bound(pack, ssd(system(component("lag", bindings(inline(*rows, mapping=mapped)))))) == {
        "T": 3.0,
        "x0": 30.0,
    }


def test_tables_of_values(pack):
    table = "<ssc:{0}MappingTransformation>{1}</ssc:{0}MappingTransformation>"
    entry = '<ssc:MapEntry source="{}" target="{}"/>'
    mapped = mapping(
        ("b", "negative", table.format("Boolean", entry.format("true", "0")), ""),
        ("i", "trouble_step", table.format("Integer", entry.format(7, 8) + entry.format(8, 9)), ""),
        ("e", "trouble", table.format("Enumeration", entry.format("rot", "error")), ""),
        ("j", "x0", table.format("Integer", entry.format(7, 8)), ""),
    )
    rows = (
        ("b", "Boolean", 'value="true"'),
        ("i", "Integer", 'value="7"'),
        ("e", "Enumeration", 'value="rot"'),
        ("j", "Integer", 'value="6"'),
    )
    assert bound(pack, ssd(system(component("lag", bindings(inline(*rows, mapping=mapped)))))) == {
        "negative": False,
        "trouble_step": 8,
        "trouble": "error",
        "x0": 6.0,
    }


def test_units_of_values(pack):
    units = UNITS.replace("ssd:", "ssv:")
    rows = real("x0", "7", "mV"), real("u", "7", "shifted")
    assert bound(pack, ssd(system(component("lag", bindings(inline(*rows, units=units)))))) == {
        "x0": 0.007,
        "u": 12.0,
    }
    mapped = mapping(("x0", "x0", "", 'suppressUnitConversion="true"'))
    text = ssd(system(component("lag", bindings(inline(*rows, units=units, mapping=mapped)))))
    assert bound(pack, text) == {"x0": 7.0}
    with pytest.raises(InputError, match='"m" into "V"'):
        bound(pack, ssd(system(component("lag", bindings(inline(real("x0", 7, "m"), units=units))))))


def test_connectors_of_systems_are_parametrised(pack):
    border = connectors("voltage:input:mV", "time:parameter", "x:output")
    inner = system(
        component("lag") + component("other"),
        wire(".voltage", "lag.u", '<ssc:LinearTransformation factor="10"/>')
        + wire(".time", "lag.T")
        + wire(".time", "other.T")
        + wire(".x", "lag.x"),
        name="inner",
        before=border,
    )
    outer = system(inner, before=bindings(inline(real("inner.voltage", 500), real("inner.time", 0.5))))
    found = read_ssp(pack(ssd(outer, UNITS)), step=0.5)
    assert found.components["inner/lag"].parameters == {"u": 5.0, "T": 0.5}
    assert found.components["inner/other"].parameters == {"T": 0.5}
    assert not found.connections
    recorder = Recorder()
    with Master(found, observers=[recorder]) as master:
        master.run(10.0)
    assert abs(recorder["inner/lag.x"][-1] - 5.0) < 1e-6


def test_names_that_mean_several_variables(pack):
    inner = system(component("b"), name="a")
    text = ssd(system(component("a.b") + inner, before=bindings(inline(real("a.b.T", 4)))))
    assert bound(pack, text, "a/b") == bound(pack, text, "a%2Eb") == {"T": 4.0}


@pytest.mark.parametrize("unit", ["1", "-"])
def test_a_tool_that_knows_no_unit_converts_none(pack, unit):
    assert bound(pack, ssd(system(component("lag", bindings(inline(real("T", "3", unit))))))) == {"T": 3.0}
