"""A campaign to be killed. Arguments: folder, cases, seconds of each, address of a scheduler or nothing."""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from co_sim.campaign import Case, Journal, Plan, run_campaign
from co_sim.campaign.cluster import connect
from co_sim.campaign.engine import ClusterLostError


def slow(case: Case, seconds: float) -> dict[str, Any]:
    time.sleep(seconds)
    return {"y": 2.0 * float(case.values["a"]), "seed_seen": case.seed}


def main() -> None:
    folder, n, seconds, scheduler = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), sys.argv[4:]
    plan = Plan(grid={"a": tuple(range(n))})
    with Journal(folder, plan.key) as journal, connect(*scheduler, workers=2 - len(scheduler)) as client:
        try:
            run_campaign(partial(slow, seconds=seconds), plan.cases(), journal, client)
        except ClusterLostError:
            print(f"lost with {len(journal.entries)}")


if __name__ == "__main__":
    main()
