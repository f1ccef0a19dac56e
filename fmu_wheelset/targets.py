"""The platforms that the FMU's shared library is built for."""

from __future__ import annotations

import platform
from dataclasses import dataclass

__all__ = ["TARGETS", "Target", "host_target"]


@dataclass(frozen=True, slots=True)
class Target:
    """A platform for which the shared library can be built.

    Parameters
    ----------
    triple : what the compiler calls it.
    fmi2_folder, fmi3_folder : folder of the library below ``binaries/``.
    suffix : of the shared library.
    wheel_tag : platform tag of a wheel that holds it.
    """

    triple: str
    fmi2_folder: str
    fmi3_folder: str
    suffix: str
    wheel_tag: str


#: Targets by (system, machine) as the platform module names them. FMI 2 has one folder for both kinds of
#: macOS machine, and there the library is a universal one.
TARGETS = {
    ("Linux", "x86_64"): Target(
        triple="x86_64-linux-gnu.2.17",
        fmi2_folder="linux64",
        fmi3_folder="x86_64-linux",
        suffix=".so",
        wheel_tag="manylinux_2_17_x86_64",
    ),
    ("Linux", "aarch64"): Target(
        triple="aarch64-linux-gnu.2.17",
        fmi2_folder="aarch64-linux",
        fmi3_folder="aarch64-linux",
        suffix=".so",
        wheel_tag="manylinux_2_17_aarch64",
    ),
    ("Windows", "AMD64"): Target(
        triple="x86_64-windows-gnu",
        fmi2_folder="win64",
        fmi3_folder="x86_64-windows",
        suffix=".dll",
        wheel_tag="win_amd64",
    ),
    ("Darwin", "x86_64"): Target(
        triple="x86_64-macos.11.0",
        fmi2_folder="darwin64",
        fmi3_folder="x86_64-darwin",
        suffix=".dylib",
        wheel_tag="macosx_11_0_x86_64",
    ),
    ("Darwin", "arm64"): Target(
        triple="aarch64-macos.11.0",
        fmi2_folder="darwin64",
        fmi3_folder="aarch64-darwin",
        suffix=".dylib",
        wheel_tag="macosx_11_0_arm64",
    ),
}


def host_target() -> Target:
    """Return the target of this machine.

    Raises
    ------
    RuntimeError
        The machine is none of `TARGETS`.
    """
    host = (platform.system(), platform.machine())
    if host not in TARGETS:
        known = ", ".join(" ".join(target) for target in TARGETS)
        raise RuntimeError(f"platform: got {' '.join(host)}, expected one of {known}; build on one of those")
    return TARGETS[host]
