"""Files that are whole or not there."""

from __future__ import annotations

import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["checked_path", "whole_file"]


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary path in the folder of `path` that takes its name when the block succeeds.

    When the block fails or is interrupted, the temporary file is removed and `path` is as it was.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes files that only their owner may read; results are for colleagues too.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def checked_path(path: str | os.PathLike[str]) -> Path:
    """Return `path`; raise an `InputError` if no file of this name can be made."""
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(
            f"{path}", got=f"no folder {path.parent}", expected="an existing folder", remedy="create it first"
        )
    if path.is_dir():
        raise InputError(f"{path}", got="a folder", expected="a file", remedy="add the name of a file")
    return path
