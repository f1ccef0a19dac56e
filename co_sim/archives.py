"""Archives that nobody vouches for: read and unpacked without harm, or refused with the entry and the reason.

An FMU and an SSP are ZIP files, often from somebody else. Everything that would leave the folder, fill the
disk or the memory, or mean different things to different readers is found in the table of contents, before
the first byte is unpacked; what the table hides, such as a wrong size, stops the unpacking.
"""

from __future__ import annotations

import stat
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING

from co_sim.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["DEFAULT_LIMITS", "Limits", "contents", "damage", "read_entry", "safe_extract"]

_CHUNK = 1 << 20
#: FMI and SSP allow no other methods.
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
_ENCRYPTED = 0x1
#: Bytes of the header before an entry, its name and extra field not counted.
_HEADER = 30


@dataclass(frozen=True, slots=True)
class Limits:
    """What an archive may ask for.

    Parameters
    ----------
    size : of all entries together when unpacked, bytes.
    entries : their number.
    ratio : of the unpacked to the packed size, for entries of more than `free` bytes.
    free : size up to which an entry may have any ratio, bytes.
    name : length of a part of a path, bytes of UTF-8.
    path : length of a path, bytes of UTF-8.
    document : size of an XML document, bytes.
    """

    size: int = 8 << 30
    entries: int = 100_000
    ratio: float = 200.0
    free: int = 64 << 20
    name: int = 255
    path: int = 1024
    document: int = 256 << 20


DEFAULT_LIMITS = Limits()


def contents(path: Path, limits: Limits = DEFAULT_LIMITS) -> dict[str, zipfile.ZipInfo]:
    """Return the entries of an archive by their path, with ``/`` between parts; folders are left out.

    Raises
    ------
    InputError
        If the file is no archive, or for any entry that must not be unpacked; all are told together.
    """
    with _opened(path, limits) as (_, entries):
        return entries


def read_entry(path: Path, name: str, limits: Limits = DEFAULT_LIMITS) -> bytes:
    """Return a document in an archive.

    Raises
    ------
    InputError
        If the archive is refused, has no such entry, or the entry is damaged or too big to be a document.
    """
    with _opened(path, limits) as (archive, entries):
        if name not in entries:
            raise InputError(
                str(path),
                got=f"an archive without {name}",
                expected=f"{name} at its top",
                remedy="pack the contents of the folder, not the folder"
                if _is_deeper(name, entries)
                else "export the model again",
            )
        if entries[name].file_size > limits.document:
            raise InputError(
                f"{path}: {name}",
                got=f"{entries[name].file_size} bytes",
                expected=f"at most {limits.document} bytes",
                remedy="get the archive from a source that you trust",
            )
        with _told(path, name):
            return archive.read(entries[name])


def damage(path: Path, limits: Limits = DEFAULT_LIMITS) -> Iterator[Fault]:
    """Unpack every entry of an archive into nowhere, and find those that cannot be unpacked.

    Raises
    ------
    InputError
        If the archive as a whole is refused.
    """
    with _opened(path, limits) as (archive, entries):
        for name, entry in entries.items():
            try:
                with _told(path, name), archive.open(entry) as source:
                    while source.read(_CHUNK):
                        pass
            except InputError as error:
                yield from error.faults


def safe_extract(path: Path, folder: Path | str, limits: Limits = DEFAULT_LIMITS) -> None:
    """Unpack an archive into an existing, empty folder and write nowhere else.

    Parameters
    ----------
    path : the archive.
    folder : the caller removes it when this fails.
    limits : what the archive may ask for.

    Raises
    ------
    InputError
        If the archive is refused or an entry is damaged.
    """
    with _opened(path, limits) as (archive, entries):
        for name, entry in entries.items():
            target = Path(folder) / name
            with _told(path, name):
                target.parent.mkdir(parents=True, exist_ok=True)
                # "x": no entry takes the place of another one, nor goes through a link that lies there.
                with archive.open(entry) as source, target.open("xb") as file:
                    _copy(source, file, entry.file_size)


def _copy(source: IO[bytes], file: IO[bytes], size: int) -> None:
    """Copy an entry of a declared size; the reader compares the check sum at the end."""
    copied = 0
    while chunk := source.read(_CHUNK):
        copied += len(chunk)
        if copied > size:
            raise zipfile.BadZipFile(f"more than the {size} bytes that it declares")
        file.write(chunk)
    if copied != size:
        raise zipfile.BadZipFile(f"{copied} instead of the {size} bytes that it declares")


@contextmanager
def _opened(path: Path, limits: Limits) -> Iterator[tuple[zipfile.ZipFile, dict[str, zipfile.ZipInfo]]]:
    """Provide an archive whose table of contents is harmless, and its entries by path."""
    with _told(path, ""):
        archive = zipfile.ZipFile(path)
    with archive:
        listed = archive.infolist()
        faults = [*_size_faults(path, listed, limits), *_entry_faults(path, listed, limits)]
        if faults:
            raise InputError.from_faults(faults)
        yield archive, {_plain(entry.filename): entry for entry in listed if not entry.is_dir()}


@contextmanager
def _told(path: Path, name: str) -> Iterator[None]:
    """Turn whatever reading an archive raises into an error that names the archive and the entry."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # damaged bytes make zipfile and zlib raise almost anything
        words = error.strerror if isinstance(error, OSError) else None
        raise InputError(
            f"{path}: {name}" if name else str(path),
            got=" ".join(str(words or error or type(error).__name__).split()),
            expected="an entry that can be unpacked" if name else "a ZIP archive",
            remedy="check the path and get or export the file again",
        ) from error


def _size_faults(path: Path, listed: Sequence[zipfile.ZipInfo], limits: Limits) -> Iterator[Fault]:
    remedy = "get it from a source that you trust, or raise the limit"
    size = sum(entry.file_size for entry in listed)
    if len(listed) > limits.entries:
        yield Fault(str(path), f"{len(listed)} entries", f"at most {limits.entries}", remedy)
    if size > limits.size:
        yield Fault(str(path), f"{size} bytes unpacked", f"at most {limits.size}", remedy)
    end = 0
    for entry in sorted(listed, key=lambda entry: entry.header_offset):
        if entry.header_offset < end:
            what = f"{path}: {entry.filename!r}"
            yield Fault(what, "an entry inside another one", "entries one after another", remedy)
        end = entry.header_offset + _HEADER + entry.compress_size
        if entry.file_size > limits.free and entry.file_size > limits.ratio * entry.compress_size:
            yield Fault(
                f"{path}: {entry.filename!r}",
                f"{entry.file_size} bytes from {entry.compress_size} packed ones",
                f"at most {limits.ratio:g} times as many",
                remedy,
            )


def _entry_faults(path: Path, listed: Sequence[zipfile.ZipInfo], limits: Limits) -> Iterator[Fault]:
    """Find what is wrong with single entries, and with entries that exclude each other."""
    files: set[str] = set()
    folders: set[str] = set()
    for entry in listed:
        what = f"{path}: {entry.filename!r}"
        # Readers differ in what they make of a name that is not what the table says.
        fault = _name_fault(entry.orig_filename, limits) or _kind_fault(entry)
        if fault:
            yield Fault(what, *fault, "refuse the archive or have it packed properly")
            continue
        plain = _plain(entry.filename)
        if not entry.is_dir():
            if plain in files:
                yield Fault(what, "a second entry of this name", "one entry for each name", "pack it again")
            files.add(plain)
        folders.update(_plain(str(parent)) for parent in PurePosixPath(plain).parents)
        if entry.is_dir():
            folders.add(plain)
    for name in sorted((files & folders) - {"."}):
        what = f"{path}: {name!r}"
        yield Fault(what, "a file and a folder of the same name", "one of them", "pack it again")


def _name_fault(name: str, limits: Limits) -> tuple[str, str] | None:
    """Return what is wrong with the path of an entry, and what is expected."""
    parts = name.split("/")
    lengths = [len(part.encode(errors="replace")) for part in parts]
    within = "a path within the archive"
    longest = f"parts of at most {limits.name} and {limits.path} bytes in all"
    wrong = (
        (not name.strip("/.") or name.startswith("/"), "an absolute or empty path", within),
        (".." in parts, "a path that leaves the archive", within),
        ("\\" in name or ":" in name, "a backslash or colon in a path", "parts of a path divided by /"),
        (not name.isprintable(), "a path with control characters", "characters that can be printed"),
        (max(lengths) > limits.name or sum(lengths) > limits.path, "a path that is too long", longest),
    )
    return next(((got, expected) for is_wrong, got, expected in wrong if is_wrong), None)


def _kind_fault(entry: zipfile.ZipInfo) -> tuple[str, str] | None:
    """Return why the contents of an entry are refused, and what is expected."""
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind == stat.S_IFLNK:
        return "a symbolic link", "a file or folder"
    if kind not in {0, stat.S_IFREG, stat.S_IFDIR}:
        return "a special file", "a file or folder"
    if entry.flag_bits & _ENCRYPTED:
        return "an encrypted entry", "one that everybody can read"
    if entry.compress_type not in _METHODS:
        return f"the compression method {entry.compress_type}", "deflated or stored entries"
    return None


def _plain(name: str) -> str:
    """Return a path without empty parts and dots."""
    return str(PurePosixPath(name))


def _is_deeper(name: str, entries: dict[str, zipfile.ZipInfo]) -> bool:
    return any(entry.endswith(f"/{name}") for entry in entries)
