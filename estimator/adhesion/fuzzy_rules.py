"""Rules of the fuzzy identifier, made from the hypotheses of a bank."""

from __future__ import annotations

from typing import TYPE_CHECKING

from estimator.adhesion.curves import REGIONS
from estimator.fuzzy import Clause, FuzzySystem, Rule, Term, Variable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["fuzzy_system"]

#: Nats by which the data are likelier under the best filter. Half of them count, as in the evidence of the
#: bank: 10 are the 5 that Kass and Raftery (1995) call very strong.
_MISFIT = (Term("small", 0.0, 0.0, 0.0, 10.0),)
#: Rms of the normalised innovations: 1 where the filter is right. From sqrt(2 ln 2) = 1.18 on, twice the
#: variance would be likelier.
_RESIDUAL = (
    Term("as expected", 0.0, 0.0, 1.08, 1.28),
    Term("too large", 1.08, 1.28, 2.0, 2.0),
)
#: Creep on a scale with the knee at 1 and the end of the peak at 2.
_CREEP = (
    Term("linear", 0.0, 0.0, 0.75, 1.25),
    Term("peak", 0.75, 1.25, 1.75, 2.25),
    Term("unstable", 1.75, 2.25, 3.0, 3.0),
)
#: As in `estimator.fuzzy.identification_system`: the centroids are 0.1 and 0.9, and of both together 0.5.
_ANSWER = (Term("no", 0.0, 0.0, 0.0, 0.3), Term("yes", 0.7, 1.0, 1.0, 1.0))


def fuzzy_system(names: Sequence[str], rails: Sequence[str], conditions: Sequence[str]) -> FuzzySystem:
    """Return the rules for filters with these names, on these rails, each one of the `conditions`.

    A filter with a small misfit speaks for its own condition and against the others; for the region in which
    it believes its creep to be as far as it is there, and against it as far as it is not; and for the bank as
    a whole if its residual is as large as it expects. What the filters say is joined by the maximum: if
    filters of two conditions have a small misfit, as much is said for each as against it: undecided.

    Inputs, for each filter in turn: ``misfit``, ``residual`` and ``creep``. Outputs: the regions, the
    conditions, and ``known``.
    """
    inputs: list[Variable] = []
    rules: list[Rule] = []
    for i, (name_of_filter, rail) in enumerate(zip(names, rails, strict=True)):
        name = f"{i + 1} ({name_of_filter})"
        inputs += (
            Variable(f"misfit of {name}", _MISFIT, high=_MISFIT[0].d),
            Variable(f"residual of {name}", _RESIDUAL, high=2.0),
            Variable(f"creep of {name}", _CREEP, high=3.0),
        )
        rules += _rules(name, rail, conditions)
    regions = (f"region {name}" for name in REGIONS)
    choices = (f"condition {name}" for name in conditions)
    outputs = tuple(Variable(name, _ANSWER) for name in (*regions, *choices, "known"))
    return FuzzySystem(tuple(inputs), outputs, tuple(rules))


def _rules(name: str, own: str, conditions: Sequence[str]) -> Iterator[Rule]:
    """Yield what one filter says."""
    small = Clause(f"misfit of {name}", "small")
    for condition in conditions:
        yield Rule((small,), Clause(f"condition {condition}", "yes" if condition == own else "no"))
    for region in REGIONS:
        for elsewhere, answer in ((False, "yes"), (True, "no")):
            there = Clause(f"creep of {name}", region, negated=elsewhere)
            yield Rule((small, there), Clause(f"region {region}", answer))
    for size, answer in (("as expected", "yes"), ("too large", "no")):
        yield Rule((small, Clause(f"residual of {name}", size)), Clause("known", answer))
