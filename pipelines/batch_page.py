"""The summary page of a batch: what came out, what failed and why, all frequencies at a glance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from statistics import median
from urllib.parse import quote

from pipelines.batch_campaigns import CampaignFolder
from pipelines.batch_folder import BatchFolder
from pipelines.batch_record import Record
from pipelines.charts_batch import frequencies_chart, tyre_of
from pipelines.numbers import number, plain
from pipelines.report import render_page
from pipelines.report.blocks import Block, Facts, Link, Listing, Paragraph, Section, Table
from pipelines.tables import MODES
from pipelines.whole_file import file_written_whole

_FREQUENCY, _ORDER = MODES.index("frequency_hz"), MODES.index("order")


def write_summary(
    records: Sequence[Record], campaigns: Sequence[CampaignFolder], folder: BatchFolder
) -> None:
    """Write ``summary.html``, one file that needs no network.

    Parameters
    ----------
    records : sequence of Record
    campaigns : sequence of CampaignFolder
        In the same order.
    folder : BatchFolder

    Raises
    ------
    InputError
        If it cannot be written; the earlier one stands then.
    """
    sections = (
        _overview(records),
        _failures(records),
        _frequencies(records),
        _campaigns(records, campaigns, folder),
    )
    page = render_page(
        "Batch of campaigns", folder.path.name, tuple(each for each in sections if each.blocks)
    )
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
    faults = [record for record in failed if record.traceback]
    blocks: list[Block] = [Listing(items, "warning")] if items else []
    if faults:
        blocks.append(
            Paragraph(
                "Faults of the program are to be reported; column traceback of campaigns.parquet "
                "says where they happened."
            )
        )
    return Section("failures", "Failures", tuple(blocks))


def _frequencies(records: Sequence[Record]) -> Section:
    """All modes with an order, as a chart and tyre by tyre."""
    found: dict[tuple[str, int], list[tuple[float, str]]] = defaultdict(list)
    for record in records:
        for mode in record.modes:
            if mode[_ORDER] is not None:
                value = (mode[_FREQUENCY], record.campaign)
                found[tyre_of(record), mode[_ORDER]].append(value)
    if not found:
        return Section("frequencies", "Frequencies", ())
    rows = tuple(_order_row(tyre, order, found[tyre, order]) for tyre, order in sorted(found))
    head = ("tyre", "order", "modes", "median / Hz", "lowest / Hz", "in", "highest / Hz", "in")
    table = Table("Frequencies by tyre and order", head, rows, (0, 5, 7), folded=len(rows) > 30)
    return Section("frequencies", "Frequencies", (frequencies_chart(records), table))


def _order_row(tyre: str, order: int, values: list[tuple[float, str]]) -> tuple[str, ...]:
    (lowest, low), (highest, high) = min(values), max(values)
    middle = median(frequency_hz for frequency_hz, _ in values)
    cells = (number(middle, 5), number(lowest, 5), low, number(highest, 5), high)
    return (tyre, str(order), str(len(values)), *cells)


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
