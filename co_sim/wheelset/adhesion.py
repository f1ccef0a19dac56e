"""The adhesion bank as a component of the co-simulation: measurements in, rail, adhesion and advice out."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from co_sim.component import Component, Port, StateError
from co_sim.errors import InputError
from co_sim.wheelset.identification import MEASUREMENTS
from estimator.adhesion import REGIONS, FuzzyIdentifier, new_judgement

if TYPE_CHECKING:
    from collections.abc import Iterator

    from co_sim.component import Vector
    from estimator.adhesion import AdhesionBank

__all__ = ["AdhesionComponent"]

_ADHESION = {
    "mu_used": "adhesion used, negative when braking",
    "mu_max": "peak adhesion, median",
    "mu_max_low": "peak adhesion, lower end of its interval of 90 %",
    "mu_max_high": "peak adhesion, upper end of its interval of 90 %",
}


class AdhesionComponent(Component):
    """Runs an `AdhesionBank` on every `period`-th step and holds its outputs in between.

    Inputs are the two measurements, the ``speed`` (m/s) and the ``traction_torque`` (total on the axle, N m).
    Outputs: ``p_region.NAME`` and ``p_condition.NAME``, ``p_none`` (probability that no hypothesis
    holds), ``mu_used``, ``mu_max``, ``mu_max_low``, ``mu_max_high`` and ``identifiable``; then what the fuzzy
    identifier makes of the same filters: degrees ``fuzzy_region.NAME``, ``fuzzy_condition.NAME`` and
    ``fuzzy_known`` from 0.1 (no) to 0.9 (yes), ``advised``, and where that is true ``advice`` from -1 (reduce
    sharply) to 1 (more torque possible), else 0. They change with each block of the bank; before the first
    one all is equally likely and nothing identifiable.

    Parameters
    ----------
    bank : made for the sampling time of the sensors; no other component may have it.
    period : that time, in steps of the master.
    """

    def __init__(self, bank: AdhesionBank, *, period: int = 1) -> None:
        classes = {"region": REGIONS, "condition": tuple(bank.conditions)}
        super().__init__(
            inputs=[
                *(Port(name, unit, description=f"measured {name}") for name, unit in MEASUREMENTS),
                Port("speed", "m/s", description="measured speed"),
                Port("traction_torque", "N.m", description="total torque on the axle"),
            ],
            outputs=[
                *(
                    Port(f"p_{what}.{name}", description=f"probability of the {what} {name}")
                    for what, names in classes.items()
                    for name in names
                ),
                Port("p_none", description="probability that no hypothesis holds"),
                *(Port(name, description=text) for name, text in _ADHESION.items()),
                Port("identifiable", kind="boolean", description="whether to trust the other outputs"),
                *(
                    Port(f"fuzzy_{what}.{name}", description=f"degree of the {what} {name}")
                    for what, names in classes.items()
                    for name in names
                ),
                Port("fuzzy_known", description="degree to which a filter is as good as it expects to be"),
                Port("advice", description="from -1, reduce sharply, to 1, more torque possible"),
                Port("advised", kind="boolean", description="whether there is an advice"),
            ],
            feedthrough={},
        )
        self._bank = bank
        self._period = period
        self._said = new_judgement(1, len(bank.hypotheses()), len(bank.conditions))
        self._fuzzy = FuzzyIdentifier(bank, bank.hypotheses())
        self._verdict = self._fuzzy.new_verdict(1)
        self._held = np.zeros(0)
        self._steps = 0

    def start(self, t0: float, h: float) -> None:
        """Forget all samples.

        Raises
        ------
        InputError
            If the bank is made for another sampling time.
        """
        if abs(self._bank.h - self._period * h) > 1e-6 * self._bank.h:
            raise InputError(
                "adhesion bank",
                got=f"a sample every {self._period * h:g} s",
                expected=f"one every {self._bank.h:g} s, for which the bank is made",
                remedy="choose another period or make the bank for this one",
            )
        self._bank.reset()
        self._fuzzy.reset()
        n = len(self._bank.conditions)
        self._held = np.concatenate(
            [np.full(3, 1.0 / 3.0), np.full(n, 1.0 / n), np.zeros(6), np.full(3 + n + 1, 0.5), np.zeros(2)]
        )
        self._steps = 0

    def exchange(self, u: Vector, y: Vector) -> None:
        """Write what can be said before the first sample."""
        y[:] = self._held

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Take the sample at the start of the step if there is one."""
        if self._steps % self._period == 0 and self._bank.step(u[:2], u[2], u[3], self._said):
            self._hold(float(u[2]))
        self._steps += 1
        y[:] = self._held

    def _hold(self, speed: float) -> None:
        """Take what the bank has told of the block that has just ended."""
        said, verdict, bank = self._said, self._verdict, self._bank
        self._fuzzy.step(bank.samples // bank.block - 1, bank.told, speed, said, verdict)
        advised = np.isfinite(verdict.score)
        told = (
            said.p_region[0], said.p_condition[0], said.p_none, said.mu[0], said.identifiable,
            verdict.region[0], verdict.condition[0], verdict.known,
            np.where(advised, verdict.score, 0.0), advised,
        )  # fmt: skip
        self._held = np.concatenate(told, dtype=np.float64)

    def save(self) -> object:
        """Return a copy of what bank and fuzzy identifier keep, in one row."""
        parts = [self._held, np.array([self._steps, self._bank.samples]), *self._arrays()]
        return np.concatenate([np.ravel(part) for part in parts], dtype=np.float64)

    def restore(self, state: object) -> None:
        """Return to a state of `save`."""
        row = cast("Vector", state)
        size = self._held.size
        self._held = row[:size].copy()
        self._steps, self._bank.samples = map(int, row[size : size + 2])
        at = size + 2
        for array in self._arrays():
            array[...] = row[at : at + array.size].reshape(array.shape)
            at += array.size

    def serialize(self, state: object) -> bytes:
        """Return the state as float64 in little-endian order."""
        return cast("Vector", state).astype("<f8").tobytes()

    def deserialize(self, data: bytes) -> object:
        """Return the state from the bytes of `serialize`."""
        size = self._held.size + 2 + sum(array.size for array in self._arrays())
        if len(data) != 8 * size:
            raise StateError(f"its state has {size} values of 8 bytes, and {len(data)} bytes were given")
        return np.frombuffer(data, dtype="<f8").astype(np.float64)

    def _arrays(self) -> Iterator[Vector]:
        yield from _leaves((self._bank.state, self._fuzzy.state))


def _leaves(tree: object) -> Iterator[Vector]:
    """Yield the arrays of nested tuples."""
    if isinstance(tree, tuple):
        for part in tree:
            yield from _leaves(part)
    else:
        yield cast("Vector", tree)
