"""Many campaigns: each by itself, none twice, and tables over all of them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ema.core.errors import InputError
from ema.core.numerics import available_cores
from pipelines.batch.campaigns import CampaignFolder, find_campaigns
from pipelines.batch.cluster import on_cluster
from pipelines.batch.state import (
    BatchFolder,
    Record,
    choices,
    prepared,
    read_record,
    take_fingerprint,
    write_record,
)
from pipelines.batch.summary import write_summary
from pipelines.batch.tables import tables_are_current, write_campaigns, write_modes_and_parameters
from pipelines.batch.task import Task, carry_out, sweep
from pipelines.batch.workers import in_this_process, on_this_machine
from pipelines.results.options import Options
from pipelines.results.provenance import PAGES, is_as_written

Finished = Callable[[Record, int, int], None]


@dataclass(frozen=True)
class Batch:
    """What became of the campaigns under a folder.

    Parameters
    ----------
    folder : BatchFolder
    records : tuple of Record
        One for each campaign, in the order of their names.
    fresh : frozenset of str
        Names of the campaigns processed in this run.
    """

    folder: BatchFolder
    records: tuple[Record, ...]
    fresh: frozenset[str]

    @property
    def failed(self) -> tuple[Record, ...]:
        """Campaigns without a result."""
        return tuple(record for record in self.records if not record.is_done)

    def count(self, *, done: bool, fresh: bool) -> int:
        """Number of campaigns with (`done`) or without a result, from this run or from before."""
        return sum(
            record.is_done == done and (record.campaign in self.fresh) == fresh
            for record in self.records
        )


def run_batch(
    root: Path | str,
    out: Path | str,
    options: Options | None = None,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    allow_unencrypted: bool = False,
    reports: bool = False,
    retry_failed: bool = False,
    finished: Finished = lambda record, done, total: None,
    say: Callable[[str], None] = lambda text: None,
) -> Batch:
    """Process every campaign under a folder that is not done yet.

    Parameters
    ----------
    root : path
        Searched at any depth.
    out : path
        Gets ``results/``, tables over all campaigns and a summary page; a later run into the same
        folder does only what is new or changed.
    options : Options, optional
        For all campaigns.
    jobs : int, optional
        Worker processes on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask.distributed scheduler, whose workers see `root` and `out` under the same
        paths, instead of `jobs`.
    allow_unencrypted : bool
        Whether `scheduler` may be on another machine and without TLS: whoever reaches it then can
        run code in its workers and in this process.
    reports : bool
        Whether each result gets its ``report.html``.
    retry_failed : bool
        Whether to try again what failed before and has not changed.
    finished : callable, optional
        Called with the record of each campaign as it ends, how many of this run have ended, and
        how many there are.
    say : callable, optional
        Called with what is waited for and what is risky.

    Returns
    -------
    Batch

    Raises
    ------
    InputError
        If there are no campaigns, `out` cannot be written, or there are no workers; what is wrong
        with a campaign is in its record.
    """
    options = options or Options()
    campaigns = find_campaigns(Path(root), Path(out))
    folder = prepared(Path(out))
    standing = {
        each.name: record
        for each in campaigns
        if (record := _standing(each, folder, options, reports, retry_failed)) is not None
    }
    tasks = [
        Task(each, folder, options, reports) for each in campaigns if each.name not in standing
    ]
    if jobs is not None and scheduler is not None:
        raise _two_kinds_of_workers(jobs, scheduler)
    if scheduler is not None and tasks:
        records = on_cluster(tasks, carry_out, scheduler, say, allow_unencrypted=allow_unencrypted)
    else:
        records = _done_here(tasks, jobs or available_cores())
    fresh = _carried_out(tasks, records, finished)
    every = standing | fresh
    batch = Batch(folder, tuple(every[each.name] for each in campaigns), frozenset(fresh))
    _write_overview(batch, campaigns)
    return batch


def _standing(
    campaign: CampaignFolder,
    folder: BatchFolder,
    options: Options,
    reports: bool,
    retry_failed: bool,
) -> Record | None:
    """The record of an earlier run, if it would come out the same today."""
    path = folder.record(campaign.place)
    record = read_record(path)
    if record is None or record.campaign != campaign.name:
        return None
    files = record.fingerprint.files
    fingerprint = take_fingerprint(campaign.path, choices(options), files)
    if fingerprint.digest != record.fingerprint.digest:
        return None
    if fingerprint.files != files:  # touched, not changed: next time a look will do
        record = replace(record, fingerprint=fingerprint)
        write_record(record, path)
    if not record.is_done:
        return None if retry_failed else record
    result = folder.result(campaign.place)
    is_complete = is_as_written(result) and (not reports or (result / PAGES[0]).is_file())
    return record if is_complete else None


def _two_kinds_of_workers(jobs: int, scheduler: str) -> InputError:
    return InputError(
        f"--jobs {jobs} and --scheduler {scheduler}",
        "both",
        "the workers are either this machine's or the scheduler's",
        "Leave one of them out",
    )


def _done_here(tasks: Sequence[Task], jobs: int) -> Iterator[Record]:
    """Records of tasks done by this machine; a single one needs no worker."""
    if len(tasks) < 2:
        return in_this_process(tasks, carry_out)
    return on_this_machine(tasks, carry_out, min(jobs, len(tasks)))


def _carried_out(
    tasks: Sequence[Task], records: Iterator[Record], finished: Finished
) -> dict[str, Record]:
    """Records by campaign; when this is cut short, half-written results are removed."""
    fresh: dict[str, Record] = {}
    try:
        for record in records:
            fresh[record.campaign] = record
            finished(record, len(fresh), len(tasks))
    finally:
        if isinstance(records, Generator):
            records.close()  # ends the workers
        for task in tasks:
            if task.campaign.name not in fresh:
                sweep(task)
    return fresh


def _write_overview(batch: Batch, campaigns: Sequence[CampaignFolder]) -> None:
    """Write tables and summary, unless they already say the same; the campaigns' table last."""
    if tables_are_current(batch.records, batch.folder):
        return

    write_modes_and_parameters(batch.records, batch.folder)
    write_summary(batch.records, campaigns, batch.folder)
    write_campaigns(batch.records, batch.folder)
