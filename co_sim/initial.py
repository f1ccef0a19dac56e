"""The values at the start: every output agrees with the inputs that it follows at once.

Components are asked group by group, each after those that feed it. A group of several is a loop of
components; most are no algebraic loops, and settle when each is asked as often as the loop is long. What
then still changes depends on itself, and is solved for if that is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from co_sim.dependencies import initial_groups
from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from co_sim.component import Vector
    from co_sim.layout import Layout, Part
    from co_sim.system import System

    Exchange = Callable[[Part, Vector], None]

__all__ = ["settle"]


def settle(system: System, layout: Layout, row: Vector, exchange: Exchange) -> None:
    """Set all outputs and inputs at the start.

    Parameters
    ----------
    row : all outputs; changed in place from first guesses to their values.
    exchange : asks a component for its outputs in its columns of a row.

    Raises
    ------
    InputError
        If outputs depend on themselves and loops are not to be solved, or have no solution.
    """
    settling = _Settling(system, layout, row, exchange)
    part_of = {part.name: part for part in layout.parts}
    for group in initial_groups(system):
        settling.group([part_of[name] for name in group])
    settling.confirm()


@dataclass
class _Settling:
    system: System
    layout: Layout
    row: Vector
    exchange: Exchange
    solved: bool = False

    def group(self, parts: Sequence[Part]) -> None:
        """Settle the components of one group."""
        columns = np.concatenate([np.arange(part.y.start, part.y.stop) for part in parts])
        if not self._repeat(parts, columns):
            if self.system.coupling.loops == "refuse":
                raise self._unsettled(parts, columns)
            self._solve(parts)
            self.solved = True

    def confirm(self) -> None:
        """Make sure that asking all components once more changes nothing."""
        before = self.row.copy()
        self._sweep(self.layout.parts)
        tolerance = 1e3 * self.system.coupling.tolerance if self.solved else 0.0
        changed = ~np.isclose(self.row, before, rtol=tolerance, atol=tolerance, equal_nan=True)
        if changed.any():
            names = [s.name for s, moved in zip(self.system.signals, changed, strict=True) if moved]
            raise _still_changing(names)

    def _repeat(self, parts: Sequence[Part], columns: NDArray[np.intp]) -> bool:
        """Ask all components in turn until nothing changes; return whether that came to pass.

        A value can pass through one component more than once, so outputs count, not components.
        """
        for _ in range(len(columns) + 2):
            before = self.row[columns]
            self._sweep(parts)
            if np.array_equal(self.row[columns], before, equal_nan=True):
                return True
            if len(parts) == 1 and not self._inside(parts).size:
                return True
        return False

    def _sweep(self, parts: Sequence[Part]) -> None:
        for part in parts:
            self._gather(slice(part.behind, part.end))
            self.exchange(part, self.row)

    def _gather(self, links: slice | NDArray[np.intp]) -> None:
        self.layout.u[self.layout.links.target[links]] = self.layout.fed(links, self.row)

    def _inside(self, parts: Sequence[Part]) -> NDArray[np.intp]:
        """Return the links from the group to itself."""
        columns = np.concatenate([np.arange(part.y.start, part.y.stop) for part in parts])
        links = np.concatenate([np.arange(part.behind, part.end) for part in parts])
        inside: NDArray[np.intp] = links[np.isin(self.layout.links.source[links], columns)]
        return inside

    def _solve(self, parts: Sequence[Part]) -> None:
        """Solve for the inputs that the group feeds to itself, by Powell's hybrid method."""
        from scipy.optimize import root

        inside = self._inside(parts)
        target = self.layout.links.target[inside]
        u = self.layout.u

        def residual(w: Vector) -> Vector:
            u[target] = w
            for part in parts:
                self.exchange(part, self.row)
            return self.layout.fed(inside, self.row) - w

        with np.errstate(all="ignore"):
            solution = root(residual, u[target].copy(), method="hybr", options={"xtol": 1e-14})
        rest = np.abs(residual(solution.x))
        allowed = self.system.coupling.tolerance * np.maximum(np.abs(solution.x), 1.0)
        if not (rest <= allowed).all():
            worst = int(np.argmax(np.nan_to_num(rest / allowed, nan=np.inf)))
            signal = self.system.signals[self.layout.links.source[inside[worst]]].name
            raise InputError(
                "initial values",
                got=f"no solution of the algebraic loop through {signal}: {rest[worst]:.3g} is left over",
                expected=f"at most {allowed[worst]:.3g}",
                remedy="give start values to the inputs in the loop that lie nearer to a solution",
            )

    def _unsettled(self, parts: Sequence[Part], columns: NDArray[np.intp]) -> InputError:
        """Return the error that names the signals of the loop, without those that only follow it."""
        before = self.row.copy()
        self._sweep(parts)
        changing = {int(c) for c in columns if self.row[c] != before[c]}
        inside = self._inside(parts)
        feeding = {int(c) for c in self.layout.links.source[inside]}
        names = [self.system.signals[c].name for c in sorted(changing & feeding or changing or set(columns))]
        return _still_changing(names)


def _still_changing(names: Sequence[str]) -> InputError:
    return InputError(
        "initial values",
        got=f"{', '.join(sorted(names))} still changing when asked again",
        expected="outputs that do not depend on themselves at the same time",
        remedy="break the algebraic loop with a component whose output does not follow its input at once, "
        'or say loops="solve"',
    )
