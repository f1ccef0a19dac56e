"""Reads TOML files whose tables are pydantic models and tells their faults, each in one line."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from co_sim.errors import Fault, InputError, suggestion

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from pydantic.fields import FieldInfo
    from pydantic_core import ErrorDetails

__all__ = ["faults_of", "read_text", "tables_in", "tables_of", "validated"]

Table = TypeVar("Table", bound=BaseModel)


def read_text(path: Path, expected: str) -> str:
    """Return the text of a file; raise `InputError` if there is none that can be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "text that is not UTF-8"
        raise InputError(str(path), got=str(reason), expected=expected, remedy="check the path") from None


def tables_of(text: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML `text`; `name` stands in messages for the file."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            name, got=f"text that is not TOML ({error})", expected="TOML 1.0", remedy="mend it there"
        ) from None


def validated(model: type[Table], tables: Mapping[str, Any], name: str) -> Table:
    """Return the tables of a file as what they describe; `name` stands in messages for the file.

    Raises
    ------
    InputError
        If they have faults; all are told.
    """
    try:
        return model.model_validate(_frozen(tables))
    except ValidationError as error:
        raise InputError.from_faults(list(faults_of(error, model, name))) from None


def _frozen(value: Any) -> Any:
    """Turn TOML's lists into the tuples of frozen tables."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def faults_of(error: ValidationError, model: type[BaseModel], name: str) -> Iterator[Fault]:
    """Yield what pydantic found wrong with tables of a `model` in the file `name`."""
    found = error.errors()
    for one in found:
        # A list that is too short only because its items have faults is none.
        inner = (o for o in found if o is not one and o["loc"][: len(one["loc"])] == one["loc"])
        if one["type"] != "too_short" or not any(inner):
            yield _fault(name, one, model)


def _fault(name: str, error: ErrorDetails, model: type[BaseModel]) -> Fault:
    """Translate one fault that pydantic found."""
    path, declared, siblings = _look_up(error["loc"], model)
    what = ": ".join((name, ".".join(map(str, path)))) if path else name
    context = error.get("ctx", {})
    field = next((part for part in reversed(path) if isinstance(part, str)), "it")
    described = declared.description if declared else None
    told = f"{field} ({described})" if described else field
    match error["type"]:
        case "scenario":
            return Fault(what, context["got"], context["expected"], context["remedy"])
        case "extra_forbidden":
            known = f"one of {', '.join(siblings)}"
            return Fault(what, "an unknown key", known, suggestion(field, siblings))
        case "too_short":
            least = context["min_length"]
            return Fault(what, f"{context['actual_length']} values", f"at least {least}", f"add to {told}")
        case "missing":
            return Fault(what, "nothing", "a value", f"add {told}")
        case "union_tag_invalid" | "union_tag_not_found":
            tag = context["discriminator"].strip("'")
            choices = [
                c for table in tables_in(declared) for c in get_args(table.model_fields[tag].annotation)
            ]
            got = repr(context.get("tag"))
            return Fault(f"{what}.{tag}", got, f"one of {', '.join(choices)}", f"choose {described or field}")
    expected = error["msg"].removeprefix("Input should be ").removeprefix("a valid ")
    return Fault(what, repr(error["input"]), expected, f"change {told}")


def _look_up(
    path: tuple[int | str, ...], model: type[BaseModel]
) -> tuple[list[int | str], FieldInfo | None, list[str]]:
    """Return a path as in the file, the declaration of its last field if known, and the names beside it."""
    tables: list[type[BaseModel]] = [model]
    shown: list[int | str] = []
    declared: FieldInfo | None = None
    names: dict[str, FieldInfo] = {}
    for part in path:
        tagged = [t for t in tables if len(tables) > 1 and _has_tag(t, part)]
        if tagged:
            # Pydantic names the one of several tables that it chose; the file does not.
            tables = tagged
            continue
        shown.append(part)
        if isinstance(part, str):
            names = {name: field for t in tables for name, field in t.model_fields.items()}
            declared = names.get(part)
            # A name that no table declares is a user's own, such as that of a rail condition.
            tables = tables_in(declared) if declared else tables
    return shown, declared, list(names)


def _has_tag(table: type[BaseModel], tag: int | str) -> bool:
    return any(tag in get_args(field.annotation) for field in table.model_fields.values())


def tables_in(declared: FieldInfo | None) -> list[type[BaseModel]]:
    """Return the tables in the type of a field, such as ``tuple[A, ...]``, ``A | B`` or ``dict[str, A]``."""
    return [] if declared is None else list(_tables_of_type(declared.annotation))


def _tables_of_type(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for inner in get_args(annotation):
            yield from _tables_of_type(inner)
