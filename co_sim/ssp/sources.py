"""Where the files of an SSP lie: in a folder, in an unpacked archive, or within an FMU."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
import weakref
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from co_sim.errors import InputError

__all__ = ["PackedFile", "Place", "SourceError", "open_place", "safe_extract"]

#: Of all files of an archive together, unpacked.
_MAX_BYTES = 8 * 2**30


class SourceError(Exception):
    """A source that cannot be had; the text says why."""


class _Folder:
    """A temporary folder that lives as long as somebody refers to it."""

    def __init__(self, prefix: str) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        self._finalizer = weakref.finalize(self, _remove, self.path, os.getpid())

    def __reduce__(self) -> tuple[type[Path], tuple[str]]:
        # Another process that is given a system is lent the folder; it stays with this one.
        return Path, (str(self.path),)


def _remove(path: Path, owner: int) -> None:
    """Remove a folder, but not in a forked process that has merely inherited it."""
    if os.getpid() == owner:
        shutil.rmtree(path, ignore_errors=True)


@dataclass(frozen=True)
class PackedFile(os.PathLike[str]):
    """A file whose folder may be a temporary one, which this object keeps."""

    path: Path
    keeper: object = None

    def __fspath__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class Place:
    """The folder against which the sources of a document are resolved.

    Parameters
    ----------
    folder : of the document.
    name : of the archive or the folder in messages.
    root : folder that no source may leave; ``None`` for a document that was not in an archive.
    keeper : owns the folder if it is temporary.
    """

    folder: Path
    name: str
    root: Path | None = None
    keeper: object = None

    def file(self, source: str) -> PackedFile:
        """Return the file that a URI names.

        Raises
        ------
        SourceError
            If the URI is no relative one, leaves the archive, or there is no such file.
        """
        parts = urlsplit(source)
        relative = unquote(parts.path)
        if parts.scheme or parts.netloc or relative.startswith("/") or "\\" in relative:
            raise SourceError(f'"{source}", which is no relative URI')
        path = Path(os.path.normpath(self.folder / relative))
        if self.root is not None and not path.is_relative_to(self.root):
            raise SourceError(f'"{source}", which leads out of the archive')
        if not relative or not path.is_file():
            raise SourceError(f'"{source}", which is not there')
        return PackedFile(path, self.keeper)

    def read(self, source: str, within: PackedFile | None = None) -> bytes:
        """Return the bytes of the file that a URI names, `within` an FMU or another archive if given.

        Raises
        ------
        SourceError
            If it cannot be read.
        """
        if within is None:
            return self.file(source).path.read_bytes()
        name = unquote(urlsplit(source).path)
        try:
            with zipfile.ZipFile(within) as archive:
                return archive.read(name)
        except (KeyError, OSError, zipfile.BadZipFile) as error:
            raise SourceError(f'"{source}", which is not in {within.path.name}') from error


def open_place(path: PackedFile, name: str, within: Place | None = None) -> Place:
    """Return the place of the documents in an archive (``.ssp``), unpacked, or beside a bare ``.ssd``.

    Raises
    ------
    InputError
        If the archive cannot be unpacked.
    """
    if path.path.suffix.lower() != ".ssp" and not zipfile.is_zipfile(path):
        return Place(path.path.parent, name, within.root if within else None, path.keeper)
    folder = _Folder(f"{path.path.stem}_")
    safe_extract(path.path, folder.path)
    return Place(folder.path, name, folder.path, folder)


def safe_extract(archive: Path, folder: Path) -> None:
    """Unpack an archive; nothing is written outside the folder.

    Raises
    ------
    InputError
        If the archive is broken, too large, or holds names that would leave the folder.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            for item in opened.infolist():
                _check(archive, item)
            if sum(item.file_size for item in opened.infolist()) > _MAX_BYTES:
                raise _refusal(archive, "more than 8 GiB when unpacked")
            opened.extractall(folder)
    except (OSError, EOFError, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise _refusal(archive, str(error)) from error


def _check(archive: Path, item: zipfile.ZipInfo) -> None:
    name = PurePosixPath(item.filename.replace("\\", "/"))
    if name.is_absolute() or ".." in name.parts or ":" in str(name):
        raise _refusal(archive, f'"{item.filename}", which leads out of the archive')
    if stat.S_ISLNK(item.external_attr >> 16):
        raise _refusal(archive, f'"{item.filename}", which is a link')


def _refusal(archive: Path, got: str) -> InputError:
    return InputError(
        f"archive {archive}", got=got, expected="a sound archive", remedy="pack it again, or do not use it"
    )
