"""Checks of the libraries in an FMU, for every platform, without loading them."""

from __future__ import annotations

from collections import defaultdict
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from fmpy import fmi2, fmi3

from co_sim.archives import DEFAULT_LIMITS, contents, read_entry
from co_sim.checking.findings import Finding
from co_sim.checking.shared_library import SharedLibrary, missing_here, read_libraries
from co_sim.errors import InputError
from co_sim.fmi import platforms_of, this_platform

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from co_sim.fmu_elements import Declaration

__all__ = ["binary_findings"]

_TOPIC = "libraries"
#: Libraries are bigger than documents.
_LIMITS = replace(DEFAULT_LIMITS, document=DEFAULT_LIMITS.size)
#: Ending of a library, file format and processors of the folders of FMI 2.
_PLATFORMS_2 = {
    "win32": (".dll", "PE", "X86"),
    "win64": (".dll", "PE", "X86_64"),
    "linux32": (".so", "ELF", "X86"),
    "linux64": (".so", "ELF", "X86_64"),
    "darwin32": (".dylib", "MACHO", "X86"),
    "darwin64": (".dylib", "MACHO", "X86_64"),
}
_SYSTEMS = {"windows": (".dll", "PE"), "linux": (".so", "ELF"), "darwin": (".dylib", "MACHO")}
_ARCHITECTURES = {"x86": "X86", "x86_64": "X86_64", "aarch32": "ARM", "aarch64": "ARM64"}
_EXCHANGE_3 = {
    *("InstantiateModelExchange", "EnterContinuousTimeMode", "CompletedIntegratorStep", "SetTime"),
    *("SetContinuousStates", "GetContinuousStateDerivatives", "GetEventIndicators", "GetContinuousStates"),
    *("GetNominalsOfContinuousStates", "GetNumberOfEventIndicators", "GetNumberOfContinuousStates"),
}
_STEPS_3 = {"InstantiateCoSimulation", "EnterStepMode", "GetOutputDerivatives", "DoStep"}
_SCHEDULED_3 = {"InstantiateScheduledExecution", "ActivateModelPartition"}


def binary_findings(path: Path, declaration: Declaration) -> Iterator[Finding]:
    """Find what is wrong with the libraries of an FMU.

    Parameters
    ----------
    path : the archive.
    declaration : its model description.
    """
    names = contents(path)
    found, here = platforms_of(names), this_platform(declaration.version)
    if here not in found:
        yield Finding("warning", _TOPIC, "binaries/", _not_here(names, found, here))
    wanted: defaultdict[str, list[str]] = defaultdict(list)
    for kind, element in declaration.interfaces():
        wanted[element.get("modelIdentifier") or ""].append(kind)
        if element.get("needsExecutionTool") in {"true", "1"}:
            tool = declaration.root.get("generationTool") or "the tool that exported it"
            message = (
                f"needs {tool} to be installed, and licensed where it asks for that (needsExecutionTool)"
            )
            yield Finding("warning", _TOPIC, kind, message)
    places = {platform: _expected(platform) for platform in found}
    asked = [_place(name, i, expected) for name, expected in places.items() if expected for i in wanted]
    libraries = _libraries(path, [name for name in asked if name in names])
    for platform, expected in places.items():
        if expected is None:
            yield Finding("warning", _TOPIC, f"binaries/{platform}", "no platform of this version of FMI")
            continue
        for identifier, kinds in wanted.items():
            name = _place(platform, identifier, expected)
            if name not in names:
                yield Finding("error", _TOPIC, name, f"is missing; {' and '.join(kinds)} needs it")
                continue
            library = libraries[name]
            if not isinstance(library, SharedLibrary):
                message = library or "is no shared library that can be read"
                yield Finding("error", _TOPIC, name, message)
                continue
            yield from _library(name, library, expected, kinds, declaration.version)
            if platform == here:
                for missing in missing_here(library, name, names):
                    yield Finding("error", _TOPIC, name, missing)


def _place(platform: str, identifier: str, expected: tuple[str, str, str]) -> str:
    """Return where the library of an interface type for a platform is."""
    return f"binaries/{platform}/{identifier}{expected[0]}"


def _libraries(path: Path, names: Sequence[str]) -> dict[str, SharedLibrary | str | None]:
    """Return what entries are, by their names; see `read_libraries`."""
    found: dict[str, SharedLibrary | str | None] = dict.fromkeys(names)
    with TemporaryDirectory(prefix="libraries_") as folder:
        files: dict[str, Path] = {}
        for i, name in enumerate(names):
            file = Path(folder, str(i))
            with suppress(InputError):  # Told with the damage of the archive.
                file.write_bytes(read_entry(path, name, _LIMITS))
                files[name] = file
        found.update(zip(files, read_libraries(list(files.values())), strict=True))
    return found


def _not_here(names: Mapping[str, object], found: list[str], here: str) -> str:
    if found:
        return f"does not run here: it has libraries for {', '.join(found)}, but not for {here}"
    if any(name.startswith("sources/") for name in names):
        return f"does not run here: it has sources only; compile them for {here}"
    return "has neither libraries nor sources"


def _expected(platform: str) -> tuple[str, str, str] | None:
    """Return the ending, format and processor of libraries in a folder; ``None`` if it is not known."""
    if platform in _PLATFORMS_2:
        return _PLATFORMS_2[platform]
    architecture, _, system = platform.partition("-")
    ending, form = _SYSTEMS.get(system.split("-")[0], ("", ""))
    return (ending, form, _ARCHITECTURES.get(architecture, "")) if ending else None


def _library(
    name: str, library: SharedLibrary, expected: tuple[str, str, str], kinds: list[str], version: int
) -> Iterator[Finding]:
    _, form, machine = expected
    if library.format != form or (machine and machine not in library.machines):
        got = f"{library.format} for {', '.join(sorted(library.machines))}"
        yield Finding("error", _TOPIC, name, f"is {got}, but its folder is for {form} {machine}".rstrip())
        return
    needed, others = _functions(version, kinds)
    if missing := sorted(needed - library.exports):
        yield Finding("error", _TOPIC, name, f"lacks {_listed(missing)}")
    if missing := sorted(others - library.exports):
        message = f"lacks {_listed(missing)}, which tools that load every function ask for"
        yield Finding("warning", _TOPIC, name, message)


def _listed(functions: list[str]) -> str:
    more = f" and {len(functions) - 5} more functions" if len(functions) > 5 else ""
    return f"{', '.join(functions[:5])}{more}"


def _functions(version: int, kinds: list[str]) -> tuple[set[str], set[str]]:
    """Return the functions that the interface types need, and those of the other types."""
    if version == 2:
        common, exchange, steps = (
            {name for name in vars(cls) if name.startswith("fmi2")}
            for cls in (fmi2._FMU2, fmi2.FMU2Model, fmi2.FMU2Slave)
        )
        own = {"ModelExchange": exchange, "CoSimulation": steps}
        # Tools load the functions of the type that they use, so that those of the other are not missed.
        return common.union(*(own.get(kind, set()) for kind in kinds)), set()
    every = {name for name in vars(fmi3._FMU3) if name.startswith("fmi3")}
    types = {"ModelExchange": _EXCHANGE_3, "CoSimulation": _STEPS_3, "ScheduledExecution": _SCHEDULED_3}
    unused = {f"fmi3{name}" for kind, names in types.items() if kind not in kinds for name in names}
    return every - unused, unused
