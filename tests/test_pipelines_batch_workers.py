"""Who does the work: whatever happens to workers, every campaign has its record."""

import multiprocessing
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from fleets import QUICK, edit, write_campaign

from pipelines import batch
from pipelines.batch import run_batch
from pipelines.batch_campaigns import CampaignFolder
from pipelines.batch_fingerprint import Fingerprint
from pipelines.batch_folder import BatchFolder
from pipelines.batch_record import DONE, Record, read_record
from pipelines.batch_task import Task
from pipelines.batch_workers import ONE_THREAD, in_this_process, on_this_machine
from pipelines.options import Options

DEADLY, DEADLY_ONCE = "tyre_3", "tyre_5"


@pytest.fixture
def tasks(tmp_path):
    folder = BatchFolder(tmp_path / "out")
    return [
        Task(CampaignFolder(name, name, tmp_path / name), folder, Options())
        for name in (f"tyre_{k}" for k in range(8))
    ]


def working(task):
    """Work that tells with which limits it was done, and whether with Dask."""
    threads = " ".join(os.environ.get(name, "") for name in ONE_THREAD)
    if "distributed" in sys.modules:
        threads += ", Dask"
    return Record(task.campaign.name, DONE, Fingerprint("", ()), message=threads)


def perilous(task):
    """Work of which one campaign kills the first worker that takes it, and one every worker."""
    trace = Path(f"{task.folder.path}.killed")
    if task.campaign.name == DEADLY or (task.campaign.name == DEADLY_ONCE and not trace.exists()):
        if task.campaign.name == DEADLY_ONCE:
            trace.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return working(task)


def test_in_this_process_campaigns_come_in_their_order(tasks):
    records = list(in_this_process(tasks, working))
    assert [record.campaign for record in records] == [task.campaign.name for task in tasks]


def test_killed_workers_lose_nothing_but_the_campaign_that_kills_them_all(tasks, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    environment = dict(os.environ)
    records = {record.campaign: record for record in on_this_machine(tasks, perilous, 2)}
    assert sorted(records) == [task.campaign.name for task in tasks]
    assert Path(f"{tasks[0].folder.path}.killed").exists()
    failed = records.pop(DEADLY)
    assert "lack of memory" in failed.message
    assert read_record(tasks[3].folder.record(DEADLY)) == failed
    assert all(record.is_done for record in records.values())
    assert {record.message for record in records.values()} == {"1 1 1"}
    assert dict(os.environ) == environment
    assert multiprocessing.active_children() == []


def test_two_workers_give_the_same_as_none(short_campaign, tmp_path, monkeypatch):
    for name in ("broken", "tyre_1", "tyre_2"):
        write_campaign(short_campaign, tmp_path / "root" / name)
    edit(tmp_path / "root" / "broken", "positions = 72", "positions = 0")
    edit(tmp_path / "root" / "tyre_2", "position_deg = 0.0", "position_deg = 30.0")
    two = run_batch(tmp_path / "root", tmp_path / "two", QUICK, jobs=2)
    monkeypatch.setattr(
        batch, "on_this_machine", lambda tasks, work, _: in_this_process(tasks, work)
    )
    one = run_batch(tmp_path / "root", tmp_path / "one", QUICK, jobs=1)
    assert [record.is_done for record in two.records] == [False, True, True]
    for name in ("modes.parquet", "parameters.parquet"):
        assert (one.folder.path / name).read_bytes() == (two.folder.path / name).read_bytes()
    for mine, other in zip(one.records, two.records, strict=True):
        # As texts: a purity that is not a number equals itself there.
        assert repr(replace(mine, seconds=0)) == repr(replace(other, seconds=0))
    again = run_batch(tmp_path / "root", tmp_path / "two", QUICK)
    assert again.fresh == frozenset()
