"""Campaigns on a real local cluster: no case is lost, none is computed twice, no death ends a campaign."""

import sys
from pathlib import Path

import pytest

from co_sim.campaign import Journal, Plan, estimate, run_campaign
from co_sim.campaign.cluster import connect
from co_sim.campaign.engine import Outcome
from co_sim.campaign.results import rows, write_parquet
from co_sim.errors import InputError

PLAN = Plan(grid={"a": tuple(range(10))}, repeat=2, draw={"m": {"normal": (1.0, 0.1)}})


@pytest.fixture(scope="module")
def functions():
    # On the path of this process and, by dask, of its workers.
    sys.path.insert(0, str(Path(__file__).parent))
    import functions

    yield functions
    sys.path.remove(str(Path(__file__).parent))


@pytest.fixture(scope="module")
def client(functions):
    with connect(workers=2) as client:
        client.upload_file(functions.__file__)
        yield client


def test_all_cases_once_and_a_second_run_computes_none(tmp_path, client, functions):
    shown = []
    with Journal(tmp_path, PLAN.key) as journal:
        outcome = run_campaign(functions.doubled, PLAN.cases(), journal, client, show=shown.append)
        again = run_campaign(functions.doubled, PLAN.cases(), journal, client)
        table = rows(PLAN.cases(), journal)
    assert (outcome.done, outcome.failed, again.done) == (20, 0, 0)
    assert sorted(entry.case for entry in shown) == list(range(20))
    for case, row in zip(PLAN.cases(), table, strict=True):
        assert (row["y"], row["seed_seen"], row["seed"]) == (2.0 * case.values["a"], case.seed, case.seed)


def test_a_campaign_goes_on_where_it_stopped(tmp_path, client, functions):
    class EnoughError(Exception):
        pass

    def stop_after(n, kept):
        def show(entry):
            kept.append(entry.case)
            if len(kept) == n:
                raise EnoughError

        return show

    kept = []
    with Journal(tmp_path, PLAN.key) as journal, pytest.raises(EnoughError):
        run_campaign(functions.doubled, PLAN.cases(), journal, client, show=stop_after(7, kept))
    with Journal(tmp_path, PLAN.key) as journal:
        outcome = run_campaign(
            functions.doubled, PLAN.cases(), journal, client, show=lambda e: kept.append(e.case)
        )
    assert outcome.done == 13
    assert sorted(kept) == list(range(20))


def test_failures_and_deaths_are_results_and_the_rest_goes_on(tmp_path, client, functions):
    plan = Plan(grid={"a": tuple(range(6))})
    with Journal(tmp_path, plan.key) as journal:
        outcome = run_campaign(functions.moody, plan.cases(), journal, client)
        entries = journal.entries
    assert (outcome.done, outcome.failed) == (6, 3)
    assert entries[4].reason == "ValueError: 4 is not to my taste"
    assert "worker died" in entries[3].reason
    assert "JSON" in entries[5].reason
    assert all(entries[i].status == "done" for i in (0, 1, 2))


def test_parquet_has_a_row_for_each_case(tmp_path, client, functions):
    from pyarrow import parquet

    plan = Plan(grid={"a": (2, 4)})
    with Journal(tmp_path, plan.key) as journal:
        run_campaign(functions.moody, plan.cases(), journal, client)
        write_parquet(rows(plan.cases(), journal), tmp_path / "results.parquet")
    table = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert [row["status"] for row in table] == ["done", "failed"]
    assert [row["y"] for row in table] == [4.0, None]


def test_nobody_at_the_address():
    with pytest.raises(InputError, match="no answer"), connect("tcp://127.0.0.1:9"):
        pass


def test_the_estimate_is_in_proportion():
    assert estimate(Outcome(100, 3, 50.0), 9900) == pytest.approx(4950.0)
