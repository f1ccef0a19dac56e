"""What the adhesion bank makes of logs that are sampled less often.

    python benchmarks/slow_loggers.py

48 rides of 11 s for each speed on the plant FMU, torque driven at 40, 60, 80 and 95 % of what the rail
gives, friction drawn with 5 %. Every tenth (fifth, ...) sample of a ride is a log at 100 Hz (200 Hz, ...),
with the noise of a sample as it is: nothing is filtered before. From 1 s on while the wheelset is less than
8 mm off the track: share of time in which the condition is right, in which it is trusted, and wrong of these.
"""

from __future__ import annotations

import itertools
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from co_sim.wheelset.identifying.adhesion import refined
from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from estimator import CreepCurve
from estimator.adhesion import AdhesionBank
from estimator.log import Log
from fmu_wheelset import CONDITIONS, WheelsetParameters

RATES = (1000, 500, 200, 100, 50)
NAMES = ("time", "yaw_rate", "lateral_acceleration", "speed", "traction_torque")


def ride(condition: str, v: float, used: float, seed: int) -> Log:
    """Record a ride as far as the wheelset stays on the track."""
    w, friction = WheelsetParameters(), np.exp(0.05 * np.random.default_rng(seed).standard_normal())
    rail = replace(CONDITIONS[condition], mu_0=float(friction * CONDITIONS[condition].mu_0))
    torque = 2.0 * w.r0 * w.N * used * CreepCurve(rail, v).peak_adhesion
    said = record(
        Journey(
            duration=11.0,
            speed=v,
            torque=Profile((0.0, 0.5), (0.0, torque)),
            rails=(Stretch(0.0, rail),),
            seed=seed,
        )
    )
    inside = said.within(8e-3)
    end = len(inside) if inside.all() else int(np.argmin(inside))
    return Log(**{name: getattr(said, name)[:end] for name in NAMES})


def look(case: tuple[str, float, float, int]) -> list[tuple[float, ...]]:
    """Return rows, rows right, trusted, and trusted while wrong, for each rate."""
    log, counts = ride(*case), []
    for rate in RATES:
        fine = refined(Log(**{name: getattr(log, name)[:: RATES[0] // rate] for name in NAMES}))
        found = AdhesionBank(h=fine.h).run(fine, workers=1)
        late = found.time > 1.0
        right = found.p_condition[late].argmax(axis=1) == list(CONDITIONS).index(case[0])
        trusted = found.identifiable[late]
        counts.append((right.size, right.sum(), trusted.sum(), (trusted & ~right).sum()))
    return counts


def main() -> None:
    """Print a line for each speed and rate."""
    print("m/s    Hz     right   trusted   wrong of these")
    for v in (20.0, 40.0):
        cases = [
            (condition, v, used, seed)
            for seed, (condition, used, _) in enumerate(
                itertools.product(CONDITIONS, (0.4, 0.6, 0.8, 0.95), range(3))
            )
        ]
        with ProcessPoolExecutor(os.cpu_count()) as pool:
            sums = np.sum(list(pool.map(look, cases)), axis=0)
        for rate, (rows, right, trusted, wrong) in zip(RATES, sums, strict=True):
            shares = f"{right / rows:9.3f} {trusted / rows:9.3f} {wrong / max(trusted, 1):16.4f}"
            print(f"{v:3.0f} {rate:5d} {shares}", flush=True)


if __name__ == "__main__":
    main()
