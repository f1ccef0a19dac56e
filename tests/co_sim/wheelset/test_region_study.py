from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from co_sim.wheelset.recordings import record
from co_sim.wheelset.region_study import EXACT, PLACES, WAYS, Counts, _row, journey, look, region_bank
from estimator import (
    CreepCurve,
    FilterBank,
    Identifier,
    design_filter,
    filter_model,
    identification_system,
    operating_points,
)
from estimator.region import HYPOTHESES, REGIONS
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from co_sim.wheelset.region_study import Place

CURVE = CreepCurve(CONDITIONS["dry"], 40.0)


@pytest.fixture(scope="module")
def paper() -> Identifier:
    """The paper's bank without the tuning."""
    W, R = np.diag([2.7e-5, 1e-4, 1e-4]), np.diag([1e-6, 2.5e-3])
    filters = [
        design_filter(filter_model(p, WheelsetParameters()), W, R, 1e-3, name=p.name)
        for p in operating_points(CURVE)
    ]
    return Identifier(
        FilterBank(filters), identification_system(3), window=1000, weights=np.array([0.0, 1.0])
    )


@pytest.mark.parametrize("place", [PLACES[0], PLACES[3]], ids=["linear", "unstable"])
def test_bank_finds_the_region_on_the_plant(place: Place, paper: Identifier) -> None:
    recording = record(journey(place, CURVE, flange=False, seed=1003))
    banks = region_bank(CURVE, HYPOTHESES), region_bank(CURVE, EXACT)
    counts = look(recording, banks, paper)
    valid = int(recording.within(8e-3).sum())
    right = REGIONS.index(place.region)
    assert [getattr(counts, way).sum() for way in WAYS] == [max((valid - 900) // 100, 0)] * len(WAYS)
    assert counts.bank[right] == counts.bank.sum() > 0
    assert counts.exact[right] == counts.exact.sum()


def test_places_are_in_their_regions() -> None:
    for place in PLACES:
        creep = place.creep(CURVE)
        expected = 0 if creep < CURVE.knee_creep else 1 if creep <= CURVE.peak_creep else 2
        assert REGIONS[expected] == place.region
    for place, hypothesis in zip(PLACES, EXACT, strict=False):
        assert hypothesis.creep(CURVE) == pytest.approx(place.creep(CURVE))


def test_rows_show_shares_of_the_right_region() -> None:
    counts = Counts(*(np.array(c) for c in ([8, 2, 0], [9, 1, 0], [5, 5, 0], [0, 0, 10])))
    both = counts + counts
    assert both.bank.tolist() == [16, 4, 0]
    assert _row(PLACES[0], "20", both).split()[-4:] == ["80.0", "90.0", "50.0", "0.0"]
    assert _row(PLACES[4], "20", both).split()[-4:] == ["80.0", "-", "50.0", "0.0"]
    none = Counts(*np.zeros((4, 3), dtype=np.int64))
    assert _row(PLACES[0], "20", none).split()[-1] == "0"


def test_a_journey_starts_in_the_middle_of_the_track() -> None:
    track = journey(PLACES[0], CURVE, flange=True, seed=3).track
    assert track.offset[0] == 0.0  # type: ignore[union-attr]
