"""Logs in all formats come out equal, and what is wrong in a file is told in one sentence."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import pyarrow
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet
from scipy.io import savemat

from co_sim.errors import InputError
from co_sim.wheelset.identifying.log_file import read_columns

if TYPE_CHECKING:
    from pathlib import Path

    from co_sim.wheelset.identifying.table import Columns

HEAD = "time,yaw_rate,lateral_acceleration,speed,traction_torque"


def read(path: Path, **renamed: str) -> Columns:
    return read_columns(path, renamed=renamed)


def from_text(folder: Path, text: str | bytes, name: str = "a.csv", **renamed: str) -> Columns:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read(path, **renamed)


@pytest.fixture(params=["arrow", "numpy"])
def both(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """With and without pyarrow."""
    if request.param == "numpy":
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    return str(request.param)


@pytest.fixture
def numbers() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([1e-3 * np.arange(300), rng.normal(size=(300, 4)) * [1e-3, 0.05, 30.0, 1e3]])


def exact(table: np.ndarray) -> str:
    return "\n".join([HEAD, *(",".join(map(repr, row)) for row in table.tolist())]) + "\n"


def test_every_number_comes_back_to_the_bit(both: str, numbers: np.ndarray, tmp_path: Path) -> None:
    columns = from_text(tmp_path, exact(numbers))
    for i, name in enumerate(HEAD.split(",")):
        np.testing.assert_array_equal(columns.values[name], numbers[:, i])
    assert columns.ignored == columns.notes == ()


def test_formats_are_equal(numbers: np.ndarray, tmp_path: Path) -> None:
    names = HEAD.split(",")
    data = {name: numbers[:, i] for i, name in enumerate(names)}
    parquet.write_table(pyarrow.table(data), tmp_path / "a.parquet")
    savemat(tmp_path / "flat.mat", data)
    savemat(tmp_path / "column.mat", {k: v[:, None] for k, v in data.items()})
    savemat(tmp_path / "struct.mat", {"ride": data})
    expected = from_text(tmp_path, exact(numbers)).values
    for name in ("a.parquet", "flat.mat", "column.mat", "struct.mat"):
        values = read(tmp_path / name).values
        assert values.keys() == expected.keys()
        for key, column in expected.items():
            np.testing.assert_array_equal(values[key], column, err_msg=f"{name} {key}")


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + HEAD + "\r\n0,1,2,3,4\r\n1,5,6,7,8\r\n",
        "# logger 7\n\n" + HEAD + "\n0,1,2,3,4\n1,5,6,7,8",
        HEAD.replace(",", ";") + "\n0;1;2;3;4\n1;5;6;7;8\n",
        HEAD.replace(",", "\t") + "\n0\t1\t2\t3\t4\n1\t5\t6\t7\t8\n",
        HEAD.replace(",", ";") + "\n0,0;1,0;2,0;3,0;4,0\n1,0;5,0;6,0;7,0;8,0\n",
        '"time", "yaw_rate", "lateral_acceleration", "speed", "traction_torque"\n0,1,2,3,4\n1,5,6,7,8\n',
        "speed,yaw_rate,time,traction_torque,lateral_acceleration\n3,1,0,4,2\n7,5,1,8,6\n",
        HEAD + "\n0,1,2,3,4\n\n1,5,6,7,8\n\n",
    ],
    ids=["bom-crlf", "comment", "semicolon", "tab", "decimal-comma", "quotes", "order", "empty-lines"],
)
def test_dialects(both: str, text: str, tmp_path: Path) -> None:
    values = from_text(tmp_path, text).values
    table = [values[name].tolist() for name in HEAD.split(",")]
    assert table == [[0.0, 1.0], [1.0, 5.0], [2.0, 6.0], [3.0, 7.0], [4.0, 8.0]]


@pytest.mark.parametrize("mark", ["", "nan", "NaN", "NA", "n/a", "null", "--", " "])
def test_missing_values(both: str, mark: str, tmp_path: Path) -> None:
    rows = f"0,{mark},2,3,4\n1,5,{mark},7,{mark}\n"
    values = from_text(tmp_path, f"{HEAD}\n{rows}").values
    np.testing.assert_array_equal(values["yaw_rate"], [np.nan, 5.0])
    np.testing.assert_array_equal(values["lateral_acceleration"], [2.0, np.nan])
    np.testing.assert_array_equal(values["traction_torque"], [4.0, np.nan])


def test_other_columns_are_named_and_may_hold_anything(both: str, tmp_path: Path) -> None:
    columns = from_text(tmp_path, f"note,{HEAD},gps\nstart,0,1,2,3,4,N52\n,1,5,6,7,8,\n")
    assert columns.ignored == ("note", "gps")
    assert columns.values["speed"].tolist() == [3.0, 7.0]


def test_units_in_headings(tmp_path: Path) -> None:
    head = "time [ms],yaw_rate [deg/s],lateral_acceleration (m/s^2),speed [km/h],traction_torque [kN.m]"
    columns = from_text(tmp_path, f"{head}\n1,180,2,36,4\n2,180,2,36,4\n")
    first = {name: values[0] for name, values in columns.values.items()}
    assert first == pytest.approx(
        {
            "time": 1e-3,
            "yaw_rate": np.pi,
            "lateral_acceleration": 2.0,
            "speed": 10.0,
            "traction_torque": 4000.0,
        }
    )
    assert [note.split(" was")[0] for note in columns.notes] == [
        "time [ms]",
        "yaw_rate [deg/s]",
        "speed [km/h]",
        "traction_torque [kN.m]",
    ]


def test_units_of_parquet_fields(tmp_path: Path) -> None:
    fields = [pyarrow.field(name, "double") for name in HEAD.split(",")]
    fields[3] = pyarrow.field("speed", "double", metadata={"unit": "km/h"})
    table = pyarrow.table([[1.0, None]] * 5, schema=pyarrow.schema(fields))
    parquet.write_table(table, tmp_path / "a.parquet")
    np.testing.assert_allclose(read(tmp_path / "a.parquet").values["speed"], [1.0 / 3.6, np.nan])


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("time,yaw_rate,lateral_acceleration,speed [kg]", 'the unit "kg"'),
        ("time,yaw_rate,lateral_acceleration,speed [furlongz]", 'the unit "furlongz"'),
    ],
)
def test_units_of_something_else(head: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        from_text(tmp_path, f"{head}\n1,2,3,4\n")


def test_a_last_line_that_broke_off(both: str, tmp_path: Path) -> None:
    columns = from_text(tmp_path, f"{HEAD}\n0,1,2,3,4\n1,5,6,7,8\n2,9,1")
    assert columns.values["time"].tolist() == [0.0, 1.0]
    assert columns.notes == ("The last line broke off and was left out.",)


def test_names_with_a_prefix_and_names_of_ones_own(tmp_path: Path) -> None:
    head = "time,sensors.yaw_rate,plant.speed,a_y,b_y"
    columns = from_text(tmp_path, f"{head}\n0,1,2,3,4\n1,1,2,3,4\n", lateral_acceleration="b_y")
    assert columns.values["lateral_acceleration"].tolist() == [4.0, 4.0]
    assert columns.ignored == ("a_y",)
    assert "traction_torque" not in columns.values


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "got an empty file, expected a heading line"),
        ("\n \n", "got an empty file"),
        ("0,1,2,3,4\n1,2,3,4,5\n", "line 1: got numbers, expected the names of the columns"),
        (HEAD + "\n", "got no rows"),
        (HEAD, "got no rows"),
        (HEAD.encode("utf-16"), "got text in UTF-16"),
        (HEAD + "\n0,1,2,3,4\n1,2,abc,4,5\n2,2,2,2,2\n", "line 3, column lateral_acceleration: got 'abc'"),
        (HEAD + "\n0,1,2,3,4\n1,2\n2,2,2,2,2\n", "line 3: got 2 columns, expected 5"),
        ("time,yawrate,lateral_acceleration,speed\n", 'column yaw_rate: got none .* mean "yawrate"'),
        ("time,yaw_rate,lateral_acceleration\n", "give a constant with --speed"),
        ("time,a.yaw_rate,b.yaw_rate,lateral_acceleration,speed\n", "got 2: a.yaw_rate, b.yaw_rate"),
        ("time,time,yaw_rate,lateral_acceleration,speed\n", "column time: got 2"),
    ],
)
def test_faults_of_texts(both: str, text: str | bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        from_text(tmp_path, text)


def test_all_missing_columns_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        from_text(tmp_path, "t,gyro,speed\n0,1,2\n")
    told = [fault.what for fault in caught.value.faults]
    assert told == [f"a.csv: column {name}" for name in ("time", "yaw_rate", "lateral_acceleration")]


def test_other_files(tmp_path: Path) -> None:
    (tmp_path / "a.xlsx").write_bytes(b"")
    (tmp_path / "a.parquet").write_bytes(b"no parquet at all")
    (tmp_path / "a.mat").write_bytes(b"no matlab" * 100)
    (tmp_path / "b.mat").write_bytes(
        b"MATLAB 7.3 MAT-file, Platform".ljust(124) + b"\x00\x02IM" + b"\0" * 100
    )
    savemat(
        tmp_path / "c.mat",
        {"time": [1.0, 2.0], "yaw_rate": [1.0], "lateral_acceleration": [1.0], "speed": [1.0]},
    )
    savemat(
        tmp_path / "d.mat",
        {"time": np.eye(2), "yaw_rate": [1.0], "lateral_acceleration": [1.0], "speed": [1.0]},
    )
    for name, said in {
        "none.csv": "no such file",
        "a.xlsx": 'the ending ".xlsx"',
        "a.parquet": "expected a Parquet file",
        "a.mat": "expected a MATLAB file",
        "b.mat": r"HDF5.*-v7",
        "c.mat": "variables of one length",
        "d.mat": r"shape \(2, 2\)",
    }.items():
        with pytest.raises(InputError, match=said):
            read(tmp_path / name)


@pytest.mark.parametrize("compressed", [False, True])
def test_files_that_broke_off(compressed: bool, numbers: np.ndarray, tmp_path: Path) -> None:
    data = {name: numbers[:, i] for i, name in enumerate(HEAD.split(","))}
    savemat(tmp_path / "whole.mat", data, do_compression=compressed)
    parquet.write_table(pyarrow.table(data), tmp_path / "whole.parquet")
    for whole in (tmp_path / "whole.mat", tmp_path / "whole.parquet"):
        content = whole.read_bytes()
        for length in np.linspace(0, len(content) - 1, 50).astype(int):
            (tmp_path / f"part{whole.suffix}").write_bytes(content[:length])
            with pytest.raises(InputError):
                read(tmp_path / f"part{whole.suffix}")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_spoilt_text_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    text = "\n".join([HEAD, *(f"{k}e-3,1e-3,.05,20,1e3" for k in range(20))]).encode()
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        put = data.draw(
            st.sampled_from([b",", b";", b"\n", b'"', b"\0", b"\xff", b"#", b" ", b"1e999", b"x", b""])
        )
        text = text[:at] + put + text[at + data.draw(st.integers(0, 3)) :]
    try:
        columns = from_text(tmp_path, text)
    except InputError:
        return
    assert len({values.size for values in columns.values.values()}) == 1


def test_parquet_without_pyarrow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.parquet").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'wheelset-cosim\[parquet\]'"):
        read(tmp_path / "a.parquet")


def test_parquet_of_texts(tmp_path: Path) -> None:
    data = {name: ["1", "2"] for name in HEAD.split(",")}
    parquet.write_table(pyarrow.table(data), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="column time: got string, expected numbers"):
        read(tmp_path / "a.parquet")
