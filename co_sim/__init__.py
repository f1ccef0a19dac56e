"""A master for fixed-step co-simulation of FMUs and components written in Python."""

from co_sim.component import Component, FunctionComponent, Port
from co_sim.errors import Fault, InputError, RunError
from co_sim.fmu import FmuComponent
from co_sim.master import Master
from co_sim.model_exchange import ExchangeFmu
from co_sim.recorder import Observer, Record, Recorder, write_runs_csv
from co_sim.signals import Constant, TimeTable
from co_sim.system import Connection, Signal, System

__all__ = [
    "Component",
    "Connection",
    "Constant",
    "ExchangeFmu",
    "Fault",
    "FmuComponent",
    "FunctionComponent",
    "InputError",
    "Master",
    "Observer",
    "Port",
    "Record",
    "Recorder",
    "RunError",
    "Signal",
    "System",
    "TimeTable",
    "write_runs_csv",
]
