"""What the adhesion bank says where left and right rail differ, on recordings of the plant FMU.

    python benchmarks/unlike_rails.py

Torque driven at half of what the weaker rail gives to both wheels, 7 s each, from 1 s on while the wheelset
is less than 8 mm off the track. *Usual* is the bank as it is, *alike* one that holds no unlike rails
possible: shares of time in which the true pair is the most probable, in which the answer is trusted, and in
which it is trusted while its interval does not hold the mean peak of both wheels.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from estimator import CreepCurve
from estimator.adhesion import AdhesionBank, Hypothesis, Unknowns
from estimator.log import Log
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from co_sim.wheelset.recordings import Recording

SPEEDS = (20.0, 40.0, 60.0)
RAILS = (("dry", "low"), ("low", "dry"), ("dry", "wet"), ("wet", "low"))
USED = 0.5


def drive(left: str, right: str, v: float) -> Recording:
    """Record a drive over two rails."""
    w = WheelsetParameters()
    weaker = min(CreepCurve(CONDITIONS[name], v).peak_adhesion for name in (left, right))
    torque = 2.0 * w.r0 * w.N * USED * weaker
    rails = (Stretch(0.0, CONDITIONS[left], CONDITIONS[right]),)
    return record(
        Journey(duration=7.0, speed=v, torque=Profile((0.0, 0.5), (0.0, torque)), rails=rails, seed=4)
    )


def look(said: Recording, bank: AdhesionBank, true: str) -> tuple[float, float, float]:
    """Return how often the true hypothesis is found, how often trusted, and how often wrongly so."""
    names = ("time", "yaw_rate", "lateral_acceleration", "speed", "traction_torque")
    found = bank.run(Log(**{name: getattr(said, name) for name in names}))
    at = np.searchsorted(said.time, found.time)
    use = (found.time > 1.0) & said.within(8e-3)[at]
    right = np.array(found.hypotheses)[found.p_hypothesis.argmax(axis=1)] == true
    peak = said.peak_adhesion[at]
    outside = (found.mu_max_low > peak) | (peak > found.mu_max_high)
    trusted = found.identifiable
    return float(right[use].mean()), float(trusted[use].mean()), float((trusted & outside)[use].mean())


def main() -> None:
    """Print a line for each pair of rails and speed."""
    usual, alike = AdhesionBank(), AdhesionBank(unknown=Unknowns(unlike_rails=False))
    print("left/right  m/s   usual: right  trusted  wrongly   alike: trusted  wrongly")
    for v, (left, right) in itertools.product(SPEEDS, RAILS):
        said, true = drive(left, right, v), Hypothesis(left, right=right).name
        there, here = look(said, usual, true), look(said, alike, true)
        print(f"{left + '/' + right:10}{v:5.0f}{there[0]:15.2f}{there[1]:9.2f}{there[2]:9.2f}", end="")
        print(f"{here[1]:17.2f}{here[2]:9.2f}")


if __name__ == "__main__":
    main()
