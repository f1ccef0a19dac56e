"""Campaigns: a function of plain values, called for many cases on a cluster, resumable and reproducible.

`plan` says which cases there are, `journal` keeps what has been computed, `engine` has it computed on
dask.distributed, `cluster` finds or makes one. Nothing here knows wheelsets.
"""

from co_sim.campaign.engine import Outcome, estimate, run_campaign
from co_sim.campaign.journal import Journal
from co_sim.campaign.plan import Case, Plan

__all__ = ["Case", "Journal", "Outcome", "Plan", "estimate", "run_campaign"]
