"""A bogie frame between two wheelsets and the ground, as PythonFMU3 exports it.

This file becomes the FMU: it is copied into the archive and knows nothing but PythonFMU3 and the standard
library. Lateral displacement `y` is positive to the left of travel and yaw `psi` from the direction of travel
to the left, as in the wheelset. The front wheelset is `a` ahead of the middle, the rear one `a` behind::

    F_i = k_y (y +- a psi - y_i) + c_y (y_dot +- a psi_dot - y_dot_i)       on wheelset i, + in front
    M_i = k_psi (psi - psi_i) + c_psi (psi_dot - psi_dot_i)
    m y_ddot   = -F_f - F_r - k_y2 y - c_y2 y_dot
    I psi_ddot = -M_f - M_r - a (F_f - F_r) - k_psi2 psi - c_psi2 psi_dot

The suspension is the same in front and behind, so the lateral motion and the yaw are two oscillators that
meet only through the wheelsets. A step is exact for motions of the wheelsets that are held during the step.

Values: passenger vehicle of the Manchester benchmarks (S. Iwnicki, Vehicle System Dynamics 30, 1998,
295-313; after ERRI B176). Primary suspension, for each of two axle boxes 1 m beside the middle: longitudinal
31.391 MN/m and 15 kN s/m, lateral 3.884 MN/m and 2 kN s/m. Secondary suspension, for each side, 1 m beside
the middle: 0.16 MN/m in both directions, 25 kN s/m longitudinal, 32 kN s/m lateral; here it stands on the
ground.
"""

from __future__ import annotations

from math import cos, cosh, exp, sin, sinh, sqrt
from typing import Any

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability
from pythonfmu3.unit import Unit

_UNITS = {
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "kg": {"kg": 1},
    "kg.m2": {"kg": 1, "m": 2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
}
_PARAMETERS = {
    "m": (2615.0, "kg", "mass of the frame"),
    "I": (3067.0, "kg.m2", "yaw moment of inertia of the frame"),
    "a": (1.28, "m", "half of the wheelbase"),
    "k_y": (2 * 3.884e6, "N/m", "lateral stiffness of the primary suspension of a wheelset"),
    "c_y": (2 * 2.0e3, "N.s/m", "lateral damping of the primary suspension of a wheelset"),
    "k_psi": (2 * 31.391e6, "N.m/rad", "yaw stiffness of the primary suspension of a wheelset"),
    "c_psi": (2 * 15.0e3, "N.m.s/rad", "yaw damping of the primary suspension of a wheelset"),
    "k_y2": (2 * 0.16e6, "N/m", "lateral stiffness of the secondary suspension"),
    "c_y2": (2 * 32.0e3, "N.s/m", "lateral damping of the secondary suspension"),
    "k_psi2": (2 * 0.16e6, "N.m/rad", "yaw stiffness of the secondary suspension"),
    "c_psi2": (2 * 25.0e3, "N.m.s/rad", "yaw damping of the secondary suspension"),
}
_MOTION = {
    "lateral_displacement": ("m", "lateral displacement"),
    "yaw_angle": ("rad", "yaw angle"),
    "lateral_velocity": ("m/s", "lateral velocity"),
    "yaw_rate": ("rad/s", "yaw rate"),
}


class Motion:
    """Motion of a wheelset as the frame sees it; zero until it is set."""

    def __init__(self) -> None:
        self.lateral_displacement = self.yaw_angle = self.lateral_velocity = self.yaw_rate = 0.0


class BogieFrame(Fmi3Slave):  # type: ignore[misc]
    """Frame with lateral motion and yaw.

    Motions of both wheelsets come in, loads on them and the frame's own motion go out.
    """

    m: float
    I: float  # noqa: E741
    a: float
    k_y: float
    c_y: float
    k_psi: float
    c_psi: float
    k_y2: float
    c_y2: float
    k_psi2: float
    c_psi2: float

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.modelName = "bogie_frame"
        self.description = "Bogie frame: lateral motion and yaw between two wheelsets and the ground"
        self.register_units([Unit(name, **exponents) for name, exponents in _UNITS.items()])
        self.front, self.rear = Motion(), Motion()
        self.time = self.lateral_displacement = self.yaw_angle = self.lateral_velocity = self.yaw_rate = 0.0
        self._register_parameters()
        for position, side in (("front", 1.0), ("rear", -1.0)):
            self._register_wheelset(position, side)
        for name, (unit, words) in _MOTION.items():
            self._register(name, unit, f"{words} of the frame", "output", initial=Fmi3Initial.exact)

    def _register_parameters(self) -> None:
        self._register("time", None, "time", "independent")
        for name, (value, unit, words) in _PARAMETERS.items():
            setattr(self, name, value)
            self._register(name, unit, words, "parameter", "fixed")

    def _register_wheelset(self, position: str, side: float) -> None:
        """Register the ports of the wheelset in front (`side` is 1) or behind (-1)."""
        wheelset: Motion = getattr(self, position)
        for name, (unit, words) in _MOTION.items():
            self._register(f"{position}.{name}", unit, f"{words} of the {position} wheelset", "input")
        for name, unit, load in (("lateral_force", "N", self._force), ("yaw_moment", "N.m", self._moment)):
            words = f"{name.replace('_', ' ')} on the {position} wheelset"
            self._register(
                f"{position}.{name}",
                unit,
                words,
                "output",
                initial=Fmi3Initial.calculated,
                getter=lambda load=load: load(wheelset, side),
            )

    def _register(
        self,
        name: str,
        unit: str | None,
        description: str,
        causality: str,
        variability: str = "continuous",
        **facts: Any,
    ) -> None:
        variable = Float64(
            name,
            unit=unit,
            description=description,
            causality=Fmi3Causality[causality],
            variability=Fmi3Variability[variability],
            **facts,
        )
        self.register_variable(variable)

    def _force(self, wheelset: Motion, side: float) -> float:
        """Return the lateral force on a wheelset, N."""
        travel = self.lateral_displacement + side * self.a * self.yaw_angle - wheelset.lateral_displacement
        rate = self.lateral_velocity + side * self.a * self.yaw_rate - wheelset.lateral_velocity
        return self.k_y * travel + self.c_y * rate

    def _moment(self, wheelset: Motion, side: float) -> float:
        """Return the yaw moment on a wheelset, N.m."""
        travel = self.yaw_angle - wheelset.yaw_angle
        return self.k_psi * travel + self.c_psi * (self.yaw_rate - wheelset.yaw_rate)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance both oscillators, with the motions of the wheelsets held."""
        f, r, a = self.front, self.rear, self.a
        pulls = [self.k_y * w.lateral_displacement + self.c_y * w.lateral_velocity for w in (f, r)]
        twists = [self.k_psi * w.yaw_angle + self.c_psi * w.yaw_rate for w in (f, r)]
        self.lateral_displacement, self.lateral_velocity = oscillate(
            (self.lateral_displacement, self.lateral_velocity),
            self.m,
            2.0 * self.c_y + self.c_y2,
            2.0 * self.k_y + self.k_y2,
            pulls[0] + pulls[1],
            step_size,
        )
        self.yaw_angle, self.yaw_rate = oscillate(
            (self.yaw_angle, self.yaw_rate),
            self.I,
            2.0 * (self.c_psi + a * a * self.c_y) + self.c_psi2,
            2.0 * (self.k_psi + a * a * self.k_y) + self.k_psi2,
            twists[0] + twists[1] + a * (pulls[0] - pulls[1]),
            step_size,
        )
        self.time = current_time + step_size
        return True


def oscillate(
    start: tuple[float, float], m: float, c: float, k: float, force: float, h: float
) -> tuple[float, float]:
    """Return displacement and velocity of ``m z_ddot + c z_dot + k z = force`` after `h`; `k` is not zero.

    With ``s = -c/(2 m)`` and ``w^2 = s^2 - k/m`` the matrix exponential is
    ``exp(s h) [cosh(w h) + sinh(w h)/w (A - s)]``, for real and imaginary `w`.
    """
    rest = force / k
    z, v = start[0] - rest, start[1]
    s = -0.5 * c / m
    w2 = s * s - k / m
    w = sqrt(abs(w2))
    if w * h < 1e-6:
        even, odd = 1.0, h
    elif w2 < 0.0:
        even, odd = cos(w * h), sin(w * h) / w
    else:
        even, odd = cosh(w * h), sinh(w * h) / w
    fade = exp(s * h)
    z_new = fade * (even * z + odd * (v - s * z))
    v_new = fade * (even * v + odd * (s * v - k / m * z))
    return rest + z_new, v_new
