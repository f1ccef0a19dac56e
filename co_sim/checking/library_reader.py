"""Reads shared libraries with lief, which is machine code at work on what nobody vouches for: a process.

``python library_reader.py BYTES SECONDS FILE...`` prints a line of JSON for each file, at once: what
`co_sim.checking.shared_library.SharedLibrary` holds, ``null`` if it is no shared library or a damaged one,
or a text that says why it cannot be read. It imports nothing else of this package, so that it starts at once.
"""

from __future__ import annotations

import json
import re
import resource
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import lief

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__: list[str] = []

_GLIBC = re.compile(r"GLIBC_(\d+)\.(\d+)")
_SEARCH = (lief.ELF.DynamicEntryRunPath, lief.ELF.DynamicEntryRpath)


def _read(data: bytes) -> dict[str, Any] | None:
    if lief.is_macho(list(data[:4096])):
        fat = lief.MachO.parse(list(data))
        return _joined(list(fat)) if fat is not None and len(fat) else None
    parsed = lief.parse(data)
    if not isinstance(parsed, lief.ELF.Binary | lief.PE.Binary):
        return None
    binary: Any = parsed
    if isinstance(parsed, lief.PE.Binary):
        return _told("PE", [binary], binary.libraries)
    paths = [entry for entry in binary.dynamic_entries if isinstance(entry, _SEARCH)]
    return _told("ELF", [binary], binary.libraries) | {
        "search": [_name(folder) for entry in paths for folder in entry.paths],
        "glibc": max(_glibc_versions(binary), default=None),
    }


def _told(form: str, binaries: list[Any], libraries: Sequence[Any]) -> dict[str, Any]:
    return {
        "format": form,
        "machines": sorted({binary.abstract.header.architecture.__name__ for binary in binaries}),
        "exports": sorted(_exports(binaries)),
        "needs": [_name(library) for library in libraries],
    }


def _joined(binaries: list[Any]) -> dict[str, Any]:
    """Return a universal library, of which the parts for all processors have to offer a function."""
    told = _told("MACHO", binaries, [library.name for library in binaries[0].libraries])
    return told | {"exports": [name.removeprefix("_") for name in told["exports"]]}


def _exports(binaries: list[Any]) -> frozenset[str]:
    return frozenset.intersection(
        *(frozenset(_name(f.name) for f in b.abstract.exported_functions) for b in binaries)
    )


def _name(name: str | bytes) -> str:
    """Return a name as text; lief gives bytes where it is none."""
    return name if isinstance(name, str) else name.decode(errors="replace")


def _glibc_versions(binary: Any) -> Iterator[tuple[int, int]]:
    for requirement in binary.symbols_version_requirement:
        for symbol in requirement.get_auxiliary_symbols():
            if found := _GLIBC.fullmatch(".".join(_name(symbol.name).split(".")[:2])):
                yield int(found[1]), int(found[2])


def _answer(file: str) -> dict[str, Any] | str | None:
    try:
        return _read(Path(file).read_bytes())
    except MemoryError:
        return "asks for more memory than any library needs to be read"
    except Exception:  # names that are no text, offsets that lead nowhere: lief raises what comes to it
        return None


def _main(memory: int, seconds: int, files: list[str]) -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    lief.logging.disable()
    for file in files:
        print(json.dumps(_answer(file)), flush=True)


if __name__ == "__main__":
    _main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
