"""The adhesion bank: filters for rail conditions, run over a log or sample by sample."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.block import N_TOLD, Design, Memory, end_block, run_filter, take_sample
from estimator.adhesion.creep_law import creep_scale, patch_row, rail_row
from estimator.adhesion.curves import REGIONS, curves_of
from estimator.adhesion.ekf import Filter, Noise, Track
from estimator.adhesion.evidence import Belief, Judgement, Rules, judge
from estimator.adhesion.hypotheses import Hypothesis, with_torque, without_torque
from estimator.adhesion.motion import N_X, Vehicle
from estimator.adhesion.start import Prior
from estimator.sensor_noise import SensorNoise
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset.parameters import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from estimator.log import Log
    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import RailCondition

__all__ = ["AdhesionBank", "AdhesionIdentification"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Length of a block, s: how often evidence is weighed.
BLOCK = 0.01
#: Time over which the speed's rate is found, s.
_RATE_TIME = 0.1
#: Speed below which the creepages are divided by it instead, m/s.
_SLOWEST = 0.5


@dataclass(frozen=True, eq=False)
class AdhesionIdentification:
    """What the adhesion bank said, one row for each `every` s; n rows.

    Parameters
    ----------
    time : (n,) s.
    p_region : (n, 3) probabilities of `regions`: linear, peak, unstable.
    p_condition : (n, c) of `conditions`. Both are given that one of the hypotheses holds.
    p_hypothesis : (n, n_h) of `hypotheses`, and p_none : (n,) of none of them; together 1.
    mu_used : (n,) longitudinal force over the load of both wheels, negative when braking.
    mu_max : (n,) peak adhesion, median; mu_max_low, mu_max_high : its interval that holds 90 %.
    identifiable : (n,) whether the data can tell the condition and the peak adhesion.
    """

    time: Array
    p_region: Array
    p_condition: Array
    p_hypothesis: Array
    p_none: Array
    mu_used: Array
    mu_max: Array
    mu_max_low: Array
    mu_max_high: Array
    identifiable: Flags
    regions: tuple[str, ...]
    conditions: tuple[str, ...]
    hypotheses: tuple[str, ...]


class Work(NamedTuple):
    """Room for a step: (5, 4, 12), (n, 13), (n + 1,), (n, 2)."""

    filter: Array
    told: Array
    log_l: Array
    peaks: Array


@njit(cache=True, nogil=True, error_model="numpy")
def bank_step(  # pragma: no cover - compiled
    design: Design, rules: Rules, memory: Memory, belief: Belief, work: Work, k: int,
    v: float, v_dot: float, torque: float, z: Array, usable: Flags, said: Judgement,
) -> bool:  # fmt: skip
    """Advance all filters by sample `k` = 0, 1, ...; at the end of a block write row 0 of what is said.

    Returns whether a block has ended.
    """
    n = design.held.shape[0]
    for i in range(n):
        take_sample(design, memory, i, k == 0, v, v_dot, torque, z, usable, work.filter)
    if (k + 1) % design.block != 0:
        return False
    for i in range(n):
        end_block(design, memory, i, v, torque, work.told[i])
    judge(rules, belief, (k + 1) // design.block - 1, work.told, v, work.log_l, work.peaks, said, 0)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _judge_all(  # pragma: no cover - compiled
    rules: Rules, belief: Belief, told: Array, v: Array, log_l: Array, peaks: Array, said: Judgement
) -> None:
    for k in range(told.shape[0]):
        judge(rules, belief, k, told[k], v[k], log_l, peaks, said, k)


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
        bias: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        if not (math.isfinite(h) and h > 0.0):
            raise ValueError(f"adhesion bank: got a step of {h!r} s, expected a finite value > 0 s")
        self.wheelset = wheelset or WheelsetParameters()
        self.conditions = dict(conditions)
        self.noise = noise or SensorNoise()
        self.track = track
        self.h = h
        self.window, self.dwell, self.friction, self.bias = window, dwell, friction, bias
        self._hypotheses = None if hypotheses is None else tuple(hypotheses)
        self._curves = curves_of(list(self.conditions.values()), self.wheelset)
        self.block = max(round(BLOCK / h), 1)

    def hypotheses(self, *, torque_known: bool = True) -> tuple[Hypothesis, ...]:
        """Return what is held possible, in the order of the results."""
        if self._hypotheses is not None:
            return self._hypotheses
        return with_torque(self.conditions) if torque_known else without_torque(self.conditions)

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
        design, rules = self.design(hypotheses), self.rules(hypotheses)
        torque = np.full(len(log), np.nan) if log.traction_torque is None else log.traction_torque
        v_dot = _rate(log.speed, self.h)
        speed, z, usable = np.abs(log.speed), log.measurements, cast("Flags", log.usable)
        rows = len(log) // self.block
        told = np.empty((rows, len(hypotheses), N_TOLD))
        memory = new_memory(len(hypotheses))

        def run(i: int) -> None:
            run_filter(design, memory, i, speed, v_dot, torque, z, usable, np.zeros((5, 4, N_X)), told)

        with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
            list(pool.map(run, range(len(hypotheses))))
        said = new_judgement(rows, len(hypotheses), len(self.conditions))
        work = new_work(len(hypotheses))
        at = np.arange(1, rows + 1) * self.block - 1
        _judge_all(rules, self.new_belief(rules), told, speed[at], work.log_l, work.peaks, said)
        return self._result(log.time[at], said, hypotheses, max(round(every / (self.block * self.h)), 1))

    def design(self, hypotheses: Sequence[Hypothesis]) -> Design:
        """Return what the filters read."""
        w, track, noise = self.wheelset, self.track, self.noise
        patch = patch_row(w.patch, w.N)
        rows = {name: rail_row(condition) for name, condition in self.conditions.items()}
        names = list(self.conditions)
        car = Vehicle(
            patch=patch, m=w.m_w, I_z=w.I_w, L_g=w.L_g, cone=w.gamma / w.r0,
            r_L=w.r0 + 0.5 * w.delta_r, r_R=w.r0 - 0.5 * w.delta_r, I_L=w.I_L, I_R=w.I_R,
            k_s=w.k_s, c_s=w.c_s, k_psi=w.k_w - 2.0 * w.N * w.contact_angle * w.L_g, c_psi=w.c_w,
            k_y=w.k_y, c_y=w.c_y, k_rel=2.0 * w.N * w.contact_angle_rate, v_min=_SLOWEST,
        )  # fmt: skip
        decay = 0.1
        return Design(
            car=car,
            track=Track(track.Omega_c, track.Omega_r, math.pi * track.A * track.Omega_c**2),
            noise=Noise(
                R_yaw=noise.yaw_rate**2,
                R_acc=noise.lateral_acceleration**2,
                R_torque=500.0**2,
                W_u=1e-8,
                W_r=1e-8,
                W_torque=4.0,
                s_decay=decay,
                W_s=2.0 * decay * self.friction**2,
                W_bg=1e-3 * self.bias[0] ** 2,
                W_ba=1e-3 * self.bias[1] ** 2,
            ),
            prior=Prior(s=self.friction, b_g=self.bias[0], b_a=self.bias[1]),
            curves=self._curves,
            rails=np.array([[rows[side] for side in h.sides] for h in hypotheses]),
            held=np.array([h.branch == "held" for h in hypotheses]),
            creep=np.array([h.creep for h in hypotheses]),
            W_creep=np.array(
                [0.01 * (h.creep * 6.0 * creep_scale(rows[h.condition], patch)) ** 2 for h in hypotheses]
            ),
            curve=np.array([[names.index(side) for side in h.sides] for h in hypotheses], dtype=np.int64),
            h=self.h,
            block=self.block,
            quiet=np.array([0.05, 1.4]),
        )

    def rules(self, hypotheses: Sequence[Hypothesis]) -> Rules:
        """Return how the evidence is weighed."""
        names = list(self.conditions)
        block = self.block * self.h
        weights = np.array([1.0 if h.branch == "driven" or h.creep <= 1.0 else 0.1 for h in hypotheses])
        none = 0.01
        prior = np.append((1.0 - none) * weights / weights.sum(), none)
        return Rules(
            curves=self._curves,
            prior=prior,
            change=-math.expm1(-block / self.dwell),
            temper=0.7,
            clip=2.0,
            none=2.0,
            window=0 if self.window is None else max(round(self.window / block), 1),
            condition=np.array([names.index(h.condition) for h in hypotheses], dtype=np.int64),
            curve=np.array([[names.index(side) for side in h.sides] for h in hypotheses], dtype=np.int64),
            load=self.wheelset.N * 2.0 * self.wheelset.r0,
            spread=0.03,
            doubt=0.1,
            width=math.log(1.6),
            memory=block / 2.0,
            s_weight=0.0 if self.friction == 0.0 else self.friction**-2,
        )

    def new_belief(self, rules: Rules) -> Belief:
        """Return what is believed before the first block."""
        n = len(rules.prior)
        return Belief(
            rules.prior.copy(), np.zeros((max(rules.window, 1), n)), np.zeros(n), np.zeros((n - 1, n - 1))
        )

    def _result(
        self, time: Array, said: Judgement, hypotheses: Sequence[Hypothesis], stride: int
    ) -> AdhesionIdentification:
        take = slice(stride - 1, None, stride)
        mu = said.mu[take]
        return AdhesionIdentification(
            time[take],
            said.p_region[take],
            said.p_condition[take],
            said.p_hypothesis[take],
            said.p_none[take],
            mu[:, 0],
            mu[:, 1],
            mu[:, 2],
            mu[:, 3],
            said.identifiable[take],
            REGIONS,
            tuple(self.conditions),
            tuple(h.name for h in hypotheses),
        )


def new_memory(n: int) -> Memory:
    """Return the memory of n filters before their start."""
    shapes = ((N_X,), (N_X, N_X), (N_X,), (5,), (5, N_X), (7,))
    return Memory(Filter(*(np.zeros((n, *shape)) for shape in shapes)), np.zeros((n, 8)), np.ones(n))


def new_work(n: int) -> Work:
    """Return room for a step of n filters."""
    return Work(np.zeros((5, 4, N_X)), np.zeros((n, N_TOLD)), np.zeros(n + 1), np.zeros((n, 2)))


def new_judgement(rows: int, n: int, conditions: int) -> Judgement:
    """Return room for what is said in that many rows."""
    return Judgement(
        np.zeros((rows, 3)),
        np.zeros((rows, conditions)),
        np.zeros((rows, n)),
        np.zeros(rows),
        np.zeros((rows, 4)),
        np.zeros(rows, dtype=np.bool_),
    )


def _rate(speed: Array, h: float) -> Array:
    """Return the rate of the speed (T,), causal: what `RateOfSpeed` finds sample by sample."""
    from scipy.signal import lfilter

    share = -math.expm1(-h / _RATE_TIME)
    smooth, _ = lfilter([share], [1.0, share - 1.0], speed, zi=[(1.0 - share) * speed[0]])
    return np.asarray((speed - smooth) / _RATE_TIME)
