"""The limits of identification on the plant itself."""

from __future__ import annotations

import numpy as np
import pytest

from co_sim.wheelset.recordings import Journey, Stretch, record
from estimator import ERRI_B176, CreepCurve
from estimator.identifiability import averaged_points
from fmu_wheelset import CONDITIONS

TRACK = ERRI_B176["erri_low"]


@pytest.mark.parametrize(("condition", "v"), [("low", 20.0), ("very_low", 60.0)])
def test_the_plant_has_the_averaged_force(condition: str, v: float) -> None:
    curve = CreepCurve(CONDITIONS[condition], v)
    creep = 0.3 * curve.peak_creep
    (point,) = averaged_points(curve, [creep], TRACK)
    run = record(
        Journey(duration=30.0, step=2e-3, creep=creep, speed=v, rails=(Stretch(0.0, CONDITIONS[condition]),))
    )
    sides = [run.truth[f"{side}.creep_force_x"][2500:] for side in ("left", "right")]
    mean = float(np.mean(sides))
    small = float(curve.force(creep))
    assert mean < 0.96 * small  # what small signals make of it
    assert point.force == pytest.approx(mean, rel=0.04)
