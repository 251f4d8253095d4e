"""Run a batch, and keep its summary: a row for each campaign."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd
import pyarrow.parquet as pq

from ema.core.display import number, plain
from ema.core.errors import InputError
from ema.core.files import require_regular
from ema.core.numerics import available_cores
from pipelines.batch.campaigns import CampaignFolder, Task, carry_out, find_campaigns, sweep
from pipelines.batch.state import (
    BatchFolder,
    Record,
    choices,
    prepared,
    read_record,
    take_fingerprint,
    write_record,
)
from pipelines.batch.workers import in_this_process, on_cluster, on_this_machine
from pipelines.plots.chart import Chart
from pipelines.plots.measurement import SYMBOLS
from pipelines.plots.plot import FREQUENCY, ORDER, SERIES, Axis, Curve, Margins, Panel, Plot
from pipelines.report.page import (
    PLAIN,
    Block,
    Facts,
    Link,
    Listing,
    Paragraph,
    Section,
    Table,
    Template,
    render_page,
)
from pipelines.results.options import Options
from pipelines.results.provenance import PAGES, is_as_written
from pipelines.results.tables import MODES, short
from pipelines.storage.atomic import file_written_whole
from pipelines.storage.tables import typed, write_table

_FREQUENCY, _ORDER = MODES.index("frequency_hz"), MODES.index("order")
PARAMETERS = ("parameter", "value", "std", "how")
_OF_CAMPAIGN = {"campaign": "string", "designation": "string", "inflation_pressure_pa": "float64"}
_TEXT = ("member", "status", "pair", "name", "chosen", "parameter", "how")
_WHOLE = ("mode", "order")
_CAMPAIGNS = {
    **_OF_CAMPAIGN,
    **{"status": "string", "message": "string", "seconds": "float64"},
    **{"n_modes": "int32", "n_warnings": "int32", "fingerprint": "string", "traceback": "string"},
}
_ROOM = 0.6  # share of the distance between two orders that the points of all tyres take


def write_modes_and_parameters(records: Sequence[Record], folder: BatchFolder) -> None:
    """Write ``modes.parquet`` and ``parameters.parquet``."""
    for name, columns in (("modes", MODES), ("parameters", PARAMETERS)):
        rows = [
            (each.campaign, each.designation, each.inflation_pressure_pa, *row)
            for each in records
            for row in getattr(each, name)
        ]
        _write_rows(getattr(folder, name), _types(columns), rows)


def write_campaigns(records: Sequence[Record], folder: BatchFolder) -> None:
    """Write ``campaigns.parquet``, from which a later run sees whether the tables are current."""
    rows = [tuple(each.values()) for each in campaign_rows(records)]
    _write_rows(folder.campaigns, _CAMPAIGNS, rows)


def tables_are_current(records: Sequence[Record], folder: BatchFolder) -> bool:
    """Whether tables and summary of exactly these records exist."""
    if not folder.is_complete():
        return False
    try:
        rows = pq.read_table(require_regular(folder.campaigns)).to_pylist()
    except (OSError, ValueError):  # what pyarrow raises for a damaged file
        return False
    return bool(rows == campaign_rows(records))


def campaign_rows(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Rows of ``campaigns.parquet`` with the names of their columns."""
    return [
        {name: getattr(record, name, None) for name in _CAMPAIGNS}
        | {"n_modes": len(record.modes), "fingerprint": record.fingerprint.digest}
        for record in records
    ]


def _types(columns: Sequence[str]) -> dict[str, str]:
    texts, whole = dict.fromkeys(_TEXT, "string"), dict.fromkeys(_WHOLE, "int32")
    return {**_OF_CAMPAIGN, **{name: (texts | whole).get(name, "float64") for name in columns}}


def _write_rows(path: Path, types: Mapping[str, str], rows: Sequence[tuple[Any, ...]]) -> None:
    write_table(path, typed((dict(zip(types, row, strict=True)) for row in rows), types))


def write_summary(
    records: Sequence[Record], campaigns: Sequence[CampaignFolder], folder: BatchFolder
) -> None:
    """Write ``summary.html``, one file that needs no network."""
    first = (_overview(records), _failures(records), _frequencies(records))
    sections = (*first, _campaigns(records, campaigns, folder))
    shown = tuple(each for each in sections if each.blocks)
    page = render_page("Batch of campaigns", folder.path.name, shown)
    with file_written_whole(folder.summary) as partial:
        partial.write_text(page, encoding="utf-8")


def _overview(records: Sequence[Record]) -> Section:
    done = [record for record in records if record.is_done]
    tyres = sorted({record.designation for record in done if record.designation})
    facts = (
        ("Campaigns", str(len(records))),
        ("Done", str(len(done))),
        ("Failed", str(len(records) - len(done))),
        ("Done with warnings", str(sum(record.n_warnings > 0 for record in done))),
        ("Modes", str(sum(len(record.modes) for record in done))),
        ("Tyres", ", ".join(tyres) or "none named"),
        ("Processing time in total", f"{number(sum(each.seconds for each in records), 3)} s"),
    )
    verdict = (
        Paragraph("Every campaign has a result.", "good")
        if len(done) == len(records)
        else Paragraph(f"{len(records) - len(done)} of {len(records)} have no result.", "warning")
    )
    return Section("summary", "Summary", (verdict, Facts(facts)))


def _failures(records: Sequence[Record]) -> Section:
    failed = [record for record in records if not record.is_done]
    items = tuple(f"{record.campaign}: {record.message}" for record in failed)
    blocks: list[Block] = [Listing(items, "warning")] if items else []
    if any(record.traceback for record in failed):
        text = "Please report internal errors, with the column traceback of campaigns.parquet."
        blocks.append(Paragraph(text))
    return Section("failures", "Failures", tuple(blocks))


def _frequencies(records: Sequence[Record]) -> Section:
    """All modes with an order, as a chart and by tyre."""
    points = _points(records)
    if points.empty:
        return Section("frequencies", "Frequencies", ())
    rows = []
    for (tyre, order), group in points.groupby(["tyre", "order"]):
        ranked = sorted(zip(group.frequency_hz, group.campaign, strict=True))
        (lowest, low), (highest, high) = ranked[0], ranked[-1]
        counts = (str(tyre), str(order), str(len(group)), number(group.frequency_hz.median(), 5))
        rows.append((*counts, number(lowest, 5), low, number(highest, 5), high))
    head = ("tyre", "order", "modes", "median / Hz", "lowest / Hz", "in", "highest / Hz", "in")
    title, long = "Frequencies by tyre and order", len(rows) > 30
    table = Table(title, head, tuple(rows), (0, 5, 7), folded=long)
    return Section("frequencies", "Frequencies", (frequencies_chart(records), table))


def _campaigns(
    records: Sequence[Record], campaigns: Sequence[CampaignFolder], folder: BatchFolder
) -> Section:
    head = ("campaign", "tyre", "pressure / Pa", "status", "modes", "warnings", "time / s")
    rows = tuple(
        (
            _linked(record, campaign, folder),
            record.designation,
            plain(record.inflation_pressure_pa),
            record.status,
            str(len(record.modes)),
            str(record.n_warnings),
            f"{record.seconds:.1f}",
        )
        for record, campaign in zip(records, campaigns, strict=True)
    )
    return Section("campaigns", "Campaigns", (Table("All campaigns", head, rows, (0, 1, 3)),))


def _linked(record: Record, campaign: CampaignFolder, folder: BatchFolder) -> Link | str:
    """Name of a campaign, as a link to its report or else to its result folder."""
    result = folder.result(campaign.place)
    if not record.is_done:
        return record.campaign
    report = result / "report.html"
    target = report if report.is_file() else result
    return Link(record.campaign, quote(target.relative_to(folder.path).as_posix()))


def _points(records: Sequence[Record]) -> pd.DataFrame:
    """Modes with an order by tyre; `place` is the order, moved aside to show tyres side by side."""
    rows = [
        (record.designation or "no tyre named", record.campaign, mode[_ORDER], mode[_FREQUENCY])
        for record in records
        for mode in record.modes
        if mode[_ORDER] is not None
    ]
    points = pd.DataFrame(rows, columns=["tyre", "campaign", "order", "frequency_hz"])
    points = points.sort_values("tyre", kind="stable", ignore_index=True)
    tyres = points.tyre.unique()
    rank = points.tyre.map({tyre: place for place, tyre in enumerate(tyres)})
    points["place"] = points.order + _ROOM * ((rank + 0.5) / max(len(tyres), 1) - 0.5)
    return points


def frequencies_chart(records: Sequence[Record]) -> Chart:
    """Frequency over order, one point a mode, tyres side by side in their colours."""
    points = _points(records)
    tyres = [(str(tyre), group) for tyre, group in points.groupby("tyre")]
    curves = tuple(_curve(*each, index, len(tyres)) for index, each in enumerate(tyres))
    across = Axis(ORDER, ticks=range(int(points.order.min()), int(points.order.max()) + 1))
    panel = Panel(curves, across, Axis(FREQUENCY), legend="beside")
    return Chart(
        "frequencies",
        Plot((panel,), (17.0, 9.0), margins=Margins(right=4.2)),
        f"Frequencies of {len(points)} modes over circumferential order, of {len(tyres)} tyres.",
        "Frequency of every mode over its order, tyres side by side. Check campaigns away from the "
        "cloud of their tyre: other pressure, other mounting, or confused modes.",
        wide=True,
        height_px=460,
    )


def _curve(tyre: str, points: pd.DataFrame, index: int, n_tyres: int) -> Curve:
    """Points of a tyre; if there are more tyres than colours, the last ones share one."""
    last = len(SERIES) - 1
    shares = n_tyres > len(SERIES) and index >= last
    tyre = short(tyre, 18)
    return Curve(
        points.place.to_numpy(),
        points.frequency_hz.to_numpy(),
        SERIES[min(index, last)],
        "others" if shares else tyre,
        marker=SYMBOLS[min(index, last)],
        opacity=0.6,
        hover="%{text}<br>n = %{customdata}<br>%{y:.2f} Hz",
        texts=[f"{short(name, 60)}, {tyre}" for name in points.campaign],
        values=points.order.to_numpy(),
        listed=not shares or index == last,
        group="others" if shares else f"{index}",
    )


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
