"""Texts as numbers, so that they travel among the other values of a system.

Equal texts have equal numbers in one process. The numbers of another process differ: what is written to
disk must hold the texts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["as_number", "listen", "number_of", "text_of"]

#: The empty text is 0, so that a value that nobody has written yet is a text too.
_TEXTS = [""]
_NUMBERS = {"": 0}
_LISTENERS: list[Callable[[str], None]] = []


def number_of(text: str) -> float:
    """Return the number that stands for `text`."""
    number = _NUMBERS.get(text)
    if number is None:
        number = _NUMBERS[text] = len(_TEXTS)
        _TEXTS.append(text)
        for listener in _LISTENERS:
            listener(text)
    return float(number)


def as_number(value: float | str) -> float:
    """Return a value as it travels: a text as its number, any other as a float."""
    return number_of(value) if isinstance(value, str) else float(value)


def listen(listener: Callable[[str], None]) -> None:
    """Tell `listener` all texts but the empty one in the order of their numbers, also those to come."""
    for text in _TEXTS[1:]:
        listener(text)
    _LISTENERS.append(listener)


def text_of(number: float) -> str:
    """Return the text that `number` stands for."""
    return _TEXTS[int(number)]
