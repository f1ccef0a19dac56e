"""Where the files of an SSP lie: in a folder, in an unpacked archive, or within an FMU."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
import zipfile
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from co_sim.archives import read_entry, safe_extract

__all__ = ["PackedFile", "Place", "SourceError", "open_place"]


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
            If there is no such file.
        InputError
            If it cannot be read from the archive.
        """
        if within is None:
            return self.file(source).path.read_bytes()
        return read_entry(within.path, unquote(urlsplit(source).path))


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
