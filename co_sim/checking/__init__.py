"""Everything that is wrong with an FMU, found at once."""

from co_sim.checking.findings import Finding, Report
from co_sim.checking.fmu import check_fmu

__all__ = ["Finding", "Report", "check_fmu"]
