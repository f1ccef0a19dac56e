"""What the bank holds possible: a rail condition and what decides the creep on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from fmu_wheelset.parameters import RailCondition

__all__ = ["Hypothesis", "rail_of", "with_torque", "with_unlike_rails", "without_torque"]

#: Creeps over that of the peak with which filters start where nothing tells the creep.
_CREEPS = (0.05, 0.3, 1.0, 1.7)
#: The same past the peak, where the torque is known but no creep past the peak balances it.
_PAST = 1.7


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
    """

    condition: str
    branch: Literal["driven", "held"] = "driven"
    creep: float = 0.0
    right: str | None = None
    patch: float = 1.0

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

    @property
    def sides(self) -> tuple[str, str]:
        """Conditions under the left and the right wheel."""
        return self.condition, self.right or self.condition

    @property
    def name(self) -> str:
        """Name in results."""
        where = "/".join(dict.fromkeys(self.sides))
        how = f"{where} driven" if self.branch == "driven" else f"{where} held at {self.creep:g}"
        return how if self.patch == 1.0 else f"{how} patch {self.patch:g}"

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
    conditions: Iterable[str] = CONDITIONS, patches: Iterable[float] = (1.0,)
) -> tuple[Hypothesis, ...]:
    """Return the usual hypotheses where the torque is known: driven, and held past the peak.

    The driven ones for each of the sizes of the contact patch.
    """
    sizes = tuple(patches)
    return tuple(
        hypothesis
        for name in conditions
        for hypothesis in (
            *(Hypothesis(name, patch=size) for size in sizes),
            Hypothesis(name, "held", _PAST),
        )
    )


def with_unlike_rails(conditions: Iterable[str] = CONDITIONS) -> tuple[Hypothesis, ...]:
    """Return a driven hypothesis for each pair of rails under left and right wheel, like or unlike."""
    names = tuple(conditions)
    return tuple(
        Hypothesis(left, right=None if left == right else right) for left in names for right in names
    )


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
