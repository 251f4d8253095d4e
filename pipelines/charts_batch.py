"""The frequencies of a whole batch as a chart: each point says which campaign it is from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.batch_record import Record
from pipelines.charts_basis import FREQUENCY, as_text, axis, printed
from pipelines.figures_labels import short
from pipelines.report.chart import SERIES, Chart, packed
from pipelines.tables import MODES

_FREQUENCY, _ORDER = MODES.index("frequency_hz"), MODES.index("order")
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
    from pipelines.batch_figure import plot_frequencies

    plot_frequencies(records, ax)
