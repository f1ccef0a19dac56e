"""The release: libraries of all platforms, what they export and need, and the same bits wherever they run.

``pytest -m release`` runs what builds for other platforms than this one. The first time it takes minutes,
because the compiler makes its Windows libraries then.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import struct
import subprocess
import zipfile
from typing import TYPE_CHECKING

import lief
import pytest
from fmpy.validation import validate_fmu

from fmu_wheelset import build, model_description
from fmu_wheelset.mach_o import universal
from fmu_wheelset.targets import TARGETS, host_target

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Run = Callable[[str], list[str]]

lief.logging.disable()
release = pytest.mark.release

FMI2_LIBRARIES = {
    "binaries/linux64/wheelset.so",
    "binaries/aarch64-linux/wheelset.so",
    "binaries/win64/wheelset.dll",
    "binaries/darwin64/wheelset.dylib",
}
FMI3_LIBRARIES = {
    "binaries/x86_64-linux/wheelset.so",
    "binaries/aarch64-linux/wheelset.so",
    "binaries/x86_64-windows/wheelset.dll",
    "binaries/x86_64-darwin/wheelset.dylib",
    "binaries/aarch64-darwin/wheelset.dylib",
}
#: What the platforms' C libraries do for us: memory, text, and mathematics that IEEE 754 or C fix to the bit.
MEMORY_AND_TEXT = {
    *("calloc", "free", "malloc", "bcmp", "bzero", "memchr", "memcmp", "memcpy", "memmove", "memset"),
    *("strchr", "strcmp", "strcpy", "strlen", "strncmp", "strncpy", "vsnprintf"),
}
EXACT_MATHEMATICS = {"ceil", "fabs", "floor", "fmax", "fmin", "sqrt"}
LOADER = {"dyld_stub_binder"}
#: Exported by the linker on macOS, where programs bind to names of one library and so to none of these.
MACOS_LINKER = {"__mh_dylib_header", "___dso_handle"}


def binaries(archive: Path) -> dict[str, bytes]:
    """Libraries by their path in an FMU."""
    with zipfile.ZipFile(archive) as opened:
        return {name: opened.read(name) for name in opened.namelist() if name.startswith("binaries/")}


def exports(library: lief.Binary) -> set[str]:
    """Names that a program can bind to, without the underscore that macOS puts before them."""
    if isinstance(library, lief.ELF.Binary):
        return {str(s.name) for s in library.exported_symbols}
    if isinstance(library, lief.PE.Binary):
        return {str(entry.name) for entry in library.get_export().entries}
    names = {str(export.symbol.name) for export in library.dyld_info.exports}
    return {name.removeprefix("_") for name in names - MACOS_LINKER}


def imports(library: lief.ELF.Binary | lief.MachO.Binary) -> set[str]:
    """Functions that a library takes from others."""
    names = {str(f.name) for f in library.imported_functions}
    return {name.lstrip("_") for name in names} if isinstance(library, lief.MachO.Binary) else names


def machine(library: lief.Binary) -> str:
    """Format and machine of a library, for whichever format."""
    kind = type(library).__module__.rsplit(".", 1)[-1]
    return f"{kind} {library.abstract.header.architecture.name}"


# This platform ---------------------------------------------------------------------------------------


def test_host_library_exports_both_standards_and_needs_no_inexact_mathematics(
    archives: dict[int, Path], fmi_functions: set[str]
) -> None:
    for archive in archives.values():
        (content,) = binaries(archive).values()
        library = lief.parse(content)
        assert exports(library) == fmi_functions
        assert imports(library) <= MEMORY_AND_TEXT | EXACT_MATHEMATICS


def mach_o(kind: int, size: int) -> bytes:
    """Something with the header of a Mach-O library."""
    return struct.pack("<3I", 0xFEEDFACF, kind, 3).ljust(size, b"%c" % (kind & 0xFF))


def test_universal_library_holds_its_slices_as_they_are() -> None:
    slices = [mach_o(0x01000007, 40_000), mach_o(0x0100000C, 123)]
    joined = universal(slices)
    magic, count = struct.unpack_from(">2I", joined)
    assert (magic, count) == (0xCAFEBABE, 2)
    for i, content in enumerate(slices):
        kind, subkind, offset, size, alignment = struct.unpack_from(">5I", joined, 8 + 20 * i)
        assert struct.pack("<2I", kind, subkind) == content[4:12]
        assert offset % (1 << alignment) == 0
        assert joined[offset : offset + size] == content
    assert len(joined) == offset + size


@pytest.mark.parametrize(
    ("slices", "message"),
    [
        ([b"\x7fELF" + bytes(60)], r"got a file that begins with b'\\x7fELF', expected a 64-bit Mach-O"),
        ([b""], "expected a 64-bit Mach-O"),
        ([mach_o(7, 99), mach_o(7, 99)], "expected different ones"),
    ],
)
def test_universal_library_of_something_else_is_refused(slices: list[bytes], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        universal(slices)


def test_command_line_builds_the_host_or_everything(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[tuple[Path, object]] = []

    def record(folder: Path, targets: object) -> list[Path]:
        seen.append((folder, targets))
        return [folder / "x.fmu"]

    monkeypatch.setattr(build, "build", record)
    build.main([])
    build.main(["--all", "--out", str(tmp_path)])
    assert seen == [(build.ARCHIVES, None), (tmp_path, list(TARGETS.values()))]
    assert capsys.readouterr().out.splitlines()[1] == str(tmp_path / "x.fmu")


# All platforms ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Archives of a release by FMI version."""
    fmi2, fmi3 = build.build(tmp_path_factory.mktemp("release"), list(TARGETS.values()))
    return {2: fmi2, 3: fmi3}


@pytest.fixture(scope="module")
def libraries(released: dict[int, Path]) -> dict[str, lief.Binary]:
    """The libraries of the FMI 3 archive by their folder."""
    return {path.split("/")[1]: lief.parse(content) for path, content in binaries(released[3]).items()}


@release
def test_release_holds_every_platform_in_one_archive(released: dict[int, Path]) -> None:
    assert set(binaries(released[2])) == FMI2_LIBRARIES
    assert set(binaries(released[3])) == FMI3_LIBRARIES
    for archive in released.values():
        assert validate_fmu(str(archive)) == []
        assert build.archive_token(archive) == build.present_token()


@release
def test_release_is_reproducible(released: dict[int, Path], tmp_path: Path) -> None:
    again = build.build(tmp_path / "elsewhere", list(TARGETS.values()))
    assert [path.read_bytes() for path in again] == [released[2].read_bytes(), released[3].read_bytes()]


@release
def test_docs_list_the_hashes_of_the_release(released: dict[int, Path]) -> None:
    page = (build.PACKAGE.parent / "docs" / "fmu.md").read_text(encoding="utf-8")
    for archive in released.values():
        line = f"{hashlib.sha256(archive.read_bytes()).hexdigest()}  {archive.name}"
        assert line in page, f"docs/fmu.md: expected the line {line}; put it there"


@release
def test_libraries_name_no_folder_of_this_machine(released: dict[int, Path]) -> None:
    for path, content in binaries(released[3]).items():
        for folder in (build.PACKAGE.parent, build.fmi_headers(), "/tmp/"):
            assert str(folder).encode() not in content, path


@release
def test_libraries_are_of_the_machine_that_their_folder_names(libraries: dict[str, lief.Binary]) -> None:
    assert {folder: machine(library) for folder, library in libraries.items()} == {
        "x86_64-linux": "ELF X86_64",
        "aarch64-linux": "ELF ARM64",
        "x86_64-windows": "PE X86_64",
        "x86_64-darwin": "MachO X86_64",
        "aarch64-darwin": "MachO ARM64",
    }


@release
def test_every_library_exports_exactly_the_functions_of_both_standards(
    libraries: dict[str, lief.Binary], fmi_functions: set[str]
) -> None:
    for folder, library in libraries.items():
        assert exports(library) == fmi_functions, folder


@release
def test_no_library_needs_inexact_mathematics(libraries: dict[str, lief.Binary]) -> None:
    allowed = MEMORY_AND_TEXT | EXACT_MATHEMATICS | LOADER
    for folder, library in libraries.items():
        if isinstance(library, lief.PE.Binary):
            # Its C runtime comes in parts, one of them for mathematics.
            needed = {str(dependency.name).lower() for dependency in library.imports}
            assert not any("math" in name or name == "msvcrt.dll" for name in needed), folder
        else:
            assert imports(library) <= allowed, folder


@release
def test_linux_libraries_need_glibc_2_17_at_most(libraries: dict[str, lief.Binary]) -> None:
    for folder in ("x86_64-linux", "aarch64-linux"):
        needed = [
            str(version.name)
            for library in libraries[folder].symbols_version_requirement
            for version in library.get_auxiliary_symbols()
        ]
        assert needed
        for name in needed:
            assert tuple(map(int, name.removeprefix("GLIBC_").split("."))) <= (2, 17), name


@release
def test_universal_library_joins_those_of_both_machines(released: dict[int, Path]) -> None:
    apple = binaries(released[3])
    content = binaries(released[2])["binaries/darwin64/wheelset.dylib"]
    joined = lief.MachO.parse(content)
    found = {machine(one): content[one.fat_offset :] for one in joined}
    assert set(found) == {"MachO X86_64", "MachO ARM64"}
    assert found["MachO X86_64"].startswith(apple["binaries/x86_64-darwin/wheelset.dylib"])
    assert found["MachO ARM64"] == apple["binaries/aarch64-darwin/wheelset.dylib"]


@release
def test_apple_silicon_library_is_signed_and_runs_from_macos_11(libraries: dict[str, lief.Binary]) -> None:
    assert libraries["aarch64-darwin"].has_code_signature  # without one the system refuses to load it
    for folder in ("x86_64-darwin", "aarch64-darwin"):
        assert list(libraries[folder].build_version.minos)[:2] == [11, 0]


# The same bits ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(compiler: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Compile the fixed run for a target, run it behind a prefix of commands, and return its lines."""
    folder = tmp_path_factory.mktemp("trajectory")
    (folder / "variables.h").write_text(model_description.c_header(build.present_token()))
    driver = build.PACKAGE.parent / "tests" / "fmu_wheelset" / "trajectory.c"
    files = [driver, *(build.SOURCES / name for name in build.read_sources() if name.endswith(".c"))]
    include = [f"-I{folder}", "-isystem", str(build.fmi_headers())]

    def lines(target: str, *prefix: str) -> list[str]:
        # The suffix is for Windows; the others do not mind.
        program = compiler(folder / f"{target}.exe", "-O2", "-target", target, *include, *map(str, files))
        environment = os.environ | {"WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
        done = subprocess.run(
            [*prefix, program], capture_output=True, text=True, check=False, timeout=300, env=environment
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return lines


@pytest.fixture(scope="module")
def host_lines(run: Run) -> list[str]:
    found = run(host_target().triple)
    assert len(found) > 10_000
    return found


@release
@pytest.mark.parametrize(
    ("target", "emulators"),
    [
        # Static, so that the emulator needs no C library of the other machine.
        ("aarch64-linux-musl", ("qemu-aarch64-static", "qemu-aarch64")),
        ("x86_64-windows-gnu", ("wine64", "wine")),
    ],
)
def test_runs_give_the_same_bits(
    run: Run, host_lines: list[str], target: str, emulators: tuple[str, ...]
) -> None:
    emulator = next(filter(None, map(shutil.which, emulators)), None)
    if emulator is None:
        pytest.skip(f"{' or '.join(emulators)} is not installed, which runs programs for {target}")
    found = run(target, emulator)
    assert len(found) == len(host_lines)
    assert [(a, b) for a, b in zip(found, host_lines, strict=True) if a != b][:5] == []
