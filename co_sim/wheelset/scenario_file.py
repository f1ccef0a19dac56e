"""Reads scenario files, packaged ones and a user's own, and lists what they may hold."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from co_sim.errors import InputError
from co_sim.wheelset.scenario import Scenario
from co_sim.wheelset.table_files import read_text, tables_in, tables_of, validated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.resources.abc import Traversable

    from pydantic import BaseModel

__all__ = ["field_table", "load_scenario", "packaged_names", "packaged_text", "parse"]


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


def parse(text: str, name: str) -> Scenario:
    """Return the scenario in a TOML `text`; `name` stands in messages for the file."""
    return validated(Scenario, tables_of(text, name), name)


def field_table() -> Iterator[tuple[str, str, str]]:
    """Yield (field, default, description) of every field of a scenario."""
    yield from _fields_of(Scenario, "")


def _fields_of(table: type[BaseModel], prefix: str) -> Iterator[tuple[str, str, str]]:
    for name, declared in table.model_fields.items():
        inner = tables_in(declared)
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
