"""Compile the C core and pack the FMUs: the only file that touches a compiler.

``python -m fmu_wheelset.build`` writes both archives for the machine it runs on, and with ``--all`` for all
platforms. It needs the packages ziglang (the compiler) and fmpy (the FMI headers in its wheel); importing
this module does not.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from fmu_wheelset import documentation, icon, model_description
from fmu_wheelset.archive import write_archive
from fmu_wheelset.mach_o import universal
from fmu_wheelset.model_description import MODEL
from fmu_wheelset.targets import TARGETS, Target, host_target
from fmu_wheelset.terminals import terminals_xml

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["ARCHIVES", "archive_token", "build", "is_current", "present_token"]

PACKAGE = Path(__file__).parent
SOURCES = PACKAGE / "sources"
LICENSE = PACKAGE.parent / "LICENSE"
#: Its equations go into the archives.
DOCUMENTATION = PACKAGE.parent / "docs" / "model.md"
ARCHIVES = PACKAGE / "archives"

# -ffp-contract=off: no fused multiply-add, so that all machines compute the same bits.
# -fvisibility=hidden: only FMI functions are exported, and none of ours can bind to another library.
FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-g0", "-s", "-shared", "-fPIC"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Werror"),
)


def read_sources() -> dict[str, bytes]:
    """Return the C files and headers by name."""
    return {p.name: p.read_bytes() for p in sorted(SOURCES.iterdir()) if p.suffix in {".c", ".h"}}


def present_token() -> str:
    """Return the token that an archive of the present sources and table carries."""
    return model_description.instantiation_token(read_sources())


def archive_token(archive: Path) -> str:
    """Return the token of an FMU of either standard."""
    with zipfile.ZipFile(archive) as opened:
        root = ET.fromstring(opened.read("modelDescription.xml"))
    return root.get("instantiationToken") or root.get("guid") or ""


def is_current() -> bool:
    """Whether both archives are there, for this machine, and newer than everything they are made of."""
    made_of = [*PACKAGE.glob("*.py"), *SOURCES.iterdir(), DOCUMENTATION, LICENSE]
    changed = max(file.stat().st_mtime for file in made_of)
    target = host_target()
    for fmi, folder in ((2, target.fmi2_folder), (3, target.fmi3_folder)):
        archive = ARCHIVES / f"{MODEL}_fmi{fmi}.fmu"
        if not archive.is_file() or archive.stat().st_mtime < changed:
            return False
        with zipfile.ZipFile(archive) as opened:
            if f"binaries/{folder}/{MODEL}{target.suffix}" not in opened.namelist():
                return False
        if archive_token(archive) != present_token():
            return False
    return True


def fmi_headers() -> Path:
    """Return the folder of the FMI 2 and FMI 3 headers inside the fmpy wheel.

    Raises
    ------
    RuntimeError
        fmpy is not installed.
    """
    found = importlib.util.find_spec("fmpy")
    if found is None or found.origin is None:
        raise RuntimeError("FMI headers: got no package fmpy, expected it installed; run `pip install fmpy`")
    return Path(found.origin).parent / "c-code"


def _compile(folder: Path, c_files: list[str], target: Target) -> bytes:
    """Compile the C files in `folder` to a shared library."""
    if importlib.util.find_spec("ziglang") is None:
        raise RuntimeError(
            "C compiler: got no package ziglang, expected it installed; run `pip install ziglang`"
        )
    library = f"{MODEL}{target.suffix}"
    # Relative names and a fixed order keep this machine's paths out of the binary.
    command = [sys.executable, "-m", "ziglang", "cc", "-target", target.triple, *FLAGS]
    command += ["-isystem", str(fmi_headers()), *c_files, "-lm", "-o", library]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"C compiler: exit code {done.returncode}\n{done.stderr}")
    return (folder / library).read_bytes()


def _binaries(libraries: Mapping[Target, bytes], fmi: int) -> dict[str, bytes]:
    """Return the libraries by their path in an archive; those that share a path become a universal one."""
    by_path: dict[str, list[bytes]] = {}
    for target, library in libraries.items():
        folder = target.fmi2_folder if fmi == 2 else target.fmi3_folder
        by_path.setdefault(f"binaries/{folder}/{MODEL}{target.suffix}", []).append(library)
    return {path: found[0] if len(found) == 1 else universal(found) for path, found in by_path.items()}


def build(folder: Path = ARCHIVES, targets: Sequence[Target] | None = None) -> tuple[Path, Path]:
    """Build the FMI 2 and the FMI 3 archive.

    Parameters
    ----------
    folder : where to write ``wheelset_fmi2.fmu`` and ``wheelset_fmi3.fmu``; created if missing.
    targets : platforms whose binaries the archives hold; this machine by default.

    Returns
    -------
    paths of the two archives.

    Raises
    ------
    RuntimeError
        No compiler, no headers, an unknown machine, or an error in the C code.
    """
    targets = targets or [host_target()]
    sources = read_sources()
    token = model_description.instantiation_token(sources)
    sources["variables.h"] = model_description.c_header(token).encode()
    c_files = [name for name in sorted(sources) if name.endswith(".c")]
    with tempfile.TemporaryDirectory() as name:
        for file, content in sources.items():
            (Path(name) / file).write_bytes(content)
        libraries = {target: _compile(Path(name), c_files, target) for target in targets}

    folder.mkdir(parents=True, exist_ok=True)
    common = {f"sources/{file}": content for file, content in sources.items()} | _documentation()
    common["documentation/licenses/license.txt"] = _license()
    fmi2_files = [file for file in c_files if not file.startswith("fmi3")]
    fmi3_files = [file for file in c_files if not file.startswith("fmi2")]
    picture = icon.png()
    fmi2 = {
        "model.png": picture,
        "modelDescription.xml": model_description.fmi2_xml(token, fmi2_files).encode(),
    }
    fmi3 = {
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_xml().encode(),
        "terminalsAndIcons/icon.png": picture,
        "terminalsAndIcons/icon.svg": icon.svg().encode(),
        "modelDescription.xml": model_description.fmi3_xml(token).encode(),
        "sources/buildDescription.xml": model_description.build_description(fmi3_files).encode(),
    }
    paths = folder / f"{MODEL}_fmi2.fmu", folder / f"{MODEL}_fmi3.fmu"
    write_archive(paths[0], common | fmi2 | _binaries(libraries, 2))
    write_archive(paths[1], common | fmi3 | _binaries(libraries, 3))
    return paths


def _documentation() -> dict[str, bytes]:
    """Return the HTML page, whose equations are those of the docs of the source tree."""
    page = documentation.index_html(model_description.TITLE, DOCUMENTATION.read_text(encoding="utf-8"))
    return {"documentation/index.html": page.encode()}


def _license() -> bytes:
    """Return the license of the project, from the source tree."""
    return LICENSE.read_bytes()


def main(arguments: Sequence[str] | None = None) -> None:
    """Build from the command line and print the paths of the archives."""
    parser = argparse.ArgumentParser(prog="python -m fmu_wheelset.build", description=main.__doc__)
    parser.add_argument(
        "--all",
        action="store_true",
        help="binaries for all platforms, as a release has them; the first time takes minutes",
    )
    parser.add_argument("--out", type=Path, default=ARCHIVES, metavar="DIR", help="folder for the archives")
    options = parser.parse_args(arguments)
    for written in build(options.out, list(TARGETS.values()) if options.all else None):
        sys.stdout.write(f"{written}\n")


if __name__ == "__main__":
    main()
