"""The plant: a nonlinear wheelset on rails as an FMU, and the parameters that it shares with the estimator.

`path` gives the packaged archive and `export` a copy with other start values. Importing this package needs
the standard library only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from fmu_wheelset.exporting import export
from fmu_wheelset.parameters import CONDITIONS, ContactPatch, RailCondition, WheelsetParameters

__all__ = ["CONDITIONS", "ContactPatch", "RailCondition", "WheelsetParameters", "export", "path"]

_REMEDY = "run `python -m pip install .` in the project folder"


def path(fmi: Literal[2, 3] = 3) -> Path:
    """Return the path of the wheelset FMU.

    Parameters
    ----------
    fmi : major version of the FMI standard that the archive follows.

    Raises
    ------
    ValueError
        `fmi` is not 2 or 3.
    FileNotFoundError
        The archive was not built.
    RuntimeError
        The archive was built from another state of the sources than the one installed.
    """
    from fmu_wheelset import build

    if fmi not in (2, 3):
        raise ValueError(f"fmi: got {fmi!r}, expected 2 or 3; choose the FMI version of the archive")
    archive = Path(__file__).parent / "archives" / f"wheelset_fmi{fmi}.fmu"
    if not archive.is_file():
        raise FileNotFoundError(f"{archive.name}: got no archive, expected one beside the package; {_REMEDY}")
    built, present = build.archive_token(archive), build.present_token()
    if built != present:
        raise RuntimeError(
            f"{archive.name}: got an archive built from {built}, expected {present} as the sources; {_REMEDY}"
        )
    return archive
