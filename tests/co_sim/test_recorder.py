import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from co_sim import FunctionComponent, InputError, Master, Port, Recorder, System, write_runs_csv


def clock(*names):
    """A component whose outputs are the time and its multiples."""
    ports = [Port(name, "s") for name in names]
    return FunctionComponent(lambda t, u: [t * (i + 1) for i in range(len(names))], outputs=ports)


def record(recorder, n_steps=10, h=0.5, system=None):
    with Master(
        system or System({"a": clock("x", "y"), "b": clock("x")}), h=h, observers=[recorder]
    ) as master:
        master.run(n_steps=n_steps)
    return recorder


def test_by_default_everything_is_recorded():
    recorder = record(Recorder())
    assert recorder.names == ("a.x", "a.y", "b.x")
    assert recorder.units == ("s", "s", "s")
    np.testing.assert_array_equal(recorder.time, 0.5 * np.arange(11))
    np.testing.assert_array_equal(recorder["a.y"], recorder.time * 2)
    assert recorder.table.shape == (11, 3)


@pytest.mark.parametrize(
    ("patterns", "names"),
    [
        (["a.*"], ("a.x", "a.y")),
        (["*.x"], ("a.x", "b.x")),
        (["b.x", "a.y"], ("a.y", "b.x")),
        (["a.?", "a.x"], ("a.x", "a.y")),
        ([], ()),
    ],
)
def test_patterns_choose_signals_in_the_order_of_the_system(patterns, names):
    recorder = record(Recorder(patterns))
    assert recorder.names == names
    assert recorder.table.shape == (11, len(names))


def test_a_pattern_without_a_match_is_refused():
    with pytest.raises(InputError, match=r'pattern "a.xx": got no match.*did you mean "a.x"'):
        record(Recorder(["a.*", "a.xx"]))


@given(every=st.integers(1, 15), n_steps=st.integers(0, 30))
def test_decimation_keeps_every_nth_row_of_the_full_record(every, n_steps):
    full = record(Recorder(), n_steps)
    some = record(Recorder(every=every), n_steps)
    np.testing.assert_array_equal(some.time, full.time[::every])
    np.testing.assert_array_equal(some.table, full.table[::every])


def test_every_must_be_positive():
    with pytest.raises(InputError, match="every: got 0"):
        Recorder(every=0)


def test_an_unknown_signal_comes_with_a_suggestion():
    with pytest.raises(KeyError, match=r"did you mean \"a.x\""):
        record(Recorder(["a.*"]))["a.xx"]


def test_a_new_run_replaces_the_record():
    recorder = record(Recorder(), n_steps=10)
    first = recorder.time
    record(recorder, n_steps=3)
    assert len(first) == 11
    assert len(recorder.time) == 4


def read(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def test_csv_round_trip(tmp_path):
    rng = np.random.default_rng(1)
    values = rng.standard_normal((2501, 3)) * 10.0 ** rng.integers(-12, 12, (2501, 3))
    noise = FunctionComponent(
        lambda t, u: values[round(t)], outputs=[Port("x", "m"), Port("v", "m/s"), Port("n", "")]
    )
    recorder = record(Recorder(), 2500, 1.0, System({"a": noise}))
    path = tmp_path / "run.csv"
    recorder.write_csv(path)
    header, *lines = read(path)
    assert header == ["time [s]", "a.x [m]", "a.v [m/s]", "a.n [1]"]
    table = np.array(lines, dtype=float)
    np.testing.assert_array_equal(table[:, 0], recorder.time)
    np.testing.assert_allclose(table[:, 1:], values, rtol=5e-9)
    assert list(tmp_path.iterdir()) == [path]


def test_names_with_commas_survive_the_header(tmp_path):
    recorder = record(Recorder(), system=System({"a": clock("x[1,2]")}))
    recorder.write_csv(tmp_path / "run.csv")
    assert read(tmp_path / "run.csv")[0] == ["time [s]", "a.x[1,2] [s]"]


def test_csv_into_a_missing_folder_is_refused(tmp_path):
    recorder = record(Recorder())
    with pytest.raises(InputError, match="an existing folder"):
        recorder.write_csv(tmp_path / "none" / "run.csv")


def test_runs_lie_below_each_other_under_their_names(tmp_path):
    runs = {"P1": record(Recorder(), 2), "100 %, wet": record(Recorder(), 1)}
    path = tmp_path / "runs.csv"
    write_runs_csv(path, runs)
    header, *lines = read(path)
    assert header == ["run", "time [s]", "a.x [s]", "a.y [s]", "b.x [s]"]
    assert [line[0] for line in lines] == ["P1"] * 3 + ["100 %, wet"] * 2
    table = np.array([line[1:] for line in lines], dtype=float)
    expected = np.vstack([np.column_stack([run.time, run.table]) for run in runs.values()])
    np.testing.assert_array_equal(table, expected)


def test_runs_of_different_signals_do_not_share_a_file(tmp_path):
    runs = {"a": record(Recorder(["a.*"])), "b": record(Recorder(["b.*"]))}
    with pytest.raises(InputError, match="2 different sets of signals"):
        write_runs_csv(tmp_path / "runs.csv", runs)
    with pytest.raises(InputError, match="0 different sets of signals"):
        write_runs_csv(tmp_path / "runs.csv", {})
    assert list(tmp_path.iterdir()) == []
