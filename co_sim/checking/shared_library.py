"""What a shared library offers and needs, read without loading it: no code of it runs."""

from __future__ import annotations

import os
import platform
import posixpath
import re
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import lief

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

__all__ = ["SharedLibrary", "missing_here", "read_library"]

_FOLDERS = ("/lib", "/usr/lib", "/lib64", "/usr/lib64", "/usr/local/lib")
_GLIBC = re.compile(r"GLIBC_(\d+)\.(\d+)")
_SEARCH = (lief.ELF.DynamicEntryRunPath, lief.ELF.DynamicEntryRpath)


@dataclass(frozen=True, slots=True)
class SharedLibrary:
    """A shared library.

    Parameters
    ----------
    format : ``"ELF"``, ``"PE"`` or ``"MACHO"``.
    machines : processors that it is for, such as ``"X86_64"`` or ``"ARM64"``.
    exports : functions that it offers.
    needs : other libraries that it asks for.
    search : folders where it looks for them first; ``$ORIGIN`` is its own.
    glibc : the youngest version of the GNU C library that it asks for; ``None`` if none.
    """

    format: str
    machines: frozenset[str]
    exports: frozenset[str]
    needs: tuple[str, ...]
    search: tuple[str, ...] = ()
    glibc: tuple[int, int] | None = None


def read_library(data: bytes) -> SharedLibrary | None:
    """Return what the bytes of a file tell; ``None`` if they are no shared library or a damaged one."""
    lief.logging.disable()
    try:
        return _read(data)
    except Exception:  # names that are no text, offsets that lead nowhere: lief raises what comes to it
        return None


def _read(data: bytes) -> SharedLibrary | None:
    if lief.is_macho(list(data[:4096])):
        fat = lief.MachO.parse(list(data))
        return _joined(list(fat)) if fat is not None and len(fat) else None
    parsed = lief.parse(data)
    if not isinstance(parsed, lief.ELF.Binary | lief.PE.Binary):
        return None
    binary: Any = parsed
    if isinstance(parsed, lief.PE.Binary):
        return SharedLibrary(
            "PE", _machines([binary]), _exports([binary]), tuple(map(_name, binary.libraries))
        )
    paths = [entry for entry in binary.dynamic_entries if isinstance(entry, _SEARCH)]
    return SharedLibrary(
        "ELF",
        _machines([binary]),
        _exports([binary]),
        tuple(map(_name, binary.libraries)),
        tuple(_name(folder) for entry in paths for folder in entry.paths),
        max(_glibc_versions(binary), default=None),
    )


def missing_here(library: SharedLibrary, path: str, archive: Collection[str]) -> Iterator[str]:
    """Find what an ELF library asks for that this machine does not have.

    Parameters
    ----------
    library : the library.
    path : its place in the archive.
    archive : names in the archive.
    """
    if library.format != "ELF" or platform.system() != "Linux":
        return
    own = posixpath.dirname(path)
    folders = [posixpath.normpath(re.sub(r"\$(ORIGIN|\{ORIGIN\})", own, f)) for f in library.search]
    for name in library.needs:
        bundled = any(posixpath.join(folder, name) in archive for folder in folders)
        if bundled or any(_is_file(folder, name) for folder in _system_folders()):
            continue
        if name not in _loader_cache():
            lying = posixpath.join(own, name) in archive
            hint = " (it lies next to it, but the library does not look there)" if lying else ""
            yield f"needs {name}, which is not on this machine{hint}"
    name, version = platform.libc_ver()
    if library.glibc is not None and name == "glibc" and library.glibc > _version(version):
        yield f"needs glibc {library.glibc[0]}.{library.glibc[1]}, but this machine has {version}"


def _joined(binaries: list[Any]) -> SharedLibrary:
    """Return a universal library, of which the parts for all processors have to offer a function."""
    needs = tuple(_name(library.name) for library in binaries[0].libraries)
    exports = frozenset(name.removeprefix("_") for name in _exports(binaries))
    return SharedLibrary("MACHO", _machines(binaries), exports, needs)


def _machines(binaries: list[Any]) -> frozenset[str]:
    return frozenset(binary.abstract.header.architecture.__name__ for binary in binaries)


def _exports(binaries: list[Any]) -> frozenset[str]:
    return frozenset.intersection(
        *(frozenset(_name(f.name) for f in b.abstract.exported_functions) for b in binaries)
    )


def _name(name: str | bytes) -> str:
    """Return a name as text; lief gives bytes where it is none."""
    return name if isinstance(name, str) else name.decode(errors="replace")


def _is_file(folder: str, name: str) -> bool:
    try:
        return Path(folder, name).is_file()
    except OSError:  # a name that is too long
        return False


def _glibc_versions(binary: Any) -> Iterator[tuple[int, int]]:
    for requirement in binary.symbols_version_requirement:
        for symbol in requirement.get_auxiliary_symbols():
            if found := _GLIBC.fullmatch(".".join(_name(symbol.name).split(".")[:2])):
                yield int(found[1]), int(found[2])


def _version(text: str) -> tuple[int, int]:
    major, minor = text.split(".")[:2]
    return int(major), int(minor)


def _system_folders() -> list[str]:
    return [*os.environ.get("LD_LIBRARY_PATH", "").split(":"), *_FOLDERS]


@cache
def _loader_cache() -> frozenset[str]:
    """Return the names that the loader of this machine knows."""
    for program in ("/sbin/ldconfig", "/usr/sbin/ldconfig", "ldconfig"):
        try:
            done = subprocess.run([program, "-p"], capture_output=True, text=True, check=True, timeout=10)
        except (OSError, subprocess.SubprocessError):
            continue
        return frozenset(line.split()[0] for line in done.stdout.splitlines()[1:] if line.strip())
    return frozenset()
