"""Runs in a process of their own, which may crash, hang or exit without harm to the caller."""

from co_sim.supervisor.process import start_server
from co_sim.supervisor.supervised import Supervised, run

__all__ = ["Supervised", "run", "start_server"]
