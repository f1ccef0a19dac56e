"""Builds the frame's FMU and the system of two wheelsets under it.

Its components know each other only by their ports::

    track_front --> front --> frame <-- rear <-- track_rear
                    front <-- frame --> rear
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING

from co_sim.component import Port
from co_sim.coupling import Coupling
from co_sim.errors import InputError
from co_sim.fmi import this_platform
from co_sim.fmu import FmuComponent
from co_sim.signals import Constant
from co_sim.system import Connection, System
from co_sim.wheelset.track import TrackInput
from fmu_wheelset import path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.component import Component
    from co_sim.wheelset.track import TrackProfile

__all__ = [
    "HALF_WHEELBASE",
    "WHEELSETS",
    "Ride",
    "assemble",
    "assemble_fmus",
    "build_frame",
    "build_track",
    "require_exporter",
]

#: Half of the distance between the wheelsets, m; the frame's parameter ``a``.
HALF_WHEELBASE = 1.28
WHEELSETS = ("front", "rear")
_MOTION = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")
_LOADS = {"lateral_force": "suspension_lateral_force", "yaw_moment": "suspension_yaw_moment"}
_OUTPUTS = (*_MOTION, "relative_displacement")


@dataclass(frozen=True, slots=True)
class Ride:
    """What the bogie runs on, and how.

    Parameters
    ----------
    track : lateral offset of the track. speed : m/s.
    creepage : longitudinal, imposed on all wheels: what a drive or a brake asks of them. At none at all
        the creep law has no linear model, as its slope depends on the direction of the creep.
    ramp : length over which the track's offset is faded in, m.
    """

    track: TrackProfile
    speed: float = 20.0
    creepage: float = 1e-3
    ramp: float = 5.0

    @property
    def delay(self) -> float:
        """Time after which the rear wheelset meets the track of the front one, s."""
        return 2.0 * HALF_WHEELBASE / self.speed


def require_exporter() -> None:
    """Raise `InputError` if FMUs that PythonFMU3 exports would have no library for this platform."""
    places = resources.files("pythonfmu3") / "resources" / "binaries"
    known = sorted(place.name for place in places.iterdir() if place.is_dir())
    here = this_platform(3)
    if here not in known:
        raise InputError(
            f"the exporter of frame and track, PythonFMU3 {version('pythonfmu3')}",
            got=f"no library for this platform, {here}",
            expected=f"one; it has {', '.join(known)}",
            remedy="run the bogie on one of these; the wheelset itself runs here",
        )


def build_frame(folder: Path) -> Path:
    """Export the frame by PythonFMU3 into a folder, which need not exist, and return the FMU."""
    return _export("bogie_frame", folder)


def build_track(track: TrackProfile, folder: Path) -> Path:
    """Export a track by PythonFMU3 into a folder, which need not exist, and return the FMU."""
    curve = track.curve
    first = curve.x[0]
    offset = curve.c[-1] - track.offset[0]
    rows = zip(curve.x[:-1] - first, *curve.c[:-1], offset, strict=True)
    lines = [",".join(repr(float(number)) for number in row) for row in rows]
    with TemporaryDirectory() as temporary:
        file = Path(temporary) / "track.csv"
        file.write_text("\n".join([*lines, repr(track.length)]) + "\n", encoding="utf-8")
        return _export("recorded_track", folder, [file])


def _export(name: str, folder: Path, files: Sequence[Path] = ()) -> Path:
    """Make an FMU of a module of this package, with files as its resources."""
    from pythonfmu3 import FmuBuilder

    require_exporter()
    script = resources.files("co_sim.wheelset.bogie") / f"{name}.py"
    options = {"canGetAndSetFMUState": True, "canSerializeFMUState": True}
    with resources.as_file(script) as file:
        return Path(FmuBuilder.build_FMU(file, dest=folder, project_files=files, **options))


def assemble(frame: Path, ride: Ride, *, step: float = 1e-3, coupling: Coupling | None = None) -> System:
    """Return the bogie.

    Parameters
    ----------
    frame : the FMU of `build_frame`, or another one with its ports.
    step : communication step, s. coupling : ``None`` is that of `System`.
    """
    components: dict[str, Component] = {
        "drive": Constant([ride.speed, ride.creepage], [Port("speed", "m/s"), Port("prescribed_creepage")]),
        "track_front": TrackInput(ride.track, ramp=ride.ramp),
        "track_rear": TrackInput(ride.track, ramp=ride.ramp, behind=2.0 * HALF_WHEELBASE),
        "front": _wheelset(),
        "rear": _wheelset(),
        "frame": FmuComponent(frame, parameters={"a": HALF_WHEELBASE}),
    }
    wires = [wire for name in WHEELSETS for wire in (*_drive_wires(name), *_wires(name))]
    return System(components, wires, step=step, coupling=coupling or Coupling())


def assemble_fmus(
    frame: Path, track: Path, ride: Ride, *, step: float = 1e-3, coupling: Coupling | None = None
) -> System:
    """Return the same bogie of FMUs alone, which any tool can run.

    Parameters
    ----------
    frame, track : the FMUs of `build_frame` and `build_track`.
    step : communication step, s. coupling : ``None`` is that of `System`.
    """
    behind = 2.0 * HALF_WHEELBASE
    drive = {"speed": ride.speed, "prescribed_creepage": ride.creepage}
    components: dict[str, Component] = {
        "track": FmuComponent(track, parameters={"speed": ride.speed, "ramp": ride.ramp, "behind": behind}),
        "front": _wheelset(drive),
        "rear": _wheelset(drive),
        "frame": FmuComponent(frame, parameters={"a": HALF_WHEELBASE}),
    }
    wires = [Connection(f"track.{name}", f"{name}.track_lateral_offset") for name in WHEELSETS]
    wires += [wire for name in WHEELSETS for wire in _wires(name)]
    return System(components, wires, step=step, coupling=coupling or Coupling())


def _wheelset(inputs: Mapping[str, float] = MappingProxyType({})) -> FmuComponent:
    """Return a wheelset that the frame alone holds, with values of inputs that nothing feeds.

    All of its suspension to the ground is off by default but the yaw spring.
    """
    return FmuComponent(
        path(fmi=3),
        inputs=["speed", "prescribed_creepage", "track_lateral_offset", *_LOADS.values()],
        outputs=_OUTPUTS,
        parameters={"drive_mode": "prescribed_creep", "k_w": 0.0, **inputs},
    )


def _drive_wires(name: str) -> list[Connection]:
    return [
        Connection("drive.speed", f"track_{name}.speed"),
        Connection("drive.speed", f"{name}.speed"),
        Connection("drive.prescribed_creepage", f"{name}.prescribed_creepage"),
        Connection(f"track_{name}.lateral_offset", f"{name}.track_lateral_offset"),
    ]


def _wires(name: str) -> list[Connection]:
    return [
        *(Connection(f"{name}.{motion}", f"frame.{name}.{motion}") for motion in _MOTION),
        *(Connection(f"frame.{name}.{load}", f"{name}.{target}") for load, target in _LOADS.items()),
    ]
