"""Everything that is wrong with an FMU or an SSP, found at once."""

from co_sim.checking.findings import Finding, Report
from co_sim.checking.fmu import check_fmu
from co_sim.checking.ssp import check_ssp

__all__ = ["Finding", "Report", "check_fmu", "check_ssp"]
