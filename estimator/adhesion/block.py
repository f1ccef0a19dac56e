"""A filter of the bank over blocks of samples: what it tells of each, and how it starts again when lost."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.adhesion.curves import landmarks
from estimator.adhesion.ekf import COUNT, LOG_L, SQUARE, Filter, filter_step, parted
from estimator.adhesion.motion import L_L, L_R, N_X, S, Vehicle, Y
from estimator.adhesion.start import start_creep, start_filter

if TYPE_CHECKING:
    from estimator.adhesion.curves import Curves
    from estimator.adhesion.ekf import Noise, Track
    from estimator.adhesion.start import Prior

__all__ = [
    "N_TOLD",
    "Design",
    "Memory",
    "awake",
    "begin_filter",
    "end_block",
    "new_memory",
    "one",
    "run_filter",
    "take_sample",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

#: What a block tells: sums of log-likelihood, squares and number; the last innovations, their variances and
#: the torque; then creep, its variance, friction's logarithm, its variance, whether it was lost, and who has
#: looked at the block.
CREEP, VAR_CREEP, FRICTION, VAR_FRICTION, LOST, LOOKED = range(8, 14)
N_TOLD = 14
#: Nobody, another filter of the same rail, the filter itself.
NOBODY, STAND_IN, ITSELF = 0.0, 1.0, 2.0
#: Blocks from the start of a filter until its friction may move. What a wheelset does in its first tenths
#: of a second, before it runs as it would by itself, looks like little friction, and is believed at once.
_SETTLING = 20
#: Blocks without data after which a filter starts again: its linear covariance no longer means anything.
_SILENCE = 20
#: Normalised squares over which their running mean is taken, and the greatest share of a block in it. It
#: counts squares and not blocks: a few samples are beyond any bound by chance.
_SQUARES, _SHARE = 400.0, 0.05
#: Greatest driving creep that a filter may believe in.
_GREATEST_CREEP = 1.0


class Design(NamedTuple):
    """What the filters of a bank read; n filters.

    `rails` (n, 2, 5), `friction` (n, 2) mean and standard deviation of its logarithm, `held` (n,), `creep`
    (n,) where a held creep starts, `W_creep` (n,), `curve` (n, 2) the places of both rails in `curves`; `h`
    step (s) and `block` its samples; `loud` the bound on the running mean of the normalised squares beyond
    which a filter is lost; `far` the offset from the track beyond which it is, m.
    """

    car: Vehicle
    track: Track
    noise: Noise
    prior: Prior
    curves: Curves
    rails: Array
    friction: Array
    held: Flags
    creep: Array
    W_creep: Array
    curve: Indices
    h: float
    block: int
    loud: float
    far: float


class Memory(NamedTuple):
    """What n filters keep from sample to sample.

    `Filter` in stacks; what they have told of the block so far (n, 8); the running mean of the normalised
    squares of their innovations (n,); for how many blocks there was nothing to measure, and in how many the
    friction may move (n,); which filter speaks for each (n,), itself while it is awake, and how far the
    turn of those that are tried has come (1,), see `renewal.py`; the speed smoothed (1,).
    """

    filters: Filter
    told: Array
    squares: Array
    silence: Indices
    settling: Indices
    voice: Indices
    turn: Indices
    speed: Array


def new_memory(n: int) -> Memory:
    """Return the memory of n filters before their start."""
    shapes = ((N_X,), (N_X, N_X), (N_X,), (5,), (5, N_X), (7,), (1,))
    filters = Filter(*(np.zeros((n, *shape)) for shape in shapes))
    silence, settling = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    voice, turn = np.arange(n), np.zeros(1, dtype=np.int64)
    return Memory(filters, np.zeros((n, 8)), np.ones(n), silence, settling, voice, turn, np.zeros(1))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def awake(memory: Memory, i: int) -> bool:  # pragma: no cover - compiled
    """Return whether filter `i` speaks for itself."""
    return bool(memory.voice[i] == i)


@njit(cache=True, nogil=True, error_model="numpy")
def one(filters: Filter, i: int) -> Filter:  # pragma: no cover - compiled
    """Return filter `i` of the stacks."""
    return Filter(
        filters.x[i],
        filters.C[i],
        filters.x0[i],
        filters.f[i],
        filters.J[i],
        filters.over_track[i],
        filters.torque[i],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def begin_filter(  # pragma: no cover - compiled
    design: Design, memory: Memory, i: int, v: float, torque: float
) -> None:
    """Start filter `i` from its prior."""
    v, s = max(v, design.car.v_min), design.friction[i, 0]
    peak = math.exp(landmarks(design.curves, design.curve[i, 0], v, s)[1])
    peak = min(peak, math.exp(landmarks(design.curves, design.curve[i, 1], v, s)[1]))
    rails = design.rails[i]
    creep = start_creep(design.car, rails, v, torque, peak, design.held[i], design.creep[i], s)
    start_filter(
        design.car,
        design.track,
        design.prior,
        rails,
        design.held[i],
        v,
        torque,
        creep,
        s,
        one(memory.filters, i),
    )
    memory.squares[i] = 1.0
    memory.settling[i] = _SETTLING


@njit(cache=True, nogil=True, error_model="numpy")
def take_sample(  # pragma: no cover - compiled
    design: Design, memory: Memory, i: int, first: bool,
    v: float, v_dot: float, torque: float, z: Array, usable: Flags, work: Array,
) -> None:  # fmt: skip
    """Advance filter `i` by one sample."""
    if first:
        begin_filter(design, memory, i, v, torque)
    filter_step(
        design.car, design.track, design.noise, design.rails[i], design.friction[i], design.held[i],
        design.W_creep[i], first, design.h, v, v_dot, torque,
        z[0] if usable[0] else math.nan, z[1] if usable[1] else math.nan,
        one(memory.filters, i), parted(work), memory.told[i],
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def end_block(  # pragma: no cover - compiled
    design: Design, memory: Memory, i: int, v: float, torque: float, row: Array
) -> None:
    """Write what filter `i` tells of a block to row (14,); start it again if it is lost."""
    told, kept = memory.told[i], one(memory.filters, i)
    x, C = kept.x, kept.C
    for j in range(told.shape[0]):
        row[j] = told[j]
    row[CREEP] = 0.5 * abs(x[L_L] + x[L_R])
    row[VAR_CREEP] = 0.25 * (C[L_L, L_L] + C[L_R, L_R] + 2.0 * C[L_L, L_R])
    row[FRICTION], row[VAR_FRICTION] = x[S], C[S, S]
    silent = told[COUNT] == 0.0
    memory.silence[i] = memory.silence[i] + 1 if silent else 0
    if not silent:
        share = min(told[COUNT] / _SQUARES, _SHARE)
        memory.squares[i] += share * (told[SQUARE] / told[COUNT] - memory.squares[i])
    told[LOG_L], told[SQUARE], told[COUNT] = 0.0, 0.0, 0.0
    sound = math.isfinite(row[LOG_L]) and row[CREEP] < _GREATEST_CREEP
    sound = sound and abs(x[Y]) < design.far
    for j in range(N_X):
        sound = sound and math.isfinite(x[j]) and C[j, j] >= 0.0
    row[LOST], row[LOOKED] = 0.0, ITSELF
    if memory.settling[i] > 0:
        memory.settling[i] -= 1
        if memory.settling[i] == 0:
            C[S, S] += design.friction[i, 1] ** 2
    if memory.silence[i] >= _SILENCE:
        begin_filter(design, memory, i, v, torque)
    elif not sound or memory.squares[i] > design.loud:
        begin_filter(design, memory, i, v, torque)
        row[LOST] = 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def run_filter(  # pragma: no cover - compiled
    design: Design, memory: Memory, i: int,
    v: Array, v_dot: Array, torque: Array, z: Array, usable: Flags, work: Array, rows: Array,
    since: int, until: int,
) -> None:  # fmt: skip
    """Run filter `i` over blocks `since` to before `until` of z (T, 2); writes their rows (blocks, n, 14).

    Arrays are taken apart once: a view costs as much as many a line of the filter.
    """
    kept, room, told = one(memory.filters, i), parted(work), memory.told[i]
    rails, friction, held, W_creep = design.rails[i], design.friction[i], design.held[i], design.W_creep[i]
    if since == 0:
        begin_filter(design, memory, i, v[0], torque[0])
    for k in range(since * design.block, until * design.block):
        filter_step(
            design.car, design.track, design.noise, rails, friction, held, W_creep, k == 0, design.h,
            v[k], v_dot[k], torque[k], z[k, 0] if usable[k, 0] else math.nan,
            z[k, 1] if usable[k, 1] else math.nan, kept, room, told,
        )  # fmt: skip
        if (k + 1) % design.block == 0:
            end_block(design, memory, i, v[k], torque[k], rows[k // design.block - since, i])
