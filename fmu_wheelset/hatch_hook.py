"""Build hook: a wheel of this project carries the FMUs for the machine it was built on.

The archives are written in the source tree. While they are newer than all they are made of, a second
installation takes them as they are and asks for no compiler.
"""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

if TYPE_CHECKING:
    from collections.abc import Iterator

#: The C compiler, and the package whose wheel has the headers of FMI 2 and FMI 3.
TOOLS = ["ziglang==0.17.1", "fmpy==0.3.32"]


class WheelsetBuildHook(BuildHookInterface[Any]):  # type: ignore[misc, unused-ignore]
    """Compile the archives before hatchling collects the files of a wheel, also of an editable one."""

    def dependencies(self) -> list[str]:
        """Return what must be installed before `initialize`."""
        if self.target_name != "wheel":
            return []
        with self._source_tree():
            from fmu_wheelset import build

            return [] if build.is_current() else TOOLS

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the archives in the source tree and tag the wheel with this machine."""
        if self.target_name != "wheel":
            return
        with self._source_tree():
            from fmu_wheelset import build, targets

            if not build.is_current():
                build.build()
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{targets.host_target().wheel_tag}"

    @contextmanager
    def _source_tree(self) -> Iterator[None]:
        sys.path.insert(0, self.root)
        try:
            yield
        finally:
            sys.path.remove(self.root)
