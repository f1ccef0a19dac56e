"""The figures of an experiment: those of the paper, from its own data, and what they leave out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl

from co_sim.wheelset.drawing.creep import draw_creep_curve
from co_sim.wheelset.drawing.filters import draw_probabilities, draw_residuals
from co_sim.wheelset.drawing.fuzzy import draw_membership, draw_output, draw_system
from co_sim.wheelset.drawing.motion import draw_motion
from co_sim.wheelset.drawing.sheet import STYLE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from co_sim.wheelset.drawing.sheet import Picture
    from co_sim.wheelset.results import Experiment

__all__ = ["Drawing", "draw"]

#: Figures of the paper, by run.
_PAPER = {"P1": "fig5_residuals_P1", "P2": "fig6_residuals_P2", "P3": "fig7_residuals_P3"}


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure that has been written.

    Parameters
    ----------
    key : name of the figure, also of its file. file : the PNG.
    title : the question that the figure answers. caption : what it shows, with the finding.
    alt : what it shows, for a reader who cannot see it.
    """

    key: str
    file: Path
    title: str
    caption: str
    alt: str


def draw(experiment: Experiment, folder: Path) -> list[Drawing]:
    """Draw all figures of an experiment into `folder`, which must exist, and return them in reading order.

    Every PNG appears under its name when it is complete.
    """
    drawings = []
    with mpl.rc_context(STYLE):
        for key, picture in _pictures(experiment):
            file = folder / f"{key}.png"
            picture.sheet.save(file)
            drawings.append(Drawing(key, file, picture.sheet.title, picture.caption, picture.alt))
    return drawings


def _pictures(experiment: Experiment) -> Iterator[tuple[str, Picture]]:
    yield "fig2_creep_curve", draw_creep_curve(experiment)
    for run in experiment.runs:
        yield _PAPER.get(run.name, f"residuals_{run.name}"), draw_residuals(experiment, run)
    for run in experiment.runs:
        yield f"probabilities_{run.name}", draw_probabilities(experiment, run)
    for run in experiment.runs:
        yield f"motion_{run.name}", draw_motion(experiment, run)
    yield "fig8_fuzzy_system", draw_system(experiment)
    yield "membership_functions", draw_membership(experiment)
    output = draw_output(experiment)
    if output is not None:
        yield "fig9_output_membership", output
