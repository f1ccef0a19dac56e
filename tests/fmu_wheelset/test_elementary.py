"""Our exponential and arc tangent against references of 40 digits."""

from __future__ import annotations

import ctypes
import math
from decimal import Decimal, localcontext
from typing import TYPE_CHECKING

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    Function = Callable[[float], float]

DIGITS = 40
LIMIT = 0.95  # ulp; 0.92 and 0.69 were the largest errors of exp and atan at ten million random points
HALF_PI = math.pi / 2
SMALLEST = math.ldexp(1.0, -1022)


def _function(core: SimpleNamespace, name: str) -> Function:
    found = getattr(core.library, name)
    found.restype, found.argtypes = ctypes.c_double, [ctypes.c_double]
    return found  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def exp(core: SimpleNamespace) -> Function:
    return _function(core, "portable_exp")


@pytest.fixture(scope="module")
def atan(core: SimpleNamespace) -> Function:
    return _function(core, "portable_atan")


def true_exp(x: float) -> Decimal:
    with localcontext() as context:
        context.prec = DIGITS
        return Decimal(x).exp()


def true_atan(x: float) -> Decimal:
    """Halve the angle until the power series converges fast."""
    with localcontext() as context:
        context.prec = DIGITS
        z, halvings = Decimal(x), 0
        while abs(z) > Decimal("0.01"):
            z = z / (1 + (1 + z * z).sqrt())
            halvings += 1
        term = total = z
        n = 1
        while abs(term) > abs(total) * Decimal(10) ** -DIGITS:
            term, n = -term * z * z, n + 2
            total += term / n
        return total * 2**halvings


def error_in_ulp(found: float, true: Decimal) -> float:
    return float(abs(Decimal(found) - true) / Decimal(math.ulp(float(true))))


@given(
    st.one_of(st.floats(-708.0, 709.5), st.floats(-3.0, 1.0), st.floats(-12.0, 0.0).map(lambda e: -(10.0**e)))
)
@example(math.log(2) / 2)  # where the power of two changes
@example(-math.log(2) / 2)
@example(5e-324)
def test_exp_is_within_one_ulp(exp: Function, x: float) -> None:
    assert error_in_ulp(exp(x), true_exp(x)) < LIMIT


@given(st.floats(-745.0, -708.4))
def test_exp_below_the_normal_numbers_loses_one_more_rounding(exp: Function, x: float) -> None:
    assert abs(Decimal(exp(x)) - true_exp(x)) < Decimal(2.0**-1074)


@given(st.one_of(st.floats(0.0, 20.0), st.floats(-15.0, 18.0).map(lambda e: 10.0**e)))
@example(math.nextafter(0.0625, 0.0))  # where the table begins, ends, and changes its entry
@example(0.0625)
@example(math.nextafter(16.0, 0.0))
@example(16.0)
@example(0.15624999999999997)
@example(1.0)
def test_atan_is_within_one_ulp_and_odd(atan: Function, x: float) -> None:
    assert error_in_ulp(atan(x), true_atan(x)) < LIMIT
    assert atan(-x) == -atan(x)


@pytest.mark.parametrize("octave", range(-4, 4))
@pytest.mark.parametrize("quarter", range(4))
def test_every_entry_of_the_table(atan: Function, octave: int, quarter: int) -> None:
    low, width = math.ldexp(1.0 + quarter / 4, octave), math.ldexp(0.25, octave)
    for share in (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999):
        x = low + share * width
        assert error_in_ulp(atan(x), true_atan(x)) < LIMIT


@pytest.mark.parametrize(
    ("x", "expected"),
    [(0.0, 1.0), (-math.inf, 0.0), (-1e308, 0.0), (-746.0, 0.0), (710.0, math.inf), (math.inf, math.inf)],
)
def test_exp_at_its_ends(exp: Function, x: float, expected: float) -> None:
    assert exp(x) == expected


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.0, 0.0),
        (math.inf, HALF_PI),
        (-math.inf, -HALF_PI),
        (1e300, HALF_PI),
        (5e-324, 5e-324),
        (1.0, HALF_PI / 2),
    ],
)
def test_atan_at_its_ends(atan: Function, x: float, expected: float) -> None:
    assert atan(x) == expected


def test_not_a_number_stays_one(exp: Function, atan: Function) -> None:
    assert math.isnan(exp(math.nan))
    assert math.isnan(atan(math.nan))


@given(st.floats(-300.0, 300.0), st.floats(0.02, 300.0))
def test_laws(exp: Function, atan: Function, x: float, z: float) -> None:
    assert exp(x) * exp(-x) == pytest.approx(1.0, rel=4e-16)
    assert atan(z) + atan(1.0 / z) == pytest.approx(HALF_PI, rel=4e-16)
