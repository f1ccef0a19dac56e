"""Observers of a run: memory, files, a terminal, the clock, functions of the user."""

from co_sim.observers.csv_file import CsvWriter, write_runs_csv
from co_sim.observers.live import Live
from co_sim.observers.mat_file import MatWriter
from co_sim.observers.memory import Record, Recorder
from co_sim.observers.pace import Overruns, Pace
from co_sim.observers.parquet_file import ParquetWriter
from co_sim.observers.progress import Progress
from co_sim.observers.protocol import Observer
from co_sim.observers.selection import Selection, Window

__all__ = [
    "CsvWriter",
    "Live",
    "MatWriter",
    "Observer",
    "Overruns",
    "Pace",
    "ParquetWriter",
    "Progress",
    "Record",
    "Recorder",
    "Selection",
    "Window",
    "write_runs_csv",
]
