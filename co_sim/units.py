"""Conversion between units written as in FMI, Modelica and SSP: ``"rad/s"``, ``"N/(m/s)"``, ``"kg.m2"``.

The notation is read here; what a symbol such as ``"bar"`` means comes from the package pint, which is loaded
only where two units are written differently. Angles keep their dimension: where ``"rad"`` meets ``"1"``
a unit was more often forgotten than left out on purpose, so that these two do not convert.
"""

from __future__ import annotations

import math
import re
from dataclasses import astuple, dataclass, replace
from decimal import Decimal, localcontext
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Unit", "UnknownUnitError", "conversion", "define"]

#: Digits that are carried, so that a factor is rounded once, when it becomes a float.
_DIGITS = 40
_MAX_EXPONENT = 99

#: Of pint, in the order of the exponents of `Unit`.
_BASES = ("kilogram", "meter", "second", "ampere", "kelvin", "mole", "candela", "radian")
#: Symbols of the field that pint does not know, or takes for something else.
_ALIASES = {
    "Bq": "1/s",
    "Nm": "N*m",
    "Ohm": "ohm",
    "PS": "metric_horsepower",
    "degK": "kelvin",
    "rev": "revolution",
    "var": "W",
}

_TOKEN = re.compile(
    r"\s*(?:(?P<symbol>(?:°|%|[^\W\d_])+)(?:(?:\^|\*\*)?(?P<exponent>[+-]?\d+))?"
    r"|(?P<one>1)(?![\d.]*\d)|(?P<sign>[./*·()]))\s*"
)


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit that an FMU declares: ``value in SI = factor * value + offset``.

    Parameters
    ----------
    kg, m, s, A, K, mol, cd, rad : exponents of the base units.
    factor, offset : of the conversion to the base unit.

    Raises
    ------
    InputError
        If the factor is 0, or one of the two is not finite.
    """

    kg: int = 0
    m: int = 0
    s: int = 0
    A: int = 0
    K: int = 0
    mol: int = 0
    cd: int = 0
    rad: int = 0
    factor: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.factor) and self.factor != 0.0 and math.isfinite(self.offset)):
            raise InputError(
                "unit",
                got=f"the factor {self.factor:g} and the offset {self.offset:g}",
                expected="finite numbers, and a factor other than 0",
                remedy="correct its definition",
            )


class UnknownUnitError(InputError):
    """A unit whose meaning is not known.

    Parameters
    ----------
    unit : as it was written.
    got : what was found in it.
    remedy : what to do.
    """

    def __init__(self, unit: str, got: str, remedy: str = "correct it, or convert in a component") -> None:
        expected = 'a unit as FMI writes it, such as "N/(m/s)" or "kg.m2"'
        super().__init__(f'unit "{unit}"', got=got, expected=expected, remedy=remedy)
        self.unit = unit

    def __reduce__(self) -> tuple[type[UnknownUnitError], tuple[str, str, str]]:
        return UnknownUnitError, (self.unit, self.faults[0].got, self.faults[0].remedy)


class _Meaning(NamedTuple):
    """Exponents of the base units, and the conversion to them."""

    exponents: tuple[int, ...]
    factor: Decimal
    offset: Decimal = Decimal(0)

    def times(self, other: _Meaning, power: int = 1) -> _Meaning:
        """Return the product with a power of another; an offset makes sense for a unit alone only."""
        exponents = tuple(a + power * b for a, b in zip(self.exponents, other.exponents, strict=True))
        return _Meaning(exponents, self.factor * other.factor**power)


_ONE = _Meaning((0,) * len(_BASES), Decimal(1))


def conversion(
    source: str,
    target: str,
    definitions: Mapping[str, Unit] = MappingProxyType({}),
    target_definitions: Mapping[str, Unit] | None = None,
) -> tuple[float, float] | None:
    """Return factor and offset of ``value in target = factor * value in source + offset``.

    For differences, such as those of temperatures, leave the offset out.

    Parameters
    ----------
    source, target : the units; ``""`` means the same as ``"1"``.
    definitions : meaning of units by name, before any general meaning.
    target_definitions : the same for the target alone; ``None`` takes `definitions`.

    Returns
    -------
    Factor and offset, or ``None`` if the units measure different things.

    Raises
    ------
    UnknownUnitError
        If a unit cannot be read or is not known; never for two units that are written alike.
    """
    if source == target:
        return 1.0, 0.0
    with localcontext(prec=_DIGITS):
        a = _meaning(source, definitions)
        b = _meaning(target, definitions if target_definitions is None else target_definitions)
        if a.exponents != b.exponents:
            return None
        return float(a.factor / b.factor), float((a.offset - b.offset) / b.factor)


def define(unit: str) -> Unit:
    """Return the general meaning of a unit.

    Raises
    ------
    UnknownUnitError
        If it cannot be read or is not known.
    """
    with localcontext(prec=_DIGITS):
        meaning = _general_meaning(unit)
    return replace(Unit(*meaning.exponents), factor=float(meaning.factor), offset=float(meaning.offset))


def _meaning(unit: str, definitions: Mapping[str, Unit]) -> _Meaning:
    if unit not in definitions:
        return _general_meaning(unit)
    *exponents, factor, offset = astuple(definitions[unit])
    # The digits that were written, which the float merely approximates.
    return _Meaning(tuple(exponents), Decimal(repr(factor)), Decimal(repr(offset)))


@cache
def _general_meaning(unit: str) -> _Meaning:
    if not unit:
        return _ONE
    tokens = _Tokens(unit)
    meaning = tokens.expression()
    if tokens.rest:
        raise UnknownUnitError(unit, f'what cannot be read from "{tokens.rest}" on')
    return meaning


class _Tokens:
    """The text of a unit, read from the left.

    ``expression = operand {"." operand} {"/" operand}``; what follows a division in parentheses only, as
    ``J/kg.K`` leaves open where K belongs. ``operand = "1" | symbol [exponent] | "(" expression ")"``.
    """

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self.rest = unit

    def expression(self) -> _Meaning:
        meaning = self._operand()
        while self._skip(".*·"):
            meaning = meaning.times(_ONE).times(self._operand())
        while self._skip("/"):
            meaning = meaning.times(_ONE).times(self._operand(), -1)
        if self.rest[:1] in {".", "*", "·"}:
            got, remedy = "an ambiguous denominator", "put all of the denominator in parentheses"
            raise UnknownUnitError(self._unit, got, remedy)
        return meaning

    def _operand(self) -> _Meaning:
        if self._skip("("):
            meaning = self.expression()
            if not self._skip(")"):
                raise UnknownUnitError(self._unit, "no closing parenthesis")
            return meaning
        match = _TOKEN.match(self.rest)
        if match is None or match["sign"]:
            raise UnknownUnitError(self._unit, f'no symbol before "{self.rest}"')
        self.rest = self.rest[match.end() :]
        if match["one"]:
            return _ONE
        meaning = _symbol(self._unit, match["symbol"])
        exponent = int(match["exponent"] or 1)
        if abs(exponent) > _MAX_EXPONENT:
            raise UnknownUnitError(self._unit, f"the exponent {exponent}")
        return meaning if exponent == 1 else _ONE.times(meaning, exponent)

    def _skip(self, signs: str) -> bool:
        match = _TOKEN.match(self.rest)
        if match is None or not match["sign"] or match["sign"] not in signs:
            return False
        self.rest = self.rest[match.end() :]
        return True


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


def _symbol(unit: str, symbol: str) -> _Meaning:
    """Return what pint knows of one symbol, with its prefix if it has one."""
    import pint

    registry = _registry()
    name = _ALIASES.get(symbol, symbol)
    try:
        zero, one = (registry.Quantity(Decimal(x), name).to_base_units() for x in (0, 1))
    except pint.UndefinedUnitError:
        raise UnknownUnitError(unit, f'"{symbol}", which is not known') from None
    except (TypeError, pint.PintError):
        # Levels such as dB, whose logarithms there are not for decimal numbers, and prefixed offsets.
        raise UnknownUnitError(unit, f'"{symbol}", which is not a multiple of SI base units') from None
    powers = dict(one.unit_items())
    exponents = tuple(int(powers.get(base, 0)) for base in _BASES)
    if {base: power for base, power in zip(_BASES, exponents, strict=True) if power} != powers:
        raise UnknownUnitError(unit, f'"{symbol}", which is not made of whole powers of SI base units')
    return _Meaning(exponents, one.magnitude - zero.magnitude, zero.magnitude)
