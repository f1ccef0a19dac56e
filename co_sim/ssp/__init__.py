"""System Structure and Parameterization (SSP) 1.0 and 2.0: systems of FMUs, read and written."""

from co_sim.ssp.reading import SspModel, open_ssp, read_ssp
from co_sim.ssp.validation import schema_faults
from co_sim.ssp.writing import write_ssp

__all__ = ["SspModel", "open_ssp", "read_ssp", "schema_faults", "write_ssp"]
