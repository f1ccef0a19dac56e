"""Figures of sections as PNG and SVG."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from co_sim.wheelset.reporting.section import Figure, Section

__all__ = ["Image", "drawn_once", "render"]

_DOTS_PER_INCH = 150


@dataclass(frozen=True, slots=True)
class Image:
    """A drawn figure as the bytes of its two files."""

    png: bytes
    svg: bytes


def render(figure: Figure) -> Image:
    """Draw a figure; the same figure gives the same bytes."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from co_sim.wheelset.drawing.sheet import STYLE, Sheet

    with mpl.rc_context({**STYLE, "svg.hashsalt": figure.key}):
        drawn = figure.draw()
        sheet = drawn.figure if isinstance(drawn, Sheet) else drawn
        FigureCanvasAgg(sheet)
        png, svg = io.BytesIO(), io.BytesIO()
        sheet.savefig(png, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
        sheet.savefig(svg, format="svg", dpi=_DOTS_PER_INCH, metadata={"Date": None, "Creator": None})
    return Image(png.getvalue(), svg.getvalue())


def drawn_once(section: Section) -> Section:
    """Return the section with figures that have been drawn already, and can go to another process."""
    return replace(section, figures=tuple(replace(figure, draw=_already) for figure in section.figures))


def _already() -> NoReturn:
    raise RuntimeError("the figure has been drawn; its image is in the report")
