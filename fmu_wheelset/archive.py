"""Writing of FMUs: zip files whose bytes depend on nothing but what they hold."""

from __future__ import annotations

import os
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["write_archive"]

ZIP_DATE = (1980, 1, 1, 0, 0, 0)


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a zip file with sorted names and fixed dates; the old one stays if this fails.

    Files are stored as they are: what a compressor makes of them depends on its version.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w") as archive:
            for member in sorted(files):
                info = zipfile.ZipInfo(member, ZIP_DATE)
                info.create_system = 3
                info.external_attr = 0o644 << 16
                archive.writestr(info, files[member])
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
