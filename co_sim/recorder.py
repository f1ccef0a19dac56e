"""The recorder under its former address; see `co_sim.observers`."""

from co_sim.observers import Observer, Record, Recorder, write_runs_csv

__all__ = ["Observer", "Record", "Recorder", "write_runs_csv"]
