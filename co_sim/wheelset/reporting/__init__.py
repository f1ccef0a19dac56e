"""Reports over a grid of operating points: what can be seen, steered and identified, and what cannot.

A report is made of sections (`section.Section`), each a function of a `setup.Setup` and a `grid.Grid`.
`over_grid` computes them in processes of their own, and `write_report` writes one page, one JSON file and the
figures. `report_model`, `report_system` and `report_fmu` ask a part of the same questions of any model.
"""

from co_sim.wheelset.reporting.grid import Grid, GridPoint
from co_sim.wheelset.reporting.model_report import report_fmu, report_model, report_system
from co_sim.wheelset.reporting.page import write_report
from co_sim.wheelset.reporting.report import Report, over_grid
from co_sim.wheelset.reporting.section import Column, Figure, Quantity, Section, Table
from co_sim.wheelset.reporting.setup import SENSORS, Setup

__all__ = [
    "SENSORS",
    "Column",
    "Figure",
    "Grid",
    "GridPoint",
    "Quantity",
    "Report",
    "Section",
    "Setup",
    "Table",
    "over_grid",
    "report_fmu",
    "report_model",
    "report_system",
    "write_report",
]
