"""The identifier as a component of the co-simulation: measurements in, residuals and probabilities out."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from co_sim.component import Port, StateError
from co_sim.native import TableComponent
from estimator.residuals import duels, equal_level

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.component import Vector
    from estimator import Identifier

__all__ = ["MEASUREMENTS", "IdentifierComponent"]

#: The measurements of (14), in the order of the filters, with their units.
MEASUREMENTS = (("yaw_rate", "rad/s"), ("lateral_acceleration", "m/s2"))


class IdentifierComponent(TableComponent):
    """Runs an `Identifier` on every `period`-th step and holds its outputs in between.

    Inputs are the two measurements. Outputs, for each filter of the bank: ``E.NAME`` (normalised
    residual (15)), ``p.NAME`` (fuzzy probability) and the innovations ``e_yaw_rate.NAME`` and
    ``e_lateral_acceleration.NAME``.

    Parameters
    ----------
    identifier : designed for the sampling period of the sensors.
    period : that period, in steps of the master.
    """

    def __init__(self, identifier: Identifier, *, period: int = 1) -> None:
        names = identifier.bank.names
        super().__init__(
            inputs=[Port(name, unit, description=f"measured {name}") for name, unit in MEASUREMENTS],
            outputs=[
                *(Port(f"E.{name}", description=f"normalised residual of {name}") for name in names),
                *(Port(f"p.{name}", description=f"probability of {name}") for name in names),
                *(
                    Port(f"e_{measured}.{name}", unit, description=f"innovation of {name}")
                    for name in names
                    for measured, unit in MEASUREMENTS
                ),
            ],
            feedthrough={},
        )
        self._identifier = identifier
        self._period = period
        #: Memory of the identifier, its last outputs, and the counters of `identification_step`.
        self._state: tuple[Vector | NDArray[np.int64], ...] = ()
        #: What else the step reads and writes.
        self._kept: tuple[object, ...] = ()

    def start(self, t0: float, h: float) -> None:
        """Forget all samples."""
        from co_sim.wheelset.steps import identification_step

        design, work = self._identifier.design, self._identifier.new_work()
        self._state, self._kept = self._first_state(), (design, work)
        *memory, held, counters = self._state
        n, s, m = design.K.shape
        F, H, K, weights, fuzzy = design
        sizes = [
            n, m, s, self._identifier.window, fuzzy.corners.shape[1], len(fuzzy.clauses),
            len(fuzzy.conclusions), *fuzzy.shapes.shape[1:],
        ]  # fmt: skip
        arrays = (counters, held, F, H, K, weights, *fuzzy, *memory, *work)
        self._attach(identification_step, [*sizes, *(int(array.ctypes.data) for array in arrays)])

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write what can be said before the first sample: all filters are equally good."""
        y[:] = self._state[-2]

    def save(self) -> object:
        """Return a copy of the memory, in one row."""
        self.native()
        return np.concatenate([part.ravel() for part in self._state], dtype=np.float64)

    def restore(self, state: object) -> None:
        """Return to a state of `save`."""
        self.native()
        ends = np.cumsum([part.size for part in self._state])
        for part, values in zip(self._state, np.split(cast("Vector", state), ends[:-1]), strict=True):
            part[...] = values.reshape(part.shape)

    def serialize(self, state: object) -> bytes:
        """Return the state as float64 in little-endian order."""
        return cast("Vector", state).astype("<f8").tobytes()

    def deserialize(self, data: bytes) -> object:
        """Return the state from the bytes of `serialize`."""
        size = sum(part.size for part in self._first_state())
        if len(data) != 8 * size:
            raise StateError(f"its state has {size} values of 8 bytes, and {len(data)} bytes were given")
        return np.frombuffer(data, dtype="<f8").astype(np.float64)

    def _first_state(self) -> tuple[Vector | NDArray[np.int64], ...]:
        n = len(self._identifier.bank.names)
        E = np.full(n, equal_level(n))
        held = np.concatenate([E, self._identifier.fuzzy(duels(E)), np.zeros(n * len(MEASUREMENTS))])
        return (*self._identifier.new_memory(), held, np.array([0, 0, self._period]))
