"""Is the region of a known creep curve found within a second? A study on recordings of the wheelset FMU.

    python -m co_sim.wheelset.region_study [--seeds N] [--flange]

Dry rail, a creepage imposed on both wheels, ERRI low track, gyro 1 mrad/s and accelerometer .05 m/s2 rms at
1 kHz. Windows of 1 s, ten in a second, within the time in which the wheelset is less than 8 mm off the
track; or all of them with flange contact. Beside the bank of `estimator.region` stands the paper's: three
filters (P1, P2 and P3, tuned on records of their own), by the smallest residual and by the fuzzy system.

*Exact* knows more than a bank can: its filters are at the very creepages that occur, P1, knee, P2 and 1.7 of
the peak, and nowhere else. What they mistake, the sensors do not tell within a window.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.recordings import Journey, Recording, record
from co_sim.wheelset.scenario import Scenario
from co_sim.wheelset.track import synthesise
from estimator import ERRI_B176, CreepCurve, SensorNoise
from estimator.log import Log
from estimator.region import HYPOTHESES, REGIONS, RegionBank, RegionHypothesis
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from estimator import Identifier

__all__ = ["PLACES", "Counts", "Place", "main", "study"]

SPEEDS = (20.0, 30.0, 40.0, 50.0, 60.0)
LIMIT = 8e-3
#: Length of a journey and of a window, and time between windows, s.
DURATION, WINDOW, STRIDE = 10.0, 1.0, 0.1
H = 1e-3
#: Lateral stiffness of a flange, N/m.
FLANGE = 1e7


@dataclass(frozen=True, slots=True)
class Place:
    """A creepage that is imposed: that of the knee or of the peak, times `multiple`, and its region."""

    name: str
    landmark: str
    multiple: float
    region: str

    def creep(self, curve: CreepCurve) -> float:
        """Return the creepage on a curve."""
        return self.multiple * float(getattr(curve, f"{self.landmark}_creep"))


#: The four of the aim, then what lies near the borders of the regions.
PLACES = (
    Place("P1, 0.1 of the peak", "peak", 0.1, "linear"),
    Place("knee", "knee", 1.0, "peak"),
    Place("P2, the peak", "peak", 1.0, "peak"),
    Place("1.7 of the peak", "peak", 1.7, "unstable"),
    Place("0.75 of the knee", "knee", 0.75, "linear"),
    Place("0.98 of the peak", "peak", 0.98, "peak"),
    Place("1.2 of the peak", "peak", 1.2, "unstable"),
)


#: The first four as hypotheses.
EXACT = tuple(RegionHypothesis(p.name, p.region, float(p.landmark == "peak"), p.multiple) for p in PLACES[:4])


@dataclass(frozen=True, eq=False)
class Counts:
    """Windows by what was said of them: three numbers, in the order of `REGIONS`, for each way to say it."""

    bank: NDArray[np.int64]
    exact: NDArray[np.int64]
    smallest: NDArray[np.int64]
    fuzzy: NDArray[np.int64]

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(getattr(self, name) + getattr(other, name) for name in WAYS))


#: Who answers.
WAYS = tuple(field.name for field in fields(Counts))


def journey(place: Place, curve: CreepCurve, flange: bool, seed: int) -> Journey:
    """Return a journey at a place of the curve that starts in the middle of the track."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    drawn = synthesise(ERRI_B176["erri_low"], curve.v * DURATION, rng)
    track = replace(drawn, offset=drawn.offset - drawn.offset[0])
    wheelset = WheelsetParameters(flange_stiffness=FLANGE if flange else 0.0)
    creep = place.creep(curve)
    return Journey(duration=DURATION, speed=curve.v, creep=creep, track=track, wheelset=wheelset, seed=seed)


def region_bank(curve: CreepCurve, hypotheses: Sequence[RegionHypothesis]) -> RegionBank:
    """Return a bank that knows the plant, its track and its sensors."""
    return RegionBank(
        curve,
        WheelsetParameters(),
        SensorNoise(),
        ERRI_B176["erri_low"],
        H,
        window=WINDOW,
        every=STRIDE,
        hypotheses=hypotheses,
    )


def paper_identifier(v: float) -> Identifier:
    """Return the paper's bank for a speed, tuned on records of its three points."""
    scenario = Scenario.model_validate(
        {"simulation": {"duration": WINDOW}, "drive": {"mode": "prescribed_creep", "speed": v}}
    )
    laboratory = Laboratory(scenario, "paper", Path())
    return laboratory.identifier(laboratory.run().filters)


def look(recording: Recording, banks: tuple[RegionBank, RegionBank], paper: Identifier) -> Counts:
    """Return what all say of the windows of a recording; `banks` are this package's and the exact one."""
    has_flange = recording.journey.wheelset.flange_stiffness > 0.0
    valid = len(recording.time) if has_flange else int(np.sum(recording.within(LIMIT)))
    ends = np.arange(round(WINDOW / H), valid + 1, round(STRIDE / H))
    if len(ends) == 0:
        return Counts(*np.zeros((len(WAYS), 3), dtype=np.int64))
    log = Log(
        time=recording.time[:valid],
        yaw_rate=recording.yaw_rate[:valid],
        lateral_acceleration=recording.lateral_acceleration[:valid],
        speed=recording.speed[:valid],
    )
    said = paper.run(log.measurements)
    rows = (ends - 1) // round(STRIDE / H)
    regions = (bank.run(log).region[rows] for bank in banks)
    answers = (*regions, np.argmin(said.E[ends - 1], axis=1), np.argmax(said.probabilities[ends - 1], axis=1))
    return Counts(*(np.bincount(answer, minlength=3) for answer in answers))


def study(
    speeds: Sequence[float], places: Sequence[Place], seeds: int, *, flange: bool = False
) -> dict[tuple[Place, float], Counts]:
    """Return the counts at each place and speed."""
    found = {}
    for v in speeds:
        curve = CreepCurve(CONDITIONS["dry"], v)
        paper = paper_identifier(v)
        banks = region_bank(curve, HYPOTHESES), region_bank(curve, EXACT)
        for place in places:
            journeys = (journey(place, curve, flange, 1000 + seed) for seed in range(seeds))
            looks = [look(record(j), banks, paper) for j in journeys]
            found[place, v] = sum(looks[1:], start=looks[0])
    return found


def _row(place: Place, v: str, counts: Counts) -> str:
    right = REGIONS.index(place.region)
    total = int(counts.bank.sum())
    if total == 0:
        return f"{place.name:20} {v:>5} {0:8}"
    said = " ".join(f"{n:6}" for n in counts.bank)
    shares = [f"{100.0 * getattr(counts, way)[right] / total:8.1f}" for way in WAYS]
    if place not in PLACES[: len(EXACT)]:
        shares[WAYS.index("exact")] = f"{'-':>8}"
    return f"{place.name:20} {v:>5} {total:8} {said}  {' '.join(shares)}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10, help="journeys at each place and speed")
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS, help="m/s")
    parser.add_argument("--flange", action="store_true", help="flange contact, and windows to the end")
    arguments = parser.parse_args()
    with threadpool_limits(1, user_api="blas"):
        found = study(arguments.speeds, PLACES, arguments.seeds, flange=arguments.flange)
    titles = "".join(f"{title:>9}" for title in ("bank", "exact", "smallest", "fuzzy"))
    print(f"{'':26} {'windows':>8} {'said by the bank':^20}  {'right, %':^35}")
    print(f"{'creepage':20} {'m/s':>5} {'of 1 s':>8} linear   peak unstab {titles}")
    for place in PLACES:
        looks = [found[place, v] for v in arguments.speeds]
        for v, counts in zip(arguments.speeds, looks, strict=True):
            print(_row(place, f"{v:g}", counts))
        print(_row(place, "all", sum(looks[1:], start=looks[0])))


if __name__ == "__main__":
    main()
