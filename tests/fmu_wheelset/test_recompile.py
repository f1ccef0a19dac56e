"""The archives bring all that others need to compile them again, with fmpy's own build."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy import build, extract, simulate_fmu

CMAKE = Path(sys.executable).parent / "cmake"  # from the wheel that fmpy depends on


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_compiles_the_fmu_from_its_own_sources(
    archives: dict[int, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fmi: int
) -> None:
    if not (shutil.which("make") and shutil.which("cc")):
        pytest.skip("fmpy's build needs make and a C compiler")
    monkeypatch.setenv("PATH", f"{CMAKE.parent}:{Path('/usr/bin')}:{Path('/bin')}")
    folder = Path(extract(str(archives[fmi]), tmp_path / "fmu"))
    shutil.rmtree(folder / "binaries")
    (tmp_path / "build").mkdir()
    build.build_platform_binary(folder, tmp_path / "build")
    assert len(list(folder.glob("binaries/*/wheelset.so"))) == 1

    ours, theirs = trajectory(archives[fmi]), trajectory(folder)
    np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-12)


def trajectory(fmu: Path) -> np.ndarray:
    outputs = ["lateral_displacement", "left.adhesion_peak"]
    result = simulate_fmu(
        str(fmu),
        stop_time=0.5,
        output_interval=1e-2,
        start_values={"lateral_displacement": 2e-3, "prescribed_creepage": 2e-3},
        output=outputs,
    )
    return np.column_stack([result[name] for name in outputs])
