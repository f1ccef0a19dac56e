"""Numbers and lists as words of a report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["capital", "listed", "number", "percent", "power_of_ten", "quantity", "span"]

# Space that holds a number and its unit together.
_NBSP = "\u00a0"

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float, digits: int = 3) -> str:
    """Return `value` with that many significant digits: ``0.00436``, ``451``, ``2.12·10⁻⁷``."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power < 6:
        text = f"{float(f'{value:.{digits - 1}e}'):.{max(digits - 1 - power, 0)}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    else:
        text = f"{mantissa}·10{str(power).translate(_SUPERSCRIPTS)}"
    return text.replace("-", "\u2212")


def power_of_ten(value: float) -> str:
    """Return a power of ten as ``1000``, ``0.01`` or ``10⁻⁷``; other numbers as `number` does."""
    text = number(value, 1)
    return text.removeprefix("1·")


def percent(share: float) -> str:
    """Return a share between 0 and 1 in percent; only all is 100 % and only nothing is 0 %."""
    for digits in range(2):
        text = f"{100.0 * share:.{digits}f}"
        if round(share, 12) in {0.0, 1.0} or float(text) not in {0.0, 100.0}:
            return f"{text}{_NBSP}%"
    return f"more than 99.9{_NBSP}%" if share > 0.5 else f"less than 0.1{_NBSP}%"


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """Return a number with its unit, which stay on one line."""
    return f"{number(value, digits)}{_NBSP}{unit.replace(' ', _NBSP)}"


def span(since: float, until: float) -> str:
    """Return an interval of time."""
    return f"{number(since)} to {quantity(until, 's')}"


def listed(items: Sequence[str]) -> str:
    """Return ``a``, ``a and b`` or ``a, b and c``."""
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)


def capital(text: str) -> str:
    """Return `text` with a capital at its beginning, as a sentence has."""
    return text[:1].upper() + text[1:]
