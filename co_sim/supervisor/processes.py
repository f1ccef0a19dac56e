"""Memory of processes and of the machine."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["available_memory", "memory_of"]

#: Share of the memory that is free which a run may use unless told otherwise.
_SHARE = 0.8
_UNLIMITED = 2**60


def memory_of(pid: int) -> tuple[int, int]:
    """Return the private and the resident memory of a process, bytes; zeros where that is not known."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
        size = os.sysconf("SC_PAGE_SIZE")
        return int(pages[5]) * size, int(pages[1]) * size
    except (OSError, IndexError):
        return 0, 0


def available_memory() -> int:
    """Return how many bytes a run may use so that the machine, or its control group, has some left."""
    return int(_SHARE * min(_of_machine(), _of_group()))


def _of_machine() -> int:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return _UNLIMITED
    values = dict(line.split(":") for line in lines)
    return int(values["MemAvailable"].split()[0]) * 1024 if "MemAvailable" in values else _UNLIMITED


def _of_group() -> int:
    group = Path("/sys/fs/cgroup")
    try:
        limit = (group / "memory.max").read_text(encoding="ascii").strip()
        used = int((group / "memory.current").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return _UNLIMITED
    return max(int(limit) - used, 0) if limit != "max" else _UNLIMITED
