"""Units and linear transformations along a way through several connectors, joined to one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from co_sim.ssp.elements import Linear
from co_sim.units import UnknownUnitError, conversion

if TYPE_CHECKING:
    from co_sim.ssp.elements import Measure
    from co_sim.units import Unit

__all__ = ["Chain", "MismatchError"]

#: Done to a number.
NOTHING = Linear()


class MismatchError(Exception):
    """Two units of a way that do not fit; the text names them."""


@dataclass(frozen=True)
class Chain:
    """What happens to a number between its source and the present place.

    Parameters
    ----------
    measure : the present unit; ``None`` if nobody has told one.
    total : from the number at the source to that here.
    relative : the same with the conversion of units left out, where `is_plain`: from the number at the
        source, converted to the unit here, to that here.
    is_plain : whether units have been converted all the way.
    """

    measure: Measure | None
    total: Linear = NOTHING
    relative: Linear = NOTHING
    is_plain: bool = True

    def to(self, measure: Measure | None, linear: Linear = NOTHING, *, suppress: bool = False) -> Chain:
        """Return the chain that goes on to a place with this unit.

        Units come first, then the linear transformation. Where one of the two units is not told,
        nothing is converted.

        Raises
        ------
        MismatchError
            If the units measure different things, or one of them is not known.
        """
        if suppress:
            longer = replace(self, measure=measure, is_plain=False)
        elif self.measure is None or measure is None:
            longer = replace(
                self, measure=self.measure or measure, is_plain=self.is_plain and self.measure is measure
            )
            if measure is None:
                longer = replace(longer, is_plain=self.is_plain)
        else:
            longer = self._converted(self.measure, measure)
        return replace(longer, total=_after(linear, longer.total), relative=_after(linear, longer.relative))

    def _converted(self, source: Measure, target: Measure) -> Chain:
        try:
            factors = conversion(source.name, target.name, _definitions(source), _definitions(target))
        except UnknownUnitError as error:
            raise MismatchError(f"{error.faults[0].what} with {error.faults[0].got}") from error
        if factors is None:
            raise MismatchError(f'"{source.name}" into "{target.name}"')
        a, b = factors
        gain, offset = self.relative
        # With z the number in the new unit: a (gain (z - b)/a + offset) + b.
        relative = Linear(gain, a * offset + b * (1.0 - gain))
        return replace(self, measure=target, total=_after(Linear(a, b), self.total), relative=relative)


def _after(outer: Linear, inner: Linear) -> Linear:
    """Return the composition of two linear transformations; one that changes nothing leaves all digits."""
    if outer == NOTHING:
        return inner
    return Linear(outer.factor * inner.factor, outer.factor * inner.offset + outer.offset)


def _definitions(measure: Measure) -> dict[str, Unit]:
    return {} if measure.definition is None else {measure.name: measure.definition}
