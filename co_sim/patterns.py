"""Names chosen by patterns: signals of observers, ends of linear models."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from co_sim.errors import Fault, InputError, suggestion

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["matching"]


def matching(
    patterns: Sequence[str],
    names: Sequence[str],
    what: str = "pattern",
    expected: str = "at least one signal",
) -> list[int]:
    """Return the indices of the names that patterns choose, in the order of the names.

    Parameters
    ----------
    patterns : names with the wildcards ``*`` (any text) and ``?`` (any character). A pattern that begins
        with ``!`` takes names out again, wherever it stands; with such patterns alone all other names are
        chosen. Brackets stand for themselves: ``"plant.x[1,*]"`` is the first row of an array.
    what, expected : words for a fault.

    Raises
    ------
    InputError
        If a pattern matches no name; all such patterns are told.
    """
    wanted = [pattern for pattern in patterns if not pattern.startswith("!")]
    unwanted = [pattern[1:] for pattern in patterns if pattern.startswith("!")]
    faults = [
        _fault(pattern, names, what, expected) for pattern in wanted + unwanted if not _any([pattern], names)
    ]
    if faults:
        raise InputError.from_faults(faults)
    if unwanted and not wanted:
        wanted = ["*"]
    return sorted(_any(wanted, names) - _any(unwanted, names))


def _any(patterns: Sequence[str], names: Sequence[str]) -> set[int]:
    """Return the indices of the names that match any pattern."""
    expression = "|".join(re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".") for pattern in patterns)
    match = re.compile(expression, re.DOTALL).fullmatch
    return {i for i, name in enumerate(names) if patterns and match(name)}


def _fault(pattern: str, names: Sequence[str], what: str, expected: str) -> Fault:
    # "plnt.*" resembles "plant.*" more than the name of any single signal.
    whole = dict.fromkeys(f"{name.partition('.')[0]}.*" for name in names) if "*" in pattern else {}
    return Fault(f'{what} "{pattern}"', "no match", expected, suggestion(pattern, [*whole, *names]))
