"""Who does the work: whatever happens to workers, every campaign has its record."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from batch_work import DEADLY, DEADLY_ONCE, Unloadable, perilous, working
from fleets import QUICK, edit, write_campaign

from ema.core.errors import InputError
from pipelines.batch import run as batch
from pipelines.batch.campaigns import CampaignFolder, Task
from pipelines.batch.run import run_batch
from pipelines.batch.state import BatchFolder, read_record
from pipelines.batch.workers import in_this_process, on_this_machine
from pipelines.results.options import Options

needs_signals = pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="looks at processes as Linux shows them"
)


@pytest.fixture
def tasks(tmp_path):
    folder = BatchFolder(tmp_path / "out")
    return [
        Task(CampaignFolder(name, name, tmp_path / name), folder, Options())
        for name in (f"tyre_{k}" for k in range(8))
    ]


def begun(folder):
    """Numbers of the processes that have begun a result."""
    return [int(path.name) for path in folder.path.glob("results/.*.partial/*")]


def runs(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()


@pytest.fixture
def endless(short_campaign, tmp_path):
    """A batch in a process group of its own, as a shell starts it, whose work does not end."""
    for name in ("a", "b", "c"):
        write_campaign(short_campaign, tmp_path / "root" / name)
    # A shell in the background leaves SIGINT ignored to what it starts.
    program = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "import sys; from pipelines.batch import run; from pipelines.cli.main import main; "
        "import batch_work; run.carry_out = batch_work.patient; main()"
    )
    tests = Path(__file__).parents[2]
    paths = os.pathsep.join([str(tests), str(tests.parent), *sys.path])
    arguments = ("batch", tmp_path / "root", "--out", tmp_path / "out", "--jobs", "2", "--quiet")
    with subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "PYTHONPATH": paths},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as running:
        yield running, BatchFolder(tmp_path / "out")
        running.kill()


def begun_by_two(batch, folder):
    """The workers of a batch, once both are at work."""
    while len(workers := begun(folder)) < 2:
        assert batch.poll() is None
        time.sleep(0.05)
    return workers


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


def test_a_campaign_that_kills_is_tried_again_by_workers_that_have_nothing_to_do(tasks):
    killing = [task for task in tasks if task.campaign.name in (DEADLY, DEADLY_ONCE)]
    records = {record.campaign: record for record in on_this_machine(killing, perilous, 2)}
    assert {name: record.is_done for name, record in records.items()} == {
        DEADLY: False,
        DEADLY_ONCE: True,
    }


def test_workers_that_cannot_start_end_the_batch(tasks):
    with pytest.raises(InputError) as refused:
        list(on_this_machine(tasks, Unloadable(), 2))
    assert "3" in refused.value.found
    assert multiprocessing.active_children() == []


@needs_signals
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_workers_and_removes_what_they_began(number, code, endless):
    batch, folder = endless
    workers = begun_by_two(batch, folder)
    os.killpg(batch.pid, number) if number == signal.SIGINT else batch.send_signal(number)
    assert batch.wait(30) == code
    assert not any(map(runs, workers))
    assert begun(folder) == []


@needs_signals
def test_workers_do_not_outlive_a_batch_that_is_killed(endless):
    batch, folder = endless
    workers = begun_by_two(batch, folder)
    batch.kill()
    batch.wait()
    deadline = time.monotonic() + 30
    while any(map(runs, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
