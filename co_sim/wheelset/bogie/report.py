"""The page that tells what the bogie did and why it was coupled as it was."""

from __future__ import annotations

import base64
from importlib.metadata import version
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from co_sim.files import whole_file
from co_sim.wheelset.bogie.assembly import WHEELSETS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from co_sim.observers import Recorder
    from co_sim.wheelset.bogie.run import BogieRun

__all__ = ["write_report"]


#: Captions of the figures by the names of their files.
_CAPTIONS = {
    "bogie_system": "The system in bogie.ssp; of the ports, those that are connected are shown.",
    "bogie_motion": "Motion of wheelsets and frame over time, and the track's lateral offset under the front "
    "wheelset. Displacements are positive to the left of travel, yaw is so counter-clockwise from above.",
    "bogie_loads": "Lateral force and yaw moment of the primary suspension on each wheelset over time, with "
    "the signs of the motions.",
}
#: Quantities of each wheelset: signal, factor to the unit that is shown, and the unit.
_QUANTITIES = {
    "lateral displacement relative to the track": ("{}.relative_displacement", 1e3, "mm"),
    "yaw angle": ("{}.yaw_angle", 1e3, "mrad"),
    "lateral force of the primary suspension": ("frame.{}.lateral_force", 1e-3, "kN"),
    "yaw moment of the primary suspension": ("frame.{}.yaw_moment", 1e-3, "kN m"),
}


def write_report(run: BogieRun, record: Recorder, drawings: Sequence[Path], path: Path) -> None:
    """Write the report to `path`; it holds the drawings and needs no other file."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("co_sim.wheelset"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pictures = [
        (file.stem, _CAPTIONS[file.stem], base64.b64encode(file.read_bytes()).decode()) for file in drawings
    ]
    page = environment.get_template("bogie.html.jinja").render(
        run=run,
        pictures=pictures,
        greatest=list(_greatest(record)),
        versions={name: version(name) for name in ("wheelset-cosim", "pythonfmu3")},
    )
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _greatest(record: Recorder) -> Iterator[tuple[str, float, float, str]]:
    for what, (signal, factor, unit) in _QUANTITIES.items():
        front, rear = (factor * float(np.max(np.abs(record[signal.format(name)]))) for name in WHEELSETS)
        yield what, front, rear, unit
