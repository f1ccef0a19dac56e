"""Which cases a campaign has: grids, random draws, repetitions, and the seed of each case.

Every random number of a case follows from the seed of the plan, the names of the quantities and the place of
the case in the plan, never from the order in which cases run: any number of workers computes the same.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Case", "Draw", "Plan", "Value"]

Value = bool | int | float | str


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Case(_Table):
    """One case: its values by name, their variant, and a seed for whatever else is random in it."""

    number: int
    variant: str = ""
    values: dict[str, Value]
    seed: int


class Draw(_Table):
    """A quantity drawn anew for each case: exactly one of the distributions."""

    uniform: tuple[float, float] | None = Field(None, description="between the first value and the second")
    normal: tuple[float, float] | None = Field(None, description="mean and standard deviation")
    choice: tuple[Value, ...] | None = Field(None, min_length=1, description="one of these, equally likely")

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [name for name in ("uniform", "normal", "choice") if getattr(self, name) is not None]
        if len(given) != 1:
            raise _fault(
                f"{' and '.join(given) or 'no distribution'}", "one of uniform, normal, choice", "keep one"
            )
        if self.uniform and not self.uniform[0] < self.uniform[1]:
            raise _fault(f"uniform = {list(self.uniform)}", "a lower and a higher value", "swap them")
        if self.normal and not self.normal[1] > 0.0:
            raise _fault(
                f"a standard deviation of {self.normal[1]:g}", "one > 0", "use a fixed value instead"
            )
        return self

    def sample(self, rng: np.random.Generator) -> Value:
        """Return one value."""
        if self.uniform is not None:
            return float(rng.uniform(*self.uniform))
        if self.normal is not None:
            return float(rng.normal(*self.normal))
        assert self.choice is not None  # by the validator
        return self.choice[int(rng.integers(len(self.choice)))]


class Plan(_Table):
    """The cases of a campaign: every variant of every combination of the grid, `repeat` times.

    Cases that differ only in their variant, or in the quantities of `common`, share their draws and their
    seed: what differs in their results is then due to those quantities, and far fewer cases show it.
    A value of a variant replaces what a draw or `fixed` says.
    """

    seed: Annotated[int, Field(ge=0)] = Field(1, description="from which all random numbers follow")
    repeat: Annotated[int, Field(ge=1)] = Field(1, description="cases for each point of the grid")
    grid: dict[str, tuple[Value, ...]] = Field({}, description="values of each quantity, all combinations")
    draw: dict[str, Draw] = Field({}, description="quantities drawn anew for each case")
    fixed: dict[str, Value] = Field({}, description="quantities that are the same in all cases")
    variant: dict[str, dict[str, Value]] = Field({}, description="values that each variant has, by its name")
    common: tuple[str, ...] = Field((), description="quantities of the grid whose cases share random numbers")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [*self.grid, *self.draw, *self.fixed]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise _fault(
                f"{', '.join(doubled)} in more than one of grid, draw and fixed", "one place", "keep one"
            )
        for name, values in self.grid.items():
            if not values or len(set(map(repr, values))) < len(values):
                raise _fault(
                    f"grid.{name} = {list(values)}", "distinct values, at least one", "mend the list"
                )
        crossed = sorted({name for values in self.variant.values() for name in values} & set(self.grid))
        if crossed:
            raise _fault(f"{', '.join(crossed)} in grid and in a variant", "one place", "keep one")
        strange = [name for name in self.common if name not in self.grid]
        if strange:
            raise _fault(
                f"common = {strange}", f"quantities of the grid ({', '.join(self.grid)})", "drop the others"
            )
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all quantities."""
        return (*self.grid, *self.draw, *self.fixed)

    @property
    def size(self) -> int:
        """Number of cases."""
        return self.repeat * math.prod(map(len, self.grid.values())) * len(self._variants)

    @property
    def key(self) -> str:
        """Hash of all that decides what the cases are."""
        return hashlib.sha256(json.dumps(self.plan_only, sort_keys=True).encode()).hexdigest()

    @property
    def plan_only(self) -> dict[str, Any]:
        """What decides the cases and their results."""
        return self.model_dump(mode="json")

    def cases(self) -> Iterator[Case]:
        """Yield all cases; the repetitions of a point of the grid follow each other."""
        counts = [len(values) for values in self.grid.values()]
        places = itertools.product(*(range(n) for n in counts), range(self.repeat))
        for number, (place, variant) in enumerate(itertools.product(places, self._variants)):
            values = {name: self.grid[name][i] for name, i in zip(self.grid, place, strict=False)}
            # The place without the quantities in common is what random numbers depend on.
            drawn_at = [0 if name in self.common else i for name, i in zip(self.grid, place, strict=False)]
            yield self._case(number, variant, values, (*drawn_at, place[-1]))

    @property
    def _variants(self) -> tuple[str, ...]:
        return tuple(self.variant) or ("",)

    def _case(self, number: int, variant: str, values: dict[str, Value], place: tuple[int, ...]) -> Case:
        drawn = {
            name: draw.sample(np.random.default_rng(self._seed(f"draw {name}", place)))
            for name, draw in self.draw.items()
        }
        seed = int(self._seed("case", place).generate_state(1)[0])
        own = self.variant.get(variant, {})
        return Case(
            number=number, variant=variant, values={**values, **drawn, **self.fixed, **own}, seed=seed
        )

    def _seed(self, purpose: str, place: tuple[int, ...]) -> np.random.SeedSequence:
        # The length keeps purposes of any length apart from the place behind them.
        name = purpose.encode()
        return np.random.SeedSequence(self.seed, spawn_key=(len(name), *name, *place))


def _fault(got: str, expected: str, remedy: str) -> PydanticCustomError:
    return PydanticCustomError(
        "scenario",
        "got {got}, expected {expected}; {remedy}",
        {"got": got, "expected": expected, "remedy": remedy},
    )
