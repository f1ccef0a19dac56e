"""What all writers of files have in common, and each of them read back with a reader of its own."""

import csv

import numpy as np
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat

from co_sim import CsvWriter, InputError, MatWriter, ParquetWriter, Recorder, RunError, Signal, write_runs_csv
from co_sim.observers import mat_file, parquet_file
from co_sim.observers.mat_file import matlab_names
from co_sim.texts import number_of

SIGNALS = [
    Signal("plant.x[1,2]", "m", "offset of the axle"),
    Signal("plant.left.slip", "1", "creep"),
    Signal("ctrl.count", "1", kind="int32"),
    Signal("ctrl.on", "1", kind="boolean"),
    Signal("ctrl.state", "1", "what it does", kind="string"),
]
STATES = ["coasting", 'says "go", twice', "äöü %s\nline"]
WRITERS = {"csv": CsvWriter, "mat": MatWriter, "parquet": ParquetWriter}


def table(n, seed=0):
    rng = np.random.default_rng(seed)
    values = np.empty((n, len(SIGNALS)))
    values[:, :2] = rng.standard_normal((n, 2)) * 10.0 ** rng.integers(-300, 300, (n, 2))
    values[: n // 3, 1] = [[np.nan, np.inf, -np.inf, -0.0][i % 4] for i in range(n // 3)]
    values[:, 2] = rng.integers(-(2**31), 2**31, n)
    values[:, 3] = rng.integers(0, 2, n)
    values[:, 4] = [number_of(STATES[i % 3]) for i in range(n)]
    return values


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        header, *lines = csv.reader(file)
    columns = list(zip(*lines, strict=True)) or [()] * len(header)
    return {
        title.rpartition(" [")[0]: np.array(column, dtype=object if title.startswith("ctrl.state") else float)
        for title, column in zip(header, columns, strict=True)
    }


def read_mat(path):
    data = loadmat(path, simplify_cells=True)
    read = {"time": np.atleast_1d(data["time"])}
    for component, fields in data["names"].items():
        for field, name in fields.items():
            read[name] = np.atleast_1d(data[component][field])
    return read


def read_parquet(path):
    data = pyarrow.parquet.read_table(path)
    return {name: data[name].to_numpy() for name in data.column_names}


READERS = {"csv": read_csv, "mat": read_mat, "parquet": read_parquet}


def exact(kind, path, *args):
    return CsvWriter(path, *args, digits=17) if kind == "csv" else WRITERS[kind](path, *args)


@pytest.fixture(params=WRITERS)
def kind(request):
    return request.param


@given(
    sizes=st.lists(st.integers(1, 9), min_size=1, max_size=5),
    every=st.integers(1, 6),
    n=st.integers(1, 30),
)
@settings(max_examples=30, deadline=None)
@pytest.mark.parametrize("kind", WRITERS)
def test_files_hold_the_run_to_the_bit_however_it_is_cut(drive, tmp_path_factory, kind, sizes, every, n):
    path = tmp_path_factory.getbasetemp() / f"cut.{kind}"
    values, recorder = table(n), Recorder(every=every)
    drive([exact(kind, path, "*", every), recorder], SIGNALS, values, t0=0.1, h=0.1, sizes=sizes)
    read = READERS[kind](path)
    assert list(read) == ["time", *recorder.names]
    np.testing.assert_array_equal(read["time"], recorder.time)
    for name in recorder.names:
        np.testing.assert_array_equal(read[name], recorder[name])
    assert not path.with_name(f"cut.partial.{kind}").exists()


def test_only_chosen_signals_are_written(drive, tmp_path, kind):
    path = tmp_path / f"run.{kind}"
    drive([exact(kind, path, ["plant.x[*]", "ctrl.*", "!*.count"])], SIGNALS, table(5), sizes=(2,))
    assert list(READERS[kind](path)) == ["time", "plant.x[1,2]", "ctrl.on", "ctrl.state"]


def test_a_run_that_fails_keeps_what_it_has_computed_under_another_name(drive, tmp_path, kind):
    path, partial = tmp_path / f"run.{kind}", tmp_path / f"run.partial.{kind}"
    drive([exact(kind, path)], SIGNALS, table(3))
    before = path.read_bytes()
    error = RunError("plant", time=3.0, step=6, reason="it broke")
    drive([exact(kind, path)], SIGNALS, table(7, seed=1), sizes=(3,), n_steps=100, error=error)
    assert path.read_bytes() == before
    read = READERS[kind](partial)
    np.testing.assert_array_equal(read["time"], 0.5 * np.arange(7))
    np.testing.assert_array_equal(read["plant.x[1,2]"], table(7, seed=1)[:, 0])
    assert error.__notes__ == [f"{partial} holds the values up to t = 3 s"]
    drive([exact(kind, path)], SIGNALS, table(4))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_run_that_fails_before_its_first_row_leaves_no_file(drive, tmp_path, kind):
    path, error = tmp_path / f"run.{kind}", RuntimeError("no start")
    writer = exact(kind, path)
    drive([writer], SIGNALS, table(2))
    drive([writer], SIGNALS, table(0), n_steps=5, error=error)
    assert list(tmp_path.iterdir()) == [path]
    assert not hasattr(error, "__notes__")


def test_a_pattern_or_folder_that_is_not_there_is_refused_before_anything_is_written(drive, tmp_path, kind):
    with pytest.raises(InputError, match="did you mean"):
        drive([exact(kind, tmp_path / "run", ["plnt.*"])], SIGNALS, table(2))
    with pytest.raises(InputError, match="an existing folder"):
        drive([exact(kind, tmp_path / "none" / "run")], SIGNALS, table(2))
    with pytest.raises(InputError, match="expected a file"):
        drive([exact(kind, tmp_path)], SIGNALS, table(2))
    with pytest.raises(InputError, match="every: got 0"):
        exact(kind, tmp_path / "run", "*", 0)
    assert list(tmp_path.iterdir()) == []


def test_a_second_failure_while_closing_does_not_hide_the_first(drive, tmp_path, monkeypatch):
    writer = CsvWriter(tmp_path / "run.csv")

    close = writer._close

    def full_disk(error):
        close(error)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writer, "_close", full_disk)
    error = RuntimeError("first")
    drive([writer], SIGNALS, table(2), error=error)
    assert "No space left" in error.__notes__[0]
    with pytest.raises(OSError, match="No space left"):
        drive([writer], SIGNALS, table(2))
    assert not (tmp_path / "run.csv").exists()


def test_csv_has_units_and_digits_as_asked(drive, tmp_path):
    signals = [Signal("a.x", "m/s"), Signal("a.n", "1", kind="int64")]
    values = [[1 / 3, 2**53], [-0.1, -1]]
    lines = {}
    for digits in (4, 17):
        drive([CsvWriter(tmp_path / "run.csv", digits=digits)], signals, values, t0=0.2, h=0.1)
        lines[digits] = (tmp_path / "run.csv").read_text().splitlines()
    assert lines[4] == ["time [s],a.x [m/s],a.n [1]", "0.2,0.3333,9007199254740992", "0.3,-0.1,-1"]
    assert lines[17][2] == "0.30000000000000004,-0.10000000000000001,-1"
    with pytest.raises(InputError, match="digits: got 18"):
        CsvWriter(tmp_path / "run.csv", digits=18)


def test_csv_is_on_disk_while_the_run_goes_on(tmp_path):
    writer = CsvWriter(tmp_path / "run.csv")
    signals = (Signal("a.x", "1"),)
    writer.begin(signals, 0.0, 1.0, 10**9)
    for k in range(0, 5000, 500):
        writer.observe(k, np.arange(k, k + 500.0), np.ones((500, 1)))
    assert writer.partial_path.stat().st_size > 20_000
    writer.end(KeyboardInterrupt())
    assert len(writer.partial_path.read_text().splitlines()) == 5001


def test_texts_survive_several_runs_in_one_file(drive, tmp_path):
    runs = {"100 %": Recorder("ctrl.state"), "b": Recorder("ctrl.state")}
    for recorder in runs.values():
        drive([recorder], SIGNALS, table(3))
    recorder.write_csv(tmp_path / "one.csv")
    write_runs_csv(tmp_path / "runs.csv", runs)
    assert read_csv(tmp_path / "one.csv")["ctrl.state"].tolist() == STATES
    with (tmp_path / "runs.csv").open(encoding="utf-8", newline="") as file:
        assert [line[2] for line in csv.reader(file)] == ["ctrl.state [1]", *STATES, *STATES]


def test_mat_has_structs_of_types_units_and_descriptions(drive, tmp_path):
    drive([MatWriter(tmp_path / "run.mat", compress=True)], SIGNALS, table(4))
    data = loadmat(tmp_path / "run.mat", simplify_cells=True)
    assert data["plant"]["x_1_2"].dtype == np.float64
    assert data["ctrl"]["count"].dtype == np.int32
    assert loadmat(tmp_path / "run.mat", mat_dtype=True)["ctrl"]["on"][0, 0].dtype == np.bool_
    assert loadmat(tmp_path / "run.mat")["time"].shape == (4, 1)
    assert data["names"]["plant"]["left_slip"] == "plant.left.slip"
    assert data["units"]["plant"] == {"x_1_2": "m", "left_slip": "1"}
    assert data["descriptions"]["ctrl"]["state"] == "what it does"


def test_mat_of_a_failed_run_has_the_reason(drive, tmp_path):
    drive([MatWriter(tmp_path / "run.mat")], SIGNALS, table(4), error=RuntimeError("it broke"))
    assert loadmat(tmp_path / "run.partial.mat", simplify_cells=True)["stopped"] == "it broke"


def test_mat_keeps_a_whole_number_that_is_none_as_it_is(drive, tmp_path):
    drive([MatWriter(tmp_path / "run.mat", "*.count")], SIGNALS, np.full((2, 5), 0.5))
    assert read_mat(tmp_path / "run.mat")["ctrl.count"].tolist() == [0.5, 0.5]


def test_mat_of_components_named_as_our_variables(drive, tmp_path):
    signals = [
        Signal("time.x", "1"),
        Signal("end.for", "1"),
        Signal("time.x[1]", "1"),
        Signal("time.x_1", "1"),
    ]
    drive([MatWriter(tmp_path / "run.mat")], signals, [[1.0, 2.0, 3.0, 4.0]] * 2)
    read = read_mat(tmp_path / "run.mat")
    assert read["time"].tolist() == [0.0, 0.5]
    assert "end" not in loadmat(tmp_path / "run.mat")
    assert {name: values[0] for name, values in read.items() if name != "time"} == {
        "time.x": 1.0,
        "end.for": 2.0,
        "time.x[1]": 3.0,
        "time.x_1": 4.0,
    }


@given(st.lists(st.text(max_size=80), unique=True, max_size=20))
@settings(deadline=None)
def test_matlab_names_are_valid_and_different(names):
    valid = matlab_names(names, taken=["time"])
    assert len({*valid, "time"}) == len(names) + 1
    for name in valid:
        assert name.isascii()
        assert name.isidentifier()
        assert name[0] != "_"
        assert len(name) <= 63
        assert name not in {"end", "for", "if"}


def test_mat_beyond_2_gb_is_refused_before_the_run(tmp_path):
    writer = MatWriter(tmp_path / "run.mat")
    with pytest.raises(InputError, match=r'got 4 GB of signals of "plant".*ParquetWriter'):
        writer.begin(tuple(SIGNALS), 0.0, 1e-3, 250_000_000)
    assert list(tmp_path.iterdir()) == []


def test_mat_limit_is_not_reached_by_what_is_allowed(drive, tmp_path, monkeypatch):
    """The estimate of the size is on the safe side of the size of the file."""
    n = 50
    drive([MatWriter(tmp_path / "run.mat", ["plant.*"])], SIGNALS, table(n))
    size = (tmp_path / "run.mat").stat().st_size - 8 * n
    monkeypatch.setattr(mat_file, "_LIMIT", 2 * 8 * n + 2 * mat_file._FIELD - 1)
    with pytest.raises(InputError):
        MatWriter(tmp_path / "run.mat", ["plant.*"]).begin(tuple(SIGNALS), 0.0, 1.0, n - 1)
    assert size < 2 * 8 * n + 10 * mat_file._FIELD


def test_parquet_has_types_units_and_row_groups(drive, tmp_path, monkeypatch):
    monkeypatch.setattr(parquet_file, "_GROUP_VALUES", 60)
    drive([ParquetWriter(tmp_path / "run.parquet")], SIGNALS, table(35), sizes=(23, 1))
    file = pyarrow.parquet.ParquetFile(tmp_path / "run.parquet")
    groups = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    assert groups == [10, 10, 10, 5]
    schema = file.schema_arrow
    assert [str(field.type) for field in schema] == ["double", "double", "double", "int32", "bool", "string"]
    assert schema.field("plant.x[1,2]").metadata[b"unit"] == b"m"
    assert schema.field("plant.x[1,2]").metadata[b"description"] == b"offset of the axle"
    assert schema.field("time").metadata[b"unit"] == b"s"


def test_parquet_of_a_failed_run_has_the_reason(drive, tmp_path):
    drive([ParquetWriter(tmp_path / "run.parquet")], SIGNALS, table(4), error=RuntimeError("it broke"))
    metadata = pyarrow.parquet.read_metadata(tmp_path / "run.partial.parquet").metadata
    assert metadata[b"stopped"] == b"it broke"


@pytest.mark.parametrize(
    ("column", "value"), [(2, 0.5), (2, 2.0**31), (2, -(2.0**31) - 1), (2, np.nan), (3, 2.0), (3, np.inf)]
)
def test_parquet_does_not_round_a_whole_number_and_keeps_the_rows_before(tmp_path, column, value):
    writer, values = ParquetWriter(tmp_path / "run.parquet"), table(3)
    writer.begin(tuple(SIGNALS), 0.0, 1.0, 2)
    writer.observe(0, np.arange(2.0), values[:2])
    values[2, column] = value
    with pytest.raises(ValueError, match=rf"{SIGNALS[column].name} = .* is no value of kind") as caught:
        writer.observe(2, np.array([2.0]), values[2:])
    writer.end(caught.value)
    assert read_parquet(writer.partial_path)["time"].tolist() == [0.0, 1.0]
    assert "up to t = 1 s" in caught.value.__notes__[0]


@pytest.mark.parametrize("compression", ["none", "zstd", "snappy", "gzip", "lz4", "brotli"])
def test_parquet_compressions(drive, tmp_path, compression):
    path = tmp_path / "run.parquet"
    drive([ParquetWriter(path, "plant.*", compression=compression)], SIGNALS, table(4))
    np.testing.assert_array_equal(read_parquet(path)["plant.left.slip"], table(4)[:, 1])


def test_parquet_refuses_what_it_cannot_do_before_the_run(monkeypatch, tmp_path):
    with pytest.raises(InputError, match='compression: got "rar"'):
        ParquetWriter(tmp_path / "run.parquet", compression="rar")
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"no pyarrow.*wheelset-cosim\[parquet\]"):
        ParquetWriter(tmp_path / "run.parquet")
