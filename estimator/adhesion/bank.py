"""The adhesion bank: filters for rail conditions, run over a log or sample by sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.adhesion.assumptions import BLOCK, Assumptions, Unknowns
from estimator.adhesion.block import Design, Memory, new_memory
from estimator.adhesion.curves import REGIONS
from estimator.adhesion.evidence import Belief, Rules, new_belief
from estimator.adhesion.fuzzy import FuzzyIdentifier
from estimator.adhesion.judgement import Judgement, new_judgement
from estimator.adhesion.log_run import run_over
from estimator.adhesion.online import bank_step, new_work
from estimator.adhesion.result import AdhesionIdentification
from estimator.sensor_noise import SensorNoise
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from estimator.adhesion.fuzzy import Verdict
    from estimator.adhesion.hypotheses import Hypothesis
    from estimator.log import Log
    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import RailCondition

__all__ = ["AdhesionBank"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_BOTH = np.ones(2, dtype=np.bool_)


class AdhesionBank:
    """Extended Kalman filters with the nonlinear creep law, one for each hypothesis, and what they say.

    Parameters
    ----------
    wheelset : parameters of the wheelset.
    conditions : rail conditions by name, in the order of the results.
    noise : of the sensors at the step `h`. track : spectrum of the track's alignment.
    h : step of the samples, s.
    hypotheses : what is held possible; None: what `unknown` asks for.
    window : length of the moving window of evidence, s; None: recursive evidence, in which another
        hypothesis may take over at any time, once in `dwell` s on average.
    dwell : mean time for which a hypothesis holds, s.
    unknown : what is allowed for besides the condition.
    """

    def __init__(
        self,
        wheelset: WheelsetParameters | None = None,
        conditions: Mapping[str, RailCondition] = CONDITIONS,
        noise: SensorNoise | None = None,
        track: TrackSpectrum = ERRI_B176["erri_low"],
        h: float = 1e-3,
        *,
        hypotheses: Sequence[Hypothesis] | None = None,
        window: float | None = None,
        dwell: float = 20.0,
        unknown: Unknowns | None = None,
    ) -> None:
        self._assumed = Assumptions(
            wheelset or WheelsetParameters(),
            dict(conditions),
            noise or SensorNoise(),
            track,
            h,
            None if hypotheses is None else tuple(hypotheses),
            window,
            dwell,
            unknown or Unknowns(),
        )
        self.reset()

    @property
    def assumed(self) -> Assumptions:
        """What the bank takes for granted and allows for."""
        return self._assumed

    @property
    def conditions(self) -> tuple[str, ...]:
        """Names of the rail conditions, in the order of the results."""
        return tuple(self._assumed.conditions)

    @property
    def h(self) -> float:
        """Step of the samples, s."""
        return self._assumed.h

    @property
    def block(self) -> int:
        """Samples from one weighing of the evidence to the next."""
        return self._assumed.block

    def hypotheses(self, *, torque_known: bool = True) -> tuple[Hypothesis, ...]:
        """Return what is held possible, in the order of the results."""
        return self._assumed.held_possible(torque_known=torque_known)

    def design(self, hypotheses: Sequence[Hypothesis]) -> Design:
        """Return what the filters read."""
        return self._assumed.design(hypotheses)

    def rules(self, hypotheses: Sequence[Hypothesis]) -> Rules:
        """Return how the evidence is weighed."""
        return self._assumed.rules(hypotheses)

    def run(self, log: Log, *, every: float = BLOCK, workers: int | None = None) -> AdhesionIdentification:
        """Identify over a log.

        Parameters
        ----------
        log : the samples; its step must be that of the bank.
        every : time between rows of the result, s; a multiple of the block of 10 ms.
        workers : threads that share the filters; None: as many as there are processors.
        """
        self._check(log)
        hypotheses = self.hypotheses(torque_known=log.traction_torque is not None)
        identifier, rows = FuzzyIdentifier(self, hypotheses), len(log) // self.block
        verdict, speed = identifier.new_verdict(rows), log.speed[self.block - 1 :: self.block]
        said = new_judgement(rows, len(hypotheses), len(self.conditions))

        def take(since: int, told: Array) -> None:
            identifier.take(since, told, speed[since : since + len(told)], said, verdict)

        run_over(log, self.design(hypotheses), self.rules(hypotheses), said, take, workers)
        return self._result(log, said, verdict, hypotheses, max(round(every / (self.block * self.h)), 1))

    def look_at(
        self, log: Log, hypotheses: Sequence[Hypothesis], *, workers: int | None = None
    ) -> tuple[Array, Judgement]:
        """Return what the filters tell of each block of a log, (blocks, n, 14), and what follows from it."""
        self._check(log)
        parts: list[Array] = []
        said = new_judgement(len(log) // self.block, len(hypotheses), len(self.conditions))

        def take(_: int, told: Array) -> None:
            parts.append(told)

        run_over(log, self.design(hypotheses), self.rules(hypotheses), said, take, workers)
        return np.concatenate(parts), said

    def _check(self, log: Log) -> None:
        if abs(log.h - self.h) > 1e-6 * self.h:
            raise ValueError(
                f"adhesion bank: got a log with a step of {log.h:.9g} s, expected {self.h:.9g} s; "
                f"make the bank for the step of the log"
            )
        if len(log) < self.block:
            raise ValueError(
                f"adhesion bank: got {len(log)} samples, expected at least {self.block}; "
                f"that is one block of {self.block * self.h:g} s"
            )

    def reset(self, *, torque_known: bool = True) -> None:
        """Forget all samples; `torque_known` chooses the hypotheses of the steps to come."""
        chosen = self.hypotheses(torque_known=torque_known)
        n = len(chosen)
        self._design, self._rules = self.design(chosen), self.rules(chosen)
        self._memory, self._belief = new_memory(n), new_belief(self._rules)
        self._work, self._k = new_work(n), 0

    @property
    def state(self) -> tuple[Memory, Belief]:
        """What `step` keeps besides `samples`: nested tuples of arrays, to be copied or written into."""
        return self._memory, self._belief

    @property
    def told(self) -> Array:
        """What the filters told of the last block that `step` has ended, (n, 14); see `block.py`."""
        return self._work.told

    @property
    def samples(self) -> int:
        """Samples taken since `reset`."""
        return self._k

    @samples.setter
    def samples(self, k: int) -> None:
        self._k = k

    def step(self, z: Array, speed: float, torque: float, said: Judgement, usable: Flags = _BOTH) -> bool:
        """Take one sample after `reset`; see `bank_step`, which a loop in machine code calls itself.

        Parameters
        ----------
        z : (2,) yaw rate and lateral acceleration. speed : m/s. torque : N m, NaN if not known.
        said : `new_judgement` of one row, written when a block ends.
        usable : (2,) which of the two may be used.

        Returns
        -------
        Whether a block has ended.
        """
        k, self._k = self._k, self._k + 1
        return bool(
            bank_step(
                self._design,
                self._rules,
                self._memory,
                self._belief,
                self._work,
                k,
                z,
                usable,
                speed,
                torque,
                said,
            )
        )

    def _result(
        self, log: Log, said: Judgement, verdict: Verdict, hypotheses: Sequence[Hypothesis], stride: int
    ) -> AdhesionIdentification:
        """Return every `stride`-th row."""
        take = slice(stride - 1, None, stride)
        mu_used, mu_max, lower, upper = said.mu[take].T
        return AdhesionIdentification(
            time=log.time[self.block - 1 :: self.block][take],
            p_region=said.p_region[take],
            p_condition=said.p_condition[take],
            p_hypothesis=said.p_hypothesis[take],
            p_none=said.p_none[take],
            mu_used=mu_used,
            mu_max=mu_max,
            mu_max_low=lower,
            mu_max_high=upper,
            identifiable=said.identifiable[take],
            fuzzy=verdict.at(take),
            regions=REGIONS,
            conditions=self.conditions,
            hypotheses=tuple(h.name for h in hypotheses),
        )
