"""`wheelset identify`, as a user meets it, on logs of the wheelset FMU."""

from __future__ import annotations

import csv
import json
from typing import TYPE_CHECKING

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from scipy.io import savemat

from co_sim.wheelset.identifying.log_csv import write_log

from .conftest import call

if TYPE_CHECKING:
    from pathlib import Path

    from .conftest import Ride

HEADINGS = [
    "time", "region", "p_linear", "p_peak", "p_unstable", "condition", "p_dry", "p_wet", "p_low",
    "p_very_low",
    "mu_used", "mu_max", "mu_max_low", "mu_max_high", "identifiable", "sensor_status",
]  # fmt: skip


@pytest.fixture
def _quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Filters tuned on a short run: good enough where it does not matter how good they are."""
    monkeypatch.setattr("co_sim.wheelset.identifying.paper._TRAINING", 1.2)


@pytest.fixture
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No figures, where nobody looks at them."""
    monkeypatch.setattr("co_sim.wheelset.identifying.figures.draw", lambda done, folder: [])


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "identification.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert reader.fieldnames == HEADINGS
    return rows


def summary_of(folder: Path) -> dict:
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def paper(ride: Ride, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("paper")
    columns = ride.changed(note=np.arange(len(ride.columns["time"]), dtype=float))
    yaw_rate, acceleration = columns["yaw_rate"].copy(), columns["lateral_acceleration"].copy()
    yaw_rate[2000:2300] = yaw_rate[2000]
    acceleration[[1500, 1700]] = 50.0
    write_log(folder / "ride.csv", columns | {"yaw_rate": yaw_rate, "lateral_acceleration": acceleration})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("co_sim.wheelset.identifying.paper._TRAINING", 3.0)
        assert call("identify", folder / "ride.csv", "--bank", "paper", "--out", folder / "out") == 0
    return folder / "out"


def test_files(paper: Path) -> None:
    assert {p.name for p in paper.iterdir()} == {
        "identification.csv",
        "advice.csv",
        "summary.json",
        "report.html",
        "figures",
    }


def test_rows(paper: Path) -> None:
    rows = rows_of(paper)
    np.testing.assert_allclose(
        [float(row["time"]) for row in rows], 0.01 * np.arange(1, 401) - 1e-3, atol=1e-12
    )
    p = np.array([[float(row[f"p_{name}"]) for name in ("linear", "peak", "unstable")] for row in rows])
    np.testing.assert_allclose(p.sum(axis=1), 1.0, atol=1e-5)
    names = np.array(["linear", "peak", "unstable"])
    assert [row["region"] for row in rows] == names[p.argmax(axis=1)].tolist()
    for row in rows:
        assert not any(row[name] for name in HEADINGS[5:14])  # what this bank cannot say
        assert row["identifiable"] in {"true", "false"}
    assert [row["identifiable"] for row in rows[:40]] == ["false"] * 40
    late = [row["region"] for row in rows[120:] if row["identifiable"] == "true"]
    assert late.count("linear") > 0.9 * len(rows[120:])


def test_faults_stand_in_the_rows_where_they_are(paper: Path) -> None:
    """A row tells the faults since the row before: at 1.509 s that of 1.5 s."""
    rows = {round(float(row["time"]), 3): row["sensor_status"] for row in rows_of(paper)}
    assert rows[1.509] == rows[1.709] == "accelerometer:outlier"
    assert all(rows[round(t, 3)] == "gyro:stuck" for t in np.arange(2.029, 2.3, 0.01))
    assert list(rows.values()).count("ok") == 400 - 2 - 29


def test_the_fuzzy_identifier_has_a_row_for_each_row(adhesion: Path) -> None:
    with (adhesion / "fuzzy.csv").open(encoding="utf-8", newline="") as file:
        fuzzy = list(csv.DictReader(file))
    rows = rows_of(adhesion)
    assert list(fuzzy[0]) == [
        "time", "region", "d_linear", "d_peak", "d_unstable",
        "condition", "d_dry", "d_wet", "d_low", "d_very_low", "d_known", "clear", "advice", "score",
    ]  # fmt: skip
    for said, row in zip(fuzzy, rows, strict=True):
        assert said["time"] == row["time"]
        assert (said["advice"] == "no statement") == (said["score"] == "")
        assert said["score"] == "" or (said["clear"] == "true" and row["identifiable"] == "true")
        for what, names in (("region", HEADINGS[2:5]), ("condition", HEADINGS[6:10])):
            degrees = {name[2:]: float(said[f"d_{name[2:]}"]) for name in names}
            assert all(0.1 - 1e-3 <= degree <= 0.9 + 1e-3 for degree in degrees.values())
            assert degrees[said[what]] == max(degrees.values())
    summary = summary_of(adhesion)["fuzzy"]
    clear = [(said, row) for said, row in zip(fuzzy, rows, strict=True) if said["clear"] == "true"]
    assert summary["clear_share"] == pytest.approx(len(clear) / len(rows))
    same = [said["condition"] == row["condition"] for said, row in clear]
    assert summary["same_condition_share"] == pytest.approx(np.mean(same))
    assert "The fuzzy identifier" in (adhesion / "report.html").read_text(encoding="utf-8")


def test_summary(paper: Path) -> None:
    summary = summary_of(paper)
    assert summary["bank"]["name"] == "paper"
    assert "dry rail" in summary["bank"]["notes"][0]
    assert summary["log"]["rows"] == 4001
    assert summary["log"]["ignored_columns"] == ["note"]
    assert summary["log"]["rate_hz"] == pytest.approx(1000.0)
    assert summary["log"]["traction_torque"]["max"] == pytest.approx(2000.0)
    assert summary["condition_shares"] is summary["adhesion"] is summary["fuzzy"] is None
    assert sum(summary["region_shares"].values()) == pytest.approx(1.0)
    found = {(f["source"], f["fault"]): f["samples"] for f in summary["faults"]}
    assert found.keys() == {("gyro", "stuck"), ("accelerometer", "outlier")}
    assert found["accelerometer", "outlier"] == 2
    assert summary["settings"]["vehicle"]["wheelset"]["m_w"] == 1250.0
    assert summary["usable_share"]["accelerometer"] == pytest.approx(1.0 - 2.0 / 4001.0)


def test_advice_has_a_row_for_each_row(paper: Path) -> None:
    with (paper / "advice.csv").open(encoding="utf-8", newline="") as file:
        advice = list(csv.DictReader(file))
    for said, row in zip(advice, rows_of(paper), strict=True):
        assert said["time"] == row["time"]
        assert (said["advice"] == "no statement") == (row["identifiable"] == "false") == (said["score"] == "")


def test_page_tells_what_was_found(paper: Path) -> None:
    page = (paper / "report.html").read_text(encoding="utf-8")
    for text in (
        "Identification of ride.csv",
        "linear region",
        "assumes dry rail",
        "Gyro, stuck",
        "Accelerometer, outlier",
        "Columns that were not used: note.",
        'src="data:image/png;base64,',
    ):
        assert text in page


@pytest.fixture(scope="module")
def adhesion(ride: Ride, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("adhesion")
    write_log(folder / "ride.csv", ride.columns)
    assert call("identify", folder / "ride.csv", "--out", folder / "out") == 0
    return folder / "out"


def test_rows_of_the_adhesion_bank(adhesion: Path) -> None:
    rows = rows_of(adhesion)
    assert len(rows) == 400
    table = {
        name: np.array([float(row[name]) for row in rows]) for name in HEADINGS if name[:2] in {"p_", "mu"}
    }
    for names in (HEADINGS[2:5], HEADINGS[6:10]):
        np.testing.assert_allclose(sum(table[name] for name in names), 1.0, atol=1e-5)
        likeliest = np.array(names)[np.argmax([table[name] for name in names], axis=0)]
        heading = "region" if names[0] == "p_linear" else "condition"
        assert [row[heading] for row in rows] == [name.removeprefix("p_") for name in likeliest]
    assert (table["mu_max_low"] <= table["mu_max"]).all()
    assert (table["mu_max"] <= table["mu_max_high"]).all()
    # 2 kN m over two wheels of 79.7 kN on a radius of .5 m.
    assert np.median(table["mu_used"][200:]) == pytest.approx(2000.0 / (2.0 * 0.5 * 79.7e3), rel=0.05)
    assert {row["sensor_status"] for row in rows} == {"ok"}
    assert {row["condition"] for row in rows[-100:]} == {"dry"}


def test_page_and_summary_of_the_adhesion_bank(adhesion: Path) -> None:
    summary = summary_of(adhesion)
    assert summary["bank"] == {"name": "adhesion", "notes": []}
    assert summary["condition_shares"]["dry"] > 0.9
    assert summary["adhesion"]["mu_max_median"] == pytest.approx(0.4, rel=0.3)
    assert summary["faults"] == []
    page = (adhesion / "report.html").read_text(encoding="utf-8")
    assert "The rail was most probably dry" in page
    assert "No fault was found in the sensors." in page
    assert {p.stem for p in (adhesion / "figures").iterdir()} == {
        "regions",
        "conditions",
        "adhesion",
        "advice",
        "log",
    }


@pytest.mark.usefixtures("_undrawn")
def test_formats_give_the_same_rows(ride: Ride, tmp_path: Path) -> None:
    short = {name: values[:1500] for name, values in ride.columns.items()}
    parquet.write_table(pyarrow.table(short), tmp_path / "a.parquet")
    savemat(tmp_path / "b.mat", short)
    answers = []
    for name in ("a.parquet", "b.mat"):
        out = tmp_path / name.replace(".", "_")
        assert call("identify", tmp_path / name, "--out", out, "--every", "0.1") == 0
        answers.append((out / "identification.csv").read_bytes())
    assert answers[0] == answers[1]
    assert answers[0].count(b"\n") == 16


@pytest.mark.usefixtures("_undrawn")
def test_speed_option_and_no_torque(ride: Ride, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("time", "yaw_rate", "lateral_acceleration")
    write_log(tmp_path / "a.csv", {name: ride.columns[name][:1500] for name in names})
    log, out = tmp_path / "a.csv", tmp_path / "out"
    assert call("identify", log, "--out", out) == 2
    assert "give a constant with --speed" in capsys.readouterr().err
    assert not out.exists()
    assert call("identify", log, "--out", out, "--speed", 20, "--every", 0.5) == 0
    summary = summary_of(out)
    assert summary["log"]["speed"] == {"min": 20.0, "median": 20.0, "max": 20.0}
    assert summary["log"]["traction_torque"] is None
    assert "no traction torque" in capsys.readouterr().out
    assert "much less is identifiable" in summary["bank"]["notes"][0]


@pytest.mark.usefixtures("_undrawn")
def test_a_vehicle_of_ones_own(log: Path, tmp_path: Path) -> None:
    (tmp_path / "loco.toml").write_text(
        "m_w = 1500\n[patch]\na = 7e-3\n[conditions.dry]\nmu_0 = 0.5\n[unknown]\npatches = [1.0]\n"
        "friction = 0.04\nvehicle = 0.02\n",
        encoding="utf-8",
    )
    arguments = ("--out", tmp_path / "out", "--vehicle", tmp_path / "loco.toml")
    assert call("identify", log, *arguments, "--every", 1.0) == 0
    vehicle = summary_of(tmp_path / "out")["settings"]["vehicle"]
    assert vehicle["wheelset"]["m_w"] == 1500.0
    assert vehicle["wheelset"]["patch"]["a"] == 7e-3
    assert vehicle["conditions"]["dry"] == {"k_A": 1.0, "k_S": 0.4, "mu_0": 0.5, "A": 0.4, "B": 0.6}
    assert vehicle["conditions"]["wet"]["mu_0"] == 0.3
    assert vehicle["unknown"]["bias"] == [1e-3, 0.05]
    assert vehicle["unknown"]["patches"] == [1.0]
    assert vehicle["unknown"]["friction"] == 0.04
    assert vehicle["unknown"]["vehicle"] == 0.02


def test_every_fault_at_once_is_survived(ride: Ride, tmp_path: Path) -> None:
    """Jitter, a gap, holes in all columns, outliers, a stuck gyro, saturation, a bias, from 1970 on."""
    rng = np.random.default_rng(1)
    columns = {name: values.copy() for name, values in ride.columns.items()}
    columns["time"] += 1.7e9 + 1e-4 * rng.uniform(-1.0, 1.0, len(columns["time"]))
    columns["yaw_rate"][500:800] = columns["yaw_rate"][500]
    columns["yaw_rate"][[900, 1000]] = np.nan
    acceleration = columns["lateral_acceleration"]
    acceleration[[1100, 1150]] = [40.0, -1e9]
    acceleration[2000:] += 5.0
    np.clip(acceleration, -1e9, 5.2, out=acceleration)
    acceleration[1200:1210] = np.inf
    columns["speed"][50:60] = columns["traction_torque"][70:90] = np.nan
    kept = np.ones(len(acceleration), dtype=bool)
    kept[1500:1600] = False
    path = tmp_path / "a.parquet"
    parquet.write_table(pyarrow.table({name: values[kept] for name, values in columns.items()}), path)
    assert call("identify", path, "--out", tmp_path / "out") == 0
    rows = rows_of(tmp_path / "out")
    assert all(float(row["time"]) >= 1.7e9 for row in rows)
    assert np.isfinite([[float(row[name]) for name in HEADINGS[2:5]] for row in rows]).all()
    told = {(f["source"], f["fault"]) for f in summary_of(tmp_path / "out")["faults"]}
    assert told >= {
        ("gyro", "dropout"),
        ("gyro", "stuck"),
        ("accelerometer", "dropout"),
        ("accelerometer", "outlier"),
        ("accelerometer", "bias"),
        ("speed", "dropout"),
        ("torque", "dropout"),
        ("clock", "jitter"),
        ("clock", "gap"),
    }


@pytest.mark.usefixtures("_undrawn")
@pytest.mark.parametrize("rate", [100, 400])
def test_slow_loggers(ride: Ride, rate: int, tmp_path: Path) -> None:
    step = 1000 // rate
    write_log(tmp_path / "a.csv", {name: values[::step] for name, values in ride.columns.items()})
    assert call("identify", tmp_path / "a.csv", "--out", tmp_path / "out") == 0
    rows = rows_of(tmp_path / "out")
    assert len(rows) == pytest.approx(400, abs=2)
    trusted = [row["condition"] for row in rows[-200:] if row["identifiable"] == "true"]
    assert set(trusted) == {"dry"}
    assert len(trusted) > 100


@pytest.mark.usefixtures("_undrawn")
def test_at_rest_nothing_is_identifiable(ride: Ride, tmp_path: Path) -> None:
    n = 1000
    rng = np.random.default_rng(1)
    columns = {"time": 1e-3 * np.arange(n), "speed": np.zeros(n), "traction_torque": np.zeros(n)}
    columns |= {"yaw_rate": 1e-3 * rng.normal(size=n), "lateral_acceleration": 0.05 * rng.normal(size=n)}
    write_log(tmp_path / "a.csv", columns)
    assert call("identify", tmp_path / "a.csv", "--out", tmp_path / "out") == 0
    assert {row["identifiable"] for row in rows_of(tmp_path / "out")} == {"false"}
    assert "No row of this log is identifiable" in (tmp_path / "out" / "report.html").read_text("utf-8")


@pytest.mark.usefixtures("_undrawn")
def test_the_packaged_example(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("identify", "example", "--out", tmp_path / "out") == 0
    assert capsys.readouterr().err == ""  # no bar where there is no terminal
    assert (tmp_path / "out" / "log.csv").is_file()
    rows = rows_of(tmp_path / "out")
    for since, until, condition in ((2.0, 8.0, "dry"), (9.5, 16.0, "wet")):
        said = [row["condition"] for row in rows if since < float(row["time"]) < until]
        assert said.count(condition) > 0.95 * len(said)
    found = {(f["source"], f["fault"]): f["samples"] for f in summary_of(tmp_path / "out")["faults"]}
    assert found == {
        ("gyro", "stuck"): pytest.approx(381, abs=3),
        ("accelerometer", "outlier"): 3,
        ("clock", "gap"): 200,
    }


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("mw = 1.0\n", ["loco.toml: mw: got an unknown key", 'did you mean "m_w"?']),
        ("m_w = -1.0\nkw = 1.0\n", ["m_w: got -1.0, expected greater than 0", 'did you mean "k_w"?']),
        (
            "[conditions.damp]\nmu_0 = 0.1\n",
            ["conditions.damp: got an unknown condition, expected one of dry"],
        ),
        ("[conditions.wet]\nmu = 0.1\n", ["conditions.wet.mu: got an unknown key", "mu_0"]),
        ("conditions = 3\n", ["conditions: got 3, expected tables"]),
        (
            "[unknown]\ngyro_bia = 0.0\npatches = []\n",
            ['did you mean "gyro_bias"?', "unknown.patches: got 0 values, expected at least 1"],
        ),
        ("m_w = \n", ["text that is not TOML"]),
    ],
)
def test_faults_of_a_vehicle(
    text: str, told: list[str], log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "loco.toml").write_text(text, encoding="utf-8")
    assert call("identify", log, "--vehicle", tmp_path / "loco.toml", "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert all(line in said for line in told), said
    assert all(line.startswith("error: ") for line in said.splitlines())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--speed", "-1"], "--speed: got -1, expected at least 0 m/s"),
        (["--column", "yaw_rate"], "got no NAME=HEADING"),
        (["--column", "yaw=gyro"], 'got the name "yaw", expected one of time, yaw_rate'),
        (["--column", "yaw_rate=gyro"], "column gyro: got none of this name"),
        (["--vehicle", "none.toml"], "No such file"),
        (["--every", "0"], "--every"),
        (["--every", "10"], "--every: got 10 s, expected from the step of the log"),
        (["--every", "inf"], "--every: got inf s"),
        (["--every", "nan"], "--every: got nan s"),
        (["--every", "0.025"], "--every: got 0.025 s, expected a multiple of 0.01 s"),
        (["--noise", "1e-3"], "--noise"),
        (["--bank", "best"], "--bank"),
    ],
)
def test_faults_of_the_command(
    arguments: list[str], told: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("identify", log, "--out", tmp_path / "out", *arguments) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_log_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("time,speed\n1,2\n", encoding="utf-8")
    assert call("identify", tmp_path / "a.csv", "--out", tmp_path / "out") == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": got")[0] for line in lines] == [
        "error: a.csv: column yaw_rate",
        "error: a.csv: column lateral_acceleration",
    ]
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_the_paper_needs_a_wheelset_that_runs(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("identify", log, "--bank", "paper", "--speed", 0, "--out", tmp_path / "out") == 2
    assert "needs a wheelset that runs" in capsys.readouterr().err


@pytest.mark.usefixtures("_quickly", "_undrawn")
def test_varying_speed_is_warned_about(ride: Ride, tmp_path: Path) -> None:
    time = ride.columns["time"]
    write_log(tmp_path / "a.csv", ride.changed(speed=15.0 + 2.5 * time))
    assert call("identify", tmp_path / "a.csv", "--bank", "paper", "--out", tmp_path / "out") == 0
    assert "designed for one speed" in summary_of(tmp_path / "out")["bank"]["notes"][1]
    rows = rows_of(tmp_path / "out")
    assert {row["identifiable"] for row in rows if float(row["time"]) > 3.0} == {"false"}
