"""A track under two wheelsets, one behind the other, as PythonFMU3 exports it.

This file becomes the FMU: it is copied into the archive, beside ``track.csv``, and knows nothing but
PythonFMU3 and the standard library. Each line of ``track.csv`` is a piece of the track: where it begins (m
from the first point), and the coefficients of the cubic from there, third power first. The last line is
where the track ends.
"""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path
from typing import Any

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability
from pythonfmu3.unit import Unit

_WHEELSETS = ("front", "rear")
#: A run may end on the last point of the track in spite of rounding.
_ROUNDING = 1.0 + 1e-9


class RecordedTrack(Fmi3Slave):  # type: ignore[misc]
    """Lateral offset of the track under both wheelsets, which run at one speed."""

    speed: float
    ramp: float
    behind: float

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.modelName = "recorded_track"
        self.description = "Lateral offset of a track under two wheelsets"
        *pieces, end = Path(self.resources, "track.csv").read_text(encoding="utf-8").splitlines()
        self.pieces = [tuple(map(float, line.split(","))) for line in pieces]
        self.begins = [piece[0] for piece in self.pieces]
        self.end = float(end)
        self.register_units([Unit("m", m=1), Unit("m/s", m=1, s=-1)])
        self.time = 0.0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent))
        fixed = Fmi3Causality.parameter, Fmi3Variability.fixed
        self._register("speed", "m/s", "forward speed", *fixed)
        self._register("ramp", "m", "length over which the offset is faded in", *fixed)
        self._register("behind", "m", "how far the rear wheelset is behind the front one", *fixed)
        moving = Fmi3Causality.output, Fmi3Variability.continuous
        inner = Fmi3Causality.local, Fmi3Variability.continuous
        for name in _WHEELSETS:
            self._register(name, "m", f"lateral offset of the track under the {name} wheelset", *moving)
            self._register(f"{name}_distance", "m", f"distance of the {name} wheelset", *inner)
            self._register(f"{name}_lost", "m", "what the last addition to the distance lost", *inner)

    def _register(
        self, name: str, unit: str, words: str, causality: Fmi3Causality, variability: Fmi3Variability
    ) -> None:
        setattr(self, name, 0.0)
        facts = {"causality": causality, "variability": variability, "initial": Fmi3Initial.exact}
        self.register_variable(Float64(name, unit=unit, description=words, **facts))

    def exit_initialization_mode(self) -> None:
        """Put the rear wheelset behind the front one."""
        self.rear_distance = 0.0 - self.behind

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Run on; fail where the track ends."""
        self.time = current_time + step_size
        for name in _WHEELSETS:
            s, lost = getattr(self, f"{name}_distance"), getattr(self, f"{name}_lost")
            # Kahan's sum, as the distance of a long run must not drift.
            increment = self.speed * step_size - lost
            distance = s + increment
            setattr(self, f"{name}_lost", (distance - s) - increment)
            setattr(self, f"{name}_distance", distance)
            if distance > self.end * _ROUNDING:
                self.log(f"the track ends after {self.end:g} m")
                return False
            setattr(self, name, self.offset(distance))
        return True

    def offset(self, s: float) -> float:
        """Return the faded offset (m) at the distance `s` (m) from the first point."""
        if s <= 0.0:
            return 0.0
        begin, c3, c2, c1, c0 = self.pieces[bisect_right(self.begins, s) - 1]
        r = s - begin
        offset = ((c3 * r + c2) * r + c1) * r + c0
        if s < self.ramp:
            z = s / self.ramp
            offset *= z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
        return offset
