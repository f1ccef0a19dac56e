"""The end of what a process prints, however much that is."""

from __future__ import annotations

import os
import sys
from itertools import groupby

__all__ = ["Tail"]

#: Bytes kept, bytes read at once, lines given and the longest of them.
_KEPT, _READ, _LINES, _LENGTH = 2**16, 2**20, 50, 1000


class Tail:
    """Reads a pipe and keeps the end.

    Parameters
    ----------
    descriptor : of the pipe, from now on owned. echo : whether to print everything on stderr.
    """

    def __init__(self, descriptor: int, *, echo: bool) -> None:
        os.set_blocking(descriptor, False)
        self.descriptor = descriptor
        self.open = True
        self._echo = echo
        self._kept = b""
        self._read = 0

    def read(self) -> bool:
        """Read what there is, up to a pipe full; return whether there may come more."""
        try:
            data = os.read(self.descriptor, _READ)
        except BlockingIOError:
            return True
        if not data:
            self.close()
            return False
        self._read += len(data)
        self._kept = (self._kept + data)[-_KEPT:]
        if self._echo:
            sys.stderr.write(data.decode(errors="replace"))
            sys.stderr.flush()
        return True

    @property
    def lines(self) -> tuple[str, ...]:
        """The last lines, long ones cut and repeated ones counted."""
        lines = [line for line in self._kept.decode(errors="replace").splitlines() if line.strip()]
        if self._read > len(self._kept) and lines:
            del lines[0]  # of which the beginning is lost
        told = [_told(line, len(list(same))) for line, same in groupby(lines)]
        return tuple(told[-_LINES:])

    def close(self) -> None:
        """Read no more."""
        if self.open:
            self.open = False
            os.close(self.descriptor)


def _told(line: str, times: int) -> str:
    text = line if len(line) <= _LENGTH else f"{line[:_LENGTH]} ... ({len(line)} characters)"
    return text if times == 1 else f"{text} ({times} times)"
