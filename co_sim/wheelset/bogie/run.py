"""Runs the bogie and writes what came out: `wheelset run bogie`."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.files import whole_file
from co_sim.master import Master
from co_sim.observers import CsvWriter, Recorder
from co_sim.supervisor import Supervised, start_server
from co_sim.wheelset.bogie.assembly import (
    Ride,
    assemble,
    assemble_fmus,
    build_frame,
    build_track,
    require_exporter,
)
from co_sim.wheelset.bogie.choice import choose
from co_sim.wheelset.track import synthesise
from estimator.track_spectrum import ERRI_B176
from fmu_wheelset import path

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from co_sim.observers import Observer
    from co_sim.wheelset.bogie.choice import Choice

__all__ = ["CHECKED", "DURATION", "BogieRun", "prepare"]

#: Length of the run and of those by which the coupling is chosen, s.
DURATION, CHECKED = 10.0, 2.0
#: Speed, m/s.
_SPEED = 20.0
#: Time between two rows of the results, s.
_INTERVAL = 1e-3


@dataclass(frozen=True, slots=True)
class BogieRun:
    """The bogie with the coupling that was chosen for it, ready to run.

    Parameters
    ----------
    frame : the FMU of the frame. ride : what it runs on. seed : of the track. choice : of the coupling.
    in_process : run in this process, without protection, instead of supervised: for debugging.
    """

    frame: Path
    ride: Ride
    seed: int
    choice: Choice
    in_process: bool = False

    def simulate(self, folder: Path, observers: Sequence[Observer] = ()) -> Recorder:
        """Run for `DURATION`, write results.csv on the way and return the same rows.

        Raises
        ------
        RunError
            If a component fails; what was computed is in results.partial.csv.
        """
        every = round(_INTERVAL / self.choice.step)
        recorder = Recorder(every=every)
        writer = CsvWriter(folder / "results.csv", every=every)
        system = assemble(self.frame, self.ride, step=self.choice.step, coupling=self.choice.coupling)
        master_type: type[Master | Supervised] = Master if self.in_process else Supervised
        with master_type(system, observers=[recorder, writer, *observers], stop_time=DURATION) as master:
            master.run(DURATION)
        return recorder

    def write(self, record: Recorder, folder: Path) -> None:
        """Write figures, summary.json and report.html, after `write_system`; earlier files are replaced."""
        from co_sim.diagram.drawing import draw as draw_diagram
        from co_sim.ssp.summary import summarise
        from co_sim.wheelset.bogie.figures import draw
        from co_sim.wheelset.bogie.report import write_report

        figures = folder / "figures"
        figures.mkdir(exist_ok=True)
        system = figures / "bogie_system.png"
        draw_diagram(summarise(folder / "bogie.ssp").pictures, system)
        drawings = [system, *draw(record, figures)]
        with whole_file(folder / "summary.json") as temporary:
            temporary.write_text(json.dumps(self._summary(record), indent=2) + "\n", encoding="utf-8")
        write_report(self, record, drawings, folder / "report.html")

    def write_system(self, folder: Path) -> None:
        """Write bogie.ssp: the same system of FMUs alone, with the step and coupling that were chosen."""
        from co_sim.ssp import write_ssp

        track = build_track(self.ride.track, folder)
        system = assemble_fmus(
            self.frame, track, self.ride, step=self.choice.step, coupling=self.choice.coupling
        )
        write_ssp(system, folder / "bogie.ssp", start_time=0.0, stop_time=DURATION)

    def _summary(self, record: Recorder) -> dict[str, Any]:
        ride = self.ride
        return {
            "seed": self.seed,
            "ride": {"speed": ride.speed, "creepage": ride.creepage, "delay": ride.delay},
            "step": self.choice.step,
            "coupling": asdict(self.choice.coupling),
            "check": {
                "sentence": self.choice.chosen.check.sentence,
                "signals": {
                    signal.name: {"error": signal.error, "unit": signal.unit}
                    for signal in self.choice.chosen.check.signals
                },
            },
            "greatest": {name: float(np.max(np.abs(record[name]))) for name in record.names},
        }


def prepare(folder: Path, seed: int = 1, *, in_process: bool = False) -> BogieRun:
    """Put both FMUs into `folder`, which is made, draw the track and choose the coupling.

    Parameters
    ----------
    folder : for the FMUs. seed : of the track.
    in_process : make all runs in this process, without protection, instead of supervised: for debugging.

    Raises
    ------
    InputError
        If the exporter has no library for this platform, in which case nothing is written, or no coupling is
        good enough.
    """
    require_exporter()
    if not in_process:
        # It gets ready while the FMUs are built.
        start_server(assemble.__module__)
    folder.mkdir(parents=True, exist_ok=True)
    frame = build_frame(folder)
    shutil.copyfile(path(fmi=3), folder / "wheelset.fmu")
    track = synthesise(ERRI_B176["erri_low"], _SPEED * DURATION, np.random.default_rng(seed))
    ride = Ride(track, speed=_SPEED)
    choice = choose(
        lambda step, coupling: assemble(frame, ride, step=step, coupling=coupling),
        duration=CHECKED,
        in_process=in_process,
    )
    return BogieRun(frame, ride, seed, choice, in_process)
