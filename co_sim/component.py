"""What the master asks of a component: ports by name, and a step.

The life of a component, in this order::

    start(t0, h) -> exchange(u, y)* -> enter_steps() -> step(t, h, u, y)* -> close()

`exchange` is called during initialisation only, as often as the master needs to settle the values
that components pass to each other at ``t0``; the same `u` must give the same `y` each time. `close` is
called on every path, also after a failure, and may be called when `start` was not reached. Any
exception raised by a component ends the run. A closed component can be started again, and a copy
(`copy.deepcopy`) of one that is not started is independent of it: that is how one description runs
many times, also side by side.

Values travel as float64 arrays: the elements of the ports, port by port in the declared order, arrays row by
row. Whole numbers, booleans (0 and 1) and enumerations are carried as numbers, texts as their number in
`co_sim.texts`. A component reads `u`, writes every element of `y` and keeps neither: the master reuses
both arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import TYPE_CHECKING, Literal

import numpy as np

from co_sim.errors import Fault, suggestion
from co_sim.local_model import LocalModel, NotLinearizableError, central_differences

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from co_sim.native import NativeState, NativeStep
    from co_sim.units import Unit

    Vector = NDArray[np.float64]
    Scalar = float | int | bool | str

__all__ = ["Component", "FunctionComponent", "Kind", "Port", "StateError"]

Kind = Literal[
    "float64",
    "float32",
    "int8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
    "boolean",
    "enumeration",
    "string",
]


class StateError(Exception):
    """A component cannot save or restore its state; the text says why."""


@dataclass(frozen=True, slots=True)
class Port:
    """One input or output of a component: a scalar, or an array of `shape`.

    Parameters
    ----------
    name : unique among the component's inputs, or among its outputs.
    unit : FMI unit name such as ``"rad/s"``; ``"1"`` where there is none.
    start : value of an input that is not connected, one for all elements or one for each (row by row);
        ``None`` makes a connection required.
    description : one line for tables and reports.
    kind : type of the values, named as in FMI 3.
    shape : of an array; empty for a scalar.
    continuous : whether the value moves smoothly between communication points, so that it may be
        extrapolated; of use for floating-point kinds only.
    definition : what the unit means, where that is declared with it; else its common meaning.
    """

    name: str
    unit: str = "1"
    start: float | str | tuple[float | str, ...] | None = None
    description: str = ""
    kind: Kind = "float64"
    shape: tuple[int, ...] = ()
    continuous: bool = True
    definition: Unit | None = None

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of the elements, row by row: ``x`` for a scalar, else ``x[1]``, ``x[2]`` or ``x[1,2]``.

        Counted from 1, as the naming convention of FMI for structured variables has it.
        """
        if not self.shape:
            return (self.name,)
        indices = product(*(range(1, n + 1) for n in self.shape))
        return tuple(f"{self.name}[{','.join(map(str, index))}]" for index in indices)

    @property
    def starts(self) -> tuple[float | str, ...] | None:
        """Start value of each element."""
        if self.start is None or isinstance(self.start, tuple):
            return self.start
        return (self.start,) * self.size


class Component(ABC):
    """A part of a co-simulation that advances in fixed steps.

    Parameters
    ----------
    inputs, outputs : the ports.
    feedthrough : for each output the inputs on which it depends at the same time; outputs that are left
        out depend on none. ``None``: not known, so that any may depend on any.
    """

    #: Whether `u` carries the first and second derivatives of the inputs behind their values: three times as
    #: many elements, derivatives in the unit of the input per s and s2, zeros where nothing is
    #: extrapolated. Others get the mean over the step of an extrapolated input. `exchange` has values only.
    takes_derivatives: bool = False

    #: Name in the system, which the master sets before `start`.
    instance_name: str = ""

    #: End of the run, s, where it is known that none goes beyond it; the master sets it before `start`.
    stop_time: float | None = None

    #: Whether `u` carries the value of an extrapolated input at the end of the step instead of its mean, as
    #: suits a component without memory. Without effect where derivatives are taken.
    takes_end_values: bool = False

    def __init__(
        self,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        feedthrough: Mapping[str, Iterable[str]] | None = None,
    ) -> None:
        self.inputs = tuple(inputs)
        self.outputs = tuple(outputs)
        self.feedthrough = (
            None if feedthrough is None else {y: frozenset(names) for y, names in feedthrough.items()}
        )

    @property
    def identity(self) -> str:
        """What this is, for messages, such as the file of an FMU."""
        return type(self).__name__

    def parameter_faults(self, values: Mapping[str, Scalar]) -> Iterable[Fault]:
        """Find parameters that are unknown or whose value is not allowed; called before `set_parameters`."""
        for name in values:
            yield Fault(
                f'parameter "{name}"',
                "an unknown name",
                "a parameter of the component",
                suggestion(name, ()),
            )

    def set_parameters(self, values: Mapping[str, Scalar]) -> None:  # noqa: B027 - many have no parameters
        """Take parameters without faults for the next `start`."""

    def start(self, t0: float, h: float) -> None:  # noqa: B027 - most components need no preparation
        """Prepare for a run that begins at `t0` with steps of `h` (both s)."""

    @abstractmethod
    def exchange(self, u: Vector, y: Vector) -> None:
        """Write the outputs at ``t0`` into `y`, given the inputs `u` at ``t0``."""

    def enter_steps(self) -> None:  # noqa: B027 - most components need no transition
        """Learn that the initial values are settled; called once, before the first step."""

    @abstractmethod
    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance from `t` to ``t + h`` with `u` held; write the outputs at ``t + h`` into `y`."""

    def native(self) -> NativeStep | None:
        """Return the same step as machine code, valid until `close`, or ``None`` if it needs Python."""
        return None

    def native_state(self) -> NativeState | None:
        """Return `save` and `restore` as machine code, valid until `close`, or ``None`` if they need Python.

        That of a parent is not asked where a subclass has a `save` of its own.

        Raises
        ------
        StateError
            If the component cannot save its state.
        """
        return None

    def linearize(self, t: float, u: Vector) -> LocalModel:
        """Return the linear model near the present state, at `t` (s) with the inputs `u`; changes nothing.

        A component without inputs acts on the others, but does not react: its model is empty.

        Raises
        ------
        NotLinearizableError
            If there is none.
        """
        if self.inputs:
            raise NotLinearizableError("it does not say how it is linearised")
        n_y = sum(port.size for port in self.outputs)
        return LocalModel(
            np.zeros((0, 0)),
            np.zeros((0, 0)),
            np.zeros((n_y, 0)),
            np.zeros((n_y, 0)),
            (),
            (),
            method="none needed",
        )

    def save(self) -> object:
        """Return the present state; it stays valid and unchanged until `close`.

        Raises
        ------
        StateError
            If the component cannot save its state.
        """
        raise StateError("it does not say how its state is saved")

    def restore(self, state: object) -> None:
        """Return to a state of `save`, as often as wanted."""
        raise StateError("it does not say how its state is restored")

    def serialize(self, state: object) -> bytes:
        """Return a state of `save` as bytes that `deserialize` takes in another process."""
        raise StateError("it does not say how its state is written")

    def deserialize(self, data: bytes) -> object:
        """Return the state, as `restore` takes it, from the bytes of `serialize`."""
        raise StateError("it does not say how its state is read")

    def close(self) -> None:  # noqa: B027 - most components hold no resources
        """Release what the component holds; safe to call twice."""


class FunctionComponent(Component):
    """A component without memory: ``y(t) = function(t, u)``.

    `function` returns one value per output element. Its output at ``t + h`` uses the inputs there: those that
    the coupling extrapolates, and the others as they were held from ``t``.
    Without `feedthrough` every output is taken to depend on every input.
    """

    takes_end_values = True

    def __init__(
        self,
        function: Callable[[float, Vector], Sequence[float]],
        *,
        inputs: Sequence[Port] = (),
        outputs: Sequence[Port],
        feedthrough: Mapping[str, Iterable[str]] | None = None,
    ) -> None:
        every = [port.name for port in inputs]
        at_once = {port.name: every for port in outputs} if feedthrough is None else feedthrough
        super().__init__(inputs, outputs, at_once)
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

    def linearize(self, t: float, u: Vector) -> LocalModel:
        """Return the matrix D, from central differences."""
        D, error = central_differences(lambda v: np.asarray(self._function(t, v), dtype=np.float64), u)
        n_y, n_u = D.shape
        return LocalModel(
            np.zeros((0, 0)),
            np.zeros((0, n_u)),
            np.zeros((n_y, 0)),
            D,
            (),
            (),
            method="central differences",
            error=error,
        )

    def save(self) -> object:
        """Return nothing: a function has no memory."""
        return None

    def restore(self, state: object) -> None:
        """Do nothing: a function has no memory."""

    def serialize(self, state: object) -> bytes:
        """Return nothing: a function has no memory."""
        return b""

    def deserialize(self, data: bytes) -> object:
        """Return nothing: a function has no memory."""
        return None
