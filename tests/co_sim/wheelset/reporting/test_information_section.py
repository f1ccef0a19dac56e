from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from co_sim.wheelset.reporting import Grid, Section, Setup
from co_sim.wheelset.reporting.confirmation import confirm
from co_sim.wheelset.reporting.images import render
from co_sim.wheelset.reporting.information import ERROR, NONE, evenly, limits, noise_limits
from co_sim.wheelset.reporting.information_section import information_sections
from co_sim.wheelset.reporting.json_text import dumps, section_json
from co_sim.wheelset.reporting.pairs import chosen_pairs, designs, ranking_of
from co_sim.wheelset.reporting.slope_bounds import slope_bounds

SETUP = Setup(sensors=(("gyro",), ("gyro", "accelerometer")), sample_rate=200.0)
GRID = Grid(conditions=("wet",), speeds=(20.0,), points=("P1", "P2", "P3"))


def nothing(share: float) -> None:
    assert 0.0 <= share <= 1.0


@pytest.fixture(scope="module")
def sections() -> tuple[Section, Section]:
    shares: list[float] = []
    found = information_sections(SETUP, GRID, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    return found


def test_sections_are_complete(sections: tuple[Section, Section]) -> None:
    for section in sections:
        assert section.words
        assert section.summary
        for figure in section.figures:
            assert render(figure).png.startswith(b"\x89PNG")
        again = json.loads(dumps(section_json(section)))
        assert again["key"] == section.key


def test_nothing_is_known_at_the_peak(sections: tuple[Section, Section]) -> None:
    information = sections[0]
    for name in ("g11_std", "g22_std"):
        std = np.asarray(information.numbers[name].value)[0, 0]
        assert np.isfinite(std[[0, 2]]).all()
        assert np.isinf(std[1])
    assert any("P2" in text for text in information.words)
    assert information.brief["g11 known in 1 s to"][0][1] == "not at all"


def test_the_plant_keeps_to_the_limits(sections: tuple[Section, Section]) -> None:
    numbers = sections[0].numbers
    low, high = (np.asarray(numbers[f"plant_{name}"].value) for name in ("low", "high"))
    assert np.all(high >= np.asarray(numbers["plant_lower"].value))
    assert np.all(low <= np.asarray(numbers["plant_upper"].value))  # wet and dry rail are nearly linear


def test_limits_follow_their_laws() -> None:
    found = limits(SETUP, ("dry", "low"), (20.0,), nothing)
    # Where no other rail carries the force, the force tells.
    assert np.array_equal(found.window == 0.0, found.rival == NONE)
    assert (found.rival[0, 0, -1], found.window[0, 0, -1]) == (NONE, 0.0)
    assert np.all(np.diff(found.utilisation, axis=-1) > 0.0)
    assert found.small[0, 0, 1]
    assert not found.small[1, 0, 1]
    longer = limits(replace(SETUP, window=4.0), ("dry",), (20.0,), nothing)
    for name in ("g11", "g22", "creep", "adhesion"):
        assert getattr(longer, name)[0] == pytest.approx(getattr(found, name)[0] / 2.0, rel=1e-6)


def test_more_noise_asks_for_longer_records() -> None:
    window = noise_limits(SETUP, ("wet",), 20.0, (0.5, 1.0, 4.0)).window[0]
    assert np.all(np.diff(window, axis=0) > 0.0)


def test_many_speeds_are_thinned() -> None:
    speeds = tuple(float(v) for v in range(10, 24))
    found = evenly(speeds)
    assert len(found) == 6
    assert (found[0], found[-1]) == (10.0, 23.0)
    assert evenly(speeds[:6]) == speeds[:6]


def test_pairs_have_the_same_mean_force() -> None:
    pairs = chosen_pairs(SETUP, ("wet", "dry"), (20.0, 60.0))
    assert pairs
    for pair in pairs:
        assert pair.p.force == pytest.approx(pair.q.force, rel=1e-9)
        assert pair.p.force == pytest.approx(pair.adhesion * SETUP.wheelset.N, rel=1e-9)
        assert pair.first != pair.second
    assert len({pair.name for pair in pairs}) == len(pairs)
    rates = ranking_of(pairs, SETUP)
    assert np.all(rates[1] > rates[0])  # one more sensor
    found = designs(pairs[:1], SETUP, ERROR, nothing)
    assert np.all(np.diff(found["noise"].error) > 0.0)
    assert np.all(np.diff(found["bandwidth"].error) < 0.0)
    assert np.all(np.diff(found["sample_rate"].error) < 0.0)


def test_nothing_is_counted_without_a_recorded_sensor() -> None:
    blind = replace(SETUP, sensors=(("wheel_speeds",),))
    assert confirm(chosen_pairs(blind, ("wet",), (20.0,)), blind, nothing) == ()


def test_slope_bounds_of_an_unstable_wheelset_come_from_its_first_second() -> None:
    grid = replace(GRID, points=("P3",))
    one, ten = (slope_bounds(replace(SETUP, window=T), grid, nothing).g11 for T in (1.0, 10.0))
    assert np.array_equal(one, ten)


def test_an_unsteady_motion_is_a_gap_and_not_a_failure() -> None:
    # Above the critical speed on dry rail, where the contact is stiff.
    soft = replace(SETUP, wheelset=replace(SETUP.wheelset, k_w=1e5))
    found = limits(soft, ("dry",), (60.0,), nothing)
    unsteady = np.isnan(found.utilisation)
    assert unsteady.any()
    for name in ("amplitude", "g11", "creep", "adhesion", "window"):
        assert np.isnan(getattr(found, name)[unsteady]).all()
