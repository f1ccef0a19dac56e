"""Reports over a grid of operating points: what can be seen, steered and identified, and what cannot.

A report is made of sections (`section.Section`), each a function of a `setup.Setup` and a `grid.Grid`;
`produce` computes them in processes of their own and writes one page, one JSON file and the figures.
"""

from co_sim.wheelset.reporting.grid import Grid, GridPoint
from co_sim.wheelset.reporting.section import Column, Figure, Quantity, Section, Table
from co_sim.wheelset.reporting.setup import SENSORS, Setup

__all__ = ["SENSORS", "Column", "Figure", "Grid", "GridPoint", "Quantity", "Section", "Setup", "Table"]
