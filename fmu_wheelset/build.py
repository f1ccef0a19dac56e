"""Compile the C core and pack the FMUs: the only file that touches a compiler.

``python -m fmu_wheelset.build`` writes both archives for the machine it runs on. It needs the packages
ziglang (the compiler) and fmpy (the FMI headers in its wheel); importing this module does not.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from fmu_wheelset import documentation, icon, model_description
from fmu_wheelset.model_description import MODEL
from fmu_wheelset.terminals import terminals_xml

__all__ = ["ARCHIVES", "TARGETS", "Target", "archive_token", "build", "host_target", "present_token"]

PACKAGE = Path(__file__).parent
SOURCES = PACKAGE / "sources"
ARCHIVES = PACKAGE / "archives"

# -ffp-contract=off: no fused multiply-add, so that all machines compute the same bits.
# -fvisibility=hidden: only FMI functions are exported, and none of ours can bind to another library.
FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-g0", "-s", "-shared", "-fPIC"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Werror"),
)
ZIP_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, slots=True)
class Target:
    """A platform for which the shared library can be built.

    Parameters
    ----------
    triple : what the compiler calls it.
    fmi2_folder, fmi3_folder : folder of the library below ``binaries/``.
    suffix : of the shared library.
    wheel_tag : platform tag of a wheel that holds it.
    """

    triple: str
    fmi2_folder: str
    fmi3_folder: str
    suffix: str
    wheel_tag: str


#: Targets by (system, machine) as the platform module names them.
TARGETS = {
    ("Linux", "x86_64"): Target(
        triple="x86_64-linux-gnu.2.17",
        fmi2_folder="linux64",
        fmi3_folder="x86_64-linux",
        suffix=".so",
        wheel_tag="manylinux_2_17_x86_64",
    ),
    ("Linux", "aarch64"): Target(
        triple="aarch64-linux-gnu.2.17",
        fmi2_folder="aarch64-linux",
        fmi3_folder="aarch64-linux",
        suffix=".so",
        wheel_tag="manylinux_2_17_aarch64",
    ),
}


def host_target() -> Target:
    """Return the target of this machine.

    Raises
    ------
    RuntimeError
        The machine is none of `TARGETS`.
    """
    host = (platform.system(), platform.machine())
    if host not in TARGETS:
        known = ", ".join(" ".join(target) for target in TARGETS)
        raise RuntimeError(f"platform: got {' '.join(host)}, expected one of {known}; build on one of those")
    return TARGETS[host]


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


def _write_archive(path: Path, files: dict[str, bytes]) -> None:
    """Write a zip file with sorted names and fixed dates; the old one stays if this fails."""
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for member in sorted(files):
                info = zipfile.ZipInfo(member, ZIP_DATE)
                info.compress_type = zipfile.ZIP_DEFLATED
                info.create_system = 3
                info.external_attr = 0o644 << 16
                archive.writestr(info, files[member])
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def build(folder: Path = ARCHIVES, target: Target | None = None) -> tuple[Path, Path]:
    """Build the FMI 2 and the FMI 3 archive.

    Parameters
    ----------
    folder : where to write ``wheelset_fmi2.fmu`` and ``wheelset_fmi3.fmu``; created if missing.
    target : platform of the binary; this machine by default.

    Returns
    -------
    paths of the two archives.

    Raises
    ------
    RuntimeError
        No compiler, no headers, an unknown machine, or an error in the C code.
    """
    target = target or host_target()
    sources = read_sources()
    token = model_description.instantiation_token(sources)
    sources["variables.h"] = model_description.c_header(token).encode()
    c_files = [name for name in sorted(sources) if name.endswith(".c")]
    with tempfile.TemporaryDirectory() as name:
        for file, content in sources.items():
            (Path(name) / file).write_bytes(content)
        library = _compile(Path(name), c_files, target)

    folder.mkdir(parents=True, exist_ok=True)
    license_text = _license()
    common = {f"sources/{file}": content for file, content in sources.items()} | _documentation()
    fmi2_files = [file for file in c_files if not file.startswith("fmi3")]
    fmi3_files = [file for file in c_files if not file.startswith("fmi2")]
    picture = icon.png()
    fmi2 = common | {
        "model.png": picture,
        "modelDescription.xml": model_description.fmi2_xml(token, fmi2_files).encode(),
        f"binaries/{target.fmi2_folder}/{MODEL}{target.suffix}": library,
        "documentation/licenses/license.txt": license_text,
    }
    fmi3 = common | {
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_xml().encode(),
        "terminalsAndIcons/icon.png": picture,
        "terminalsAndIcons/icon.svg": icon.svg().encode(),
        "modelDescription.xml": model_description.fmi3_xml(token).encode(),
        "sources/buildDescription.xml": model_description.build_description(fmi3_files).encode(),
        f"binaries/{target.fmi3_folder}/{MODEL}{target.suffix}": library,
        "documentation/licenses/license.txt": license_text,
    }
    paths = folder / f"{MODEL}_fmi2.fmu", folder / f"{MODEL}_fmi3.fmu"
    _write_archive(paths[0], fmi2)
    _write_archive(paths[1], fmi3)
    return paths


def _documentation() -> dict[str, bytes]:
    """Return the HTML page, whose equations are those of the docs of the source tree."""
    model = (PACKAGE.parent / "docs" / "model.md").read_text(encoding="utf-8")
    page = documentation.index_html(model_description.TITLE, model)
    return {"documentation/index.html": page.encode()}


def _license() -> bytes:
    """Return the license of the project, from the source tree."""
    return (PACKAGE.parent / "LICENSE").read_bytes()


if __name__ == "__main__":
    for written in build():
        sys.stdout.write(f"{written}\n")
