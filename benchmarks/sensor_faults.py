"""How often good samples are called faulty, and how much of each fault is found.

    python benchmarks/sensor_faults.py

Good samples come from the wheelset FMU on good and bad rail, at rest, slow, fast, past the peak and against
flanges of several stiffnesses. Each fault is put into a ride on dry rail.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.recordings import Journey, Profile, Stretch, record
from estimator.contact import CreepCurve
from estimator.log import Log
from estimator.sensor_faults import BIAS, DROPOUT, OUTLIER, SATURATION, STUCK, SensorMonitor, fault_names
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from co_sim.wheelset.recordings import Recording

    Samples = NDArray[np.float64]

DURATION = 60.0


def rides() -> Iterator[tuple[str, Journey]]:
    """Yield what is ridden over."""
    past = 1.7 * CreepCurve(CONDITIONS["dry"], 40.0).peak_creep
    for name, speed, torque in (
        ("dry", 5.0, 2e3),
        ("dry", 40.0, 5e3),
        ("wet", 100.0, 2e3),
        ("low", 20.0, 3e3),
    ):
        rails = (Stretch(0.0, CONDITIONS[name]),)
        yield (
            f"{name}, {speed:g} m/s",
            Journey(duration=DURATION, speed=speed, torque=torque, rails=rails, seed=11),
        )
    stopping = Profile((0.0, DURATION - 5.0, DURATION), (20.0, 0.05, 0.05))
    yield "braking to rest", Journey(duration=DURATION, speed=stopping, torque=-1e3, seed=12)
    for stiffness, damping in ((1e7, 0.0), (3e7, 1e5), (1e8, 1e5)):
        wheelset = WheelsetParameters(flange_stiffness=stiffness, flange_damping=damping)
        yield (
            f"past the peak, flanges of {stiffness:.0e} N/m",
            Journey(duration=DURATION, speed=40.0, creep=past, wheelset=wheelset, seed=13),
        )


def log_of(recording: Recording, z: Samples | None = None) -> Log:
    """Return the log of a recording, with other samples if given."""
    columns = (recording.yaw_rate, recording.lateral_acceleration) if z is None else (z[:, 0], z[:, 1])
    return Log(
        time=recording.time, yaw_rate=columns[0], lateral_acceleration=columns[1], speed=recording.speed
    )


def false_alarms() -> None:
    """Print how many good samples are called faulty."""
    print(f"{'good samples':42} {'largest m/s2':>12} {'false alarms':>13}  of samples  as")
    for name, journey in rides():
        recording = record(journey)
        faults = SensorMonitor(journey.step).run(log_of(recording))
        kinds = ", ".join(fault_names(int(np.bitwise_or.reduce(faults, axis=None)))) or "-"
        largest = np.abs(recording.lateral_acceleration).max()
        print(f"{name:42} {largest:12.3g} {np.count_nonzero(faults):13} {faults.size:11}  {kinds}")


def injected() -> None:
    """Print how much of each fault is found, how soon, and what else is called faulty."""
    recording = record(Journey(duration=20.0, speed=40.0, torque=5e3, seed=14))
    good = np.column_stack([recording.yaw_rate, recording.lateral_acceleration])
    rms = good.std(axis=0)
    during = slice(10_000, 14_000)
    rng = np.random.default_rng(15)
    spikes = 10_000 + rng.choice(4000, 40, replace=False)

    def clip(z: Samples) -> NDArray[np.bool_]:
        limit = 1.5 * rms
        where = np.abs(z) >= limit
        z[:] = np.clip(z, -limit, limit)
        return where

    def spike(size: float) -> Callable[[Samples], NDArray[np.bool_]]:
        def put(z: Samples) -> NDArray[np.bool_]:
            z[spikes] += size * np.array([1e-3, 0.05]) * rng.choice([-1.0, 1.0], (40, 1))
            return marked(z, spikes)

        return put

    def set_to(value: Samples | float) -> Callable[[Samples], NDArray[np.bool_]]:
        def put(z: Samples) -> NDArray[np.bool_]:
            z[during] = value
            return marked(z, during)

        return put

    def shifted(z: Samples) -> NDArray[np.bool_]:
        z[during] += [0.2, 4.0]
        return marked(z, during)

    kinds: list[tuple[str, int, Callable[[Samples], NDArray[np.bool_]]]] = [
        ("drop-outs (NaN)", DROPOUT, set_to(np.nan)),
        ("outliers of 15 times the noise", OUTLIER, spike(15.0)),
        ("outliers of 30 times the noise", OUTLIER, spike(30.0)),
        ("outliers of 1000 times the noise", OUTLIER, spike(1000.0)),
        ("stuck at the last value", STUCK, set_to(good[during.start])),
        ("saturation at 1.5 rms of the signal", SATURATION, clip),
        ("bias of .2 rad/s or 4 m/s2", BIAS, shifted),
    ]
    print(
        f"\n{'fault put in':36} {'sensor':14} {'found':>7} {'first after':>12} {'others called faulty':>21}"
    )
    for name, bit, put in kinds:
        for c, sensor in enumerate(("gyro", "accelerometer")):
            bad = good.copy()
            where = put(bad)[:, c]
            z = good.copy()
            z[:, c] = bad[:, c]
            faults = SensorMonitor(1e-3).run(log_of(recording, z))
            found = faults[:, c] & bit != 0
            delay = (
                (np.flatnonzero(found & where)[0] - np.flatnonzero(where)[0]) if found[where].any() else -1
            )
            others = np.count_nonzero(faults) - np.count_nonzero(faults[where, c])
            print(f"{name:36} {sensor:14} {found[where].mean():7.1%} {delay:9} ms {others:21}")


def marked(z: Samples, where: slice | NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return a mask of z with `where` set."""
    mask = np.zeros(z.shape, dtype=np.bool_)
    mask[where] = True
    return mask


if __name__ == "__main__":
    false_alarms()
    injected()
