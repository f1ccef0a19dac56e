"""Build hook: a wheel of this project carries the FMUs for the machine it was built on."""

from __future__ import annotations

import sys
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WheelsetBuildHook(BuildHookInterface[Any]):  # type: ignore[misc, unused-ignore]
    """Compile the archives before hatchling collects the files of a wheel, also of an editable one."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the archives in the source tree and tag the wheel with this machine."""
        if self.target_name != "wheel":
            return
        sys.path.insert(0, self.root)
        try:
            from fmu_wheelset import build, targets

            target = targets.host_target()
            build.build(targets=[target])
        finally:
            sys.path.remove(self.root)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{target.wheel_tag}"
