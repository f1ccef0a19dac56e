"""Systems and errors on their way between processes.

What another process can import travels by its name. Functions and classes of scripts, prompts, notebooks and
other modules that are nowhere on the path travel by value (cloudpickle). So do functions compiled by numba,
together with the place of their cached machine code: as numba pickles them, they would be compiled again in
each process.
"""

from __future__ import annotations

import io
import sys
from functools import lru_cache
from types import FunctionType
from typing import Any, cast

import cloudpickle
from numba.core.dispatcher import Dispatcher

from co_sim.array_functions import assembled, parts_of

__all__ = ["dumps"]


class _Pickler(cloudpickle.CloudPickler):  # type: ignore[misc]
    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self._by_value: set[str] = set()

    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, Dispatcher):
            if _has_name(thing):
                return getattr, (sys.modules[thing.__module__], cast("Any", thing).__qualname__)
            return assembled, parts_of(thing)
        if isinstance(thing, FunctionType | type):
            self._heed(thing.__module__)
        return super().reducer_override(thing)

    def close(self) -> None:
        """Forget which modules travelled by value."""
        for name in self._by_value:
            cloudpickle.unregister_pickle_by_value(sys.modules[name])

    def _heed(self, name: str) -> None:
        """Have the contents of a module travel by value, if another process cannot import it."""
        module = sys.modules.get(name)
        if module is None or name in self._by_value or name in cloudpickle.list_registry_pickle_by_value():
            return
        if not _is_importable(name, getattr(module, "__file__", None), tuple(sys.path)):
            cloudpickle.register_pickle_by_value(module)
            self._by_value.add(name)


def dumps(thing: object) -> bytes:
    """Return bytes that `pickle.loads` takes in another process with the same path of modules."""
    with io.BytesIO() as buffer:
        pickler = _Pickler(buffer)
        try:
            pickler.dump(thing)
        finally:
            pickler.close()
        return buffer.getvalue()


def _has_name(function: Any) -> bool:
    name = function.__module__
    module = sys.modules.get(name)
    if getattr(module, function.__qualname__, None) is not function:
        return False
    return _is_importable(name, getattr(module, "__file__", None), tuple(sys.path))


@lru_cache(maxsize=1024)
def _is_importable(name: str, file: str | None, path: tuple[str, ...]) -> bool:
    """Tell whether a new process with this path would find the same file under this name."""
    if name == "__main__":
        return False
    if file is None:
        return True
    places: Any = None
    spec: Any = None
    parts = name.split(".")
    for i in range(len(parts)):
        spec = _found(".".join(parts[: i + 1]), places)
        if spec is None:
            return False
        places = spec.submodule_search_locations
    # A module without a location is part of the interpreter.
    return not spec.has_location or bool(spec.origin == file)


def _found(name: str, places: Any) -> Any:
    # Not importlib.util.find_spec, which answers from the modules that are already loaded.
    specs = (finder.find_spec(name, places) for finder in sys.meta_path if hasattr(finder, "find_spec"))
    return next((spec for spec in specs if spec is not None), None)
