"""A master for fixed-step co-simulation of FMUs and components written in Python."""

from co_sim.compiled_component import CompiledComponent, compiled
from co_sim.component import Component, FunctionComponent, Port
from co_sim.coupling import Coupling
from co_sim.coupling_check import CouplingCheck, check_coupling
from co_sim.errors import Fault, InputError, RunError
from co_sim.fmu import FmuComponent, StepSizeWarning
from co_sim.linear import LinearComponent
from co_sim.linearize import Linearization, linearize
from co_sim.master import CouplingWarning, Master
from co_sim.model_exchange import ExchangeFmu
from co_sim.observers import (
    CsvWriter,
    Live,
    MatWriter,
    Observer,
    Overruns,
    Pace,
    ParquetWriter,
    Progress,
    Record,
    Recorder,
    write_runs_csv,
)
from co_sim.signals import Constant, TimeTable
from co_sim.supervisor import Supervised, run
from co_sim.system import Connection, Signal, System

__all__ = [
    "CompiledComponent",
    "Component",
    "Connection",
    "Constant",
    "Coupling",
    "CouplingCheck",
    "CouplingWarning",
    "CsvWriter",
    "ExchangeFmu",
    "Fault",
    "FmuComponent",
    "FunctionComponent",
    "InputError",
    "LinearComponent",
    "Linearization",
    "Live",
    "Master",
    "MatWriter",
    "Observer",
    "Overruns",
    "Pace",
    "ParquetWriter",
    "Port",
    "Progress",
    "Record",
    "Recorder",
    "RunError",
    "Signal",
    "StepSizeWarning",
    "Supervised",
    "System",
    "TimeTable",
    "check_coupling",
    "compiled",
    "linearize",
    "run",
    "write_runs_csv",
]
