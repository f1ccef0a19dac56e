"""Sections: what they refuse, and their numbers as JSON."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from co_sim.wheelset.reporting import Column, Figure, Quantity, Section, Table
from co_sim.wheelset.reporting.json_text import dumps, quantity_json, schema

QUANTITY_SCHEMA = schema() | {"$ref": "#/$defs/quantity"}
for key in ("type", "required", "additionalProperties", "properties"):
    del QUANTITY_SCHEMA[key]
VALIDATOR = jsonschema.Draft202012Validator(QUANTITY_SCHEMA)


def encoded(quantity: Quantity) -> dict:
    found = json.loads(dumps(quantity_json(quantity)))
    VALIDATOR.validate(found)
    return found


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(schema())


@settings(deadline=None)
@given(arrays(np.float64, array_shapes(max_dims=3, max_side=3)))
def test_every_number_comes_back_or_is_missing_with_its_reason(values: np.ndarray) -> None:
    over = ("condition", "speed", "point")[: values.ndim]
    found = encoded(
        Quantity(values, "m/s", "a speed", over, {"nan": "not tried", "inf": "none", "-inf": "none too"})
    )
    back = np.array(found["value"], dtype=np.float64)
    finite = np.isfinite(values)
    np.testing.assert_allclose(back[finite], values[finite], rtol=1e-8, atol=1e-300)
    assert np.isnan(back[~finite]).all()
    told = {tuple(place): one["was"] for one in found.get("missing", []) for place in one["at"]}
    assert told == {tuple(place): f"{values[tuple(place)]}" for place in np.argwhere(~finite)}


@settings(deadline=None)
@given(st.complex_numbers(allow_nan=False, allow_infinity=False, max_magnitude=1e12))
def test_complex_numbers_have_two_parts(value: complex) -> None:
    found = encoded(Quantity([value], "1/s", "a pole", ("mode",)))
    assert found["over"] == ["mode", "real_imaginary"]
    assert complex(*found["value"][0]) == pytest.approx(value, rel=1e-8)


def test_truths_whole_numbers_and_texts_stay_what_they_are() -> None:
    assert encoded(Quantity(np.array([True, False]), "1", "whether", ("mode",)))["value"] == [True, False]
    assert encoded(Quantity(np.int64(3), "1", "how many"))["value"] == 3
    assert encoded(Quantity("split", "1", "kind"))["value"] == "split"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"value": [1.0], "over": ()}, "a name for each axis"),
        ({"value": [[1.0], [2.0, 3.0]], "over": ("a", "b")}, "inhomogeneous|full array"),
        ({"value": np.inf}, "inf without a reason"),
        ({"value": [np.nan, np.inf], "over": ("a",), "missing": {"inf": "none"}}, "nan without a reason"),
        ({"value": [complex(0.0, np.inf)], "over": ("a",)}, "inf without a reason"),
        ({"value": None}, "expected numbers, truths or texts"),
    ],
)
def test_what_a_quantity_refuses(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Quantity(unit="1", meaning="something", **arguments)


def section(**changes: object) -> Section:
    return Section(**{"key": "some", "title": "What?", "words": (), **changes})


def test_what_a_section_refuses() -> None:
    values = Quantity([1.0, 2.0], "1", "values", ("mode",))
    with pytest.raises(ValueError, match=r"axis mode.*`axes`"):
        section(numbers={"values": values})
    with pytest.raises(ValueError, match="2 values over mode, expected 1"):
        section(numbers={"values": values}, axes={"mode": [1]})
    assert section(numbers={"values": values}, axes={"mode": [1, 2]})
    assert section(numbers={"values": Quantity([1.0], "1", "values", ("speed",))})
    with pytest.raises(ValueError, match="small letters"):
        section(key="Some thing")
    with pytest.raises(ValueError, match="small letters"):
        Figure("a figure", "What?", "caption", "alt", lambda: None)
    with pytest.raises(ValueError, match="got 1 cells in row 1, expected 2"):
        Table("t", (Column("a"), Column("b")), (("x", 1.0), ("y",)))
