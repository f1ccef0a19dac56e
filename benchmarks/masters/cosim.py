"""libcosim of the Open Simulation Platform, through its Python package libcosimpy."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from masters.contender import Contender

if TYPE_CHECKING:
    from masters.contender import Trajectory

__all__ = ["Libcosim"]


class Libcosim(Contender):
    """Its fixed-step algorithm; FMUs step in threads of its own. Records in memory."""

    def run(self, n: int, *, record: bool) -> float:
        """Make all steps in one call."""
        case = self.case
        log_output_level(CosimLogLevel.ERROR)
        execution = CosimExecution.from_step_size(round(case.step * 1e9))
        index = {
            fmu.name: execution.add_local_slave(CosimLocalSlave(str(fmu.path), fmu.name)) for fmu in case.fmus
        }
        outputs = {f"{f.name}.{name}": (index[f.name], r) for f in case.fmus for name, r in f.outputs.items()}
        inputs = {f"{f.name}.{name}": (index[f.name], r) for f in case.fmus for name, r in f.inputs.items()}
        for source, target in case.connections:
            execution.connect_real_variables(*outputs[source], *inputs[target])
        if record:
            observer = CosimObserver.create_time_series(n + 2)
            execution.add_observer(observer)
            for slave, reference in outputs.values():
                observer.start_time_series(slave, reference, CosimVariableType.REAL)
        begin = time.perf_counter()
        done = execution.step(n)
        seconds = time.perf_counter() - begin
        if not done:
            raise RuntimeError("it refused to step")
        if record:
            series = [observer.time_series_real_samples(*place, 1, n)[2] for place in outputs.values()]
            self._values = np.array(series).T
        return seconds

    def trajectory(self) -> Trajectory:
        """Return the time series."""
        return self._values
