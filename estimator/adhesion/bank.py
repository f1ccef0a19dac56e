"""The adhesion bank: filters for rail conditions, run over a log or sample by sample."""

from __future__ import annotations

import math
import os
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from estimator.adhesion.block import N_TOLD, Design, Memory, new_memory, run_filter
from estimator.adhesion.creep_law import creep_scale, patch_row, rail_row
from estimator.adhesion.curves import REGIONS, curves_of
from estimator.adhesion.ekf import Noise, Track
from estimator.adhesion.evidence import Belief, Judgement, Rules
from estimator.adhesion.fuzzy import FuzzyIdentifier
from estimator.adhesion.hypotheses import (
    FRICTIONS,
    Hypothesis,
    kinds,
    rail_of,
    stand_ins,
    unlike_rails,
    with_torque,
    without_torque,
)
from estimator.adhesion.motion import Vehicle
from estimator.adhesion.online import bank_step, judge_blocks, new_judgement, new_work, rate_of
from estimator.adhesion.renewal import renew, speak_for_the_sleeping
from estimator.adhesion.result import AdhesionIdentification
from estimator.adhesion.start import Prior
from estimator.sensor_noise import SensorNoise
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from estimator.adhesion.fuzzy import Verdict
    from estimator.log import Log
    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import RailCondition

__all__ = ["BIAS", "PATCHES", "AdhesionBank"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Length of a block, s: how often evidence is weighed.
BLOCK = 0.01
#: Standard deviations of the offsets of gyro (rad/s) and accelerometer (m/s2) that are usually expected.
BIAS = (1e-3, 0.05)
#: Sizes of the contact patches over that of the wheelset that are usually held possible.
PATCHES = (0.93, 1.0, 1.07)
#: Time over which friction within a condition changes, s.
_FRICTION_TIME = 1.0
#: Time from one renewal of the hopeless filters to the next, s.
_RENEWAL = 1.0
#: Speed below which the creepages are divided by it instead, m/s.
_SLOWEST = 0.5
#: A wheelset this far from the track is held back by its flanges, m.
_FAR = 0.01
#: What a torque leaves open over load times radius: rms on a held creep, and root of the intensity of the
#: noise on a driving one, s^.5.
_TORQUE_RMS, _TORQUE_NOISE = 6.25e-3, 1.25e-5
#: How much less likely than another condition it is that the patch becomes another one.
_OTHER_PATCH = 1e-3
#: How likely before the data a creep past the peak and a pair of unlike rails are.
_PAST_PEAK, _UNLIKE = 0.1, 0.01
_BOTH = np.ones(2, dtype=np.bool_)


class AdhesionBank:
    """Extended Kalman filters with the nonlinear creep law, one for each hypothesis, and what they say.

    Parameters
    ----------
    wheelset : parameters of the wheelset.
    conditions : rail conditions by name, in the order of the results.
    noise : of the sensors at the step `h`. track : spectrum of the track's alignment.
    h : step of the samples, s.
    hypotheses : what is held possible; None: `with_torque` and, for logs without it, `without_torque`.
    window : length of the moving window of evidence, s; None: recursive evidence, in which another
        hypothesis may take over at any time, once in `dwell` s on average.
    dwell : mean time for which a hypothesis holds, s.
    friction : standard deviation of the friction's logarithm within a condition.
    bias : standard deviations of the offsets of gyro (rad/s) and accelerometer (m/s2); 0: none.
    patches : sizes of the contact patches that are held possible, over that of the wheelset. They take part
        in the usual hypotheses, and last when the condition changes.
    unlike : whether the usual hypotheses have unlike rails under left and right wheel, where the torque is
        known.
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
        friction: float = 0.05,
        bias: tuple[float, float] = BIAS,
        patches: Sequence[float] = PATCHES,
        unlike: bool = True,
    ) -> None:
        if not (math.isfinite(h) and h > 0.0):
            raise ValueError(
                f"adhesion bank: got a step of {h!r} s, expected a finite value > 0 s; use that of the log"
            )
        self.wheelset = wheelset or WheelsetParameters()
        self.conditions = dict(conditions)
        self.noise = noise or SensorNoise()
        self.track = track
        self.h = h
        self.window, self.dwell, self.friction, self.bias = window, dwell, friction, bias
        self._hypotheses = None if hypotheses is None else tuple(hypotheses)
        for side in (side for hypothesis in hypotheses or () for side in hypothesis.sides):
            if side not in self.conditions:
                raise ValueError(
                    f"adhesion bank: got the condition {side!r}, expected one of "
                    f"{', '.join(self.conditions)}; define it among the conditions"
                )
        if len(patches) == 0:
            raise ValueError(
                "adhesion bank: got no sizes of the contact patch, expected at least one; 1 is the usual one"
            )
        self.patches, self.unlike = tuple(patches), unlike
        possible = {*self.hypotheses(), *self.hypotheses(torque_known=False)}
        rails = {(side, h.patch) for h in possible for side in h.sides}
        self._rails = {key: rail_of(self.conditions[key[0]], key[1]) for key in sorted(rails)}
        self._curves = curves_of(list(self._rails.values()), self.wheelset)
        self.block = max(round(BLOCK / h), 1)
        self.reset()

    def hypotheses(self, *, torque_known: bool = True) -> tuple[Hypothesis, ...]:
        """Return what is held possible, in the order of the results."""
        if self._hypotheses is not None:
            return self._hypotheses
        if not torque_known:
            return without_torque(self.conditions, self.patches)
        frictions = FRICTIONS if self.friction > 0.0 else FRICTIONS[:1]
        pairs = unlike_rails(self.conditions) if self.unlike else ()
        return *with_torque(self.conditions, self.patches, frictions), *pairs

    def run(self, log: Log, *, every: float = BLOCK, workers: int | None = None) -> AdhesionIdentification:
        """Identify over a log.

        Parameters
        ----------
        log : the samples; its step must be that of the bank.
        every : time between rows of the result, s; a multiple of the block of 10 ms.
        workers : threads that share the filters; None: as many as there are processors.
        """
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
        hypotheses = self.hypotheses(torque_known=log.traction_torque is not None)
        told, said = self.look_at(log, hypotheses, workers=workers)
        speed = log.speed[self.block - 1 :: self.block]
        verdict = FuzzyIdentifier(self, hypotheses).run(told, speed, said)
        return self._result(log, said, verdict, hypotheses, max(round(every / (self.block * self.h)), 1))

    def look_at(
        self, log: Log, hypotheses: Sequence[Hypothesis], *, workers: int | None = None
    ) -> tuple[Array, Judgement]:
        """Return what the filters tell of each block of a log, (blocks, n, 14), and what follows from it."""
        n, design, rules = len(hypotheses), self.design(hypotheses), self.rules(hypotheses)
        rows = len(log) // self.block
        torque = np.full(len(log), np.nan) if log.traction_torque is None else log.traction_torque
        memory, belief, work = new_memory(n), self.new_belief(rules), new_work(n)
        v_dot = rate_of(log.speed, self.h, memory.speed, True)
        speed, z, usable = np.abs(log.speed), log.measurements, cast("Flags", log.usable)
        at_end = speed[self.block - 1 :: self.block]
        told, said = np.empty((rows, n, N_TOLD)), new_judgement(rows, n, len(self.conditions))
        rooms = [new_work(n).filter for _ in range(n)]
        stride = rules.renewal or rows

        def run(i: int) -> None:
            run_filter(
                design, memory, i, speed, v_dot, torque, z, usable, rooms[i], told, since, until
            )  # fmt: skip

        with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
            for since in range(0, rows, stride):
                until = min(since + stride, rows)
                list(pool.map(run, np.flatnonzero(memory.voice == np.arange(n))))
                speak_for_the_sleeping(design, memory, told[since:until])
                judge_blocks(rules, belief, told, at_end, work, said, since, until)
                if rules.renewal > 0 and until % rules.renewal == 0:
                    last = until * self.block - 1
                    renew(design, memory, belief, speed[last], torque[last])
        return told, said

    def reset(self, *, torque_known: bool = True) -> None:
        """Forget all samples; `torque_known` chooses the hypotheses of the steps to come."""
        chosen = self.hypotheses(torque_known=torque_known)
        n = len(chosen)
        self._design, self._rules = self.design(chosen), self.rules(chosen)
        self._memory, self._belief = new_memory(n), self.new_belief(self._rules)
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

    def design(self, hypotheses: Sequence[Hypothesis]) -> Design:
        """Return what the filters read."""
        w, track, noise = self.wheelset, self.track, self.noise
        patch = patch_row(w.patch, w.N)
        rows = {key: rail_row(rail) for key, rail in self._rails.items()}
        car = Vehicle(
            patch=patch, m=w.m_w, I_z=w.I_w, L_g=w.L_g, cone=w.gamma / w.r0,
            r_L=w.r0 + 0.5 * w.delta_r, r_R=w.r0 - 0.5 * w.delta_r, I_L=w.I_L, I_R=w.I_R,
            k_s=w.k_s, c_s=w.c_s, k_psi=w.k_w - 2.0 * w.N * w.contact_angle * w.L_g, c_psi=w.c_w,
            k_y=w.k_y, c_y=w.c_y, k_rel=2.0 * w.N * w.contact_angle_rate, v_min=_SLOWEST,
        )  # fmt: skip
        load = 2.0 * w.r0 * w.N
        return Design(
            car=car,
            track=Track(track.Omega_c, track.Omega_r, math.pi * track.A * track.Omega_c**2),
            noise=Noise(
                R_yaw=noise.yaw_rate**2,
                R_acc=noise.lateral_acceleration**2,
                R_torque=(_TORQUE_RMS * load) ** 2,
                W_u=1e-8,
                W_r=1e-8,
                W_torque=(_TORQUE_NOISE * load) ** 2,
                s_decay=1.0 / _FRICTION_TIME,
                W_bg=1e-3 * self.bias[0] ** 2,
                W_ba=1e-3 * self.bias[1] ** 2,
            ),
            prior=Prior(b_g=self.bias[0], b_a=self.bias[1]),
            curves=self._curves,
            rails=np.array([[rows[side, h.patch] for side in h.sides] for h in hypotheses]),
            friction=self.friction * np.array([h.friction for h in hypotheses]),
            held=np.array([h.branch == "held" for h in hypotheses]),
            creep=np.array([h.creep for h in hypotheses]),
            W_creep=np.array(
                [
                    0.01 * (h.creep * 6.0 * creep_scale(rows[h.condition, h.patch], patch)) ** 2
                    for h in hypotheses
                ]
            ),
            curve=self._places(hypotheses),
            stand_in=np.array(stand_ins(hypotheses), dtype=np.int64),
            in_turn=_in_turn(hypotheses),
            h=self.h,
            block=self.block,
            loud=1.25,
            far=_FAR,
        )

    def _places(self, hypotheses: Sequence[Hypothesis]) -> NDArray[np.int64]:
        """Return the places (n, 2) of the rails of each hypothesis among the curves."""
        keys = list(self._rails)
        return np.array(
            [[keys.index((side, h.patch)) for side in h.sides] for h in hypotheses], dtype=np.int64
        )

    def rules(self, hypotheses: Sequence[Hypothesis]) -> Rules:
        """Return how the evidence is weighed."""
        names = list(self.conditions)
        block = self.block * self.h
        kind = kinds(hypotheses)
        alike = Counter(kind)
        weights = np.array([_weight(h) / alike[k] for h, k in zip(hypotheses, kind, strict=True)])
        none = 0.01
        prior = np.append((1.0 - none) * weights / weights.sum(), none)
        return Rules(
            curves=self._curves,
            prior=prior,
            change=-math.expm1(-block / self.dwell),
            turn=_turns(hypotheses, prior),
            clip=10.0,
            none=2.0,
            window=0 if self.window is None else max(round(self.window / block), 1),
            condition=np.array([names.index(self._weaker(h)) for h in hypotheses], dtype=np.int64),
            stand_in=np.array(stand_ins(hypotheses), dtype=np.int64),
            curve=self._places(hypotheses),
            load=self.wheelset.N * 2.0 * self.wheelset.r0,
            spread=0.006,
            doubt=0.1,
            width=math.log(1.6),
            memory=block / 2.0,
            # Evidence of one window has no memory: nothing is hopeless.
            renewal=round(_RENEWAL / block) if self.window is None else 0,
        )

    def _weaker(self, hypothesis: Hypothesis) -> str:
        """Return the condition of the rail with the lower peak."""

        def peak(side: str) -> float:
            place = list(self._rails).index((side, hypothesis.patch))
            return float(self._curves.values[place, :, :, 0].mean())

        return min(hypothesis.sides, key=peak)

    def new_belief(self, rules: Rules) -> Belief:
        """Return what is believed before the first block."""
        n = len(rules.prior)
        return Belief(
            rules.prior.copy(),
            np.zeros((max(rules.window, 1), n)),
            np.zeros(n),
            np.zeros((n - 1, n - 1)),
            np.zeros(n - 1),
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
            conditions=tuple(self.conditions),
            hypotheses=tuple(h.name for h in hypotheses),
        )


def _in_turn(hypotheses: Sequence[Hypothesis]) -> NDArray[np.int64]:
    """Return the hypotheses that may sleep, unlike rails and all for which another one stands in.

    By name, so that the order of the conditions does not decide which are tried first.
    """
    chosen = stand_ins(hypotheses)
    may_sleep = [i for i, h in enumerate(hypotheses) if h.unlike or chosen[i] != i]
    return np.array(sorted(may_sleep, key=lambda i: hypotheses[i].name), dtype=np.int64)


def _weight(hypothesis: Hypothesis) -> float:
    """Return how likely a hypothesis is before the data, over one of a driven wheelset on like rails."""
    return _PAST_PEAK if hypothesis.past_peak else _UNLIKE if hypothesis.unlike else 1.0


def _turns(hypotheses: Sequence[Hypothesis], prior: Array) -> Array:
    """Return how likely each hypothesis (column) is to follow each other, (n + 1, n + 1); rows sum to 1.

    A rail changes, a contact patch does not: it lasts, but where it does not show.
    """
    patch = np.array([math.nan if h.past_peak else h.patch for h in hypotheses] + [math.nan])
    other = np.abs(patch[:, None] - patch) > 0.0
    likely = prior * np.where(other, _OTHER_PATCH, 1.0)
    return np.asarray(likely / likely.sum(axis=1, keepdims=True))
