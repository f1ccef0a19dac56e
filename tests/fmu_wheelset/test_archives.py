"""The archives: valid, complete, reproducible, and never out of date unnoticed."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
import zipfile
from typing import TYPE_CHECKING

import pytest
from fmpy.validation import validate_fmu

import fmu_wheelset
from fmu_wheelset import CONDITIONS, ContactPatch, WheelsetParameters, build, model_description
from fmu_wheelset.archive import write_archive
from fmu_wheelset.targets import TARGETS, host_target
from fmu_wheelset.variables import REFERENCES, UNITS, VARIABLES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fmpy.model_description import ModelDescription

Extracted = dict[int, tuple["Path", "ModelDescription"]]
both = pytest.mark.parametrize("fmi", [2, 3])


@both
def test_fmpy_finds_no_problem(archives: dict[int, Path], fmi: int) -> None:
    assert validate_fmu(str(archives[fmi])) == []


@both
def test_variables_are_those_of_the_table(extracted: Extracted, fmi: int) -> None:
    described = extracted[fmi][1].modelVariables
    assert [v.name for v in described] == [v.name for v in VARIABLES]
    assert [v.valueReference for v in described] == list(range(len(VARIABLES)))
    assert [v.causality for v in described] == [v.causality for v in VARIABLES]
    assert [v.description for v in described] == [v.description for v in VARIABLES]
    starts = [
        None if v.start is None else float({"true": 1, "false": 0}.get(v.start, v.start)) for v in described
    ]
    assert starts == [v.start for v in VARIABLES]


def test_table_reads_the_constants_from_their_only_home() -> None:
    start = {v.name: v.start for v in VARIABLES}
    assert start["m_w"] == WheelsetParameters().m_w
    assert start["patch.C11"] == ContactPatch().C11
    assert start["normal_load_left"] == WheelsetParameters().N
    assert start["rail_right.mu_0"] == CONDITIONS["dry"].mu_0
    assert "N" not in start


def test_table_is_sound() -> None:
    names = [v.name for v in VARIABLES]
    assert len(set(names)) == len(names)
    assert len({v.field for v in VARIABLES}) == len(names)
    for v in VARIABLES:
        assert v.kind != "Float64" or v.unit in UNITS, v.name
        assert all(
            VARIABLES[REFERENCES[name]].causality in {"input", "output", "local"} for name in v.depends_on
        )
        assert v.start is None or v.minimum <= v.start <= v.maximum, v.name
    assert sum(v.is_state for v in VARIABLES) == 8


@both
def test_structure_lists_outputs_and_derivatives(extracted: Extracted, fmi: int) -> None:
    description = extracted[fmi][1]
    assert len(description.outputs) == sum(v.causality == "output" for v in VARIABLES)
    states = [unknown.variable.derivative.name for unknown in description.derivatives]
    assert states == [v.name for v in VARIABLES if v.is_state]
    for unknown in (*description.outputs, *description.derivatives):
        declared = set(VARIABLES[REFERENCES[unknown.variable.name]].depends_on)
        assert {v.name for v in unknown.dependencies} == declared


def test_two_builds_give_the_same_bytes(archives: dict[int, Path], tmp_path: Path) -> None:
    again = build.build(tmp_path)
    assert [path.read_bytes() for path in again] == [archives[2].read_bytes(), archives[3].read_bytes()]


def test_archives_name_no_folder_of_this_machine(extracted: Extracted) -> None:
    for folder, _ in extracted.values():
        for file in folder.rglob("*"):
            if file.is_file():
                assert str(build.PACKAGE.parent).encode() not in file.read_bytes(), file.name


@both
def test_archive_holds_its_sources_and_license(archives: dict[int, Path], fmi: int) -> None:
    with zipfile.ZipFile(archives[fmi]) as archive:
        names = set(archive.namelist())
        assert archive.read("sources/variables.h").decode() == model_description.c_header(
            build.present_token()
        )
    assert {f"sources/{name}" for name in build.read_sources()} <= names
    assert "documentation/licenses/license.txt" in names
    assert ("sources/buildDescription.xml" in names) == (fmi == 3)


def test_a_change_of_sources_or_table_changes_the_token() -> None:
    sources = build.read_sources()
    token = model_description.instantiation_token(sources)
    assert token == build.present_token()
    assert token != model_description.instantiation_token(
        sources | {"contact.c": sources["contact.c"] + b"\n"}
    )
    assert token != model_description.instantiation_token(sources, VARIABLES[:-1])


@both
def test_installed_archive_belongs_to_the_installed_sources(fmi: int) -> None:
    assert build.archive_token(fmu_wheelset.path(fmi)) == build.present_token()


def test_stale_archive_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "present_token", lambda: "{of-newer-sources}")
    with pytest.raises(RuntimeError, match=r"expected \{of-newer-sources\}.*run `python -m pip install \.`"):
        fmu_wheelset.path()


def test_missing_archive_tells_the_remedy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(fmu_wheelset, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(FileNotFoundError, match=r"wheelset_fmi3\.fmu: .*run `python -m pip install \.`"):
        fmu_wheelset.path(3)


def test_unknown_version_is_refused() -> None:
    with pytest.raises(ValueError, match="fmi: got 1, expected 2 or 3"):
        fmu_wheelset.path(1)  # type: ignore[arg-type]


def test_import_needs_the_standard_library_only() -> None:
    code = (
        "import sys; before = set(sys.modules); import fmu_wheelset, fmu_wheelset.build;"
        "new = {m.split('.')[0] for m in set(sys.modules) - before} - sys.stdlib_module_names;"
        "assert new == {'fmu_wheelset'}, new"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=build.PACKAGE.parent)


def test_unknown_machine_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    with pytest.raises(RuntimeError, match=r"platform: got \w+ riscv64, expected one of Linux x86_64"):
        host_target()


def test_error_in_the_c_code_is_shown_and_leaves_no_archive(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sources = build.read_sources() | {"contact.c": b"int unfinished("}
    monkeypatch.setattr(build, "read_sources", lambda: sources)
    with pytest.raises(RuntimeError, match=r"C compiler: exit code 1\n.*contact\.c:1"):
        build.build(tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("package", ["ziglang", "fmpy"])
def test_missing_build_dependency_tells_the_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, package: str
) -> None:
    find: Callable[[str], object] = build.importlib.util.find_spec
    monkeypatch.setattr(
        build.importlib.util, "find_spec", lambda name: None if name == package else find(name)
    )
    with pytest.raises(RuntimeError, match=f"got no package {package}, .*run `pip install {package}`"):
        build.build(tmp_path)


def test_failed_write_keeps_the_old_archive(tmp_path: Path) -> None:
    archive = tmp_path / "x.fmu"
    write_archive(archive, {"a": b"old"})
    before = archive.read_bytes()
    with pytest.raises(TypeError):
        write_archive(archive, {"a": None})  # type: ignore[dict-item]
    assert archive.read_bytes() == before
    assert list(tmp_path.iterdir()) == [archive]


@pytest.mark.parametrize("version", ["standard", "editable"])
@pytest.mark.parametrize("current", [True, False])
def test_build_hook_compiles_what_is_not_current_and_tags_the_wheel(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, version: str, current: bool
) -> None:
    from fmu_wheelset.hatch_hook import TOOLS, WheelsetBuildHook

    built: list[str] = []
    monkeypatch.setattr(build, "is_current", lambda: current)
    monkeypatch.setattr(build, "build", lambda: built.append("archives"))
    for target_name in ("sdist", "wheel"):
        data: dict[str, object] = {}
        hook = WheelsetBuildHook(str(build.PACKAGE.parent), {}, None, None, str(tmp_path), target_name)
        needed = target_name == "wheel" and not current
        assert hook.dependencies() == (TOOLS if needed else [])
        hook.initialize(version, data)
        assert built == ["archives"] * needed
        assert (data != {}) == (target_name == "wheel")
    assert data == {"pure_python": False, "tag": f"py3-none-{host_target().wheel_tag}"}


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package with its archives, that `build` takes for its own."""
    package = tmp_path / "fmu_wheelset"
    shutil.copytree(build.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for file in (build.LICENSE, build.DOCUMENTATION):
        shutil.copy2(file, tmp_path / file.name)
    for name in ("sources", "archives"):
        monkeypatch.setattr(build, name.upper(), package / name)
    monkeypatch.setattr(build, "PACKAGE", package)
    monkeypatch.setattr(build, "LICENSE", tmp_path / "LICENSE")
    monkeypatch.setattr(build, "DOCUMENTATION", tmp_path / "model.md")
    for archive in (package / "archives").iterdir():
        os.utime(archive)
    return tmp_path


def test_archives_are_current_until_something_changes(tree: Path) -> None:
    assert build.is_current()
    later = time.time() + 10.0
    for file in ("model.md", "LICENSE", "fmu_wheelset/icon.py", "fmu_wheelset/sources/contact.c"):
        before = (tree / file).stat().st_mtime
        os.utime(tree / file, (later, later))
        assert not build.is_current(), file
        os.utime(tree / file, (before, before))
    assert build.is_current()


def test_archives_of_other_sources_or_machines_are_not_current(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "present_token", lambda: "{another}")
    assert not build.is_current()
    monkeypatch.undo()
    monkeypatch.setattr(build, "host_target", lambda: TARGETS["Windows", "AMD64"])
    assert not build.is_current()


def test_missing_archives_are_not_current(tree: Path) -> None:
    (tree / "fmu_wheelset" / "archives" / "wheelset_fmi3.fmu").unlink()
    assert not build.is_current()
