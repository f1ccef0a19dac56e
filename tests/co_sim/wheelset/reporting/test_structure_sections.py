"""The sections on motion, reach, sight and filters of the wheelset."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from co_sim.wheelset.reporting import Section, Setup
from co_sim.wheelset.reporting.grid import Grid
from co_sim.wheelset.reporting.images import render
from co_sim.wheelset.reporting.json_text import dumps, section_json
from co_sim.wheelset.reporting.structure_section import structure_sections
from estimator import CreepCurve, operating_points
from estimator.linear_models import critical_speed, full_model
from estimator.structure import distance_to_unobservable
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

GRID = Grid(conditions=("dry", "very_low"), speeds=(20.0, 50.0))


def made(setup: Setup, grid: Grid) -> Mapping[str, Section]:
    shares: list[float] = []
    sections = structure_sections(setup, grid, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    return {section.key: section for section in sections}


@pytest.fixture(scope="module")
def sections() -> Mapping[str, Section]:
    return made(Setup(), GRID)


def numbers(section: Section, name: str) -> np.ndarray:
    return np.asarray(section.numbers[name].value)


def test_every_section_and_figure_asks_a_question(sections: Mapping[str, Section]) -> None:
    assert list(sections) == ["motion", "reach", "sight", "filters"]
    figures = [figure for section in sections.values() for figure in section.figures]
    assert len({figure.key for figure in figures}) == len(figures) == 10
    assert all(title.title.endswith("?") for title in (*sections.values(), *figures))


def test_points_of_the_curve_behave_as_the_algebra_says(sections: Mapping[str, Section]) -> None:
    behaviour = numbers(sections["motion"], "behaviour")
    assert (behaviour[:, :, 0] == "decays").all()
    assert ((behaviour[:, :, 1] == "undamped").sum(axis=-1) == 3).all()
    assert ((behaviour[:, :, 2] == "grows").sum(axis=-1) == 3).all()
    # 13.45 Hz on the yaw spring alone.
    assert numbers(sections["motion"], "frequency")[0, 0, 1].max() == pytest.approx(13.451, abs=1e-3)
    assert "at P2 it is without damping at all speeds on all rails" in sections["motion"].words[0]
    assert sections["motion"].brief["critical speed"][0][1:] == ["never stable", "never stable"]


def test_critical_speeds_are_where_growth_changes_sign(sections: Mapping[str, Section]) -> None:
    section = sections["motion"]
    speeds, growth = np.array(section.axes["map_speed"]), numbers(section, "growth_rate")
    relative = np.array(section.axes["relative_creepage"])
    assert (growth[:, :, relative > 1.05] > 0.0).all()
    slow = growth[:, speeds < 90.0][:, :, (relative > 0.05) & (relative < 0.9)]
    assert (slow < 0.0).all()
    # Hardly any creepage: the initial slopes decide.
    slope = CreepCurve(CONDITIONS["dry"], 20.0).initial_slope
    expected = critical_speed(slope, slope, WheelsetParameters())
    assert numbers(section, "critical_speed")[0, 0] == pytest.approx(expected, rel=1e-3)


def test_paths_start_in_grip_and_end_in_growth(sections: Mapping[str, Section]) -> None:
    paths = numbers(sections["motion"], "pole_path")
    assert (paths[:, :, 0].real.max(axis=-1) < 0.0).all()
    assert (paths[:, :, -1].real.max(axis=-1) > 0.0).all()


def test_ranks_and_distances_are_those_of_the_driven_wheelset(sections: Mapping[str, Section]) -> None:
    sight, reach = sections["sight"], sections["reach"]
    names = list(sight.axes["set"])
    both = names.index("gyro+accelerometer")
    assert numbers(sight, "rank")[both, 0, 0].tolist() == [7, 3, 7]
    point = operating_points(CreepCurve(CONDITIONS["dry"], 20.0))[0]
    found = distance_to_unobservable(
        full_model(point, WheelsetParameters()), ["yaw_rate", "lateral_acceleration"]
    )
    assert numbers(sight, "distance")[both, 0, 0, 0] == pytest.approx(found.value, rel=1e-4)
    assert not numbers(sight, "detectable")[:, :, :, 1].any()
    # The track reaches nothing at the peak, and the torque nothing but the wheels.
    inputs = list(reach.axes["set"])
    assert numbers(reach, "rank")[inputs.index("track"), :, :, 1].tolist() == [[0, 0], [0, 0]]
    assert numbers(reach, "rank")[inputs.index("traction torque"), :, :, 1].tolist() == [[3, 3], [3, 3]]
    for section in (sight, reach):
        assert (numbers(section, "distance_at_least") <= numbers(section, "distance")).all()


def test_no_filter_at_the_peak_and_why(sections: Mapping[str, Section]) -> None:
    section = sections["filters"]
    names = list(section.axes["set"])
    exists = numbers(section, "exists")
    assert names == ["gyro", "accelerometer", "gyro+accelerometer", "gyro+accelerometer+displacement"]
    assert exists[:, :3, :, :, 1].sum() == 0
    assert exists[:, :, :, :, [0, 2]].all()
    # A displacement sees where the wheelset is; noise in yaw must then excite what swings undamped.
    assert not exists[0, 3, :, :, 1].any()
    assert exists[1, 3, :, :, 1].all()
    assert section.brief["steady filter"] == [["yes", "no", "yes"]] * 2
    assert "cannot see the integrator y_rel" in " ".join(section.words)
    assert np.isnan(numbers(section, "forgets")[0, :, :, 1]).all()
    assert not numbers(section, "hankel_singular_value")[:, :, 1].any()


def test_figures_can_be_drawn_and_numbers_written(sections: Mapping[str, Section]) -> None:
    for section in sections.values():
        assert json.loads(dumps(section_json(section)))["key"] == section.key
        for figure in section.figures:
            assert render(figure).png.startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("setup", "grid"),
    [
        (Setup(sensors=(("wheel_speeds",),)), Grid(("wet",), (30.0,), (0.0, 0.01))),
        (Setup(sensors=(("displacement",), ("gyro",))), Grid(("low", "dry", "wet"), (10.0,), ("P2",))),
    ],
    ids=["no sensor of the filter", "nothing but the peak"],
)
def test_unusual_grids_and_sensors(setup: Setup, grid: Grid) -> None:
    for section in made(setup, grid).values():
        dumps(section_json(section))
        for figure in section.figures:
            render(figure)


def test_a_wheelset_without_a_yaw_spring_is_never_stable() -> None:
    found = made(Setup(wheelset=WheelsetParameters(k_w=0.0)), Grid(("dry",), (20.0,), ("P1",)))
    assert found["motion"].brief["critical speed"] == [["never stable"]]
    assert "at P1 it is unstable" in found["motion"].words[0]
