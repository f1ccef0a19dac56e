"""The plant in three forms: its FMUs, its C core through ctypes, and its equations again in Python."""

from __future__ import annotations

import cmath
import ctypes
import math
import re
import subprocess
import sys
from dataclasses import dataclass, field, fields
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Model, FMU3Slave
from hypothesis import settings

from fmu_wheelset import ContactPatch, RailCondition, WheelsetParameters, build
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from fmpy.model_description import ModelDescription

settings.register_profile("laws", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("laws")

# FMUs ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def archives(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """FMUs of the present sources, by FMI version."""
    fmi2, fmi3 = build.build(tmp_path_factory.mktemp("archives"))
    return {2: fmi2, 3: fmi3}


@pytest.fixture(scope="session")
def fmi_functions() -> set[str]:
    """Names of all functions that the headers of both standards declare."""
    found = {
        name
        for version in (2, 3)
        for name in re.findall(
            rf"^\s*FMI{version}_Export\s+\w+\s+(fmi{version}\w+);",
            (build.fmi_headers() / f"fmi{version}Functions.h").read_text(),
            re.MULTILINE,
        )
    }
    assert len(found) == 44 + 75
    return found


class Plant:
    """An instance of the FMU with variables by name, the same for both standards."""

    states = tuple(v.name for v in VARIABLES if v.is_state)

    def __init__(
        self, folder: Path, description: ModelDescription, exchange: bool = False, **start: float
    ) -> None:
        self.fmi = int(description.fmiVersion[0])
        self.messages: list[str] = []
        kinds = (FMU2Model, FMU3Model) if exchange else (FMU2Slave, FMU3Slave)
        self.slave = kinds[self.fmi - 2](
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="plant",
        )
        if self.fmi == 2:
            self._callbacks = fmi2CallbackFunctions()
            self._callbacks.logger = fmi2CallbackLoggerTYPE(
                lambda _e, _n, _s, _c, message: self.messages.append(message.decode())
            )
            self.slave.instantiate(callbacks=self._callbacks)
        else:
            self.slave.instantiate(
                logMessage=lambda _e, _s, _c, message: self.messages.append(message.decode())
            )
        self.set(**start)

    def set(self, **values: float) -> None:
        for name, value in values.items():
            self.set_named(name, value)

    def set_named(self, name: str, value: float) -> None:
        reference = [REFERENCES[name]]
        kind = VARIABLES[REFERENCES[name]].kind
        fmi2, s = self.fmi == 2, self.slave
        if kind == "Float64":
            (s.setReal if fmi2 else s.setFloat64)(reference, [value])
        elif kind == "Boolean":
            s.setBoolean(reference, [bool(value)])
        else:
            (s.setInteger if fmi2 else s.setInt64)(reference, [int(value)])

    def rail(self, condition: RailCondition, *sides: str) -> Plant:
        for side in sides or ("left", "right"):
            for f in fields(condition):
                self.set_named(f"rail_{side}.{f.name}", getattr(condition, f.name))
        return self

    def get(self, *names: str) -> list[float]:
        read = self.slave.getReal if self.fmi == 2 else self.slave.getFloat64
        return list(read([REFERENCES[name] for name in names]))

    def initialise(self, t0: float = 0.0, **arguments: float) -> Plant:
        if self.fmi == 2:
            self.slave.setupExperiment(startTime=t0, **arguments)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=t0, **arguments)
        self.slave.exitInitializationMode()
        return self

    def derivatives(
        self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]
    ) -> np.ndarray:
        """Directional derivatives of the unknowns along the seed of the knowns."""
        references = [REFERENCES[name] for name in unknowns], [REFERENCES[name] for name in knowns]
        return np.array(self.slave.getDirectionalDerivative(*references, list(seed)))

    def jacobian(self, unknowns: Sequence[str], knowns: Sequence[str]) -> np.ndarray:
        """Derivatives of the unknowns, in rows, with respect to the knowns."""
        return np.column_stack([self.derivatives(unknowns, knowns, seed) for seed in np.eye(len(knowns))])

    def step(self, t: float, h: float) -> None:
        self.slave.doStep(t, h)

    def run(self, steps: int, *names: str, h: float = 1e-3) -> np.ndarray:
        """Rows of the named variables (default: the states) at the start and after each step."""
        names = names or self.states
        rows = [self.get(*names)]
        for k in range(steps):
            self.step(k * h, h)
            rows.append(self.get(*names))
        return np.array(rows)


@pytest.fixture(scope="session")
def extracted(
    archives: dict[int, Path], tmp_path_factory: pytest.TempPathFactory
) -> dict[int, tuple[Path, ModelDescription]]:
    found = {}
    for fmi, archive in archives.items():
        folder = tmp_path_factory.mktemp(f"fmi{fmi}")
        extract(str(archive), str(folder))
        found[fmi] = (folder, read_model_description(str(folder)))
    return found


@pytest.fixture
def plant(extracted: dict[int, tuple[Path, ModelDescription]]) -> Iterator[Callable[..., Plant]]:
    """Make instances: ``plant(speed=20.0, fmi=3, exchange=False)``; they are freed after the test."""
    made: list[Plant] = []

    def make(fmi: int = 3, exchange: bool = False, **start: float) -> Plant:
        made.append(Plant(*extracted[fmi], exchange, **start))
        return made[-1]

    yield make
    for one in made:
        one.slave.freeInstance()


# C core ----------------------------------------------------------------------------------------------


def _struct(name: str, **members: Any) -> type[ctypes.Structure]:
    return type(name, (ctypes.Structure,), {"_fields_": list(members.items())})


def _doubles(*names: str) -> dict[str, Any]:
    return dict.fromkeys(names, ctypes.c_double)


_real = ctypes.c_double
C_Patch = _struct("ContactPatch", **_doubles(*(f.name for f in fields(ContactPatch))))
C_Rail = _struct("RailCondition", **_doubles(*(f.name for f in fields(RailCondition))))
C_State = _struct("ContactState", **_doubles("creepage_x", "creepage_y", "speed", "normal_load"), rail=C_Rail)
C_Contact = _struct(
    "Contact",
    **_doubles("force_x", "force_y", "creep", "secant", "tangent"),
    jacobian=_real * 2 * 2,
    **_doubles("secant_by_speed", "secant_by_load"),
    secant_by_rail=C_Rail,
)
C_Peak = _struct("ContactPeak", **_doubles("creep_peak", "adhesion_peak"))
C_Parameters = _struct(
    "Parameters",
    **_doubles("m_w", "I_w", "r0", "gamma", "L_g", "k_w", "I_L", "I_R", "k_s", "c_s", "M_v"),
    **_doubles("delta_r", "k_y", "c_y", "c_w", "contact_angle", "contact_angle_rate"),
    **_doubles("flange_stiffness", "flange_clearance", "flange_transition", "flange_damping", "g"),
    patch=C_Patch,
    **_doubles("v0", "initial_creepage"),
    drive_mode=ctypes.c_int32,
    forward_dynamics=ctypes.c_int32,
)
C_WheelInputs = _struct("WheelInputs", normal_load=_real, rail=C_Rail)
AXLE_INPUTS = (
    *("speed", "prescribed_creepage", "traction_torque", "suspension_lateral_force"),
    *("suspension_yaw_moment", "curve_force", "curvature", "cant"),
    *("running_resistance", "track_lateral_offset"),
)
C_Inputs = _struct("Inputs", **_doubles(*AXLE_INPUTS), wheel=C_WheelInputs * 2)
C_Wheelset = _struct("Wheelset", p=C_Parameters, u=C_Inputs, x=_real * 8)
C_Flange = _struct("Flange", **_doubles("force", "by_y", "by_y_dot"))
C_Evaluation = _struct(
    "Evaluation",
    **_doubles("v", "v_r", "v_r_slope"),
    driving=_real * 2,
    **_doubles("guidance", "axle_torque"),
    flange=C_Flange,
    **_doubles("guiding_force", "guiding_moment"),
    at=C_State * 2,
    contact=C_Contact * 2,
    x_dot=_real * 8,
)
WHEEL_OUTPUTS = (
    *("wheel_speed", "creepage_x", "creepage_y", "creep_force_x", "creep_force_y"),
    *("adhesion_used", "g11", "g22"),
)
C_WheelOutputs = _struct("WheelOutputs", **_doubles(*WHEEL_OUTPUTS))
AXLE_OUTPUTS = ("forward_speed", "relative_displacement", "axle_torque", "adhesion_used", "flange_force")
C_Outputs = _struct("Outputs", **_doubles(*AXLE_OUTPUTS), wheel=C_WheelOutputs * 2)

Evaluate = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.POINTER(_real), ctypes.POINTER(_real), ctypes.POINTER(_real)
)
C_System = _struct(
    "OdeSystem",
    model=ctypes.c_void_p,
    evaluate=Evaluate,
    n_states=ctypes.c_int,
    n_moving=ctypes.c_int,
    moving=ctypes.c_int * 8,
    tolerance=_real,
    nominal=_real * 8,
)


def _flat(struct: ctypes.Structure) -> np.ndarray:
    """Copy of a struct that holds doubles only."""
    return np.frombuffer(bytes(struct), dtype=np.float64).copy()


def _filled(kind: type[ctypes.Structure], values: np.ndarray) -> ctypes.Structure:
    return kind.from_buffer_copy(np.ascontiguousarray(values, dtype=np.float64).tobytes())


def compile_c(output: Path, *arguments: str, compiler: tuple[str, ...] = ()) -> Path:
    """Compile C with the compiler of the build, or another one."""
    compiler = compiler or (sys.executable, "-m", "ziglang", "cc")
    command = [*compiler, "-std=c99", "-ffp-contract=off", f"-I{build.SOURCES}", *arguments]
    done = subprocess.run([*command, "-lm", "-o", str(output)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return output


@pytest.fixture(scope="session")
def compiler() -> Callable[..., Path]:
    return compile_c


@pytest.fixture(scope="session")
def core(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """The C core as a library with structs; ``core.flat`` and ``core.filled`` convert them to arrays."""
    names = ("contact", "elementary", "guiding", "wheelset", "integrator")
    files = [str(build.SOURCES / f"{name}.c") for name in names]
    path = compile_c(tmp_path_factory.mktemp("core") / "core.so", "-O2", "-shared", "-fPIC", *files)
    library = ctypes.CDLL(str(path))
    library.contact_peak.restype = library.contact_peak_tangent.restype = C_Peak
    return SimpleNamespace(
        library=library,
        Patch=C_Patch,
        State=C_State,
        Contact=C_Contact,
        Wheelset=C_Wheelset,
        Inputs=C_Inputs,
        Evaluation=C_Evaluation,
        Outputs=C_Outputs,
        System=C_System,
        Evaluate=Evaluate,
        flat=_flat,
        filled=_filled,
        vector=lambda *x: (_real * len(x))(*x),
    )


# The equations again ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reference:
    """The equations of docs/model.md in plain Python, for real or complex numbers.

    `state` is (y, psi, y_dot, psi_dot, omega_L, omega_R, theta, v), `u` maps names of FMU inputs to values.
    """

    mode: DriveMode
    forward: bool = False
    p: WheelsetParameters = field(default_factory=WheelsetParameters)
    v0: float = 0.1

    def regularised(self, v: complex) -> complex:
        real = v.real
        if abs(real) >= self.v0:
            return v if real > 0 else -v
        return (v * v + self.v0 * self.v0) / (2 * self.v0)

    def creepages(self, x: Any, u: Mapping[str, Any]) -> tuple[tuple[Any, Any], tuple[Any, Any], Any]:
        p = self.p
        y, psi, y_dot, psi_dot, omega_L, omega_R, _, v = x
        v = v if self.forward else u["speed"]
        r_L, r_R = self.radii
        v_r = self.regularised(v)
        drive = {
            DriveMode.PRESCRIBED_CREEP: (u["prescribed_creepage"],) * 2,
            DriveMode.FREE_ROLLING: (0.0, 0.0),
            DriveMode.TORQUE_DRIVEN: ((r_L * omega_L - v) / v_r, (r_R * omega_R - v) / v_r),
        }[self.mode]
        # On one axle of speed v/r0 the wheels roll r_L v/r0 and r_R v/r0.
        excess = p.gamma * (y - u["track_lateral_offset"])
        if self.mode is not DriveMode.TORQUE_DRIVEN:
            excess += (r_L - r_R) / 2
        turn = (p.L_g * (psi_dot + v * u["curvature"]) + v * excess / p.r0) / v_r
        lateral = (y_dot - v * psi) / v_r
        return (drive[0] + turn, lateral), (drive[1] - turn, lateral), v_r

    def force(self, lx: Any, ly: Any, v_r: Any, N: Any, rail: Mapping[str, Any]) -> tuple[Any, Any]:
        return polach(lx, ly, v_r, N, rail, self.p.patch)

    @property
    def radii(self) -> tuple[float, float]:
        return self.p.r0 + self.p.delta_r / 2, self.p.r0 - self.p.delta_r / 2

    def flange(self, y: Any, y_dot: Any) -> Any:
        """Force on the wheelset at the displacement `y` from the track."""
        p = self.p
        side = 1.0 if y.real > 0 else -1.0
        depth, rate = side * y - p.flange_clearance, p.flange_damping * side * y_dot
        if depth.real <= 0:
            return 0.0
        s = p.flange_transition
        elastic = p.flange_stiffness * (depth - s / 2 if depth.real > s else depth**2 / (2 * s))
        return -side * elastic * (1 + rate if rate.real > 0 else 1 / (1 - rate))

    def guiding(self, x: Any, u: Mapping[str, Any]) -> tuple[Any, Any]:
        """Lateral force and yaw moment of flange, suspension, gravity and curve."""
        p = self.p
        y, psi, y_dot, psi_dot, *_, v = x
        v = v if self.forward else u["speed"]
        y_rel, N_L, N_R = y - u["track_lateral_offset"], u["normal_load_left"], u["normal_load_right"]
        angle_L = p.contact_angle + p.contact_angle_rate * y_rel
        angle_R = p.contact_angle - p.contact_angle_rate * y_rel
        force = self.flange(y_rel, y_dot) - p.k_y * y - p.c_y * y_dot + N_R * angle_R - N_L * angle_L
        force += p.m_w * (p.g * u["cant"] / (2 * p.L_g) - v**2 * u["curvature"])
        return force, p.L_g * p.contact_angle * (N_L + N_R) * psi - p.c_w * psi_dot

    def x_dot(self, x: Any, u: Mapping[str, Any]) -> list[Any]:
        p = self.p
        _, psi, y_dot, psi_dot, omega_L, omega_R, theta, _ = x
        r_L, r_R = self.radii
        left, right, v_r = self.creepages(x, u)
        f_L = self.force(*left, v_r, u["normal_load_left"], _rail(u, "left"))
        f_R = self.force(*right, v_r, u["normal_load_right"], _rail(u, "right"))
        force, moment = self.guiding(x, u)
        F_y = u["curve_force"] + u["suspension_lateral_force"] + force
        y_ddot = (F_y - f_L[1] - f_R[1]) / p.m_w
        M_z = u["suspension_yaw_moment"] + moment - p.k_w * psi
        psi_ddot = (p.L_g * (f_R[0] - f_L[0]) + M_z) / p.I_w
        spin = (0.0, 0.0, 0.0)
        if self.mode is DriveMode.TORQUE_DRIVEN:
            T_s = p.k_s * theta + p.c_s * (omega_R - omega_L)
            spin = (
                (T_s - r_L * f_L[0]) / p.I_L,
                (u["traction_torque"] - T_s - r_R * f_R[0]) / p.I_R,
                omega_R - omega_L,
            )
        v_dot = (f_L[0] + f_R[0] - u["running_resistance"]) / p.M_v if self.forward else 0.0
        return [y_dot, psi_dot, y_ddot, psi_ddot, *spin, v_dot]


def _rail(u: Mapping[str, Any], side: str) -> dict[str, Any]:
    return {f.name: u[f"rail_{side}.{f.name}"] for f in fields(RailCondition)}


def polach(
    lx: Any, ly: Any, v_r: Any, N: Any, rail: Mapping[str, Any], patch: ContactPatch
) -> tuple[Any, Any]:
    """The creep law as published, with its division by the creep."""
    m: Any = math if all(not isinstance(z, complex) for z in (lx, ly, v_r, N, *rail.values())) else cmath
    creep = m.sqrt(lx * lx + ly * ly)
    if creep == 0 or N.real <= 0:
        return 0.0, 0.0
    c_jj = m.sqrt((patch.C11 * lx / creep) ** 2 + (patch.C22 * ly / creep) ** 2)
    mu = rail["mu_0"] * ((1 - rail["A"]) * m.exp(-rail["B"] * creep * v_r) + rail["A"])
    eps = patch.G * math.pi * patch.a * patch.b * c_jj * creep / (4 * N * mu)
    adhesion, slip = rail["k_A"] * eps, rail["k_S"] * eps
    F = 2 * N * mu / math.pi * (adhesion / (1 + adhesion**2) + m.atan(slip))
    return F * lx / creep, F * ly / creep


#: Start values of all inputs by name.
INPUTS = {v.name: float(v.start or 0.0) for v in VARIABLES if v.causality == "input"}


@pytest.fixture(scope="session")
def reference() -> SimpleNamespace:
    return SimpleNamespace(Model=Reference, polach=polach, INPUTS=INPUTS, with_rail=with_rail)


def with_rail(condition: RailCondition, *sides: str) -> dict[str, float]:
    """Inputs that put the condition on both rails, or on the named sides."""
    return {
        f"rail_{side}.{f.name}": getattr(condition, f.name)
        for side in sides or ("left", "right")
        for f in fields(condition)
    }


@pytest.fixture(scope="session")
def wheelset_struct(core: SimpleNamespace) -> Callable[..., ctypes.Structure]:
    """Make the C struct of a wheelset from a `Reference` and inputs by name."""

    def make(model: Reference, x: Any, u: Mapping[str, float]) -> ctypes.Structure:
        wheelset = core.Wheelset()
        for name, _ in C_Parameters._fields_:
            if hasattr(model.p, name) and name != "patch":
                setattr(wheelset.p, name, getattr(model.p, name))
        for f in fields(ContactPatch):
            setattr(wheelset.p.patch, f.name, getattr(model.p.patch, f.name))
        wheelset.p.v0 = model.v0
        wheelset.p.drive_mode = model.mode
        wheelset.p.forward_dynamics = model.forward
        wheelset.u = core.filled(core.Inputs, np.array([u[name] for name in INPUTS]))
        wheelset.x[:] = x
        return wheelset

    return make
