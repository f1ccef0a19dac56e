"""What an adhesion bank takes for granted and what it allows for, and what its filters read of that."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.adhesion.block import Design
from estimator.adhesion.creep_law import creep_scale, patch_row, rail_row
from estimator.adhesion.curves import Curves, curves_of
from estimator.adhesion.ekf import Noise, Track
from estimator.adhesion.evidence import Rules
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
from estimator.adhesion.start import Prior

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from estimator.sensor_noise import SensorNoise
    from estimator.track_spectrum import TrackSpectrum
    from fmu_wheelset.parameters import RailCondition, WheelsetParameters

__all__ = ["BLOCK", "Assumptions", "Unknowns"]

Array = NDArray[np.float64]

#: Length of a block, s: how often evidence is weighed.
BLOCK = 0.01
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


@dataclass(frozen=True)
class Unknowns:
    """What a bank allows for besides the condition.

    Parameters
    ----------
    friction : standard deviation of the friction's logarithm within a condition; 0: known.
    bias : standard deviations of the offsets of gyro (rad/s) and accelerometer (m/s2); 0: none.
    patches : sizes of the contact patches that are held possible, over that of the wheelset. They take part
        in the usual hypotheses, and last when the condition changes.
    unlike_rails : whether the usual hypotheses have unlike rails under left and right wheel, where the
        torque is known.
    vehicle : standard deviation of the peak adhesion's logarithm that errors in the parameters of the
        wheelset leave. The default is for parameters that are known; 0.025 if they are known to 10 %.
    """

    friction: float = 0.05
    bias: tuple[float, float] = (1e-3, 0.05)
    patches: tuple[float, ...] = (0.93, 1.0, 1.07)
    unlike_rails: bool = True
    vehicle: float = 0.006

    def __post_init__(self) -> None:
        for name, value in (("friction", self.friction), *(("bias", value) for value in self.bias)):
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(
                    f"unknowns: got {value!r} as standard deviation of the {name}, expected a finite "
                    f"number >= 0; 0 is what is known"
                )
        if not (math.isfinite(self.vehicle) and self.vehicle > 0.0):
            raise ValueError(
                f"unknowns: got {self.vehicle!r} as what the vehicle leaves open of the peak, expected a "
                f"finite number > 0; {type(self).vehicle} is for one that is known"
            )
        if not self.patches:
            raise ValueError(
                "unknowns: got no sizes of the contact patch, expected at least one; 1 is the usual one"
            )

    @classmethod
    def none(cls, friction: float = 0.0) -> Unknowns:
        """Return those of one who knows all but the condition, and its friction but for a deviation."""
        return cls(friction=friction, bias=(0.0, 0.0), patches=(1.0,), unlike_rails=False)


@dataclass(frozen=True)
class Assumptions:
    """What a bank is told of wheelset, rails, sensors and track, as in `AdhesionBank`."""

    wheelset: WheelsetParameters
    conditions: Mapping[str, RailCondition]
    noise: SensorNoise
    track: TrackSpectrum
    h: float
    hypotheses: tuple[Hypothesis, ...] | None
    window: float | None
    dwell: float
    unknown: Unknowns

    def __post_init__(self) -> None:
        if not (math.isfinite(self.h) and self.h > 0.0):
            raise ValueError(
                f"adhesion bank: got a step of {self.h!r} s, expected a finite value > 0 s; "
                f"use that of the log"
            )
        for name, value in (("dwell", self.dwell), ("window", self.window)):
            if value is not None and not (math.isfinite(value) and value >= BLOCK):
                raise ValueError(
                    f"adhesion bank: got {name} = {value!r} s, expected a finite value of at least a block "
                    f"of {BLOCK:g} s; seconds are usual"
                )
        for side in (side for hypothesis in self.hypotheses or () for side in hypothesis.sides):
            if side not in self.conditions:
                raise ValueError(
                    f"adhesion bank: got the condition {side!r}, expected one of "
                    f"{', '.join(self.conditions)}; define it among the conditions"
                )

    @property
    def block(self) -> int:
        """Samples of a block."""
        return max(round(BLOCK / self.h), 1)

    def held_possible(self, *, torque_known: bool = True) -> tuple[Hypothesis, ...]:
        """Return the hypotheses, in the order of the results."""
        if self.hypotheses is not None:
            return self.hypotheses
        unknown = self.unknown
        if not torque_known:
            return without_torque(self.conditions, unknown.patches)
        frictions = FRICTIONS if unknown.friction > 0.0 else FRICTIONS[:1]
        pairs = unlike_rails(self.conditions) if unknown.unlike_rails else ()
        return *with_torque(self.conditions, unknown.patches, frictions), *pairs

    @cached_property
    def _rails(self) -> dict[tuple[str, float], RailCondition]:
        """The rail of each condition and size of the patch."""
        possible = {*self.held_possible(), *self.held_possible(torque_known=False)}
        keys = sorted({(side, h.patch) for h in possible for side in h.sides})
        return {key: rail_of(self.conditions[key[0]], key[1]) for key in keys}

    @cached_property
    def _curves(self) -> Curves:
        return curves_of(list(self._rails.values()), self.wheelset)

    @property
    def _load(self) -> float:
        """Normal load times radius on both wheels, N m."""
        return 2.0 * self.wheelset.r0 * self.wheelset.N

    def frictions(self, hypotheses: Sequence[Hypothesis]) -> Array:
        """Return mean and standard deviation of the friction's logarithm for each hypothesis, (n, 2)."""
        return self.unknown.friction * np.array([h.friction for h in hypotheses])

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
        return Design(
            car=car,
            track=Track(track.Omega_c, track.Omega_r, math.pi * track.A * track.Omega_c**2),
            noise=Noise(
                R_yaw=noise.yaw_rate**2,
                R_acc=noise.lateral_acceleration**2,
                R_torque=(_TORQUE_RMS * self._load) ** 2,
                W_u=1e-8,
                W_r=1e-8,
                W_torque=(_TORQUE_NOISE * self._load) ** 2,
                s_decay=1.0 / _FRICTION_TIME,
                W_bg=1e-3 * self.unknown.bias[0] ** 2,
                W_ba=1e-3 * self.unknown.bias[1] ** 2,
            ),
            prior=Prior(b_g=self.unknown.bias[0], b_a=self.unknown.bias[1]),
            curves=self._curves,
            rails=np.array([[rows[side, h.patch] for side in h.sides] for h in hypotheses]),
            friction=self.frictions(hypotheses),
            held=np.array([h.branch == "held" for h in hypotheses]),
            creep=np.array([h.creep for h in hypotheses]),
            W_creep=np.array(
                [
                    0.01 * (h.creep * 6.0 * creep_scale(rows[h.condition, h.patch], patch)) ** 2
                    for h in hypotheses
                ]
            ),
            curve=self._places(hypotheses),
            h=self.h,
            block=self.block,
            loud=1.25,
            far=_FAR,
        )

    def _places(self, hypotheses: Sequence[Hypothesis]) -> NDArray[np.int64]:
        """Return the places (n, 2) of the rails of each hypothesis among the curves."""
        return np.array(
            [[self._place(side, h.patch) for side in h.sides] for h in hypotheses], dtype=np.int64
        )

    def _place(self, side: str, patch: float) -> int:
        return list(self._rails).index((side, patch))

    def rules(self, hypotheses: Sequence[Hypothesis]) -> Rules:
        """Return how the evidence is weighed."""
        names, unknown = list(self.conditions), self.unknown
        block = self.block * self.h
        kind = kinds(hypotheses)
        alike = Counter(kind)
        weights = np.array([_weight(h) / alike[k] for h, k in zip(hypotheses, kind, strict=True)])
        none, chosen = 0.01, stand_ins(hypotheses)
        may_sleep = _in_turn(hypotheses, chosen)
        driven = any(h.branch == "driven" for h in hypotheses)
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
            curve=self._places(hypotheses),
            load=self._load,
            # Without the torque filters know the friction no better than their condition does, and each
            # condition has a creep at which it looks like another one.
            spread=unknown.vehicle if driven else math.hypot(unknown.vehicle, unknown.friction),
            doubt=0.1 if driven else 0.01,
            width=math.log(1.6),
            torque_known=driven,
            memory=block / 2.0,
            # Evidence of one window has no memory: nothing is hopeless.
            renewal=round(_RENEWAL / block) if self.window is None else 0,
            stand_in=np.array(chosen, dtype=np.int64),
            always=np.setdiff1d(np.arange(len(hypotheses)), may_sleep),
            in_turn=may_sleep,
        )

    def _weaker(self, hypothesis: Hypothesis) -> str:
        """Return the condition of the rail with the lower peak."""

        def peak(side: str) -> float:
            place = self._place(side, hypothesis.patch)
            return float(self._curves.values[place, :, :, 0].mean())

        return min(hypothesis.sides, key=peak)


def _in_turn(hypotheses: Sequence[Hypothesis], chosen: Sequence[int]) -> NDArray[np.int64]:
    """Return the hypotheses that may sleep, unlike rails and all for which another one stands in.

    By name, so that the order of the conditions does not decide which are tried first.
    """
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
