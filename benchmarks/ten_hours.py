"""Ten simulated hours through filters that are hard to keep, to see whether anything diverges.

    python benchmarks/ten_hours.py [--hours N]

A recording of 100 s of the wheelset FMU at P1 (dry rail, 20 m/s) again and again, with a second without
samples at each joint. Four filters look at it: P1 with biases of the sensors; the peak, which has no steady
state (its slope is zero, nothing excites its yaw mode, its covariance moves for ever); one next to the
peak that hardly sees where the wheelset is; and an unstable one. For each hour:

* nis: normalised innovations squared for each measurement, 1 for a filter whose model holds (P1's alone),
* std: the greatest standard deviation of a state over that at the start,
* eig: the smallest eigenvalue of the covariance in units of its own variances; below zero it would be none.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from co_sim.wheelset.recordings import Journey, record
from estimator import ERRI_B176, CreepCurve, Disturbances, LikelihoodBank, SensorBias, coloured_filter
from estimator.likelihood_kernel import Memory, likelihood_run
from estimator.linear_models import operating_points, point_at
from fmu_wheelset import CONDITIONS, WheelsetParameters

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


def main() -> None:
    """Print a line for each hour."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--hours", type=float, default=10.0, help="simulated, h")
    hours = parser.parse_args().hours
    bank = hard_bank()
    curve = CreepCurve(CONDITIONS["dry"], v=20.0)
    said = record(Journey(duration=LOOP, speed=20.0, creep=0.1 * curve.peak_creep))
    z = np.column_stack([said.yaw_rate, said.lateral_acceleration])[1:]
    usable = np.ones(z.shape, dtype=np.bool_)
    usable[:GAP] = False
    cells = np.zeros(len(z), dtype=np.int64)
    memory, work, n = bank.new_memory(), bank.new_work(), len(bank.names)
    history, sums = np.zeros((1, 2 * n + 1)), np.empty((1, 2 * n + 1))
    loops = round(hours * 3600.0 / LOOP)
    per_hour = min(round(3600.0 / LOOP), loops)
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


if __name__ == "__main__":
    main()
