"""What each part of `wheelset identify` costs on a log of a million samples.

    python benchmarks/identify_log.py [--without-adhesion]

The log is a ride of 20 s on dry rail, repeated. Every part is run once before it is timed, so that compiling
does not count. "x real time" is the time of the log over that of the part. Processor time is that of all
threads together: what one core would need, and the same while other programs share the machine.
"""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from co_sim.wheelset.identifying.grid import on_grid
from co_sim.wheelset.identifying.log_csv import write_log
from co_sim.wheelset.identifying.log_file import read_columns
from co_sim.wheelset.identifying.pipeline import Stages, identify, write
from co_sim.wheelset.identifying.results import Settings
from co_sim.wheelset.recordings import Journey, record
from co_sim.wheelset.vehicle_file import Vehicle
from estimator import (
    CreepCurve,
    FilterBank,
    Identifier,
    NoiseModel,
    design_filter,
    filter_model,
    identification_system,
)
from estimator.linear_models import point_at
from estimator.masked import identify_rows
from estimator.sensor_faults import SensorMonitor
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SAMPLES = 1_000_000
REPEATS = 3
NAMES = ("yaw_rate", "lateral_acceleration", "speed", "traction_torque")


class BothStages(Stages):
    """Processor time of each stage as well."""

    def __init__(self) -> None:
        super().__init__()
        self.processor: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure a block of work."""
        begin = time.process_time()
        with super().stage(name):
            yield
        self.processor[name] = time.process_time() - begin


def best(action: Callable[[], object]) -> tuple[float, float]:
    """Return the shortest of a few wall times and processor times, s."""
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter(), time.process_time()
        action()
        times.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    wall, processor = zip(*times, strict=True)
    return min(wall), min(processor)


def linear_bank(n: int) -> Identifier:
    """Return n linear filters along the dry curve."""
    curve = CreepCurve(CONDITIONS["dry"], 30.0)
    noise = NoiseModel(1e-5, 1e-4, 0.75, (1e-3, 0.05))
    filters = [
        design_filter(
            filter_model(point_at(curve, f"{i}", share * curve.peak_creep), WheelsetParameters()),
            noise.W,
            noise.R,
            1e-3,
            name=f"{i}",
        )
        for i, share in enumerate(np.linspace(0.1, 0.9, n))
    ]
    return Identifier(FilterBank(filters), identification_system(n), window=1000, weights=np.ones(2))


def main() -> None:
    """Print one line for each part."""
    recording = record(Journey(duration=20.0, speed=30.0, torque=4e3))
    columns = {name: np.resize(getattr(recording, name)[:20_000], SAMPLES) for name in NAMES}
    columns = {"time": 1e-3 * np.arange(SAMPLES)} | columns
    settings = Settings(
        bank="adhesion",
        every=0.01,
        noise=(1e-3, 0.05),
        track="erri_low",
        vehicle=Vehicle(),
        full_scale=(np.inf, np.inf),
        bias_limit=(0.05, 1.0),
    )

    def tell(part: str, times: tuple[float, float]) -> None:
        wall, processor = times
        real = SAMPLES * 1e-3 / wall
        print(f"{part:46} {wall:6.2f} s, processor {processor:6.2f} s {real:8.0f} x real time", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        write_log(path, columns)
        tell(
            f"reading CSV of {path.stat().st_size / 1e6:.0f} MB", best(lambda: read_columns(path, renamed={}))
        )
        read = read_columns(path, renamed={})
        tell("bringing it onto a uniform grid", best(lambda: on_grid("log", read)))
        log = on_grid("log", read).log
        monitor = SensorMonitor(log.h)
        tell("looking for faults of the sensors", best(lambda: monitor.run(log)))
        rows = np.arange(9, SAMPLES, 10)
        for n in (3, 12, 48):
            action = partial(identify_rows, linear_bank(n), log, rows)
            action()
            tell(f"{n} linear filters, (15), fuzzy system", best(action))
        if "--without-adhesion" in sys.argv:
            return
        short = replace(settings, bank="adhesion")
        write_log(Path(folder) / "short.csv", {name: values[:5000] for name, values in columns.items()})
        identify(Path(folder) / "short.csv", short, Stages())
        stages = BothStages()
        write(identify(path, settings, stages), Path(folder) / "out", stages)
        for stage, seconds in stages.seconds.items():
            tell(f"wheelset identify, adhesion bank: {stage}", (seconds, stages.processor[stage]))


if __name__ == "__main__":
    main()
