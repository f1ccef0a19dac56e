"""The plant in the forms that fmu_step.py compares."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.sundials import CVode, CVodeReInit, CVodeSolver
from fmpy.sundials.libraries import sundials_nvecserial

import fmu_wheelset
from fmu_wheelset import build, model_description
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

H = 1e-3
STATES = tuple(v.name for v in VARIABLES if v.is_state)
NOMINALS = np.array([v.nominal for v in VARIABLES if v.is_state], dtype=float)
N = len(STATES)


@dataclass(frozen=True)
class Scenario:
    """Motion from 2 mm beside a track that waves by 2 mm at 2 Hz and changes in each step, or is straight."""

    name: str
    drive_mode: DriveMode
    speed: float
    waves: bool = True

    @property
    def start(self) -> dict[str, float]:
        """Start values by name in our FMU."""
        given = {"prescribed_creepage": 2e-3, "traction_torque": 2e3, "lateral_displacement": 2e-3}
        return {"speed": self.speed, **given}

    @cache  # noqa: B019
    def offsets(self, n: int) -> np.ndarray:
        """Return the offset of the track that is held in each of n steps."""
        return 2e-3 * np.sin(4 * np.pi * H * np.arange(n)) if self.waves else np.zeros(n)


def address(function: Any) -> ctypes.c_void_p:
    """Return the address of a C function, as an argument."""
    return ctypes.cast(function, ctypes.c_void_p)


def pointer(values: np.ndarray) -> Any:
    """Return the elements as an argument; the array must stay alive."""
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def compile_loops(folder: Path) -> ctypes.CDLL:
    """Compile fmu_step.c and the C core with the flags of the FMU."""
    (folder / "variables.h").write_text(model_description.c_header(build.present_token()), encoding="utf-8")
    core = ("contact", "elementary", "guiding", "wheelset", "integrator")
    files = [Path(__file__).with_name("fmu_step.c"), *(build.SOURCES / f"{name}.c" for name in core)]
    includes = [f"-I{folder}", f"-I{build.SOURCES}", "-isystem", str(build.fmi_headers())]
    output = folder / "fmu_step.so"
    command = [sys.executable, "-m", "ziglang", "cc", *build.FLAGS, *includes, *map(str, files)]
    subprocess.run([*command, "-lm", "-o", str(output)], check=True)
    return ctypes.CDLL(str(output))


def load(kind: type, archive: Path) -> tuple[Any, dict[str, int]]:
    """Return an instance of an FMU, and its value references by name."""
    description = read_model_description(str(archive))
    fmu = kind(
        guid=description.guid,
        unzipDirectory=extract(str(archive)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="plant",
    )
    fmu.instantiate()
    return fmu, {v.name: v.valueReference for v in description.modelVariables}


class Plant(ABC):
    """One form of the plant, in one scenario."""

    def __init__(self, scenario: Scenario, loops: ctypes.CDLL) -> None:
        self.scenario, self.loops = scenario, loops
        self.step = 0

    @abstractmethod
    def _start(self) -> None: ...

    @abstractmethod
    def _states(self) -> np.ndarray: ...

    @abstractmethod
    def _advance(self, t: float, offsets: np.ndarray) -> None:
        """Advance from `t` by one step for each offset of the track."""

    def start(self) -> None:
        """Go to the start of the scenario."""
        self._start()
        self.step = 0

    def states(self) -> np.ndarray:
        """Return the present states, in the order of our FMU."""
        return self._states()

    def advance(self, n: int) -> None:
        """Advance by n steps."""
        offsets = self.scenario.offsets(self.step + n)[self.step :]
        self._advance(self.step * H, offsets)
        self.step += n

    def trajectory(self, n: int) -> np.ndarray:
        """Return the states after each of n steps from the start."""
        self.start()
        rows = []
        for _ in range(n):
            self.advance(1)
            rows.append(self.states())
        return np.array(rows)

    def _run(self, loop: Any, functions: tuple[Any, ...], t: float, track: int, offsets: np.ndarray) -> None:
        """Run a loop of fmu_step.c."""
        real, given = ctypes.c_double, pointer(offsets) if self.scenario.waves else None
        done = loop(*functions, real(t), real(H), len(offsets), track, given)
        if done != len(offsets):
            raise RuntimeError(f"steps: got a failure after {done}, expected {len(offsets)}")


class WheelsetFmu(Plant):
    """Our FMU, co-simulation."""

    def __init__(self, scenario: Scenario, loops: ctypes.CDLL, kind: type = FMU3Slave) -> None:
        super().__init__(scenario, loops)
        self.fmu, _ = load(kind, fmu_wheelset.path(fmi=3))
        self.instance = ctypes.c_void_p(self.fmu.component)

    def _start(self) -> None:
        start, fmu = self.scenario.start, self.fmu
        fmu.reset()
        fmu.setInt64([REFERENCES["drive_mode"]], [int(self.scenario.drive_mode)])
        fmu.setFloat64([REFERENCES[name] for name in start], list(start.values()))
        fmu.enterInitializationMode(startTime=0.0)
        fmu.exitInitializationMode()

    def _advance(self, t: float, offsets: np.ndarray) -> None:
        functions = address(self.fmu.dll.fmi3DoStep), address(self.fmu.dll.fmi3SetFloat64), self.instance
        self._run(self.loops.steps, functions, t, REFERENCES["track_lateral_offset"], offsets)

    def _states(self) -> np.ndarray:
        return np.array(self.fmu.getFloat64([REFERENCES[name] for name in STATES]))

    def set_offset(self, offset: float) -> None:
        """Set the offset of the track."""
        self.fmu.setFloat64([REFERENCES["track_lateral_offset"]], [offset])

    def evaluate(self, x: np.ndarray, times: int = 1, jacobian: bool = False) -> np.ndarray:
        """Evaluate the right-hand side at each row of states; return the last derivatives."""
        x_dot = np.empty(N)
        self.loops.evaluations(self.instance, pointer(x), len(x), times, int(jacobian), pointer(x_dot))
        return x_dot

    def count(self, n: int) -> np.ndarray:
        """Return how many evaluations without and with Jacobian n steps from the start take."""
        counts = (ctypes.c_long * 2)()
        self.start()
        for offset in self.scenario.offsets(n):
            self.set_offset(float(offset))
            self.loops.count_evaluations(self.instance, ctypes.c_double(H), counts)
            self.advance(1)
        return np.array(counts, dtype=float)


class CVodeFmpy(WheelsetFmu):
    """Our FMU, model exchange with CVode as fmpy calls it: the right-hand side is a callback in Python."""

    def __init__(self, scenario: Scenario, loops: ctypes.CDLL, tolerance: float) -> None:
        super().__init__(scenario, loops, FMU3Model)
        self.tolerance = tolerance
        self.solver: Any = None

    def _start(self) -> None:
        super()._start()
        self.fmu.enterContinuousTimeMode()
        self.solver = self._solver(CVodeSolver)

    def _solver(self, kind: type) -> Any:
        fmu = self.fmu
        return kind(
            nx=N,
            nz=0,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=fmu.getContinuousStateDerivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=fmu.getNominalsOfContinuousStates,
            set_time=fmu.setTime,
            input=None,
            startTime=0.0,
            relativeTolerance=self.tolerance,
            maxNumSteps=100_000,
        )

    def _advance(self, t: float, offsets: np.ndarray) -> None:
        for k, offset in enumerate(offsets):
            if self.scenario.waves:
                self.set_offset(float(offset))
                self.solver.reset(t + k * H)
            self.solver.step(t + k * H, t + (k + 1) * H)

    def _states(self) -> np.ndarray:
        return np.array(self.solver.px[:N])


class _Exchange(ctypes.Structure):
    """`Exchange` of fmu_step.c."""

    _pointers = (
        *("instance", "set_time", "set_states", "get_derivatives", "set_reals"),
        *("data", "cvode", "restart"),
    )
    _fields_ = (*((name, ctypes.c_void_p) for name in _pointers), ("evaluations", ctypes.c_long))


class CVodeC(CVodeFmpy):
    """Our FMU, model exchange with the same CVode, called from C and calling C."""

    def _start(self) -> None:
        super()._start()
        # fmpy makes the callback of `f`, and of a number one to the C function at that address.
        callback = address(self.loops.exchange_derivatives).value
        self.solver = self._solver(type("CSolver", (CVodeSolver,), {"f": callback}))
        dll, exchange = self.fmu.dll, _Exchange.in_dll(self.loops, "exchange")
        exchange.instance, exchange.evaluations = self.instance.value, 0
        for name, function in {
            "set_time": dll.fmi3SetTime,
            "set_states": dll.fmi3SetContinuousStates,
            "get_derivatives": dll.fmi3GetContinuousStateDerivatives,
            "set_reals": dll.fmi3SetFloat64,
            "data": sundials_nvecserial.N_VGetArrayPointer_Serial,
            "cvode": CVode,
            "restart": CVodeReInit,
        }.items():
            setattr(exchange, name, address(function).value)

    def _advance(self, t: float, offsets: np.ndarray) -> None:
        memory = ctypes.c_void_p(self.solver.cvode_mem), self.solver.x
        self._run(self.loops.steps_cvode, memory, t, REFERENCES["track_lateral_offset"], offsets)

    @property
    def evaluations(self) -> int:
        """Evaluations of the right-hand side since the start."""
        return int(_Exchange.in_dll(self.loops, "exchange").evaluations)


class PythonFmu(Plant):
    """python_wheelset.py in an FMU of PythonFMU3, stepped by the loop that steps ours."""

    names = ("y", "psi", "y_dot", "psi_dot", "omega_L", "omega_R", "theta")

    def __init__(self, scenario: Scenario, loops: ctypes.CDLL, substeps: int) -> None:
        from pythonfmu3 import FmuBuilder

        super().__init__(scenario, loops)
        self.substeps = substeps
        with tempfile.TemporaryDirectory() as folder:
            script = Path(__file__).with_name("python_wheelset.py")
            self.fmu, self.references = load(FMU3Slave, FmuBuilder.build_FMU(script, dest=folder))
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def _start(self) -> None:
        start = self.scenario.start
        rolling = self.scenario.speed / fmu_wheelset.WheelsetParameters().r0
        values = dict.fromkeys(self.names, 0.0) | {"omega_L": rolling, "omega_R": rolling}
        values |= {"y": start.pop("lateral_displacement"), **start, "track_lateral_offset": 0.0}
        values |= {"drive_mode": float(self.scenario.drive_mode), "substeps": float(self.substeps)}
        self.fmu.setFloat64([self.references[name] for name in values], list(values.values()))

    def _advance(self, t: float, offsets: np.ndarray) -> None:
        dll, instance = self.fmu.dll, ctypes.c_void_p(self.fmu.component)
        functions = address(dll.fmi3DoStep), address(dll.fmi3SetFloat64), instance
        # Its functions take the lock of the interpreter themselves.
        self._run(self.loops.steps, functions, t, self.references["track_lateral_offset"], offsets)

    def _states(self) -> np.ndarray:
        x = self.fmu.getFloat64([self.references[name] for name in self.names])
        return np.array([*x, self.scenario.speed])
