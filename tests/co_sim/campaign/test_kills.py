"""Whatever is killed in mid-campaign: nothing that was computed is lost, nothing is computed twice."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from co_sim.campaign import Journal, Plan, run_campaign
from co_sim.campaign.cluster import connect
from co_sim.campaign.journal import Entry
from co_sim.campaign.results import rows, write_parquet

HERE = Path(__file__).parent
CASES = 40


def start(*arguments: object, **environment: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(HERE / "driver.py"), *map(str, arguments)]
    path = os.pathsep.join([str(HERE), str(HERE.parents[2])])
    return subprocess.Popen(
        command,
        env=os.environ | {"PYTHONPATH": path} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def numbers(folder: Path) -> list[int]:
    """The cases in the journal, in the order in which they were computed."""
    lines = (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)[1:]
    return [json.loads(line)["case"] for line in lines if line.endswith("\n")]


def finish(folder: Path) -> None:
    """Run the campaign to its end."""
    process = start(folder, CASES, 0.0)
    process.communicate(timeout=120)
    assert process.returncode == 0


def wait_for(folder: Path, n: int, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + 120.0
    while process.poll() is None and time.monotonic() < end:
        if (folder / "journal.jsonl").exists() and len(numbers(folder)) >= n:
            return
        time.sleep(0.05)
    raise AssertionError(f"the campaign ended or hung, {process.returncode}")


def children(pid: int) -> set[int]:
    found = subprocess.run(["ps", "-eo", "pid,ppid"], capture_output=True, text=True, check=True).stdout
    pairs = [tuple(map(int, line.split())) for line in found.splitlines()[1:]]
    grown, before = {pid}, set()
    while grown != before:
        before = set(grown)
        grown |= {child for child, parent in pairs if parent in grown}
    return grown - {pid}


def test_a_killed_command_goes_on_where_it_was(tmp_path):
    first = start(tmp_path, CASES, 0.1)
    wait_for(tmp_path, 5, first)
    workers = children(first.pid)
    first.kill()
    first.communicate()
    kept = numbers(tmp_path)
    assert 5 <= len(kept) < CASES
    finish(tmp_path)
    assert numbers(tmp_path)[: len(kept)] == kept
    assert Counter(numbers(tmp_path)) == Counter(range(CASES))
    end = time.monotonic() + 60.0
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < end:
        time.sleep(0.2)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()], "workers outlive their command"


def test_a_killed_scheduler_ends_the_campaign_and_keeps_its_results(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    impatient = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "2s"}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parents[2])])}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    dask = [sys.executable, "-m", "dask"]
    scheduler = subprocess.Popen([*dask, "scheduler", "--port", str(port), "--no-dashboard"], **quiet)
    worker = subprocess.Popen(
        [*dask, "worker", address, "--nthreads", "1", "--no-dashboard", "--death-timeout", "60"], **quiet
    )
    try:
        campaign = start(tmp_path, CASES, 0.1, address, **impatient)
        wait_for(tmp_path, 3, campaign)
        scheduler.kill()
        said, _ = campaign.communicate(timeout=120)
    finally:
        for process in (scheduler, worker):
            process.send_signal(signal.SIGKILL)
            process.wait()
    kept = numbers(tmp_path)
    assert said == f"lost with {len(kept)}\n"
    assert 3 <= len(kept) < CASES
    finish(tmp_path)
    assert Counter(numbers(tmp_path)) == Counter(range(CASES))


@pytest.mark.parametrize("workers", [1, 2])
def test_any_number_of_workers_computes_the_same(tmp_path, workers):
    plan = Plan(grid={"a": tuple(range(12))}, draw={"m": {"normal": (1.0, 0.1)}})
    with Journal(tmp_path, plan.key) as journal:
        with connect(workers=workers) as client:
            run_campaign(drawn, plan.cases(), journal, client)
        write_parquet(rows(plan.cases(), journal), tmp_path / "cases.parquet")
    alone = tmp_path / "alone"
    alone.mkdir()
    with Journal(alone, plan.key) as here:
        for case in plan.cases():
            here.add(Entry(case.number, "done", drawn(case)))
        write_parquet(rows(plan.cases(), here), tmp_path / "here.parquet")
    assert (tmp_path / "cases.parquet").read_bytes() == (tmp_path / "here.parquet").read_bytes()


def drawn(case):
    return {"y": float(np.random.default_rng(case.seed).normal()) * case.values["m"]}
