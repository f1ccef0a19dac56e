"""Ecos, through its Python package ecospy."""

from __future__ import annotations

import csv
import ctypes
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from masters.contender import Contender

if TYPE_CHECKING:
    from masters.contender import Trajectory

__all__ = ["Ecos"]

# Its library needs that of TBB, which a wheel of its own puts where the system does not look.
_TBB = Path(sys.prefix) / "lib" / "libtbb.so.12"
if _TBB.exists():
    ctypes.CDLL(str(_TBB), mode=ctypes.RTLD_GLOBAL)
import ecospy  # noqa: E402


class Ecos(Contender):
    """Its fixed-step algorithm; it records into a CSV file only."""

    def run(self, n: int, *, record: bool) -> float:
        """Make all steps in one call."""
        case, signals = self.case, [signal.replace(".", "::") for signal in self.case.signals]
        with ecospy.EcosSimulationStructure() as structure:
            for fmu in case.fmus:
                structure.add_model(fmu.name, fmu.path)
            for source, target in case.connections:
                structure.make_real_connection(source.replace(".", "::"), target.replace(".", "::"))
            with ecospy.EcosSimulation(structure=structure, step_size=case.step) as simulation:
                if record:
                    self._file = self.folder / "result.csv"
                    simulation.add_csv_writer(str(self._file), identifiers=signals)
                simulation.init()
                begin = time.perf_counter()
                simulation.step(n)
                seconds = time.perf_counter() - begin
                simulation.terminate()
        return seconds

    def trajectory(self) -> Trajectory:
        """Read the file; its rows without time and number of the step."""
        with self._file.open(encoding="utf-8", newline="") as file:
            titles, *rows = csv.reader(file, skipinitialspace=True)
        places = [_place(titles, signal) for signal in self.case.signals]
        return np.array([[float(row[i]) for i in places] for row in rows[1:]])


def _place(titles: list[str], signal: str) -> int:
    """Return the column of a signal; titles have the type of the variable behind its name."""
    name = signal.replace(".", "::")
    return next(i for i, title in enumerate(titles) if title.partition("[")[0] == name)
