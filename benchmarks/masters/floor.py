"""The floor: a loop in C, compiled for the case."""

from __future__ import annotations

import ctypes
import time
from pathlib import Path
from typing import TYPE_CHECKING

import fmpy
import numpy as np

from masters.cases import SOURCES, compile_library
from masters.contender import Contender

if TYPE_CHECKING:
    from masters.cases import Case, Fmu
    from masters.contender import Trajectory

__all__ = ["BareLoop"]


class BareLoop(Contender):
    """A loop in C written for these two FMUs."""

    def __init__(self, case: Case, folder: Path) -> None:
        super().__init__(case, folder)
        header, library = folder / "case.h", folder / "bare_loop.so"
        header.write_text(_header(case), encoding="utf-8")
        compile_library(SOURCES / "bare_loop.c", library, [f'-DCASE="{header}"'])
        self._loop = ctypes.CDLL(str(library))
        self._loop.bare_run.argtypes = [ctypes.c_long, ctypes.c_double]
        self._loop.bare_record.argtypes = [*self._loop.bare_run.argtypes, ctypes.c_void_p, ctypes.c_void_p]
        self._libraries = [
            (Path(fmpy.extract(fmu.path, folder / fmu.name)) / _library(fmu), fmu.guid) for fmu in case.fmus
        ]

    def run(self, n: int, *, record: bool) -> float:
        """Run the C loop."""
        loop = self.opened()
        begin = time.perf_counter()
        if record:
            times, rows = np.empty(n + 1), np.empty((n + 1, len(self.case.signals)))
            failed = loop.bare_record(n, self.case.step, times.ctypes.data, rows.ctypes.data)
        else:
            failed = loop.bare_run(n, self.case.step)
        seconds = time.perf_counter() - begin
        loop.bare_close()
        if failed:
            raise RuntimeError("an FMU refused a call")
        if record:
            self._rows = rows
        return seconds

    def opened(self) -> ctypes.CDLL:
        """Return the loop with both FMUs ready for their first step."""
        loop = self._loop
        for i, (library, guid) in enumerate(self._libraries):
            if loop.bare_open(i, str(library).encode(), guid.encode()):
                raise RuntimeError(f"{library} cannot be opened")
        if loop.bare_start():
            raise RuntimeError("an FMU refused to leave initialisation mode")
        return loop

    def trajectory(self) -> Trajectory:
        """Return the recorded rows after the first."""
        return self._rows[1:]


def _library(fmu: Fmu) -> str:
    return f"binaries/{fmpy.platform}/{fmu.identifier}{fmpy.sharedLibraryExtension}"


def _header(case: Case) -> str:
    """Return the case in C."""
    lines = []
    for fmu, label in zip(case.fmus, "ab", strict=True):
        for kind, letter, references in (("inputs", "U", fmu.inputs), ("outputs", "Y", fmu.outputs)):
            numbers = ", ".join(map(str, references.values()))
            lines.append(f"#define N_{letter}_{label.upper()} {len(references)}")
            lines.append(f"static const fmi2ValueReference {kind}_{label}[] = {{{numbers}}};")
    copies = []
    for source, target in case.connections:
        name, _, variable = target.partition(".")
        i = [fmu.name for fmu in case.fmus].index(name)
        place = list(case.fmus[i].inputs).index(variable)
        copies.append(f"{'ab'[i]}[{place}] = row[{case.signals.index(source)}];")
    lines.append(f"#define EXCHANGE(a, b, row) {' '.join(copies)}")
    return "\n".join(lines) + "\n"
