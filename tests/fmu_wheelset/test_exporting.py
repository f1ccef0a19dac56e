"""Exported FMUs: they behave as their XML says, for a tool that sets nothing."""

from __future__ import annotations

import copy
import math
import struct
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from hypothesis import given
from hypothesis import strategies as st

import fmu_wheelset
from fmu_wheelset.exporting import read_start_values
from fmu_wheelset.variables import REFERENCES, VARIABLES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    MakePlant = Callable[..., Any]

both = pytest.mark.parametrize("fmi", [2, 3])

TOML = """
m_w = 1500
drive_mode = "torque_driven"
forward_dynamics = true
speed = 12.5
traction_torque = 2500.0
lateral_displacement = -0.001
patch.a = 7.1e-3
[rail_left]
mu_0 = 0.1
"""
AS_SET = {
    "m_w": 1500.0,
    "drive_mode": DriveMode.TORQUE_DRIVEN,
    "forward_dynamics": True,
    "speed": 12.5,
    "traction_torque": 2500.0,
    "lateral_displacement": -1e-3,
    "patch.a": 7.1e-3,
    "rail_left.mu_0": 0.1,
}
OUTPUTS = [v.name for v in VARIABLES if v.causality == "output"]


@pytest.fixture
def exported(tmp_path: Path) -> Callable[[int], Path]:
    def make(fmi: int) -> Path:
        parameters = tmp_path / "mine.toml"
        parameters.write_text(TOML, encoding="utf-8")
        start_values = read_start_values(parameters)
        return fmu_wheelset.export(tmp_path / f"mine{fmi}.fmu", fmi, start_values)

    return make


def simulated(archive: Path, **start_values: Any) -> np.ndarray:
    rows = simulate_fmu(
        str(archive), stop_time=0.2, output_interval=1e-2, output=OUTPUTS, start_values=start_values
    )
    return np.array(rows.tolist())


@both
def test_exported_fmu_runs_as_the_packaged_one_with_these_values_set(
    exported: Callable[[int], Path], fmi: int
) -> None:
    found = simulated(exported(fmi))
    np.testing.assert_array_equal(found, simulated(fmu_wheelset.path(fmi), **AS_SET))
    assert not np.array_equal(found, simulated(fmu_wheelset.path(fmi)))


@both
def test_exported_description_is_valid_and_differs_in_start_values_only(
    exported: Callable[[int], Path], fmi: int
) -> None:
    archive = exported(fmi)
    assert validate_fmu(str(archive)) == []
    packaged = read_model_description(str(fmu_wheelset.path(fmi)))
    changed = {}
    for mine, theirs in zip(
        read_model_description(str(archive)).modelVariables, packaged.modelVariables, strict=True
    ):
        for fact in ("name", "valueReference", "causality", "unit", "min", "max", "nominal", "description"):
            assert getattr(mine, fact) == getattr(theirs, fact)
        if mine.start != theirs.start:
            changed[mine.name] = float({"true": 1, "false": 0}.get(mine.start, mine.start))
    assert changed == AS_SET


@both
def test_without_start_values_it_is_the_packaged_archive(tmp_path: Path, fmi: int) -> None:
    packaged = fmu_wheelset.path(fmi).read_bytes()
    plain = fmu_wheelset.export(tmp_path / "plain.fmu", fmi)
    assert plain.read_bytes() == packaged
    same = fmu_wheelset.export(tmp_path / "same.fmu", fmi, {"m_w": VARIABLES[REFERENCES["m_w"]].start})
    assert same.read_bytes() == packaged


# The token -------------------------------------------------------------------------------------------


def bits(value: float) -> str:
    return struct.pack(">d", value).hex()


@pytest.fixture
def with_token(plant: MakePlant, extracted: Any) -> Callable[[int, str], Any]:
    """Make an instance with something behind the token of the sources."""

    def make(fmi: int, behind: str) -> Any:
        folder, original = extracted[fmi]
        description = copy.copy(original)
        description.guid = original.guid + behind
        extracted[fmi] = (folder, description)
        try:
            return plant(fmi)
        finally:
            extracted[fmi] = (folder, original)

    return make


@both
def test_reset_returns_to_the_start_values_of_the_token(
    with_token: Callable[[int, str], Any], fmi: int
) -> None:
    names = ("m_w", "speed", "gamma")
    one = with_token(fmi, f"[{REFERENCES['m_w']}={bits(1500.0)},{REFERENCES['speed']}={bits(-3.0)}]")
    expected = [1500.0, -3.0, VARIABLES[REFERENCES["gamma"]].start]
    assert one.get(*names) == expected
    one.set(m_w=900.0, gamma=0.1, speed=7.0)
    one.initialise().step(0.0, 1e-3)
    one.slave.reset()
    assert one.get(*names) == expected


@given(st.floats(-sys.float_info.max, sys.float_info.max))
def test_every_bit_of_a_start_value_arrives(extracted: Any, value: float) -> None:
    from fmpy.fmi3 import FMU3Slave

    folder, description = extracted[3]
    reference = REFERENCES["traction_torque"]
    one = FMU3Slave(
        guid=f"{description.guid}[{reference}={bits(value)}]",
        unzipDirectory=str(folder),
        modelIdentifier="wheelset",
        instanceName="bits",
    )
    one.instantiate()
    assert bits(one.getFloat64([reference])[0]) == bits(value)
    one.freeInstance()


GOOD = f"{REFERENCES['m_w']}={bits(1500.0)}"


@both
@pytest.mark.parametrize(
    "behind",
    [
        *("[", "[]", "]", "{}", f"[{GOOD}", f"[{GOOD},]", f"[{GOOD}]]", f"[{GOOD[:-1]}", f" [{GOOD}]"),
        *(f"[{GOOD}0]", f"[={bits(1.0)}]", f"[{REFERENCES['m_w']}=]", f"[{REFERENCES['m_w']}=40G0]"),
        f"[{REFERENCES['m_w']}={bits(math.nan)}]",
        f"[{REFERENCES['m_w']}={bits(-1.0)}]",  # out of bounds
        f"[{REFERENCES['yaw_rate']}={bits(math.inf)}]",
        f"[{REFERENCES['axle_torque']}={bits(1.0)}]",  # computed
        f"[{len(VARIABLES)}={bits(1.0)}]",
        f"[4294967297={bits(1500.0)}]",  # 1 after an overflow of 32 bits
    ],
)
def test_token_that_is_cut_off_or_wrong_is_refused(
    with_token: Callable[[int, str], Any], fmi: int, behind: str
) -> None:
    with pytest.raises(Exception, match="Failed to instantiate"):
        with_token(fmi, behind)


# Faults ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start_values", "message"),
    [
        ({"mw": 1.0}, "mw: got an unknown name, expected a variable .*; did you mean m_w?"),
        ({"patch": {"q": 1.0}}, r"patch\.q: got an unknown name"),
        ({"axle_torque": 1.0}, "axle_torque: got an unknown name"),  # it is computed
        (
            {"m_w": 0.0},
            "m_w: got 0.0, expected a finite value > 0 in kg; give the mass of the wheelset",
        ),
        ({"m_w": 10**400}, "m_w: got 1000"),
        ({"m_w": math.nan}, "m_w: got nan, expected a finite value > 0 in kg"),
        ({"speed": math.inf}, "speed: got inf, expected a finite value in m/s"),
        ({"rail_left": {"A": 1.5}}, r"rail_left\.A: got 1.5, expected a finite value > 0 and <= 1 in 1"),
        ({"gamma": -0.1}, "gamma: got -0.1, expected a finite value >= 0 in rad"),
        ({"m_w": "heavy"}, "m_w: got 'heavy', expected a number in kg; write it without quotes"),
        ({"m_w": True}, "m_w: got True, expected a number in kg"),
        ({"m_w": [1.0]}, r"m_w: got \[1.0\], expected a number in kg"),
        (
            {"drive_mode": 3},
            "drive_mode: got 3, expected one of prescribed_creep, free_rolling, ",
        ),
        ({"drive_mode": "electric"}, "drive_mode: got 'electric', expected one of prescribed_creep"),
        ({"drive_mode": []}, r"drive_mode: got \[\], expected one of"),
        ({"forward_dynamics": 1}, "forward_dynamics: got 1, expected true or false"),
    ],
)
def test_fault_is_told_in_one_line(tmp_path: Path, start_values: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        fmu_wheelset.export(tmp_path / "x.fmu", 3, start_values)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_every_fault_is_told(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"(?s)^m_w: .*\nk_s: [^\n]*$"):
        fmu_wheelset.export(tmp_path / "x.fmu", 3, {"m_w": -1.0, "I_w": 700.0, "k_s": "stiff"})


def test_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"x\.fmu: got no folder .*none, expected one; make it first"):
        fmu_wheelset.export(tmp_path / "none" / "x.fmu")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "p.toml: got No such file or directory, expected a TOML file; check the path"),
        (b"m_w = ", r"p.toml: got text that is not TOML \(.*\), expected TOML 1.0; mend it there"),
        (b"\xff", "p.toml: got text that is not UTF-8, expected a TOML file; mend it there"),
    ],
)
def test_file_that_cannot_be_read_is_told(tmp_path: Path, content: bytes | None, message: str) -> None:
    file = tmp_path / "p.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_start_values(file)
