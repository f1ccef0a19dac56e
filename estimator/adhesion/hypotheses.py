"""What the bank holds possible: a rail condition and what decides the creep on it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from fmu_wheelset.parameters import RailCondition

__all__ = [
    "FRICTIONS",
    "Hypothesis",
    "kinds",
    "rail_of",
    "stand_ins",
    "unlike_rails",
    "with_torque",
    "without_torque",
]

#: Creeps over that of the peak with which filters start where nothing tells the creep. Near enough to each
#: other that one of each condition finds its creep: else the nearest of another condition wins.
_CREEPS = (0.05, 0.15, 0.3, 0.6, 1.0, 1.3, 1.7)
#: The same past the peak, where the torque is known but no creep past the peak balances it.
_PAST = 1.7
#: The friction within a condition as a sum of three equally likely normal distributions: their means and
#: standard deviations over that of the whole, which they make 1.1 times as wide.
FRICTIONS = ((0.0, 0.5), (-1.2, 0.5), (1.2, 0.5))
_ALL_FRICTION = (0.0, 1.0)


@dataclass(frozen=True)
class Hypothesis:
    """A rail condition and what decides the creep on it.

    Parameters
    ----------
    condition : name of the condition, under both wheels or under the left one.
    branch : ``"driven"``: torque and inertia of the wheels decide the creep, on the stable branch and, when
        the torque asks for more than the rail can give, past the peak. ``"held"``: something else does, a
        slip controller or a test rig; the creep is a slow random walk, and a known torque tells its force.
    creep : of a held creep, where it starts, over the creep of the peak. Past 1 with a known torque: where
        the falling branch balances it.
    right : condition under the right wheel; None: the same.
    patch : semi-axes of the contact patches over those of the wheelset.
    friction : mean and standard deviation of the friction's logarithm, over its standard deviation within
        the condition: a part of its distribution, or all of it.
    """

    condition: str
    branch: Literal["driven", "held"] = "driven"
    creep: float = 0.0
    right: str | None = None
    patch: float = 1.0
    friction: tuple[float, float] = _ALL_FRICTION

    def __post_init__(self) -> None:
        if self.branch not in {"driven", "held"}:
            raise ValueError(
                f"hypothesis: got the branch {self.branch!r}, expected 'driven' or 'held'; "
                f"a creep that follows the torque is 'driven'"
            )
        if not (math.isfinite(self.creep) and self.creep >= 0.0):
            raise ValueError(
                f"hypothesis: got a creep of {self.creep!r} times that of the peak, expected a finite "
                f"number >= 0; 1 is the peak"
            )
        if not (math.isfinite(self.patch) and self.patch > 0.0):
            raise ValueError(
                f"hypothesis: got a contact patch of {self.patch!r} times that of the wheelset, expected a "
                f"finite number > 0; 1 is the patch of the wheelset"
            )
        mean, deviation = self.friction
        if not (math.isfinite(mean) and math.isfinite(deviation) and deviation >= 0.0):
            raise ValueError(
                f"hypothesis: got a friction of mean and deviation {self.friction!r}, expected finite "
                f"numbers, the second >= 0; (0, 1) is all that a condition may have"
            )

    @property
    def sides(self) -> tuple[str, str]:
        """Conditions under the left and the right wheel."""
        return self.condition, self.right or self.condition

    @property
    def unlike(self) -> bool:
        """Whether the rails under left and right wheel differ."""
        return self.right not in {None, self.condition}

    @property
    def name(self) -> str:
        """Name in results."""
        where = "/".join(dict.fromkeys(self.sides))
        how = f"{where} driven" if self.branch == "driven" else f"{where} held at {self.creep:g}"
        if self.patch != 1.0:
            how = f"{how} patch {self.patch:g}"
        return how if self.friction[0] == 0.0 else f"{how} friction {self.friction[0]:+g} sd"

    @property
    def kind(self) -> Hypothesis:
        """The same with the usual patch and all of the friction."""
        return replace(self, patch=1.0, friction=_ALL_FRICTION)

    @property
    def past_peak(self) -> bool:
        """Whether the creep is held past the peak, where the size of the patch does not show."""
        return self.branch == "held" and self.creep > 1.0


def rail_of(condition: RailCondition, patch: float) -> RailCondition:
    """Return the rail that acts on the usual patch as `condition` does on one `patch` times as large.

    The area of the patch enters the creep law as a factor of Kalker's reductions alone.
    """
    return replace(condition, k_A=patch**2 * condition.k_A, k_S=patch**2 * condition.k_S)


def with_torque(
    conditions: Iterable[str] = CONDITIONS,
    patches: Iterable[float] = (1.0,),
    frictions: Iterable[tuple[float, float]] = (_ALL_FRICTION,),
) -> tuple[Hypothesis, ...]:
    """Return the usual hypotheses where the torque is known: driven, and held past the peak.

    The driven ones for each of the sizes of the contact patch with each part of the friction.
    """
    kinds = tuple(itertools.product(patches, frictions))
    return tuple(
        hypothesis
        for name in conditions
        for hypothesis in (
            *(Hypothesis(name, patch=size, friction=friction) for size, friction in kinds),
            Hypothesis(name, "held", _PAST),
        )
    )


def kinds(hypotheses: Sequence[Hypothesis]) -> tuple[int, ...]:
    """Return for each hypothesis the place of the first that differs from it in patch and friction alone.

    First is that of the patch nearest to 1 with the friction nearest to that of the condition.
    """
    return _first_alike(hypotheses, [h.kind for h in hypotheses])


def stand_ins(hypotheses: Sequence[Hypothesis]) -> tuple[int, ...]:
    """Return the place of the hypothesis that stands in for each while its rail has no chance.

    It is the first of its kind; past the peak the driven one of the same rail, if there is one.
    """
    rails = [replace(h.kind, branch="driven", creep=0.0) if h.past_peak else h.kind for h in hypotheses]
    return _first_alike(hypotheses, rails)


def _first_alike(hypotheses: Sequence[Hypothesis], alike: Sequence[Hypothesis]) -> tuple[int, ...]:
    """Return the place of the most usual of the hypotheses that are alike."""

    def usual(i: int) -> tuple[bool, float, float]:
        h = hypotheses[i]
        return h.past_peak, abs(math.log(h.patch)), abs(h.friction[0])

    found: dict[Hypothesis, int] = {}
    for i in sorted(range(len(hypotheses)), key=usual):
        found.setdefault(alike[i], i)
    return tuple(found[h] for h in alike)


def unlike_rails(conditions: Iterable[str] = CONDITIONS) -> tuple[Hypothesis, ...]:
    """Return a driven hypothesis for each pair of unlike rails under left and right wheel."""
    return tuple(Hypothesis(left, right=right) for left, right in itertools.permutations(conditions, 2))


def without_torque(
    conditions: Iterable[str] = CONDITIONS, patches: Iterable[float] = (1.0,)
) -> tuple[Hypothesis, ...]:
    """Return the usual hypotheses where the torque is not known: creeps from rolling to past the peak.

    Those below the peak for each of the sizes of the contact patch.
    """
    sizes = tuple(patches)
    return tuple(
        Hypothesis(name, "held", creep, patch=size)
        for name in conditions
        for creep in _CREEPS
        for size in (sizes if creep < 1.0 else (1.0,))
    )
