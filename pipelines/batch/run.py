"""A batch: every campaign under a folder, each by itself, and tables over all of them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ema.core.errors import InputError
from ema.core.numerics import available_cores
from pipelines.batch.campaigns import Task, carry_out, find_campaigns, sweep
from pipelines.batch.state import (
    BatchFolder,
    Record,
    choices,
    prepared,
    read_record,
    take_fingerprint,
    write_record,
)
from pipelines.batch.summary import (
    tables_are_current,
    write_campaigns,
    write_modes_and_parameters,
    write_summary,
)
from pipelines.batch.workers import in_this_process, on_cluster, on_this_machine
from pipelines.report.template import PLAIN, Template
from pipelines.results.options import Options
from pipelines.results.provenance import PAGES, is_as_written

Finished = Callable[[Record, int, int], None]


@dataclass(frozen=True)
class Batch:
    """Outcome of the campaigns under a folder.

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
    template: Template = PLAIN,
    retry_failed: bool = False,
    finished: Finished = lambda record, done, total: None,
    announce: Callable[[str], None] = lambda text: None,
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
        Whether `scheduler` may be on another machine without TLS: anyone who reaches it can run
        code in its workers and in this process.
    reports : bool
        Whether each result gets its ``report.html``.
    template : Template
        Texts, logo and units of the reports.
    retry_failed : bool
        Whether to retry campaigns that failed and have not changed.
    finished : callable, optional
        Called with (record, done, total) as each campaign ends.
    announce : callable, optional
        Called with messages about waiting and about risks.

    Raises
    ------
    InputError
        If there are no campaigns, `out` cannot be written, or there are no workers; an error of
        a campaign is in its record.
    """
    options = options or Options()
    campaigns = find_campaigns(Path(root), Path(out))
    folder = prepared(Path(out))
    tasks = [Task(each, folder, options, reports, template) for each in campaigns]
    known = {each.campaign.name: _earlier(each, retry_failed=retry_failed) for each in tasks}
    earlier = {name: record for name, record in known.items() if record is not None}
    tasks = [each for each in tasks if each.campaign.name not in earlier]
    if jobs is not None and scheduler is not None:
        where = f"--jobs {jobs} and --scheduler {scheduler}"
        rule = "the workers are either on this machine or those of the scheduler"
        raise InputError(where, "both", rule, "Leave one of them out")
    if scheduler is not None and tasks:
        ended = on_cluster(
            tasks, carry_out, scheduler, announce, allow_unencrypted=allow_unencrypted
        )
    elif len(tasks) < 2:  # a single one needs no worker process
        ended = in_this_process(tasks, carry_out)
    else:
        ended = on_this_machine(tasks, carry_out, min(jobs or available_cores(), len(tasks)))
    fresh = _carried_out(tasks, ended, finished)
    every = earlier | fresh
    records = tuple(every[each.name] for each in campaigns)
    if not tables_are_current(records, folder):  # the campaigns' table last: it tells that
        write_modes_and_parameters(records, folder)
        write_summary(records, campaigns, folder)
        write_campaigns(records, folder)
    return Batch(folder, records, frozenset(fresh))


def _earlier(task: Task, *, retry_failed: bool) -> Record | None:
    """The record of an earlier run, if it would be the same today."""
    record = read_record(task.record)
    if record is None or record.campaign != task.campaign.name:
        return None
    files = record.fingerprint.files
    fingerprint = take_fingerprint(task.campaign.path, choices(task.options), files)
    if fingerprint.digest != record.fingerprint.digest:
        return None
    if fingerprint.files != files:  # only times changed: next time the content need not be read
        record = replace(record, fingerprint=fingerprint)
        write_record(record, task.record)
    if not record.is_done:
        return None if retry_failed else record
    is_complete = not task.report or (task.result / PAGES[0]).is_file()
    return record if is_complete and is_as_written(task.result) else None


def _carried_out(
    tasks: Sequence[Task], records: Generator[Record], finished: Finished
) -> dict[str, Record]:
    """Records by campaign; after an interruption half-written results are removed."""
    fresh: dict[str, Record] = {}
    try:
        for record in records:
            fresh[record.campaign] = record
            finished(record, len(fresh), len(tasks))
    finally:
        records.close()  # ends the workers
        for task in tasks:
            if task.campaign.name not in fresh:
                sweep(task)
    return fresh
