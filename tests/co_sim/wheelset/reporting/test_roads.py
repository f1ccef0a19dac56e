"""Three roads to one linear model, and what happens where one of them goes astray."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest

from co_sim.wheelset.reporting import Grid, Setup, roads
from co_sim.wheelset.reporting.json_text import dumps, section_json
from co_sim.wheelset.reporting.roads_section import roads_section
from estimator import filter_model, wheelset_model
from fmu_wheelset import ContactPatch, WheelsetParameters

if TYPE_CHECKING:
    import control

    from co_sim.wheelset.reporting import Section
    from estimator import OperatingPoint

GRID = Grid(("dry", "very_low"), (5.0, 60.0), ("P1", "P2", "P3", 1e-5))
OTHER = WheelsetParameters(
    m_w=1500.0, gamma=0.05, L_g=0.8, N=60e3, k_y=8e5, c_y=3e4, c_w=2e4, contact_angle=0.1,
    contact_angle_rate=8.0, flange_stiffness=1.5e7, patch=ContactPatch(C11=4.0, C22=3.8),
)  # fmt: skip


def computed(grid: Grid = GRID, **assumed: object) -> Section:
    shares: list[float] = []
    section = roads_section(Setup(**assumed), grid, shares.append)
    assert shares == sorted(shares)
    return section


@pytest.mark.parametrize("wheelset", [WheelsetParameters(), OTHER], ids=["paper", "other"])
def test_the_roads_meet(wheelset: WheelsetParameters) -> None:
    section = computed(wheelset=wheelset)
    difference = section.numbers["difference"].value
    assert difference.shape == (3, 2, 2, 4)
    assert np.all(difference <= roads.BOUND)
    # Two of them are the same but for rounding, and differences have an error of their own.
    assert np.all(difference[0] < 1e-13)
    assert np.any(difference[1] > difference[0])
    assert section.faults == ()
    assert section.words[0].startswith("Yes. At 16 points")


def printed(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
    """Return (12) as the paper prints it, with r0 where the speed and the mass belong."""
    model = wheelset_model(point, wheelset)
    model.A[2, 2] = -2.0 * point.g22 / (wheelset.r0 * wheelset.r0)
    model.C[1] = model.A[2]
    return model


def test_the_printed_equation_fails_loudly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(roads, "wheelset_model", printed)
    section = computed()
    assert "dry rail, 5 m/s, P1" in section.faults[0]
    assert "equations – derivatives" in section.faults[0]
    assert "(12): der(y_dot) over y_dot" in section.faults[0]
    assert section.faults[-1] == f"three roads: {2 * 16 - 5} more differences like these"
    assert section.words[0].startswith("No.")
    assert "not those of the FMU" in section.summary[0]


@pytest.mark.parametrize("row", range(7))
def test_no_entry_of_the_filter_model_goes_unseen(row: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
        model = filter_model(point, wheelset)
        rows = np.block([[model.A, model.B], [model.C, model.D]])[row]
        place = int(np.argmax(np.abs(rows)))
        matrix, i = (model.A, row) if row < 5 else (model.C, row - 5)
        if place < 5:
            matrix[i, place] *= 1.0 + 1e-6
        else:
            model.B[i, place - 5] *= 1.0 + 1e-6
        return model

    monkeypatch.setattr(roads, "filter_model", wrong)
    section = computed(grid=Grid(("dry",), (20.0,), ("P1",)))
    assert len(section.faults) == 2
    assert "(13)" in section.faults[0]


def test_a_number_that_is_none_fails_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(point: OperatingPoint, wheelset: WheelsetParameters) -> control.StateSpace:
        model = wheelset_model(point, wheelset)
        model.B[3, 0] = np.nan
        return model

    monkeypatch.setattr(roads, "wheelset_model", broken)
    section = computed(grid=Grid(("dry",), (20.0,), ("P1",)))
    assert len(section.faults) == 2
    dumps(section_json(section))


def test_another_wheelset_in_the_fmu_is_noticed() -> None:
    grid = Grid(("wet",), (30.0,), ("P1",))
    (at,) = grid.resolve(WheelsetParameters())
    with roads.LinearisedPlant(dataclasses.replace(WheelsetParameters(), k_w=5.01e6)) as plant:
        found = roads.differences(plant, at, WheelsetParameters())
    assert [one.is_small for one in found] == [False, False, True]
    assert found[0].entry == "(12): der(psi_dot) over psi"


def test_at_rest_nothing_is_compared_and_that_is_said() -> None:
    section = computed(grid=Grid(("dry",), (20.0,), ("P1", 0.0)))
    difference = section.numbers["difference"].value
    assert np.isfinite(difference[:, 0, 0, 0]).all()
    assert np.isnan(difference[:, 0, 0, 1]).all()
    assert "1 point is at zero creepage" in section.words[1]
    assert section.faults == ()
    alone = computed(grid=Grid(("dry",), (20.0,), (0.0,)))
    assert alone.figures == ()
    assert alone.summary == ()
    dumps(section_json(alone))
