"""From what a bank says to what a driver or a traction controller should do.

A Mamdani system of three advisers, each with one thing in view: the probability that the wheelset is past the
peak of the creep curve, the probability that it is at or past it, and the use that is made of the adhesion
there is. The most cautious adviser is followed, so that more of any input never advises more torque. Where
the bank does not know, nothing is advised. The advice is the same for traction and for braking: torque is its
magnitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.fuzzy import Clause, FuzzySystem, Rule, Tables, Term, Variable, infer

if TYPE_CHECKING:
    from estimator.fuzzy import CompiledFuzzySystem

__all__ = [
    "LEVELS",
    "NO_STATEMENT",
    "Advice",
    "Advisers",
    "advice_score",
    "advice_system",
    "advise",
    "new_advisers",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: What is advised, with the least score for it; from the least to the most torque.
LEVELS = {
    "sand or reduce sharply": -np.inf,
    "reduce torque": -0.6,
    "hold torque": -0.25,
    "more torque possible": 0.4,
}
#: Instead, where the bank does not know.
NO_STATEMENT = "no statement"

#: What each adviser says: what it sees, and the torque that it advises then.
_RULES = {
    "past": {"unlikely": "more", "possible": "less", "likely": "sharply less"},
    "not_linear": {"unlikely": "more", "possible": "hold", "likely": "less"},
    "use": {"small": "more", "large": "hold", "full": "less"},
}

#: Use of the adhesion that is assumed where it is not known: enough to hold, never to ask for more.
_UNKNOWN_USE = 0.75
#: Below this a used or available adhesion is none.
_TINY = 1e-6


class Advisers(NamedTuple):
    """The system, its inputs (3,) and room for (rules,), (3, grid) and its outputs (3,)."""

    fuzzy: Tables
    x: Array
    strength: Array
    area: Array
    y: Array


@dataclass(frozen=True, eq=False)
class Advice:
    """Advice for n rows.

    Parameters
    ----------
    score : (n,) from -1, reduce sharply, to 1, more torque possible; NaN for no statement.
    words : of `LEVELS` or `NO_STATEMENT`.
    """

    score: Array
    words: tuple[str, ...]

    @classmethod
    def of(cls, score: Array) -> Advice:
        """Return the advice of these scores (n,), in words."""
        names = np.array([*LEVELS, NO_STATEMENT])
        level = np.searchsorted(list(LEVELS.values())[1:], score, side="right")
        return cls(score, tuple(names[np.where(np.isnan(score), len(LEVELS), level)].tolist()))

    @property
    def shares(self) -> dict[str, float]:
        """Share of the rows by what is advised, most torque first."""
        n = max(len(self.words), 1)
        return {name: self.words.count(name) / n for name in (*reversed(LEVELS), NO_STATEMENT)}


def advice_system() -> FuzzySystem:
    """Return the advisers: an input, an output from -1 to 1 and three rules for each.

    Inputs: ``past`` and ``not_linear``, the probabilities that the wheelset is past the peak, and at or past
    it; ``use``, the used adhesion over the lower end of the interval of the available one. The terms of the
    outputs do not overlap: otherwise the centroid would not follow the inputs evenly.
    """
    probability = (
        Term("unlikely", 0.0, 0.0, 0.05, 0.35),
        Term("possible", 0.05, 0.35, 0.45, 0.75),
        Term("likely", 0.45, 0.75, 1.0, 1.0),
    )
    use = (
        Term("small", 0.0, 0.0, 0.4, 0.7),
        Term("large", 0.4, 0.7, 0.8, 0.95),
        Term("full", 0.8, 0.95, 1.2, 1.2),
    )
    torque = (
        Term("sharply less", -1.0, -1.0, -1.0, -0.7),
        Term("less", -0.65, -0.45, -0.45, -0.25),
        Term("hold", -0.2, 0.0, 0.0, 0.2),
        Term("more", 0.7, 1.0, 1.0, 1.0),
    )
    inputs = (
        Variable("past", probability),
        Variable("not_linear", probability),
        Variable("use", use, high=1.2),
    )
    return FuzzySystem(
        inputs,
        tuple(Variable(f"torque by {v.name}", torque, low=-1.0) for v in inputs),
        tuple(
            Rule((Clause(name, term),), Clause(f"torque by {name}", advised))
            for name, rules in _RULES.items()
            for term, advised in rules.items()
        ),
    )


def advise(
    p_region: Array,
    identifiable: Mask,
    mu_used: Array | None = None,
    mu_max_low: Array | None = None,
) -> Advice:
    """Advise on n rows of what a bank says.

    Parameters
    ----------
    p_region : (n, 3) probabilities of the linear region, the peak and the unstable region.
    identifiable : (n,) whether to trust the row; no statement where not.
    mu_used, mu_max_low : (n,) used adhesion and lower end of the interval of the available one. NaN or None:
        not known, so that nothing ever asks for more torque.
    """
    p_region = np.asarray(p_region, dtype=np.float64)
    if p_region.ndim != 2 or p_region.shape[1] != 3 or len(p_region) != len(identifiable):
        raise ValueError(
            f"advice: got probabilities of shape {p_region.shape} and {len(identifiable)} flags, expected "
            f"(n, 3) and n; give those of the linear region, the peak and the unstable region"
        )
    n = len(p_region)
    used, available = (
        np.full(n, np.nan) if adhesion is None else np.asarray(adhesion, dtype=np.float64)
        for adhesion in (mu_used, mu_max_low)
    )
    score = np.empty(n)
    _scores(new_advisers(), p_region, used, available, score)
    score[~np.asarray(identifiable, dtype=np.bool_) | ~np.isfinite(p_region).all(axis=1)] = np.nan
    return Advice.of(score)


@cache
def _compiled() -> CompiledFuzzySystem:
    return advice_system().compile()


def new_advisers() -> Advisers:
    """Return what `advice_score` needs; not to be shared between threads."""
    fuzzy = _compiled().tables
    strength, area, outputs = np.empty(len(fuzzy.conclusions)), np.empty_like(fuzzy.grid), np.empty(3)
    return Advisers(fuzzy, np.empty(3), strength, area, outputs)


@njit(cache=True, nogil=True, error_model="numpy")
def advice_score(  # pragma: no cover - compiled
    advisers: Advisers, past: float, not_linear: float, used: float, available: float
) -> float:
    """Return the score of `Advice` for one row, from -1 to 1.

    `past` and `not_linear` are the probabilities that the wheelset is past the peak, and at or past it;
    `used` and `available` (lower end of its interval) the adhesion, NaN where not known.
    """
    a = advisers
    a.x[0], a.x[1], a.x[2] = past, not_linear, _use(used, available)
    infer(a.fuzzy, a.x, a.strength, a.area, a.y)
    return float(a.y.min())


@njit(cache=True, nogil=True, error_model="numpy")
def _use(used: float, available: float) -> float:  # pragma: no cover - compiled
    """Return how much of the available adhesion is used."""
    if not (math.isfinite(used) and math.isfinite(available)):
        return _UNKNOWN_USE
    if available > _TINY:
        return abs(used) / available
    return math.inf if abs(used) > _TINY else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _scores(  # pragma: no cover - compiled
    advisers: Advisers, p_region: Array, used: Array, available: Array, score: Array
) -> None:
    for i in range(len(score)):
        past = p_region[i, 2]
        score[i] = advice_score(advisers, past, p_region[i, 1] + past, used[i], available[i])
