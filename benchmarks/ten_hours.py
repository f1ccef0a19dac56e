"""Ten simulated hours through filters that are hard to keep, to see whether anything diverges.

    python benchmarks/ten_hours.py [--hours N]

A recording of 100 s of the wheelset FMU at P1 (dry rail, 20 m/s) again and again, with a second without
samples at each joint. Four filters look at it: P1 with biases of the sensors; the peak, which has no steady
state (its slope is zero, nothing excites its yaw mode, its covariance moves for ever); one next to the
peak that hardly sees where the wheelset is; and an unstable one. For each hour:

* nis: normalised innovations squared for each measurement, 1 for a filter whose model holds (P1's alone),
* std: the greatest standard deviation of a state over that at the start,
* eig: the smallest eigenvalue of the covariance in units of its own variances; below zero it would be none.

Then the adhesion bank, sample by sample and without any break, through a journey of 100 s again and again:
from standstill to 60 m/s and back, driving and braking on dry, wet, low and very low rail. For each hour:

* trace: the greatest trace of a covariance in units of the variances with which a filter starts, and
  condition: the greatest condition number of its correlations, over the filters that are awake, looked at
  each 100 s, when the wheelset stands,
* nan: how often something was not finite in what filters told or the bank said of a block,
* MiB: the greatest memory of the process,
* awake: filters that do not sleep, and lost: how often a second each of them starts again, on average.
"""

from __future__ import annotations

import argparse
import resource
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from co_sim.wheelset.recordings import Journey, Profile, Recording, Stretch, record
from estimator import ERRI_B176, CreepCurve, Disturbances, LikelihoodBank, SensorBias, coloured_filter
from estimator.adhesion import AdhesionBank
from estimator.adhesion.block import ITSELF, LOOKED, LOST, begin_filter
from estimator.adhesion.block import Memory as AdhesionMemory
from estimator.adhesion.judgement import new_judgement
from estimator.adhesion.motion import STATES
from estimator.adhesion.online import bank_step, new_work
from estimator.likelihood_kernel import Memory, likelihood_run
from estimator.linear_models import operating_points, point_at
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

H, LOOP, GAP = 1e-3, 100.0, 1000


def hard_bank() -> LikelihoodBank:
    """Return the four filters."""
    curve, wheelset = CreepCurve(CONDITIONS["dry"], v=20.0), WheelsetParameters()
    exact = Disturbances(ERRI_B176["erri_low"])
    biased = replace(exact, bias=SensorBias(1e-4, 5e-3, time=600.0))
    first, peak, _ = operating_points(curve)
    near = point_at(curve, "0.999 of the peak", 0.999 * curve.peak_creep)
    beyond = point_at(curve, "1.7 of the peak", 1.7 * curve.peak_creep)
    points = [(first, biased), (peak, exact), (near, exact), (beyond, exact)]
    return LikelihoodBank([coloured_filter(point, wheelset, noise, H) for point, noise in points])


def spread(bank: LikelihoodBank, memory: Memory, i: int) -> tuple[float, float]:
    """Return the greatest relative standard deviation and the smallest scaled eigenvalue of filter `i`."""
    s = len(bank.cells[0][i].F)
    # A filter that has reached its steady state keeps its covariance in the design.
    P = (memory.P if memory.moving[i] else bank.design.P[0])[i, :s, :s]
    scale = np.sqrt(np.diag(P))
    grown = np.max(scale / np.sqrt(bank.design.start[0, i, :s]))
    return float(grown), float(np.linalg.eigvalsh(P / np.outer(scale, scale)).min())


def linear_hours(loops: int, per_hour: int) -> None:
    """Print three lines for each hour of the linear filters."""
    bank = hard_bank()
    curve = CreepCurve(CONDITIONS["dry"], v=20.0)
    said = record(Journey(duration=LOOP, speed=20.0, creep=0.1 * curve.peak_creep))
    z = np.column_stack([said.yaw_rate, said.lateral_acceleration])[1:]
    usable = np.ones(z.shape, dtype=np.bool_)
    usable[:GAP] = False
    cells = np.zeros(len(z), dtype=np.int64)
    memory, work, n = bank.new_memory(), bank.new_work(), len(bank.names)
    history, sums = np.zeros((1, 2 * n + 1)), np.empty((1, 2 * n + 1))
    total = np.zeros(n + 1)
    print(f"{'hour':11}" + "".join(f"{name:>20}" for name in bank.names))
    for loop in range(1, loops + 1):
        likelihood_run(bank.design, memory, work, z, usable, cells, len(z), history, sums)
        total += sums[0, [*range(n), 2 * n]]
        if loop % per_hour == 0:
            std, eig = zip(*(spread(bank, memory, i) for i in range(n)), strict=True)
            for title, values in (("nis", total[:n] / total[n]), ("std", std), ("eig", eig)):
                hour = f"{loop * LOOP / 3600.0:.1f}" if title == "nis" else ""
                print(f"{hour:7}{title:4}" + "".join(f"{value:20.3g}" for value in values), flush=True)
            total[:] = 0.0
    assert np.isfinite(memory.x).all()


def journey() -> Recording:
    """Return 100 s from standstill to 60 m/s and back, over all rails."""
    speed = Profile((2.0, 42.0, 52.0, 97.0), (0.0, 60.0, 60.0, 0.0))
    torque = Profile(
        (0.0, 1.0, 20.0, 22.0, 40.0, 42.0, 52.0, 54.0, 96.0, 98.0),
        (0.0, 8e3, 8e3, 3e3, 3e3, 0.0, 0.0, -1.5e3, -1.5e3, 0.0),
    )
    names = ("dry", "wet", "dry", "low", "dry", "wet", "low", "very_low", "dry")
    since = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 72.0, 80.0)
    rails = tuple(Stretch(t, CONDITIONS[name]) for t, name in zip(since, names, strict=True))
    return record(Journey(duration=LOOP, speed=speed, torque=torque, rails=rails))


def shape(memory: AdhesionMemory, first: NDArray[np.float64]) -> tuple[float, float]:
    """Return the greatest trace and condition number over the filters awake, in the units `first` (n, 12)."""
    traces, conditions = [], []
    for i in np.flatnonzero(memory.voice == np.arange(len(first))):
        C, units = memory.filters.C[i], first[i]
        kept = units > 0.0
        scaled = C[np.ix_(kept, kept)] / np.outer(units[kept], units[kept])
        traces.append(np.trace(scaled))
        own = np.sqrt(np.diag(scaled))
        free = own > 0.0  # without the friction of a filter that has not settled yet
        conditions.append(np.linalg.cond(scaled[np.ix_(free, free)] / np.outer(own[free], own[free])))
    return float(np.max(traces)), float(np.max(conditions))


@njit
def go_on(  # type: ignore[no-untyped-def]
    design, rules, memory, belief, work, since, z, usable, speed, torque, judged, lost, nan
):  # pragma: no cover - compiled
    """Take samples, the first of which has the number `since`; count filters lost and awake, and NaNs."""
    for k in range(z.shape[0]):
        if bank_step(
            design, rules, memory, belief, work, since + k, z[k], usable, speed[k], torque[k], judged
        ):
            for i in range(work.told.shape[0]):
                if work.told[i, LOOKED] == ITSELF:
                    lost[0] += work.told[i, LOST]
                    lost[1] += 1.0
                nan[0] += not np.isfinite(work.told[i]).all()
            nan[0] += not np.isfinite(judged.p_hypothesis).all()
            nan[0] += not np.isfinite(judged.p_region).all()
            nan[0] += not np.isfinite(judged.mu).all()


def adhesion_hours(loops: int, per_hour: int) -> None:
    """Print a line for each hour of the adhesion bank."""
    said, bank = journey(), AdhesionBank(h=H)
    hypotheses = bank.hypotheses()
    n, design, rules = len(hypotheses), bank.design(hypotheses), bank.rules(hypotheses)
    memory, belief = bank.state
    z = np.column_stack([said.yaw_rate, said.lateral_acceleration])[1:]
    speed, torque, usable = said.speed[1:], said.traction_torque[1:], np.ones(2, dtype=np.bool_)
    judged, work = new_judgement(1, n, len(CONDITIONS)), new_work(n)
    for i in range(n):
        begin_filter(design, memory, i, float(speed[-1]), float(torque.max()))
    first = np.sqrt(np.diagonal(memory.filters.C, axis1=1, axis2=2)).copy()
    first[:, STATES.index("s")] = bank.assumed.unknown.friction  # which may move once a filter has settled
    print(f"\n{'hour':7}{'trace':>10}{'condition':>10}{'nan':>10}{'MiB':>10}{'awake':>10}{'lost':>10}")
    trace, condition, lost, nan = 0.0, 0.0, np.zeros(2), np.zeros(1)
    for loop in range(1, loops + 1):
        since = (loop - 1) * len(z)
        go_on(design, rules, memory, belief, work, since, z, usable, speed, torque, judged, lost, nan)
        sizes = shape(memory, first)
        trace, condition = max(trace, sizes[0]), max(condition, sizes[1])
        if loop % per_hour == 0:
            used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            line = f"{loop * LOOP / 3600.0:<7.1f}{trace:10.3g}{condition:10.3g}{nan[0]:10.0f}{used:10.1f}"
            awake = lost[1] / (per_hour * len(z) / bank.block)
            print(line + f"{awake:10.1f}{lost[0] / (per_hour * LOOP * awake):10.2f}", flush=True)
            trace, condition, lost[:], nan[:] = 0.0, 0.0, 0.0, 0.0


def main() -> None:
    """Print what an hour after another does."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--hours", type=float, default=10.0, help="simulated, h")
    parser.add_argument("--bank", choices=("linear", "adhesion"), help="only this one")
    options = parser.parse_args()
    loops = round(options.hours * 3600.0 / LOOP)
    per_hour = min(round(3600.0 / LOOP), loops)
    if options.bank != "adhesion":
        linear_hours(loops, per_hour)
    if options.bank != "linear":
        adhesion_hours(loops, per_hour)


if __name__ == "__main__":
    main()
