"""The summary page of a batch: what came out, what failed and why, all frequencies at a glance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipelines.batch.campaigns import CampaignFolder
from pipelines.batch.state import BatchFolder, Record
from pipelines.plots.chart import FREQUENCY, SERIES, Chart, as_text, axis, packed, printed
from pipelines.plots.style import SERIES as STYLE_SERIES
from pipelines.plots.style import series_style
from pipelines.report.blocks import Block, Facts, Link, Listing, Paragraph, Section, Table
from pipelines.report.write import render_page
from pipelines.results.labels import literal, short
from pipelines.results.tables import MODES
from pipelines.storage.atomic import file_written_whole
from pipelines.storage.rounding import number, plain

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
                "Please report internal errors; column traceback of campaigns.parquet says "
                "where they happened."
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


_ROOM = 0.6  # share of the distance between two orders that the points of all tyres take


@dataclass(frozen=True, eq=False)
class TyrePoints:
    """The modes with an order of all campaigns of one tyre.

    Parameters
    ----------
    tyre : str
        Designation.
    order : ndarray of int, shape (n_modes,)
    place : ndarray, shape (n_modes,)
        The order, moved aside so that tyres stand side by side.
    frequency_hz : ndarray, shape (n_modes,)
    campaigns : tuple of str
        Where each mode is from.
    """

    tyre: str
    order: NDArray[np.int_]
    place: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    campaigns: tuple[str, ...]


def points_by_tyre(records: Sequence[Record]) -> list[TyrePoints]:
    """Modes with an order, tyre by tyre in alphabetical order."""
    tyres = sorted({tyre_of(record) for record in records if record.is_done})
    return [_points(records, tyre, (k + 0.5) / len(tyres) - 0.5) for k, tyre in enumerate(tyres)]


def tyre_of(record: Record) -> str:
    """Designation of a campaign's tyre as labels show it."""
    return record.designation or "no tyre named"


def frequencies_chart(records: Sequence[Record]) -> Chart:
    """Frequency over order, one point a mode, tyres side by side in their colours.

    Parameters
    ----------
    records : sequence of Record
        With at least one mode that has an order.
    """
    shown = points_by_tyre(records)
    count = sum(points.order.size for points in shown)
    return Chart(
        "frequencies",
        tuple(_trace(points, index, len(shown)) for index, points in enumerate(shown)),
        {
            "xaxis": axis("order n", dtick=1, zeroline=False),
            "yaxis": axis(FREQUENCY),
            "hovermode": "closest",
        },
        f"Frequencies of {count} modes over their circumferential order, of {len(shown)} tyres.",
        "Frequency of every mode over its order, tyres side by side. A campaign that leaves the "
        "cloud of its tyre deserves a look: other pressure, other mounting, or a mode taken for "
        "another.",
        printed(_draw, records, size_cm=(17.0, 9.0), right=4.2),
        wide=True,
        height_px=460,
    )


def _points(records: Sequence[Record], tyre: str, offset: float) -> TyrePoints:
    found = [
        (mode[_ORDER], mode[_FREQUENCY], record.campaign)
        for record in records
        if tyre_of(record) == tyre
        for mode in record.modes
        if mode[_ORDER] is not None
    ]
    order = np.array([number for number, _, _ in found], dtype=int)
    return TyrePoints(
        tyre,
        order,
        order + _ROOM * offset,
        np.array([frequency_hz for _, frequency_hz, _ in found], dtype=float),
        tuple(campaign for _, _, campaign in found),
    )


def _trace(points: TyrePoints, index: int, n_tyres: int) -> dict[str, Any]:
    """Points of a tyre; where there are more tyres than colours, the last ones share one."""
    last = len(SERIES) - 1
    shares = n_tyres > len(SERIES) and index >= last
    tyre = as_text(short(points.tyre, 18))
    return {
        "type": "scatter",
        "mode": "markers",
        "name": "others" if shares else tyre,
        "legendgroup": "others" if shares else f"{index}",
        "showlegend": not shares or index == last,
        "x": packed(points.place),
        "y": packed(points.frequency_hz),
        "customdata": points.order.tolist(),
        "text": [as_text(short(name, 60)) for name in points.campaigns],
        "marker": {"color": SERIES[min(index, last)], "size": 7, "opacity": 0.6},
        "hovertemplate": "%{text}, %{meta}<br>n = %{customdata}<br>%{y:.2f} Hz<extra></extra>",
        "meta": tyre,
    }


def _draw(_figures: Any, records: Sequence[Record], ax: Any) -> None:
    plot_frequencies(records, ax)


def plot_frequencies(records: Sequence[Record], ax: Axes) -> Axes:
    """Frequency over order, one point a mode, tyres side by side in their colours.

    Parameters
    ----------
    records : sequence of Record
    ax : matplotlib.axes.Axes

    Returns
    -------
    Axes
    """
    shown = points_by_tyre(records)
    for index, points in enumerate(shown):
        named = index < len(STYLE_SERIES) - 1 or len(shown) == len(STYLE_SERIES)
        style = series_style(min(index, len(STYLE_SERIES) - 1))
        label = literal(short(points.tyre, 18)) if named else "others"
        ax.plot(
            points.place,
            points.frequency_hz,
            linestyle="",
            alpha=0.5,
            markeredgewidth=0,
            label=label if named or index == len(STYLE_SERIES) - 1 else None,
            **style,
        )
    ax.set_xlabel("order")
    ax.set_ylabel("frequency / Hz")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return ax
