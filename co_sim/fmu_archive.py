"""Unpacked archives: one folder for all instances of an FMU that live at the same time."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from threading import Lock
from typing import TYPE_CHECKING

from co_sim.archives import contents, safe_extract

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator
    from pathlib import Path

__all__ = ["unpacked"]


@dataclass(slots=True)
class _Folder:
    directory: TemporaryDirectory[str]
    users: int = 0


_FOLDERS: dict[Hashable, _Folder] = {}
_LOCK = Lock()


@contextmanager
def unpacked(path: Path, *, alone: bool) -> Iterator[str]:
    """Provide a folder with the contents of an archive; it is removed when its last user leaves.

    Parameters
    ----------
    alone : share the folder with nobody. The library in it is then loaded once more, with variables of its
        own: that is how an FMU that allows one instance in a process can have several.
    """
    key = object() if alone else (path.resolve(), _content(path))
    with _LOCK:
        if key not in _FOLDERS:
            _FOLDERS[key] = _new_folder(path)
        folder = _FOLDERS[key]
        folder.users += 1
    try:
        yield folder.directory.name
    finally:
        with _LOCK:
            folder.users -= 1
            if not folder.users:
                del _FOLDERS[key]
                folder.directory.cleanup()


def _content(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Return the names, check sums and sizes in an archive: a file that was written anew is another one."""
    return tuple((name, entry.CRC, entry.file_size) for name, entry in contents(path).items())


def _new_folder(path: Path) -> _Folder:
    directory = TemporaryDirectory(prefix=f"{path.stem}_")
    try:
        safe_extract(path, directory.name)
    except BaseException:
        directory.cleanup()
        raise
    return _Folder(directory)
