import math
import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from co_sim import Connection, Constant, FunctionComponent, InputError, Master, Port, Recorder, System
from co_sim.units import Unit, UnknownUnitError, conversion

#: Units of each quantity, with factor and offset to SI from the standards.
QUANTITIES = {
    "length": {"m": (1, 0), "mm": (1e-3, 0), "km": (1e3, 0), "in": (0.0254, 0), "µm": (1e-6, 0)},
    "speed": {"m/s": (1, 0), "km/h": (1 / 3.6, 0), "m.s-1": (1, 0), "mm/min": (1e-3 / 60, 0)},
    "acceleration": {"m/s2": (1, 0), "m/s/s": (1, 0), "m/(s.s)": (1, 0), "m*s^-2": (1, 0)},
    "angle": {"rad": (1, 0), "deg": (math.pi / 180, 0), "rev": (2 * math.pi, 0)},
    "angular speed": {"rad/s": (1, 0), "deg/s": (math.pi / 180, 0), "rpm": (math.pi / 30, 0)},
    "frequency": {"1/s": (1, 0), "Hz": (1, 0), "1/min": (1 / 60, 0), "1/h": (1 / 3600, 0)},
    "force": {"N": (1, 0), "kN": (1e3, 0), "kg.m/s2": (1, 0)},
    "torque": {"N.m": (1, 0), "kN.m": (1e3, 0), "Nm": (1, 0), "kg.m2/s2": (1, 0), "J": (1, 0)},
    "inertia": {"kg.m2": (1, 0), "N.m/(1/s2)": (1, 0), "g.cm2": (1e-7, 0)},
    "damping": {"N/(m/s)": (1, 0), "N.s/m": (1, 0), "kN.s/m": (1e3, 0), "kg/s": (1, 0)},
    "pressure": {"Pa": (1, 0), "bar": (1e5, 0), "MPa": (1e6, 0), "N/mm2": (1e6, 0)},
    "temperature": {"K": (1, 0), "degC": (1, 273.15), "degF": (5 / 9, 273.15 - 32 * 5 / 9)},
    "heat capacity": {"J/(kg.K)": (1, 0), "kJ/(kg.degC)": (1e3, 0)},
    "resistance": {"Ohm": (1, 0), "V/A": (1, 0), "kΩ": (1e3, 0)},
    "power": {"W": (1, 0), "kW": (1e3, 0), "var": (1, 0), "J/s": (1, 0), "PS": (735.49875, 0)},
    "ratio": {"1": (1, 0), "": (1, 0), "%": (0.01, 0), "m/m": (1, 0)},
}
PAIRS = [(a, b, q) for q, units in QUANTITIES.items() for a in units for b in units]
EVERY = [(q, unit) for q, units in QUANTITIES.items() for unit in units]


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_units_of_a_quantity_convert_as_the_standards_say(quantity):
    units = QUANTITIES[quantity]
    for source, (f, o) in units.items():
        for target, (g, p) in units.items():
            factor, offset = conversion(source, target)
            assert factor == pytest.approx(f / g, rel=4e-16)
            assert offset == pytest.approx((o - p) / g, rel=1e-15, abs=1e-13)


@given(st.sampled_from(EVERY), st.sampled_from(EVERY))
def test_units_of_different_quantities_do_not_convert(one, other):
    assume(one[0] != other[0])
    assert conversion(one[1], other[1]) is None


@given(st.sampled_from(PAIRS), st.floats(-1e6, 1e6))
def test_there_and_back_is_where_it_began(pair, value):
    factor, offset = conversion(pair[0], pair[1])
    back, back_offset = conversion(pair[1], pair[0])
    there = factor * value + offset
    assert back * there + back_offset == pytest.approx(value, rel=1e-15, abs=1e-12 * abs(back))
    assert factor * back == pytest.approx(1.0, rel=3e-16)


@given(st.sampled_from(PAIRS), st.data())
def test_a_detour_leads_to_the_same_place(pair, data):
    by = data.draw(st.sampled_from(list(QUANTITIES[pair[2]])))
    (f, o), (g, p) = conversion(pair[0], by), conversion(by, pair[1])
    factor, offset = conversion(pair[0], pair[1])
    assert f * g == pytest.approx(factor, rel=1e-15)
    assert g * o + p == pytest.approx(offset, rel=1e-12, abs=1e-12)


def test_factors_are_the_nearest_numbers():
    assert abs(conversion("deg", "rad")[0] - math.pi / 180) <= math.ulp(math.pi / 180)
    assert conversion("km/h", "m/s") == (1 / 3.6, 0.0)
    assert conversion("m/s", "km/h") == (3.6, 0.0)
    assert conversion("degC", "K") == (1.0, 273.15)
    assert conversion("K", "degC") == (1.0, -273.15)


def test_an_angle_is_not_a_bare_number():
    assert conversion("rad", "1") is None
    assert conversion("rad/s", "1/s") is None
    assert conversion("rpm", "1/min") is None
    assert conversion("", "m/s") is None


def test_an_offset_is_for_a_temperature_alone():
    assert conversion("degC/s", "K/s") == (1.0, 0.0)
    assert conversion("1/degC", "1/K") == (1.0, 0.0)


def test_units_written_alike_need_no_meaning():
    code = (
        "import sys; from co_sim.units import conversion; "
        "assert conversion('flurb', 'flurb') == (1.0, 0.0); assert 'pint' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("unit", "reason"),
    [
        ("flurb", 'unit "flurb": got "flurb", which is not known'),
        ("m/flurb", 'unit "m/flurb": got "flurb", which'),
        ("J/kg.K", "ambiguous denominator, .*parentheses"),
        ("(m", "closing parenthesis"),
        ("m)", r'cannot be read from "\)"'),
        ("m.", "no symbol before"),
        ("/s", "no symbol before"),
        ("10", "no symbol before"),
        ("m s", 'cannot be read from "s"'),
        ("m1000", "exponent 1000"),
        ("dB", "not a multiple"),
        ("byte", "not made of whole powers"),
        ("mdegC", "not a multiple"),
    ],
)
def test_an_unknown_unit_is_told(unit, reason):
    with pytest.raises(UnknownUnitError, match=reason) as error:
        conversion(unit, "m")
    assert error.value.unit == unit
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)


def test_definitions_of_an_fmu_come_first():
    mine = {
        "flurb": Unit(m=1, s=-1, factor=0.25, offset=2.0),
        "deg": Unit(rad=1, factor=0.5),
        "degC": Unit(K=1, offset=273.15),
    }
    assert conversion("flurb", "m/s", mine) == (0.25, 2.0)
    assert conversion("m/s", "flurb", mine) == (4.0, -8.0)
    assert conversion("deg", "rad", mine) == (0.5, 0.0)
    assert conversion("degC", "K", mine) == conversion("degC", "K")
    assert conversion("rad", "deg", {}, mine) == (2.0, 0.0)
    assert conversion("deg", "rad", mine, {}) == (0.5, 0.0)
    assert conversion("flurb", "m", mine) is None


@given(st.floats(1e-9, 1e9), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_a_declared_unit_converts_by_its_factor_and_offset(factor, offset, value):
    mine = {"mine": Unit(kg=1, factor=factor, offset=offset)}
    assert conversion("mine", "kg", mine) == (factor, offset)
    inverse, back = conversion("kg", "mine", mine)
    si = factor * value + offset
    # The least normal number beside it: below, floats have fewer digits.
    tolerance = 1e-14 * ((abs(si) + abs(offset)) / factor + abs(value)) + sys.float_info.min
    np.testing.assert_allclose(inverse * si + back, value, rtol=0, atol=tolerance)


@pytest.mark.parametrize("numbers", [{"factor": 0.0}, {"factor": math.inf}, {"offset": math.nan}])
def test_a_definition_needs_a_usable_factor(numbers):
    with pytest.raises(InputError, match="factor other than 0"):
        Unit(m=1, **numbers)


def test_a_connection_converts_before_its_own_gain_and_offset():
    source = Constant([20.0, 90.0], [Port("air", "degC"), Port("yaw", "deg")])
    ends = [Port("air", "K"), Port("yaw", "rad")]
    target = FunctionComponent(lambda t, u: u, inputs=ends, outputs=ends)
    connections = [Connection("a.air", "b.air", gain=2.0, offset=1.0), Connection("a.yaw", "b.yaw")]
    recorder = Recorder()
    with Master(System({"a": source, "b": target}, connections), observers=[recorder]) as master:
        master.run(n_steps=1)
    np.testing.assert_allclose(recorder["b.air"], 2.0 * 293.15 + 1.0, rtol=1e-15)
    np.testing.assert_allclose(recorder["b.yaw"], math.pi / 2.0, rtol=1e-15)


def test_an_unknown_unit_at_one_end_is_a_fault_of_the_user():
    source, target = (
        Constant([1.0], [Port("y", "flurb")]),
        FunctionComponent(lambda t, u: u, inputs=[Port("u", "m")], outputs=[Port("y")]),
    )
    with pytest.raises(InputError, match='unit "flurb"'):
        System({"a": source, "b": target}, [Connection("a.y", "b.u")]).check()
