"""The figure of a batch: frequencies of all campaigns over the order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from pipelines.batch_record import Record
from pipelines.figures_labels import literal, short
from pipelines.figures_style import SERIES, series_style
from pipelines.tables import MODES

_FREQUENCY, _ORDER = MODES.index("frequency_hz"), MODES.index("order")
_ROOM = 0.6  # share of the distance between two orders that the points of all tyres take


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
    tyres = sorted({tyre_of(record) for record in records if record.is_done})
    for index, tyre in enumerate(tyres):
        points = np.array(
            [
                (mode[_ORDER], mode[_FREQUENCY])
                for record in records
                if tyre_of(record) == tyre
                for mode in record.modes
                if mode[_ORDER] is not None
            ]
        ).reshape(-1, 2)
        offset = _ROOM * ((index + 0.5) / len(tyres) - 0.5)
        named = index < len(SERIES) - 1 or len(tyres) == len(SERIES)
        style = series_style(min(index, len(SERIES) - 1))
        label = literal(short(tyre, 18)) if named else "others"
        ax.plot(
            points[:, 0] + offset,
            points[:, 1],
            linestyle="",
            alpha=0.5,
            markeredgewidth=0,
            label=label if named or index == len(SERIES) - 1 else None,
            **style,
        )
    ax.set_xlabel("order")
    ax.set_ylabel("frequency / Hz")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return ax


def tyre_of(record: Record) -> str:
    """Designation of a campaign's tyre as labels show it."""
    return record.designation or "no tyre named"
