"""Reads scenario files and tells their faults, each in one line: what, got, expected, remedy."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from pydantic import BaseModel, ValidationError

from co_sim.errors import Fault, InputError
from co_sim.wheelset.scenario import MODES, Scenario

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.resources.abc import Traversable

    from pydantic.fields import FieldInfo
    from pydantic_core import ErrorDetails

    from fmu_wheelset import WheelsetParameters

__all__ = [
    "field_table",
    "load_scenario",
    "load_wheelset",
    "packaged_names",
    "packaged_text",
    "read_text",
    "tables_of",
    "validated",
]


def _packaged() -> Traversable:
    return resources.files("co_sim.wheelset") / "scenarios"


def packaged_names() -> list[str]:
    """Return the names of the packaged scenarios."""
    names = (item.name for item in _packaged().iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def packaged_text(name: str) -> str:
    """Return the text of a packaged scenario.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in packaged_names():
        raise InputError(
            "scenario",
            got=repr(name),
            expected=f"one of the packaged {', '.join(packaged_names())}",
            remedy="check the name",
        )
    return (_packaged() / f"{name}.toml").read_text(encoding="utf-8")


def load_scenario(source: str) -> tuple[Scenario, Path]:
    """Read a scenario: a packaged one by its name, or a file.

    Returns
    -------
    (scenario, folder) : `folder` is where files that the scenario names are looked for.

    Raises
    ------
    InputError
        If there is no such scenario, or it has faults.
    """
    if source in packaged_names():
        return parse(packaged_text(source), f"{source}.toml"), Path()
    path = Path(source)
    text = read_text(path, f"a scenario file or one of the packaged {', '.join(packaged_names())}")
    return parse(text, path.name), path.parent


def load_wheelset(path: Path) -> WheelsetParameters:
    """Read parameters of the wheelset from a file with the content of a scenario's table ``[wheelset]``.

    Raises
    ------
    InputError
        If there is no such file, or it has faults.
    """
    tables = tables_of(read_text(path, "a file of parameters"), path.name)
    return validated({"wheelset": tables}, path.name).parameters


def read_text(path: Path, expected: str) -> str:
    """Return the text of a file; raise `InputError` if there is none that can be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "text that is not UTF-8"
        raise InputError(str(path), got=str(reason), expected=expected, remedy="check the path") from None


def parse(text: str, name: str) -> Scenario:
    """Return the scenario in a TOML `text`; `name` stands in messages for the file."""
    return validated(tables_of(text, name), name)


def tables_of(text: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML `text`; `name` stands in messages for the file."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            name, got=f"text that is not TOML ({error})", expected="TOML 1.0", remedy="mend it there"
        ) from None


def validated(tables: dict[str, Any], name: str) -> Scenario:
    """Return the scenario of the `tables` of a file; `name` stands in messages for the file."""
    try:
        return Scenario.model_validate(_frozen(tables))
    except ValidationError as error:
        raise InputError.from_faults([_fault(name, e) for e in _causes(error.errors())]) from None


def _causes(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Drop the faults of a list that only follow from those of its items."""
    return [
        e
        for e in errors
        if e["type"] != "too_short"
        or not any(o is not e and o["loc"][: len(e["loc"])] == e["loc"] for o in errors)
    ]


def _frozen(value: Any) -> Any:
    """Turn TOML's lists into the tuples of frozen tables."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _fault(name: str, error: ErrorDetails) -> Fault:
    """Translate one fault that pydantic found in the file `name`."""
    path = ".".join(str(part) for part in error["loc"] if part not in MODES)
    what = f"{name}: {path}" if path else name
    context = error.get("ctx", {})
    declared, siblings = _look_up(error["loc"])
    field = next((part for part in reversed(error["loc"]) if isinstance(part, str)), "it")
    told = f"{field} ({declared.description})" if declared and declared.description else field
    match error["type"]:
        case "scenario":
            return Fault(what, context["got"], context["expected"], context["remedy"])
        case "extra_forbidden":
            close = difflib.get_close_matches(field, siblings, n=1, cutoff=0.0)[0]
            return Fault(what, "an unknown key", f"one of {', '.join(siblings)}", f"did you mean {close}?")
        case "missing":
            return Fault(what, "nothing", "a value", f"add {told}")
        case "union_tag_invalid" | "union_tag_not_found":
            got = repr(context.get("tag"))
            return Fault(f"{what}.mode", got, f"one of {', '.join(MODES)}", "choose what turns the wheels")
    expected = error["msg"].removeprefix("Input should be ").removeprefix("a valid ")
    return Fault(what, repr(error["input"]), expected, f"change {told}")


def _look_up(path: tuple[int | str, ...]) -> tuple[FieldInfo | None, list[str]]:
    """Return the declaration of the field at `path` if it is known, and the names beside it."""
    tables: list[type[BaseModel]] = [Scenario]
    declared: FieldInfo | None = None
    names: dict[str, FieldInfo] = {}
    for part in path:
        if part in MODES:
            tables = [t for t in tables if part in get_args(t.model_fields["mode"].annotation)]
        elif isinstance(part, str):
            names = {name: field for t in tables for name, field in t.model_fields.items()}
            declared = names.get(part)
            # A name that no table declares is a user's own, such as that of a rail condition.
            tables = _tables_in(declared.annotation) if declared else tables
    return declared, list(names)


def _tables_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the tables in a type such as ``tuple[Rail, ...]``, ``A | B`` or ``dict[str, Condition]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for inner in get_args(annotation) for table in _tables_in(inner)]


def field_table() -> Iterator[tuple[str, str, str]]:
    """Yield (field, default, description) of every field of a scenario."""
    yield from _fields_of(Scenario, "")


def _fields_of(table: type[BaseModel], prefix: str) -> Iterator[tuple[str, str, str]]:
    for name, declared in table.model_fields.items():
        inner = _tables_in(declared.annotation)
        own = ".NAME" if str(declared.annotation).startswith("dict") else ""
        if not inner:
            default = "required" if declared.is_required() else _toml(declared.default)
            yield f"{prefix}{name}", default, declared.description or ""
        for one in inner:
            mode = one.model_fields.get("mode")
            choice = f" ({get_args(mode.annotation)[0]})" if mode else ""
            for path, default, description in _fields_of(one, f"{prefix}{name}{own}."):
                yield path, default, f"{description}{choice}"


def _toml(value: Any) -> str:
    if value is None:
        return "left out"
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"
