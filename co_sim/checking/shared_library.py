"""What a shared library offers and needs, read without loading it: no code of it runs."""

from __future__ import annotations

import json
import os
import platform
import posixpath
import re
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

__all__ = ["SharedLibrary", "missing_here", "read_libraries"]

_FOLDERS = ("/lib", "/usr/lib", "/lib64", "/usr/lib64", "/usr/local/lib")
#: The program that reads, what it may take for that beyond the size of a library (bytes), and its time, s.
_READER = Path(__file__).with_name("library_reader.py")
_MEMORY, _TIME = 1 << 30, 60


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


def read_libraries(files: Sequence[Path]) -> Iterator[SharedLibrary | str | None]:
    """Read files in a process of its own, which a library that is made for it may crash.

    Parameters
    ----------
    files : the files, unpacked.

    Returns
    -------
    For each file what it is; ``None`` if it is no shared library or a damaged one; a text that says what
    happened if reading it failed.
    """
    left = list(files)
    while left:
        answers, end = _answers(left)
        for answer in answers:
            left.pop(0)
            yield _library(answer) if isinstance(answer, dict) else answer
        if left:
            left.pop(0)
            yield f"cannot be read safely: the process that read it {end}"


def _answers(files: Sequence[Path]) -> tuple[list[Any], str]:
    """Return the answers of the reader, as many as it gave, and how it ended."""
    memory = _MEMORY + 8 * max(file.stat().st_size for file in files)
    # Modules are not looked for beside it, where they belong to this package.
    command = [sys.executable, "-P", str(_READER), str(memory), str(_TIME), *map(str, files)]
    child = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        told, _ = child.communicate(timeout=_TIME)
        end = _death(child.returncode)
    except subprocess.TimeoutExpired:
        child.kill()
        told, _ = child.communicate()
        end = f"did not come back within {_TIME:g} s"
    answers: list[Any] = []
    with suppress(ValueError):  # The last line may be half a line.
        answers += map(json.loads, told.decode(errors="replace").splitlines())
    return answers[: len(files)], end


def _death(status: int) -> str:
    if status >= 0:
        return f"ended with exit code {status}"
    with suppress(ValueError):
        return f"was ended by {signal.Signals(-status).name}"
    return f"was ended by signal {-status}"


def _library(told: dict[str, Any]) -> SharedLibrary:
    glibc = told.get("glibc")
    return SharedLibrary(
        told["format"],
        frozenset(told["machines"]),
        frozenset(told["exports"]),
        tuple(told["needs"]),
        tuple(told.get("search", ())),
        None if glibc is None else (glibc[0], glibc[1]),
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


def _is_file(folder: str, name: str) -> bool:
    try:
        return Path(folder, name).is_file()
    except OSError:  # a name that is too long
        return False


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
