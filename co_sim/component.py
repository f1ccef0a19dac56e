"""What the master asks of a component: ports by name, and a step.

The life of a component, in this order::

    start(t0, h) -> exchange(u, y)* -> step(t, h, u, y)* -> close()

`exchange` is called during initialisation only, as often as the master needs to settle the values
that components pass to each other at ``t0``; the same `u` must give the same `y` each time. `close` is
called on every path, also after a failure, and may be called when `start` was not reached. Any
exception raised by a component ends the run.

Values travel as float64 arrays in the order of the declared ports. A component reads `u`, writes
every element of `y` and keeps neither: the master reuses both arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]

__all__ = ["Component", "FunctionComponent", "Port"]


@dataclass(frozen=True, slots=True)
class Port:
    """One scalar input or output of a component.

    Parameters
    ----------
    name : unique among the component's inputs, or among its outputs.
    unit : FMI unit name such as ``"rad/s"``; ``"1"`` where there is none.
    start : value of an input that is not connected; ``None`` makes a connection required.
    description : one line for tables and reports.
    """

    name: str
    unit: str = "1"
    start: float | None = None
    description: str = ""


class Component(ABC):
    """A part of a co-simulation that advances in fixed steps."""

    def __init__(self, inputs: Sequence[Port], outputs: Sequence[Port]) -> None:
        self.inputs = tuple(inputs)
        self.outputs = tuple(outputs)

    def start(self, t0: float, h: float) -> None:  # noqa: B027 - most components need no preparation
        """Prepare for a run that begins at `t0` with the communication step `h` (both s)."""

    @abstractmethod
    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the outputs at ``t0`` into `y`, given the inputs `u` at ``t0``."""

    @abstractmethod
    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance from `t` to ``t + h`` with `u` held; write the outputs at ``t + h`` into `y`."""

    def close(self) -> None:  # noqa: B027 - most components hold no resources
        """Release what the component holds; safe to call twice."""


class FunctionComponent(Component):
    """A component without memory: ``y(t) = function(t, u)``.

    `function` returns one value per output. Its output at ``t + h`` uses the inputs held from ``t``.
    """

    def __init__(
        self,
        function: Callable[[float, Vector], Sequence[float]],
        *,
        inputs: Sequence[Port] = (),
        outputs: Sequence[Port],
    ) -> None:
        super().__init__(inputs, outputs)
        self._function = function
        self._t0 = 0.0

    def start(self, t0: float, h: float) -> None:
        """Remember the start time for `exchange`."""
        self._t0 = t0

    def exchange(self, u: Vector, y: Vector) -> None:
        """Evaluate the function at the start time."""
        y[:] = self._function(self._t0, u)

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Evaluate the function at the end of the step."""
        y[:] = self._function(t + h, u)
