"""The fuzzy identifier on the residuals of the adhesion bank, beside the evidence on the same filters.

    python benchmarks/fuzzy_residuals.py [--seeds 1]

Recordings of the plant FMU of 9 s at 1 kHz (ERRI low, gyro 1 mrad/s, accelerometer 0.05 m/s2 rms): four
rails at 20, 40 and 60 m/s, torque driven with 40, 60, 80 and 95 % of the peak adhesion, and with a creep of
1.7 times that of the peak and the torque that goes with it. Counted is what both say of each 10 ms after the
first second, with 1 s of evidence and 1 s of residuals, while the wheelset is less than 8 mm off the track.
"""

from __future__ import annotations

import argparse
import itertools
import time
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.recordings import Journey, Stretch, record
from estimator import CreepCurve
from estimator.adhesion import REGIONS, AdhesionBank, FuzzyIdentifier
from estimator.adhesion.curves import PAST_PEAK
from estimator.advice import LEVELS, advise
from estimator.log import Log
from fmu_wheelset.parameters import CONDITIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from co_sim.wheelset.recordings import Recording

SPEEDS = (20.0, 40.0, 60.0)
UTILISATIONS = (0.4, 0.6, 0.8, 0.95)
PAST = 1.7
DURATION, WINDOW, NEAR = 9.0, 1.0, 8e-3
RADIUS = 0.5


def drive(condition: str, speed: float, load: float, seed: int) -> tuple[Recording, Log]:
    """Record a journey with this utilisation, or past the peak where it is greater than one."""
    rail = CONDITIONS[condition]
    curve = CreepCurve(rail, speed)
    force = 2.0 * curve.N * load * curve.peak_adhesion
    rails = (Stretch(0.0, rail),)
    if load < 1.0:
        creep = curve.creep_at(load * curve.peak_adhesion)
        journey = Journey(
            duration=DURATION, speed=speed, torque=RADIUS * force, initial_creep=creep, rails=rails, seed=seed
        )
    else:
        journey = Journey(
            duration=DURATION, speed=speed, creep=load * curve.peak_creep, rails=rails, seed=seed
        )
    recording = record(journey)
    torque = recording.traction_torque
    if load > 1.0:
        used = recording.truth["left.creep_force_x"] + recording.truth["right.creep_force_x"]
        torque = np.full_like(used, RADIUS * np.abs(used).mean())
    log = Log(
        time=recording.time,
        yaw_rate=recording.yaw_rate,
        lateral_acceleration=recording.lateral_acceleration,
        speed=recording.speed,
        traction_torque=torque,
    )
    return recording, log


def score(recording: Recording, log: Log, bank: AdhesionBank, condition: str) -> NDArray[np.float64]:
    """Return counts of rows by evidence and by the fuzzy identifier, (2, 6)."""
    hypotheses = bank.hypotheses()
    told, said = bank.look_at(log, hypotheses)
    ends = slice(bank.block - 1, None, bank.block)
    fuzzy = FuzzyIdentifier(bank, hypotheses, window=WINDOW).run(told, log.speed[ends], said)
    curve = CreepCurve(CONDITIONS[condition], float(log.speed[0]))
    borders = (curve.knee_creep, PAST_PEAK * curve.peak_creep)
    creep = recording.creep[: len(told) * bank.block].reshape(len(told), bank.block).mean(axis=1)
    region = np.searchsorted(borders, np.abs(creep))
    counted = recording.within(NEAR)[ends][: len(told)].copy()
    counted[: round(WINDOW / (bank.block * bank.h))] = False
    own, unstable = list(CONDITIONS).index(condition), region == REGIONS.index("unstable")
    rows = []
    evidence = advise(said.p_region, said.identifiable, said.mu[:, 0], said.mu[:, 2])
    for p_condition, p_region, advice in (
        (said.p_condition, said.p_region, evidence.score),
        (fuzzy.condition, fuzzy.region, fuzzy.score),
    ):
        advised, unsafe = np.isfinite(advice), unstable & (advice >= LEVELS["hold torque"])
        right = p_condition.argmax(axis=1) == own
        found = p_region.argmax(axis=1)
        rows.append(
            [
                np.sum(which & counted)
                for which in (
                    counted,
                    right,
                    found == region,
                    advised,
                    advised & ~right,
                    unsafe,
                )
            ]
        )
    return np.array(rows, dtype=np.float64)


def line(name: str, counts: NDArray[np.float64]) -> str:
    """Return the number of rows, and shares of them by evidence and by the fuzzy identifier."""
    cells = []
    for rows, right, region, advised, wrong, unsafe in counts:
        shares = (right / rows, region / rows, advised / rows, wrong / max(advised, 1.0), unsafe / rows)
        cells.append("".join(f"{share:8.3f}" for share in shares))
    return f"{name:16s}{counts[0, 0]:7.0f} {cells[0]}   {cells[1]}"


def main() -> None:
    """Print a line for each rail and speed, and one for each way of driving."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    seeds = range(parser.parse_args().seeds)
    bank, loads = AdhesionBank(window=WINDOW), (*UTILISATIONS, PAST)
    print("shares of rows: condition right; region right; advised; condition wrong of these;")
    print("told to hold or raise the torque past the peak")
    print(f"{'':16s}{'rows':>7s} {'evidence':>40s}   {'fuzzy identifier':>40s}")
    by_load = dict.fromkeys(loads, np.zeros((2, 6)))
    for condition, speed in itertools.product(CONDITIONS, SPEEDS):
        total = np.zeros((2, 6))
        for load, seed in itertools.product(loads, seeds):
            counts = score(*drive(condition, speed, load, seed + 1), bank, condition)
            by_load[load] = by_load[load] + counts
            if load < 1.0:
                total += counts
        print(line(f"{condition} {speed:.0f} m/s", total), flush=True)
    for load, counts in by_load.items():
        print(line(f"{load:.0%} of peak" if load < 1.0 else f"{load:g} x peak creep", counts))
    print(line("all below peak", sum(by_load[load] for load in UTILISATIONS)))


if __name__ == "__main__":
    started = time.process_time()
    main()
    print(f"{time.process_time() - started:.0f} s of processor time")
