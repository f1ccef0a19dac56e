"""The C code under sanitizers: no undefined behaviour, no access outside its memory, no leak."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from fmu_wheelset import build, model_description
from fmu_wheelset.variables import REFERENCES, DriveMode

if TYPE_CHECKING:
    from collections.abc import Callable

NAMES = (
    *("drive_mode", "forward_dynamics", "speed", "lateral_displacement", "track_lateral_offset"),
    *("traction_torque", "normal_load_left"),
)


@pytest.fixture
def sources(tmp_path: Path) -> list[str]:
    """Arguments that compile the driver with the FMU sources."""
    token = build.present_token()
    (tmp_path / "variables.h").write_text(model_description.c_header(token))
    constants = [
        f'#define TOKEN "{token}"',
        f"#define N_VARIABLES {len(REFERENCES)}",
        f"#define MODES {len(DriveMode)}",
    ]
    constants += [f"#define {name.upper()} {REFERENCES[name]}" for name in NAMES]
    (tmp_path / "driver_references.h").write_text("\n".join(constants) + "\n")
    files = [str(build.SOURCES / name) for name in build.read_sources() if name.endswith(".c")]
    drivers = [str(Path(__file__).with_name(name)) for name in ("driver.c", "fuzz.c")]
    return [f"-I{tmp_path}", "-isystem", str(build.fmi_headers()), *drivers, *files]


def finishes(program: Path, **environment: str) -> None:
    done = subprocess.run(
        [program], capture_output=True, text=True, check=False, timeout=60, env=os.environ | environment
    )
    assert done.stderr == ""
    assert (done.returncode, done.stdout) == (0, "finished\n")


def test_no_undefined_behaviour(compiler: Callable[..., Path], sources: list[str], tmp_path: Path) -> None:
    # The compiler of the build lets the program trap where C leaves the behaviour undefined.
    flags = ("-O1", "-fsanitize=undefined", "-fsanitize-trap=undefined")
    finishes(compiler(tmp_path / "driver", *flags, *sources))


def test_the_sanitizer_would_notice(compiler: Callable[..., Path], tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.c"
    wrong.write_text("int main(int n, char **v) { int big = 2147483647; (void)v; return (big + n) != 0; }\n")
    program = compiler(
        tmp_path / "wrong", "-O1", "-fsanitize=undefined", "-fsanitize-trap=undefined", str(wrong)
    )
    assert subprocess.run([program], check=False).returncode < 0


def test_no_access_outside_memory(compiler: Callable[..., Path], sources: list[str], tmp_path: Path) -> None:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed; the compiler of the build has no address sanitizer")
    trial = tmp_path / "trial.c"
    trial.write_text("int main(void) { return 0; }\n")
    flags = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    linked = subprocess.run([gcc, *flags, trial, "-o", tmp_path / "trial"], capture_output=True, check=False)
    if linked.returncode != 0:
        pytest.skip("gcc is installed without its address sanitizer")
    finishes(compiler(tmp_path / "driver", *flags, *sources, compiler=(gcc,)))
