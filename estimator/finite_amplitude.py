"""Operating points whose slopes are averaged over the wheelset's motion.

A linear model takes the slopes of the creep curve at one creepage. When the wheelset yaws, the creepages of
its wheels swing around that: along the track by ``a sin(phi)``, one up while the other goes down, and across
it by ``b cos(phi)``, for the yaw angle lags its rate by a quarter of a period. The first harmonic of forces
over the swing (describing function, Krylov and Bogoliubov) gives slopes that hold at that amplitude::

    g11 = 2 <f_x sin(phi)>/a,    g22 = 2 <f_y cos(phi)>/b

Past the peak of the curve g11 rises with the amplitude, until in the limit cycle nothing grows any more.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from estimator.linear_models import OperatingPoint, point_at

if TYPE_CHECKING:
    from estimator.contact import CreepCurve
    from fmu_wheelset.parameters import WheelsetParameters

__all__ = ["averaged_point"]

#: Midpoints of the phase: exact for the harmonics that matter, and never at zero creep.
_PHASES = (np.arange(64) + 0.5) / 64 * 2.0 * math.pi


def averaged_point(
    curve: CreepCurve, name: str, creep: float, amplitude: float, wheelset: WheelsetParameters
) -> OperatingPoint:
    """Return the operating point at `creep` for a yaw oscillation of the wheelset.

    Parameters
    ----------
    curve : creep curve, with its speed.
    creep : common longitudinal creepage of both wheels.
    amplitude : of the longitudinal creepage ``L_g psi_dot/v``, >= 0; 0 gives the tangent and the secant.
    wheelset : its yaw spring and inertia give the frequency of the oscillation.
    """
    if amplitude == 0.0:
        return point_at(curve, name, creep)
    swing = creep + amplitude * np.sin(_PHASES)
    frequency = math.sqrt(wheelset.k_w / wheelset.I_w)
    lateral = amplitude * curve.v / (wheelset.L_g * frequency) if frequency > 0.0 else 0.0
    f_x, f_y = curve.forces(swing, lateral * np.cos(_PHASES))
    across = 2.0 * np.mean(f_y * np.cos(_PHASES)) / lateral if lateral > 0.0 else np.mean(curve.secant(swing))
    return OperatingPoint(
        name,
        creep=creep,
        force=float(np.mean(f_x)),
        g11=float(2.0 * np.mean(f_x * np.sin(_PHASES)) / amplitude),
        g22=float(across),
        v=curve.v,
    )
