"""Universal libraries of macOS: one Mach-O file for each kind of machine behind a common header."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["universal"]

UNIVERSAL, MACH_O_64 = 0xCAFEBABE, 0xFEEDFACF
#: As a power of two: 16 KiB, the pages of Apple silicon, which suit the smaller pages of Intel as well.
ALIGNMENT = 14


def universal(slices: Sequence[bytes]) -> bytes:
    """Join Mach-O libraries of different machines.

    Parameters
    ----------
    slices : the 64-bit libraries; their bytes, and so their signatures, stay as they are.

    Raises
    ------
    ValueError
        One of them is not a 64-bit Mach-O file, or two are for the same machine.
    """
    machines = [_machine(content) for content in slices]
    if len(set(machines)) != len(machines):
        raise ValueError(
            f"slices: got machines {machines}, expected different ones; give one library for each"
        )
    page = 1 << ALIGNMENT
    header = struct.pack(">2I", UNIVERSAL, len(slices))
    body = b""
    for (kind, subkind), content in zip(machines, slices, strict=True):
        body += bytes(-len(body) % page)
        header += struct.pack(">5I", kind, subkind, page + len(body), len(content), ALIGNMENT)
        body += content
    return header.ljust(page, b"\0") + body


def _machine(content: bytes) -> tuple[int, int]:
    """Return type and subtype of the processor from the header of a library."""
    magic, kind, subkind = struct.unpack_from("<3I", content) if len(content) >= 12 else (0, 0, 0)
    if magic != MACH_O_64:
        raise ValueError(
            f"slice: got a file that begins with {content[:4]!r}, expected a 64-bit Mach-O library"
        )
    return kind, subkind
