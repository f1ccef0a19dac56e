"""Experiments on the real plant: the paper's scheme works where it can, and says where it can not."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from co_sim.errors import InputError
from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.results import Experiment, Run
from co_sim.wheelset.scenario_file import load_scenario, parse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from co_sim.system import Signal

SHORT = "[simulation]\nduration = 1.5\n[identifier]\ntraining = 1.5\n"


def run_of(text: str, folder: Path = Path()) -> Experiment:
    return Laboratory(parse(text, "x.toml"), "x", folder).run()


@pytest.fixture(scope="module")
def paper() -> Experiment:
    """The packaged default, whole."""
    scenario, folder = load_scenario("default")
    return Laboratory(scenario, "default", folder).run()


@pytest.fixture(scope="module")
def drop() -> Experiment:
    scenario, folder = load_scenario("adhesion-drop")
    return Laboratory(scenario, "adhesion-drop", folder).run()


def test_p1_is_recognised_as_in_figures_5_and_9(paper: Experiment) -> None:
    p1 = paper.stretches[0]
    assert p1.share_smallest is not None
    assert p1.mean_probability is not None
    assert p1.share_smallest["dry-P1"] > 0.98
    assert 0.8 < p1.mean_probability["dry-P1"] < 0.95
    assert max(p1.mean_probability["dry-P2"], p1.mean_probability["dry-P3"]) < 0.25


def test_p2_is_left_undecided_because_the_sensors_see_nothing(paper: Experiment) -> None:
    p2 = paper.stretches[1]
    assert p2.signal_to_noise is not None
    assert p2.mean_probability is not None
    assert p2.margin is not None
    assert max(p2.signal_to_noise.values()) < 0.1
    assert p2.margin < 0.02
    assert max(p2.mean_probability.values()) < 0.6


def test_p3_grows_until_the_model_ceases_to_hold(paper: Experiment) -> None:
    p3, run = paper.stretches[2], paper.runs[2]
    assert 1.0 < run.valid_until < 4.0
    assert p3.share_smallest_valid is not None
    assert p3.valid_windows < p3.windows
    assert max(p3.share_smallest_valid, key=lambda name: p3.share_smallest_valid[name]) == "dry-P3"


def test_adhesion_drop_is_seen_under_torque(drop: Experiment) -> None:
    assert [s.condition for s in drop.stretches] == ["dry", "wet", "low", "dry"]
    for stretch in drop.stretches:
        assert stretch.share_smallest is not None
        (expected,) = stretch.expected
        assert stretch.share_smallest[expected] > 0.95
    used, peak = (drop.runs[0].signals[f"plant.{n}"] for n in ("adhesion_used", "left.adhesion_peak"))
    low = (drop.runs[0].time > 21.0) & (drop.runs[0].time < 30.0)
    # In the steady state the wheels put down the torque: f_L + f_R = T/r0.
    np.testing.assert_allclose(used[low].mean(), 4200.0 / 0.5 / (2 * 79.7e3), rtol=5e-3)
    assert (used[low] < peak[low]).all()


def test_training_and_runs_share_no_noise(paper: Experiment) -> None:
    noises = [run.signals["sensors.yaw_rate"][1:] - run.signals["plant.yaw_rate"][:-1] for run in paper.runs]
    for noise in noises:
        assert abs(noise.std() - 1e-3) < 4e-5
    correlation = np.corrcoef(noises)
    assert np.abs(correlation - np.eye(3)).max() < 0.05


def test_runs_of_a_scenario_pass_over_the_same_track(paper: Experiment) -> None:
    first, *others = (run.signals["track.lateral_offset"] for run in paper.runs)
    for other in others:
        np.testing.assert_array_equal(first, other)


def test_same_seed_same_result_and_another_seed_another() -> None:
    runs = [run_of(f"seed = {seed}\n{SHORT}").runs for seed in (1, 1, 2)]
    for a, b, c in zip(*runs, strict=True):
        np.testing.assert_array_equal(a.E, b.E)
        assert not np.array_equal(a.E, c.E)


def test_fmi_2_and_3_give_the_same_bits() -> None:
    two, three = (run_of(f"{SHORT}[fmu]\nversion = {version}").runs for version in (2, 3))
    for a, b in zip(two, three, strict=True):
        assert a.signals.keys() == b.signals.keys()
        for name, series in a.signals.items():
            np.testing.assert_array_equal(series, b.signals[name], err_msg=name)


def test_slower_sensors_get_slower_filters() -> None:
    sensors = (
        "[sensors.gyro]\nnoise_rms = 1e-3\nrate_hz = {0}\n"
        "[sensors.accelerometer]\nnoise_rms = 0.05\nrate_hz = {0}"
    )
    experiment = run_of(SHORT + sensors.format(500.0))
    changes = np.diff(experiment.runs[0].E, axis=0).any(axis=1)
    assert 0.4 < changes.mean() <= 0.5
    with pytest.raises(InputError, match="one rate"):
        run_of(SHORT + sensors.format(500.0).replace("500.0", "250.0", 1))


def test_measured_track_is_used_and_must_be_long_enough(tmp_path: Path) -> None:
    distance = np.arange(0.0, 35.0, 0.5)
    np.savetxt(tmp_path / "track.csv", np.column_stack([distance, 1e-3 * np.sin(distance)]), delimiter=",")
    track = '[track]\nfile = "track.csv"\n'
    run = run_of(SHORT + track, tmp_path).runs[0]
    at = run.signals["track.distance"] > 5.0
    expected = 1e-3 * np.sin(run.signals["track.distance"][at])
    np.testing.assert_allclose(run.signals["track.lateral_offset"][at], expected, atol=5e-5)
    with pytest.raises(InputError, match=r"track\.csv: got 34\.5 m"):
        Laboratory(parse(track, "x.toml"), "x", tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[drive]\nmode = "prescribed_creep"\nspeed = 1e-3', "without a maximum"),
        (
            """
            [identifier]
            filters = [{condition = "low", adhesion = 0.2}, {condition = "dry", point = "P1"}]
            """,
            "less than the maximum of 0.05949",
        ),
        ('[track]\nfile = "nowhere.csv"', "nowhere.csv"),
        ("[sensors.gyro]\nnoise_rms = 1e-3\nrate_hz = 333.0", "one rate"),
    ],
)
def test_what_cannot_run_is_refused_before_it_runs(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Laboratory(parse(text, "x.toml"), "x", Path())


def test_free_rolling_stays_in_the_linear_region() -> None:
    (run,) = run_of(SHORT + '[drive]\nmode = "free_rolling"').runs
    assert isinstance(run, Run)
    assert run.point is None
    assert np.abs(run.signals["plant.left.creepage_x"]).max() < 1e-3
    assert run.valid_until == run.time[-1] == 1.5


def test_supervised_and_in_process_give_the_same_bits() -> None:
    scenario = parse(SHORT, "x.toml")
    one, other = (Laboratory(scenario, "x", Path(), in_process=alone).run() for alone in (False, True))
    assert [run.name for run in one.runs] == ["P1", "P2", "P3"]
    for a, b in zip(one.runs, other.runs, strict=True):
        assert a.table.tobytes() == b.table.tobytes()
        assert a.probabilities.tobytes() == b.probabilities.tobytes()


class Impatience:
    """Observer that presses Ctrl-C in the second of the runs that are watched."""

    def __init__(self, run: int) -> None:
        self._left = run

    def begin(self, signals: Sequence[Signal], t0: float, h: float, n_steps: int) -> None:
        self._left -= 1

    def observe(self, k: int, time: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        if self._left == 0 and k + len(time) > 300:
            signal.raise_signal(signal.SIGINT)

    def end(self, error: BaseException | None) -> None: ...


@pytest.mark.parametrize("in_process", [False, True])
def test_an_interrupt_keeps_what_there_is_and_ends_the_experiment(in_process: bool) -> None:
    laboratory = Laboratory(parse(SHORT, "x.toml"), "x", Path(), in_process=in_process)
    experiment = laboratory.run([Impatience(5)])
    first, second = experiment.runs
    assert (first.stopped, first.interrupted) == (None, False)
    assert second.interrupted
    assert second.stopped == f"interrupted at t = {second.time[-1]:g} s"
    # What the other process had computed ahead is kept too.
    assert 0.01 < second.time[-1] <= 1.5
    # In training there is nothing yet to be kept.
    with pytest.raises(KeyboardInterrupt):
        laboratory.run([Impatience(2)])
